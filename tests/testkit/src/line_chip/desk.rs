//! The chip, set up, and what its tasks and its bus do.

use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::task::{Wake, Waker};

use multidrop_protocol::Adu;
use multidrop_protocol::format::LineFormat;
use multidrop_protocol::frame::ReceiveErrors;
use multidrop_protocol::line::{Chip, LineConfig, LineError, LineMachine, Waiting};
use multidrop_protocol::timing::{Intervals, Sight, character};

use super::ChipUnderTest;

/// Unit 17, function 07, with its CRC.
pub(super) const REQUEST: [u8; 4] = [0x11, 0x07, 0x4C, 0x22];
/// An answer to it: exception 02, without its CRC.
pub(super) const ANSWER: [u8; 3] = [0x11, 0x87, 0x02];

/// The settings: 38400 8N1.
pub(super) const CONFIG: LineConfig = LineConfig {
    baud: 38_400,
    format: LineFormat::F8N1,
    ..LineConfig::DEFAULT
};

/// Counts how often it was woken.
#[derive(Default)]
pub(super) struct Counter(AtomicUsize);

impl Wake for Counter {
    fn wake(self: Arc<Self>) {
        self.0.fetch_add(1, Ordering::Relaxed);
    }
}

/// The chip, set up, and what its tasks do.
pub(super) struct Desk<T: ChipUnderTest> {
    pub on: T,
    pub config: LineConfig,
    pub intervals: Intervals,
    pub sight: Sight,
    pub receiver: Arc<Counter>,
    pub user: Arc<Counter>,
}

impl<T: ChipUnderTest> Desk<T> {
    pub fn new(config: LineConfig) -> Self {
        let on = T::power_up();
        let sight = on.sight(&config);
        let mut desk = Desk {
            intervals: Intervals::new(&config, &sight),
            on,
            config,
            sight,
            receiver: Arc::default(),
            user: Arc::default(),
        };
        if let Err(error) = desk.set_up(config) {
            panic!("the suite needs these settings of every chip: {error:?} for {config:?}");
        }
        desk
    }

    /// A desk whose line was silent for t3.5.
    pub fn silent(config: LineConfig) -> Self {
        let mut desk = Self::new(config);
        desk.wait(desk.intervals.t3_5 + 2 * desk.intervals.character);
        desk.on.sent();
        desk.on.de_changes();
        desk
    }

    pub fn set_up(&mut self, config: LineConfig) -> Result<(), LineError> {
        let chip = self.on.chip();
        let settings = chip.settings(&config)?;
        chip.with(|machine, wire| {
            chip.set_up(wire, &settings);
            machine.reset(wire);
        });
        self.sight = self.on.sight(&config);
        self.intervals = Intervals::new(&config, &self.sight);
        self.config = config;
        Ok(())
    }

    pub fn machine<R>(
        &self,
        f: impl FnOnce(&mut LineMachine, &mut <T::Chip as Chip>::Wire) -> R,
    ) -> R {
        self.on.chip().with(f)
    }

    pub fn wait(&mut self, ticks: u32) {
        self.on.run_until(self.on.now().wrapping_add(ticks));
    }

    /// A frame, or what was wrong with one; the receive task waits for the next.
    pub fn fetch(&self) -> Option<Result<u8, ReceiveErrors>> {
        let waker = Waker::from(self.receiver.clone());
        let chip = self.on.chip();
        chip.with_waker(Waiting::ForFrame, &waker, |machine, _| machine.fetch())
    }

    /// The task with the frame waits for the verdict.
    pub fn verdict(&self) -> Option<bool> {
        let waker = Waker::from(self.user.clone());
        let chip = self.on.chip();
        chip.with_waker(Waiting::WithFrame, &waker, |machine, _| machine.verdict())
    }

    pub fn release(&self, bytes: &[u8]) {
        // SAFETY: the buffer was lent.
        let adu = unsafe { self.on.chip().buffer().as_mut() };
        adu[..bytes.len()].copy_from_slice(bytes);
        self.machine(|machine, wire| machine.release(wire, bytes.len() as u8));
    }

    pub fn give_back(&self) {
        self.machine(|machine, wire| machine.give_back(wire));
    }

    pub fn buffer(&self) -> Adu {
        // SAFETY: nobody writes meanwhile.
        unsafe { self.on.chip().buffer().read() }
    }

    /// Ticks of a character as it comes in, and what of it is left when its interrupt comes.
    pub fn character(&self) -> (u32, u32) {
        let Sight { tick_hz, rest, .. } = self.sight;
        let baud = self.config.baud;
        (
            character(self.config.format, baud, tick_hz),
            (rest * tick_hz).div_ceil(16 * baud),
        )
    }

    /// A character that begins now, with edges inside; it is over, and the interrupt has come, when this returns.
    pub fn hear_one(&mut self, byte: u8, errors: ReceiveErrors) {
        let (whole, rest) = self.character();
        self.on.falling_edge();
        self.wait((whole - rest) / 2);
        self.on.falling_edge();
        self.wait(whole - rest - (whole - rest) / 2);
        self.on.character(byte, errors);
    }

    /// Characters without a gap. Gives the tick at which the interrupt of the last one came.
    pub fn hear(&mut self, bytes: &[u8]) -> u32 {
        let (_, rest) = self.character();
        for (place, &byte) in bytes.iter().enumerate() {
            if place > 0 {
                self.wait(rest);
            }
            self.hear_one(byte, ReceiveErrors::NONE);
        }
        self.on.now()
    }

    /// A good request is lent and stands. Gives the tick of its t3.5.
    pub fn hear_request(&mut self) -> u32 {
        let came = self.hear(&REQUEST);
        self.wait(self.intervals.to_complete);
        assert_eq!(self.fetch(), Some(Ok(2)), "a frame at t1.5");
        self.wait(self.intervals.to_stand());
        assert_eq!(self.verdict(), Some(true), "it stands");
        came.wrapping_add(self.intervals.t3_5)
    }

    /// Ticks by which something may be late: a bit of the wire.
    pub fn slack(&self) -> u32 {
        self.sight.tick_hz / self.config.baud + self.sight.latency
    }

    /// Something is at `tick`, no earlier, and no later than a bit.
    pub fn is_at(&self, at: u32, tick: u32, what: &str) {
        let late = at.wrapping_sub(tick) as i32;
        assert!(
            (0..=self.slack() as i32).contains(&late),
            "{what} {late} ticks late, may be 0..={}",
            self.slack()
        );
    }
}

pub(super) fn count(counter: &Counter) -> usize {
    counter.0.load(Ordering::Relaxed)
}

/// CRC of Modbus, low byte first (SER 6.2.2), bit by bit.
pub(super) fn crc(bytes: &[u8]) -> [u8; 2] {
    let mut crc = 0xFFFF_u16;
    for &byte in bytes {
        crc ^= u16::from(byte);
        for _ in 0..8 {
            crc = if crc & 1 != 0 {
                crc >> 1 ^ 0xA001
            } else {
                crc >> 1
            };
        }
    }
    crc.to_le_bytes()
}
