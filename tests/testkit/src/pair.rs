//! A client and a unit whose clocks differ.

use multidrop_bus::{
    Bus, BusConfig, Emulator, HostId, HostPort, Line, Nano, Station, Stm32, Time, Tx, WireId,
};

use super::frames::{block, data, words};
use super::{Runner, registers, stm32_registers_at};

/// A client and a unit on one line.
pub struct Pair {
    /// The bus of the pair.
    pub bus: Bus,
    /// The client's host.
    pub client: HostId,
    /// What both are set to.
    pub line: Line,
    /// t3.5 by the client's clock.
    pub silence: Time,
    /// How far the unit's clock is off.
    pub unit_ppm: i32,
}

/// A span of the clock that is off by this much.
pub fn by_clock(span: Time, ppm: i32) -> Time {
    Time::from_ps(span.ps() * 1_000_000 / 1_000_000u64.strict_add_signed(ppm.into()))
}

impl Pair {
    fn new(mut bus: Bus, line: Line, client_ppm: i32, unit_ppm: i32) -> Self {
        let mut port = HostPort::new(line);
        port.clock_ppm = client_ppm;
        let client = bus.add_host(port);
        // It listens when the line has been silent for t3.5.
        bus.run_for(Time::from_ms(20) + line.t35() * 2);
        Self {
            bus,
            client,
            line,
            silence: by_clock(line.t35(), client_ppm),
            unit_ppm,
        }
    }

    /// With a Nano.
    pub fn nano(line: Line, client_ppm: i32, unit_ppm: i32) -> Self {
        let mut bus = Bus::new(BusConfig::default());
        let nano = Nano {
            clock_ppm: unit_ppm,
            ..Nano::new("unit 1", registers(16, line))
        };
        bus.add_nano(nano).expect("a valid image");
        Self::new(bus, line, client_ppm, unit_ppm)
    }

    /// With an STM32. QEMU's clock is exact, so the client's is off by as much as both are apart.
    pub fn stm32(runner: Runner, line: Line, client_ppm: i32, unit_ppm: i32) -> Self {
        let mut bus = Bus::new(BusConfig::default());
        let mut emulator = runner.emulator();
        let (client_ppm, unit_ppm) = match &mut emulator {
            Emulator::Core { clock_ppm, .. } => {
                *clock_ppm = unit_ppm;
                (client_ppm, unit_ppm)
            }
            Emulator::Qemu { .. } => {
                let apart = i64::from(client_ppm - unit_ppm) * 1_000_000;
                ((apart / i64::from(1_000_000 + unit_ppm)) as i32, 0)
            }
        };
        bus.add_stm32(Stm32 {
            name: "stm32".to_owned(),
            image: stm32_registers_at(runner, line),
            emulator,
            wires: [None, None, None, Some(WireId::default())],
        })
        .expect("a valid image");
        Self::new(bus, line, client_ppm, unit_ppm)
    }

    /// Sends frames, t3.5 after what was last on the line and t3.5 apart; the answer to the last.
    pub fn say(&mut self, frames: &[&[u8]]) -> Vec<u8> {
        let mut characters = Vec::new();
        for frame in frames {
            let before = if characters.is_empty() {
                Time::ZERO
            } else {
                self.silence
            };
            let (head, tail) = frame.split_first().expect("no frame is empty");
            characters.push(Tx::byte(*head).after(before));
            characters.extend(tail.iter().map(|&byte| Tx::byte(byte)));
        }
        self.say_each(characters)
    }

    /// Sends characters as described, t3.5 after what was last on the line; what comes then.
    pub fn say_each(&mut self, mut characters: Vec<Tx>) -> Vec<u8> {
        let last = self.bus.record().bytes().last();
        let begin = last.map_or(Time::ZERO, |byte| byte.end) + self.silence;
        let first = begin.saturating_sub(self.bus.now());
        if let Some(head) = characters.first_mut() {
            *head = head.after(head.gap() + first);
        }
        let client = self.client;
        self.bus.host(client).take();
        let end = self.bus.host(client).send_each(characters);
        self.bus.run_to(end);
        let mut patience = self.line.t35() + Time::from_ms(1);
        let mut count = self.bus.host(client).heard().len();
        loop {
            let heard = |bus: &mut Bus| bus.host(client).heard().len() > count;
            if !self.bus.run_until(heard, patience + self.line.character()) {
                break;
            }
            count += 1;
            patience = self.line.bits(1);
        }
        let heard = self.bus.host(client).take();
        heard.iter().map(|byte| byte.value).collect()
    }

    /// Rounds of frames back to back, to all, to another unit and from it, and to ours: how many had no effect, or not their
    /// answer.
    pub fn lost(&mut self, rounds: u16) -> usize {
        let mut lost = 0;
        let read = words(1, 3, 3, 1);
        for round in 0..rounds {
            let value = 0x1000 + round;
            let many = [value.to_be_bytes(); 16].concat();
            let broadcast = words(0, 6, 3, value);
            let others = [words(2, 3, 0, 2), data(2, 3, &[1, 2, 3, 4])];
            let write = block(1, 16, 0, 16, &many);
            let got = data(1, 3, &many[..2]);
            let exchanges: [(&[&[u8]], &[u8]); 4] = [
                (&[&broadcast, &read], &got),
                (&[&others[0], &others[1], &read], &got),
                (&[&others[0], &write], &words(1, 16, 0, 16)),
                (&[&read], &got),
            ];
            for (frames, expected) in exchanges {
                lost += usize::from(self.say(frames) != expected);
                self.assert_not_early();
            }
        }
        lost
    }

    /// Frames that begin before the answer to the one before: that one's write is carried out, its answer withdrawn.
    pub fn withdrawn(&mut self, rounds: u16) {
        let baud = self.line.baud;
        for round in 0..rounds {
            let bytes = (0x2000 + round).to_be_bytes();
            let (read, got) = (words(1, 3, 3, 1), data(1, 3, &bytes));
            let write = words(1, 6, 3, 0x2000 + round);
            assert_eq!(self.say(&[&write, &read]), got, "{baud} baud, a write");
            let many = block(1, 16, 0, 16, &[round as u8; 32]);
            let got = data(1, 3, &[round as u8; 2]);
            assert_eq!(self.say(&[&many, &read]), got, "{baud} baud, a long write");
            assert_eq!(self.say(&[&read, &read]), got, "{baud} baud, a read");
        }
        self.assert_not_early();
    }

    /// The unit answered no earlier than t3.5 after the character before, by its own clock, which times that from the start
    /// bit on.
    fn assert_not_early(&self) {
        let bytes = self.bus.record().bytes();
        let pairs = bytes.windows(2);
        for pair in pairs.filter(|pair| pair[0].from == Station::Host(self.client)) {
            let due = by_clock(self.line.character() + self.line.t35(), self.unit_ppm);
            if pair[1].from != pair[0].from {
                assert!(pair[1].start - pair[0].start >= due, "{:?}", pair[1]);
            }
        }
        assert_eq!(self.bus.record().conflicts(), []);
    }
}
