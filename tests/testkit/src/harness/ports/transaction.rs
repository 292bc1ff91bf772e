//! Transactions that START begins: what is asked, what is answered, and what becomes of it.

use super::{Asked, Judge, Script, Written};
use multidrop_protocol::client;
use multidrop_protocol::client::RequestError;
use multidrop_protocol::port_registers::{PortRegisters, Register, Status, TransactionStep};
use multidrop_protocol::registers::{Items, Rules};
use std::cell::Cell;

impl<R: Items<Item = u16>, C: Items<Item = bool>, V: Rules> Judge<R, C, V> {
    /// Makes it likely that there is something to start.
    fn prepare(&mut self, script: &mut Script<'_>) {
        let how = script.byte();
        if how % 8 == 7 {
            return;
        }
        self.try_load(Register::Mode, 0);
        let function = [1, 2, 3, 4, 5, 6, 15, 16, 23][usize::from(how >> 3) % 9];
        self.try_load(Register::Func, function);
        self.try_load(Register::SlaveId, (script.byte() % 16).into());
        let (offset, count) = (script.byte(), script.byte());
        let most = match function {
            5 | 6 => 1,
            _ => 1 + u32::from(count % 12),
        };
        if self.for_coils() {
            self.try_load(Register::CoilOff, (offset % 12).into());
            self.try_load(Register::CoilCnt, most);
        } else {
            self.try_load(Register::RegOff, (offset % 10).into());
            self.try_load(Register::RegCnt, most);
        }
    }

    /// Starts, and carries out what was started: right answers and wrong ones.
    pub(super) fn transact(&mut self, script: &mut Script<'_>) {
        self.prepare(script);
        let described = self.describes();
        self.try_load(Register::Start, 1);
        if !described {
            return;
        }
        let asked = self.asked();
        let mut transaction = self.port.transaction();
        assert_eq!(transaction.goes_on(), self.shape.scan && !self.for_coils());
        for expected in asked {
            let step = self
                .port
                .next_step(&mut transaction)
                .unwrap_or_else(|| panic!("no step for {expected:?}"));
            assert_eq!((step.unit, step.first), (expected.unit, expected.first));
            assert_eq!(usize::from(step.count), expected.items.len());
            self.exchange(&step, &expected, script);
            // Not touched by loads while it is under way.
            self.load(script);
            if !described {
                return;
            }
        }
        assert_eq!(self.port.next_step(&mut transaction), None);
        self.end(script);
    }

    /// Ends it as a client would, and again, which is nothing.
    pub(super) fn end(&mut self, script: &mut Script<'_>) {
        let status = [
            Status::Idle,
            Status::WrongFunction,
            Status::WrongSlave,
            Status::WrongCrc,
            Status::Timeout,
            Status::InvalidRequest,
        ][usize::from(script.byte() % 6)];
        let error = script.byte() % 8;
        self.port.proceed(Status::Receiving);
        self.set("STATUS", 2);
        self.compare_all();
        self.port.finish(status, error);
        self.port.finish(Status::Idle, 0);
        self.port.proceed(Status::Transmitting);
        let counter = match (status, error) {
            (Status::Idle, 0) => "DATAOK",
            _ => "DATAERR",
        };
        self.set("START", 0);
        self.set("STATUS", status as u32);
        self.set("ERROR", error.into());
        self.set(counter, (self.get(counter) + 1) % 65_536);
        self.compare_all();
    }

    /// One request and one answer.
    fn exchange(&mut self, step: &TransactionStep, asked: &Asked, script: &mut Script<'_>) {
        let request = Written {
            port: &self.port,
            step,
            value: Cell::new(0),
        };
        let mut adu = [0xEE; 256];
        let encoded = client::encode(&request, asked.unit, &mut adu);
        let value = request.value.get();
        let reads = [1, 2, 3, 4, 23].contains(&asked.function);
        if asked.unit == 0 && reads {
            assert_eq!(
                encoded,
                Err(RequestError::Broadcast {
                    function: asked.function
                })
            );
            return;
        }
        let encoded = encoded.unwrap_or_else(|error| panic!("{asked:?}: {error}"));
        let wire = self.wire(asked);
        assert_eq!(adu[..encoded.len.into()], wire, "{asked:?}");
        if !encoded.answered {
            return;
        }

        let mut answer = wire[..2].to_vec();
        let data: Vec<u8> = match asked.function {
            1 | 2 => (0..asked.items.len().div_ceil(8))
                .map(|_| script.byte())
                .collect(),
            _ => (0..2 * asked.items.len()).map(|_| script.byte()).collect(),
        };
        if reads {
            answer.push(data.len() as u8);
            answer.extend(&data);
        } else {
            answer.extend(&wire[2..6]);
        }
        let right = answer.clone();
        match script.byte() % 8 {
            0 => answer.truncate(2 + usize::from(script.byte()) % answer.len()),
            1 => answer.push(script.byte()),
            2 if answer.len() > 2 => {
                let at = 2 + usize::from(script.byte()) % (answer.len() - 2);
                answer[at] ^= 1 << (script.byte() % 8);
            }
            _ => {}
        }
        // What was read may be anything; all else has to be as it is.
        let holds = match reads {
            true => answer.len() == right.len() && answer[..3] == right[..3],
            false => answer == right,
        };
        let checked = PortRegisters::<R, C, V>::check(step, value, &answer);
        assert_eq!(checked.is_ok(), holds, "{asked:?} {answer:02x?}");
        if !holds {
            return;
        }
        self.port.store(step, &answer);
        let data = &answer[3..];
        for (place, item) in asked.items.iter().enumerate() {
            match asked.function {
                1 | 2 => self.coils[*item] = data[place / 8] / 2u8.pow(place as u32 % 8) % 2 == 1,
                3 | 4 | 23 => {
                    self.regs[*item] =
                        u16::from(data[2 * place]) * 256 + u16::from(data[2 * place + 1]);
                }
                _ => {}
            }
        }
        self.compare_all();
    }

    /// The request as it has to be on the wire, without CRC.
    fn wire(&self, asked: &Asked) -> Vec<u8> {
        let word = |value: usize| [(value / 256) as u8, (value % 256) as u8];
        let first = word(asked.first.into());
        let count = word(asked.items.len());
        let values = || {
            asked
                .items
                .iter()
                .flat_map(|item| word(self.regs[*item].into()))
        };
        let mut wire = vec![asked.unit, asked.function];
        wire.extend(first);
        match asked.function {
            5 => wire.extend([if self.coils[asked.items[0]] { 255 } else { 0 }, 0]),
            6 => wire.extend(values()),
            15 => {
                wire.extend(count);
                let bytes = asked.items.chunks(8).map(|eight| {
                    let on = eight
                        .iter()
                        .enumerate()
                        .filter(|(_, item)| self.coils[**item]);
                    on.map(|(bit, _)| 2u8.pow(bit as u32)).sum::<u8>()
                });
                wire.push(asked.items.len().div_ceil(8) as u8);
                wire.extend(bytes);
            }
            function => {
                wire.extend(count);
                if function == 23 {
                    wire.extend(first);
                    wire.extend(count);
                }
                if function == 16 || function == 23 {
                    wire.push((asked.items.len() * 2) as u8);
                    wire.extend(values());
                }
            }
        }
        wire
    }
}
