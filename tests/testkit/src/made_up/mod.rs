//! A chip that nobody makes, as the guide's chapter "A new board" has it written: [`Driver`] is the [`Wire`], [`MadeUp`] the
//! [`Chip`]. A piece of software stands for the silicon.
//!
//! One USART, one timer of 32 bits that counts at [`CLOCK_HZ`], a compare register, a DE pin, and a flag that falling edges of RXD set.

mod desk;
mod silicon;

use std::cell::{Cell, RefCell};
use std::ptr::NonNull;
use std::rc::Rc;
use std::task::Waker;

use multidrop_protocol::Adu;
use multidrop_protocol::format::Framing;
use multidrop_protocol::frame::{ReceiveErrors, Received};
use multidrop_protocol::line::{
    Ascii, Chip, Interval, LineConfig, LineError, LineMachine, Observer, Role, Waiting, Wire,
};
use multidrop_protocol::port_registers::Flow;
use multidrop_protocol::rtu::Reception;
use multidrop_protocol::timing::{Intervals, Sight};

pub use desk::OnDesk;
use silicon::{Awaited, Hardware};

/// What USART and timer count with.
pub const CLOCK_HZ: u32 = 8_000_000;

// ANCHOR: settings
/// What a configuration makes of the chip.
#[derive(Clone, Copy, Debug)]
pub struct Settings {
    framing: Framing,
    data_bits: u8,
    intervals: Intervals,
    /// Ticks of a character without rounding up, as the divider makes them.
    character: u32,
    lead: u32,
    response: u32,
}

/// The receive interrupt comes in the middle of the stop bit, of the first where there are two.
fn sight(config: &LineConfig) -> Sight {
    Sight {
        tick_hz: CLOCK_HZ,
        rest: 8 + 16 * (u32::from(config.format.stop_bits()) - 1),
        latency: 0,
        client_part: 2,
    }
}

impl Settings {
    fn new(config: &LineConfig) -> Result<Self, LineError> {
        if matches!(config.framing, Framing::Text) {
            return Err(LineError::Framing(config.framing));
        }
        if matches!(config.framing, Framing::Rtu) && config.format.data_bits() != 8 {
            return Err(LineError::Format(config.format));
        }
        if config.flow == Flow::RtsCts {
            return Err(LineError::Flow);
        }
        let divider = (CLOCK_HZ / config.baud.max(1)).max(16);
        let made = CLOCK_HZ / divider;
        if made.abs_diff(config.baud) > config.baud / 40 {
            return Err(LineError::Baud { nearest: made });
        }
        let response_ms = match config.role {
            Role::Server => config.response_delay_ms,
            Role::Client => 0,
        };
        Ok(Settings {
            framing: config.framing,
            data_bits: config.format.data_bits(),
            intervals: Intervals::new(config, &sight(config)),
            character: divider * u32::from(config.format.character_bits()),
            lead: u32::from(config.de_lead_us) * (CLOCK_HZ / 1_000_000),
            response: u32::from(response_ms) * (CLOCK_HZ / 1_000),
        })
    }
}
// ANCHOR_END: settings

// ANCHOR: driver
/// The chip as it is set up, with the wakers of its tasks.
pub struct Driver {
    hardware: Hardware,
    adu: NonNull<Adu>,
    framing: Framing,
    intervals: Intervals,
    lead: u32,
    response: u32,
    reception: Reception,
    ascii: Ascii,
    /// What the alarm was last set to.
    alarm_at: u32,
    /// Ticks that are left of a delay.
    delay_left: u32,
    receiver: Option<Waker>,
    user: Option<Waker>,
}
// ANCHOR_END: driver

// ANCHOR: interrupts
/// Machine and driver, which the interrupts and the tasks share.
struct State {
    machine: LineMachine,
    driver: Driver,
}

