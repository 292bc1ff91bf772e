//! STATUS, ERROR and DATAERR after a scan list or a table of addresses: the first failure counts.

#[allow(dead_code, reason = "each test binary uses a part")]
mod bench;

use std::cell::RefCell;
use std::rc::Rc;

use bench::{Bench, Heard, TestLine, Wire};
use multidrop::PortConfig;
use multidrop::client::ClientError;
use multidrop::managed::{Failure, ManagedPort, Outcome, managed_receive, managed_run};
use multidrop::protocol::exception::Exception;
use multidrop::protocol::frame::ReceiveErrors;
use multidrop::protocol::port_registers::{PortRegisters, Register};
use multidrop::protocol::registers::{CoilBank, Items, NoRules, ScanList, SparseBank};

const RS4: PortConfig = PortConfig::new("RS4")
    .client()
    .slave_id(17)
    .timeout_ms(40)
    .late_guard_ms(1);
/// Long enough for any walk.
const WALK: u64 = 400;

type Port<R> = &'static ManagedPort<TestLine, PortRegisters<R, CoilBank<1>, NoRules>>;

/// What a slave does: a value, or something else that is heard, or nothing.
#[derive(Clone)]
enum Does {
    Tell(u16),
    Hear(Heard),
    Nothing,
}

/// A master of slaves that do what stands here for their unit id and address.
struct Walked<R: Items<Item = u16> + 'static> {
    wire: &'static Wire,
    port: Port<R>,
    does: Rc<RefCell<Vec<(u8, u16, Does)>>>,
}

impl<R: Items<Item = u16> + 'static> Walked<R> {
    fn open(bench: &mut Bench<'_>, regs: R) -> Self {
        let wire = Wire::new(RS4.line());
        let port = ManagedPort::new(TestLine(wire), &RS4, regs, CoilBank::new(0, 8));
        let port: Port<R> = Box::leak(Box::new(port));
        let does: Rc<RefCell<Vec<(u8, u16, Does)>>> = Rc::default();
        let slaves = does.clone();
        wire.answered_by(move |request| {
            let address = u16::from_be_bytes([request[2], request[3]]);
            let slaves = slaves.borrow();
            let does = slaves
                .iter()
                .find(|(unit, of, _)| (*unit, *of) == (request[0], address))
                .map(|(_, _, does)| does.clone());
            match does {
                Some(Does::Tell(value)) => {
                    let mut answer = vec![request[0], 3, 2 * request[5]];
                    for place in 0..u16::from(request[5]) {
                        answer.extend((value + place).to_be_bytes());
                    }
                    vec![(5, Ok(answer))]
                }
                Some(Does::Hear(heard)) => vec![(5, heard)],
                _ => vec![],
            }
        });
        bench.wire(wire);
        bench.spawn(async move { managed_receive(port).await });
        bench.spawn(async move { managed_run(port).await });
        port.load_raw(Register::Func, 3).unwrap();
        bench.poll();
        Walked { wire, port, does }
    }

    fn read(&self, register: Register) -> u32 {
        self.port.read(register).unwrap()
    }

    /// One walk over `count` items, with these slaves: how it ended, STATUS and ERROR.
    fn walk(
        &self,
        bench: &mut Bench<'_>,
        count: u32,
        does: Vec<(u8, u16, Does)>,
    ) -> (Outcome, u32, u32) {
        *self.does.borrow_mut() = does;
        self.port.load_raw(Register::RegCnt, count).unwrap();
        self.port.start().unwrap();
        // What the last one has left is gone.
        assert_eq!(
            (self.read(Register::Status), self.read(Register::Error)),
            (1, 0)
        );
        let done = bench.ask(self.port.done());
        bench.run(WALK);
        let done = done.take().expect("it is over");
        (
            done,
            self.read(Register::Status),
            self.read(Register::Error),
        )
    }

    fn counts(&self) -> [u32; 2] {
        [Register::DataOk, Register::DataErr].map(|register| self.read(register))
    }
}

fn failed(unit: u8, address: u16, cause: ClientError) -> Outcome {
    Err(Failure {
        unit,
        address,
        cause,
    })
}

fn refusal(unit: u8, code: u8) -> Does {
    Does::Hear(Ok(vec![unit, 0x83, code]))
}

