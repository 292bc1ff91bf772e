//! A line with a driver that only records its calls.
#![allow(dead_code, reason = "each test binary uses a part")]

use multidrop_protocol::Adu;
use multidrop_protocol::frame::{ReceiveErrors, Received};
use multidrop_protocol::line::{Ascii, Interval, LineMachine, Wire};
use multidrop_protocol::rtu::Reception;

/// What the machine has had a driver do.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Did {
    Alarm(Interval),
    On,
    Off,
    Talk(u8),
    Bound(u8),
    Put(u8, bool),
    End,
    Listen,
    Cut,
    BeginDelay,
    EndDelay,
    Lead,
    Receiver,
    User,
}

/// A driver that does nothing but note what it is told.
pub struct Driver {
    pub adu: Adu,
    pub reception: Reception,
    /// What is kept of ASCII, if the line is set up for that.
    pub ascii: Option<Ascii>,
    pub incoming: u8,
    pub did: Vec<Did>,
    pub start_bit: bool,
    pub is_text: bool,
    /// How often the delay is looked at before it is over.
    pub delays: u8,
    pub leads: bool,
    pub bound_is_over: bool,
    /// Bytes that the transmitter takes at once.
    pub room: usize,
    /// The line waits at once for the moment in which a frame stands: gaps are allowed.
    pub stands_at_once: bool,
}

impl Wire for Driver {
    const IS_BOUNDED: bool = true;
    const HAS_DELAYS: bool = true;

    fn ascii(&mut self) -> Option<&mut Ascii> {
        self.ascii.as_mut()
    }
    fn store(&mut self, at: u8, byte: u8) {
        self.adu[usize::from(at)] = byte;
    }
    fn is_text(&self) -> bool {
        self.is_text
    }
    fn take(&mut self) -> u8 {
        self.incoming
    }
    fn start_bit_seen(&mut self) -> bool {
        self.start_bit
    }
    fn clear_start_bit(&mut self) {
        self.start_bit = false;
    }
    fn alarm(&mut self, interval: Interval) -> bool {
        self.did.push(Did::Alarm(interval));
        !(self.stands_at_once && interval == Interval::ToStand)
    }
    fn alarm_on(&mut self) {
        self.did.push(Did::On);
    }
    fn alarm_off(&mut self) {
        self.did.push(Did::Off);
    }
    fn restart(&mut self) {
        self.reception = Reception::new();
    }
    fn finish(&mut self) -> Received {
        self.reception.finish()
    }
    fn adu(&self) -> &Adu {
        &self.adu
    }
    fn talk(&mut self, first: u8) {
        self.did.push(Did::Talk(first));
    }
    fn bound(&mut self, len: u8) {
        self.did.push(Did::Bound(len));
    }
    fn is_bound_over(&mut self) -> bool {
        self.bound_is_over
    }
    fn begin_delay(&mut self) {
        self.did.push(Did::BeginDelay);
    }
    fn end_delay(&mut self) {
        self.did.push(Did::EndDelay);
        self.delays = 0;
    }
    fn is_delay_over(&mut self) -> bool {
        let is_over = self.delays == 0;
        self.delays = self.delays.saturating_sub(1);
        is_over
    }
    fn lead(&mut self) -> bool {
        if self.leads {
            self.did.push(Did::Lead);
        }
        self.leads
    }
    fn is_ready(&mut self) -> bool {
        self.room > 0
    }
    fn put(&mut self, byte: u8, last: bool) {
        self.room -= 1;
        self.did.push(Did::Put(byte, last));
    }
    fn end(&mut self) {
        self.did.push(Did::End);
    }
    fn listen(&mut self) {
        self.did.push(Did::Listen);
    }
    fn cut(&mut self) {
        self.did.push(Did::Cut);
    }
    fn wake_receiver(&mut self) {
        self.did.push(Did::Receiver);
    }
    fn wake_user(&mut self) {
        self.did.push(Did::User);
    }
}

pub struct Line {
    pub machine: LineMachine,
    pub driver: Driver,
}

/// As short as a request can be, with its CRC.
pub const REQUEST: [u8; 4] = [0x11, 0x07, 0x4C, 0x22];

impl Line {
    /// A line in silence.
    pub fn new() -> Line {
        Line::with(None)
    }

    /// A line that is set up for ASCII.
    pub fn ascii() -> Line {
        Line::with(Some(Ascii::new()))
    }

    fn with(ascii: Option<Ascii>) -> Line {
        let mut line = Line {
            machine: LineMachine::default(),
            driver: Driver {
                adu: [0; 256],
                reception: Reception::new(),
                ascii,
                incoming: 0,
                did: Vec::new(),
                start_bit: false,
                is_text: false,
                delays: 0,
                leads: false,
                bound_is_over: false,
                room: 0,
                stands_at_once: false,
            },
        };
        line.machine.reset(&mut line.driver);
        line.alarm();
        line.alarm();
        line.did();
        line
    }

    pub fn did(&mut self) -> Vec<Did> {
        std::mem::take(&mut self.driver.did)
    }

    pub fn alarm(&mut self) -> Vec<Did> {
        self.machine.on_alarm(&mut self.driver);
        self.did()
    }

    pub fn hear(&mut self, byte: u8, errors: ReceiveErrors) {
        self.driver.incoming = byte;
        let mut stored = self.machine.on_character(&mut self.driver, errors, false);
        while let Some(byte) = stored.take() {
            let Driver { reception, adu, .. } = &mut self.driver;
            reception.push(adu, byte);
            if byte != self.driver.incoming {
                stored = self.machine.on_character(&mut self.driver, errors, false);
            }
        }
    }

    /// A good frame comes and stands; t3.5 is near.
    pub fn hear_request(&mut self) {
        for byte in REQUEST {
            self.hear(byte, ReceiveErrors::NONE);
        }
        self.alarm();
        assert_eq!(self.machine.fetch(), Some(Ok(2)));
        self.alarm();
        assert_eq!(self.machine.verdict(), Some(true));
        self.did();
    }

    pub fn release(&mut self, len: u8) -> Vec<Did> {
        self.driver.adu[..3].copy_from_slice(&[0x11, 0x83, 0x02]);
        self.machine.release(&mut self.driver, len);
        self.did()
    }
}