impl State {
    /// The USART's interrupt.
    fn on_usart(&mut self) {
        let (machine, driver) = (&mut self.machine, &mut self.driver);
        match driver.hardware.interrupt {
            Awaited::Received => {
                let errors = driver.errors();
                driver.set_alarm(driver.hardware.now, driver.intervals.to_complete);
                driver.clear_start_bit();
                if driver.framing == Framing::Ascii {
                    let character = driver.take();
                    machine.on_ascii_character(driver, character, errors);
                } else if let Some(byte) = machine.on_character(driver, errors, false) {
                    // A character that was not taken interrupts again.
                    driver.push(byte);
                }
            }
            Awaited::Ready => machine.on_ready(driver),
            Awaited::Sent => machine.on_sent(driver),
        }
    }

    /// The timer's interrupt.
    fn on_timer(&mut self) {
        self.driver.hardware.compare_matched = false;
        self.machine.on_alarm(&mut self.driver);
    }
}
// ANCHOR_END: interrupts

impl Driver {
    fn errors(&self) -> ReceiveErrors {
        match self.hardware.received {
            Some((_, errors)) => errors,
            None => ReceiveErrors::NONE,
        }
    }

    // ANCHOR: alarm
    /// The alarm goes off so many ticks behind `from`; at once, if that moment has passed.
    fn set_alarm(&mut self, from: u32, ticks: u32) {
        self.alarm_at = from.wrapping_add(ticks);
        self.hardware.set_compare(self.alarm_at);
    }
    // ANCHOR_END: alarm

    // ANCHOR: push
    /// The next byte of an RTU frame.
    fn push(&mut self, byte: u8) {
        // SAFETY: the machine has a byte stored only while the buffer is the line's.
        self.reception.push(unsafe { self.adu.as_mut() }, byte);
    }
    // ANCHOR_END: push
}

// ANCHOR: wire
impl Wire for Driver {
    const IS_BOUNDED: bool = true;
    const HAS_DELAYS: bool = true;

    fn ascii(&mut self) -> Option<&mut Ascii> {
        (self.framing == Framing::Ascii).then_some(&mut self.ascii)
    }

    fn take(&mut self) -> u8 {
        self.hardware.read()
    }

    fn store(&mut self, at: u8, byte: u8) {
        // SAFETY: as in `push`.
        let adu = unsafe { self.adu.as_mut() };
        adu[usize::from(at)] = byte;
    }

    fn start_bit_seen(&mut self) -> bool {
        self.hardware.start_bit
    }

    fn clear_start_bit(&mut self) {
        self.hardware.start_bit = false;
    }

    fn alarm(&mut self, interval: Interval) -> bool {
        let intervals = &self.intervals;
        let mut from = self.alarm_at;
        let ticks = match interval {
            Interval::ToStand => intervals.to_stand(),
            Interval::ToStandLessCharacter => {
                intervals.to_stand().saturating_sub(intervals.character)
            }
            Interval::ToStart => intervals.to_start,
            Interval::Character => intervals.character,
            Interval::T3_5Then => intervals.t3_5,
            Interval::T3_5 => {
                from = self.hardware.now;
                intervals.t3_5
            }
            Interval::Fortieth => intervals.to_complete,
        };
        if ticks > 0 {
            self.set_alarm(from, ticks);
        }
        ticks > 0
    }

    fn alarm_on(&mut self) {
        self.hardware.compare_interrupt = true;
    }

    fn alarm_off(&mut self) {
        self.hardware.compare_interrupt = false;
    }

    fn restart(&mut self) {
        self.reception.restart();
    }

    fn finish(&mut self) -> Received {
        self.reception.finish()
    }

    fn adu(&self) -> &Adu {
        // SAFETY: read while an answer is sent; those bytes are not changed then.
        unsafe { self.adu.as_ref() }
    }

    fn talk(&mut self, first: u8) {
        self.hardware.receiver_on = false;
        self.hardware.set_de(true);
        self.hardware.write(first);
        self.hardware.interrupt = Awaited::Ready;
    }