#[test]
fn the_first_failure_of_a_scan_is_reported_whatever_follows() {
    let mut bench = Bench::new();
    let list = ScanList::from_rows([4, 1000, 4], [0; 3], [1, 2, 3], [0, 1, 2]);
    let walked = Walked::open(&mut bench, list);
    let cells = || [0, 1, 2].map(|place| walked.read(Register::Regs(place)));
    let all = |first, second, third| vec![(1, 4, first), (2, 1000, second), (3, 4, third)];
    let refused = ClientError::Exception(Exception::IllegalDataAddress);
    let damaged = ClientError::Damaged(ReceiveErrors::CHECK);
    let damage = || Does::Hear(Err(ReceiveErrors::CHECK));
    for (does, expected, now, counts) in [
        (
            all(Does::Tell(11), Does::Tell(12), Does::Tell(13)),
            (Ok(()), 0, 0),
            [11, 12, 13],
            [1, 0],
        ),
        // Refused, then a good one, then silence.
        (
            all(refusal(1, 2), Does::Tell(22), Does::Nothing),
            (failed(1, 4, refused), 0, 2),
            [11, 22, 13],
            [1, 1],
        ),
        // Good, damaged, good: nothing of the refusal before.
        (
            all(Does::Tell(31), damage(), Does::Tell(33)),
            (failed(2, 1000, damaged), 5, 0),
            [31, 22, 33],
            [1, 2],
        ),
        // Silence, then a refusal.
        (
            all(Does::Nothing, refusal(2, 2), Does::Tell(43)),
            (failed(1, 4, ClientError::Timeout), 6, 0),
            [31, 22, 43],
            [1, 3],
        ),
        // The last one alone.
        (
            all(Does::Tell(51), Does::Tell(52), refusal(3, 2)),
            (failed(3, 4, refused), 0, 2),
            [51, 52, 43],
            [1, 4],
        ),
        // All good: nothing of what was before.
        (
            all(Does::Tell(61), Does::Tell(62), Does::Tell(63)),
            (Ok(()), 0, 0),
            [61, 62, 63],
            [2, 4],
        ),
    ] {
        let told = walked.walk(&mut bench, 3, does);
        assert_eq!(told, expected);
        assert_eq!(cells(), now, "{told:?}");
        assert_eq!(walked.counts(), counts, "{told:?}");
        // It goes on whoever fails.
        let units: Vec<_> = walked.wire.sent().iter().map(|sent| sent[0]).collect();
        assert_eq!(units[units.len() - 3..], [1, 2, 3]);
    }
}

const TABLE: [u16; 6] = [4, 5, 6, 1000, 1001, 63_023];

#[test]
fn a_transfer_over_holes_ends_with_the_block_that_failed() {
    let blocks = [(4, 3), (1000, 2), (63_023, 1)];
    // Where each block's items stand.
    let places = [0..3, 3..5, 5..6];
    for failing in 0..3 {
        let mut bench = Bench::new();
        let walked = Walked::open(&mut bench, SparseBank::new(TABLE));
        let does = |value: u16, failing: Option<usize>| {
            let blocks = blocks.iter().enumerate();
            blocks
                .map(|(block, (first, _))| {
                    let does = match failing == Some(block) {
                        true => refusal(17, 4),
                        false => Does::Tell(value),
                    };
                    (17, *first, does)
                })
                .collect::<Vec<_>>()
        };
        let before = walked.walk(&mut bench, 6, does(100, None));
        assert_eq!(before, (Ok(()), 0, 0));
        let told = walked.walk(&mut bench, 6, does(200, Some(failing)));
        let cause = ClientError::Exception(Exception::ServerDeviceFailure);
        assert_eq!(told, (failed(17, blocks[failing].0, cause), 0, 4));
        for (block, places) in places.iter().enumerate() {
            for (place, index) in places.clone().enumerate() {
                let value = if block < failing { 200 } else { 100 };
                let cell = walked.read(Register::Regs(index as u16));
                assert_eq!(cell, value + place as u32, "{index} where {failing} fails");
            }
        }
        let asked: Vec<_> = walked.wire.sent()[3..]
            .iter()
            .map(|sent| (u16::from_be_bytes([sent[2], sent[3]]), sent[5]))
            .collect();
        assert_eq!(asked, blocks[..=failing]);
        assert_eq!(walked.counts(), [1, 1]);
        // And the next one is as if nothing had been.
        let behind = walked.walk(&mut bench, 6, does(300, None));
        assert_eq!(behind, (Ok(()), 0, 0));
        assert_eq!(walked.read(Register::Regs(5)), 300);
    }
}