    fn bound(&mut self, len: u8) {
        let characters = u32::from(self.framing.characters(len)) + 1;
        self.set_alarm(self.hardware.now, characters * self.intervals.character);
        self.alarm_on();
    }

    fn is_bound_over(&mut self) -> bool {
        true
    }

    fn begin_delay(&mut self) {
        self.delay_left = self.response;
    }

    fn end_delay(&mut self) {
        self.delay_left = 0;
    }

    fn is_delay_over(&mut self) -> bool {
        let left = std::mem::take(&mut self.delay_left);
        if left > 0 {
            self.set_alarm(self.alarm_at, left);
        }
        left == 0
    }

    fn lead(&mut self) -> bool {
        if self.lead == 0 {
            return false;
        }
        self.hardware.receiver_on = false;
        self.hardware.set_de(true);
        self.set_alarm(self.hardware.now, self.lead);
        self.alarm_on();
        true
    }

    fn is_ready(&mut self) -> bool {
        self.hardware.waiting.is_none()
    }

    fn put(&mut self, byte: u8, last: bool) {
        self.hardware.write(byte);
        if last {
            self.end();
        }
    }

    fn end(&mut self) {
        self.hardware.interrupt = Awaited::Sent;
    }

    fn listen(&mut self) {
        self.hardware.set_de(false);
        self.hardware.interrupt = Awaited::Received;
        // What was heard of the line itself is nobody's.
        self.hardware.received = None;
        self.clear_start_bit();
        self.hardware.receiver_on = true;
    }

    fn cut(&mut self) {
        self.hardware.ends = None;
        self.hardware.waiting = None;
        self.listen();
    }

    fn wake_receiver(&mut self) {
        if let Some(waker) = self.receiver.take() {
            waker.wake();
        }
    }

    fn wake_user(&mut self) {
        if let Some(waker) = self.user.take() {
            waker.wake();
        }
    }
}
// ANCHOR_END: wire

/// The chip's side of its line.
pub struct MadeUp {
    state: Rc<RefCell<State>>,
    adu: NonNull<Adu>,
    observer: Cell<Option<&'static dyn Observer>>,
}

// ANCHOR: chip
impl Chip for MadeUp {
    type Wire = Driver;
    type Settings = Settings;

    const HAS_NEIGHBOURS: bool = true;

    fn with<R>(&self, f: impl FnOnce(&mut LineMachine, &mut Driver) -> R) -> R {
        // On a real chip: with interrupts off.
        let State { machine, driver } = &mut *self.state.borrow_mut();
        f(machine, driver)
    }

    fn with_waker<R>(
        &self,
        waiting: Waiting,
        waker: &Waker,
        f: impl FnOnce(&mut LineMachine, &mut Driver) -> R,
    ) -> R {
        self.with(|machine, driver| {
            match waiting {
                Waiting::ForFrame => driver.receiver = Some(waker.clone()),
                Waiting::WithFrame => driver.user = Some(waker.clone()),
            }
            f(machine, driver)
        })
    }

    fn buffer(&self) -> NonNull<Adu> {
        self.adu
    }

    fn settings(&self, config: &LineConfig) -> Result<Settings, LineError> {
        Settings::new(config)
    }

    fn set_up(&self, driver: &mut Driver, settings: &Settings) {
        driver.framing = settings.framing;
        driver.intervals = settings.intervals;
        driver.lead = settings.lead;
        driver.response = settings.response;
        driver.ascii.set_data_bits(settings.data_bits);
        driver.hardware.character = settings.character;
        driver.listen();
    }

    fn set_delimiter(&self, delimiter: u8) {
        self.with(|_, driver| driver.ascii.set_delimiter(delimiter));
    }

    fn observer(&self) -> Option<&Cell<Option<&'static dyn Observer>>> {
        Some(&self.observer)
    }
}
// ANCHOR_END: chip
