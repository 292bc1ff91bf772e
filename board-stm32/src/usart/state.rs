//! The state that the interrupts and the futures of a port share: the state machine of
//! [`protocol::line`](multidrop::protocol::line), and the chip as its [`Wire`].
//!
//! Only the interrupts of the line, which do not nest, and the futures with interrupts off use this state.

use core::cell::UnsafeCell;

use embassy_sync::waitqueue::WakerRegistration;
use multidrop::line::{Adu, LineBuffer};
use multidrop::protocol::format::Framing;
use multidrop::protocol::frame::{ReceiveErrors, Received};
use multidrop::protocol::line::{Ascii, Interval, LineMachine, Wire};
use multidrop::protocol::rtu::Reception;

use super::registers::{self, ERRORS, ORE, RXNE, Registers, TC, TXE};
use super::settings::Settings;
use crate::ports::PORTS;
use crate::{TICK_HZ, platform};

/// The buffers, apart from [`State`], so that they start as zeros and take no flash.
pub(super) static ADUS: [LineBuffer; PORTS] = [const { LineBuffer::new() }; PORTS];

/// The cell of the [`State`] of a port.
pub(super) struct Shared(UnsafeCell<State>);

// SAFETY: used by interrupts that do not nest, and with interrupts off.
unsafe impl Sync for Shared {}

pub(super) static SHARED: [Shared; PORTS] = [
    Shared::new(0),
    Shared::new(1),
    Shared::new(2),
    Shared::new(3),
];

impl Shared {
    const fn new(port: usize) -> Self {
        Self(UnsafeCell::new(State::new(port)))
    }

    pub fn get(&self) -> *mut State {
        self.0.get()
    }
}

pub(super) struct State {
    pub machine: LineMachine,
    pub driver: Driver,
}

/// Bytes of the longest frame without its check (SER 2.5.1).
const LONGEST: u8 = 254;

/// The event of the transmitter that the port waits for.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Awaited {
    /// No event: the port listens.
    Nothing,
    /// The transmitter takes the next character.
    Ready,
    /// The last character has been sent.
    Sent,
}

/// The USART, alarm and start-bit detector of a port as they are set up, and the wakers of its tasks.
pub struct Driver {
    port: u8,
    /// The buffer of the port in [`ADUS`].
    adu: &'static LineBuffer,
    registers: Registers,
    settings: Settings,
    reception: Reception,
    ascii: Ascii,
    awaited: Awaited,
    /// The tick to which the alarm was last set.
    alarm_at: u32,
    /// Ticks from `alarm_at` to the end of the time for which the port may send; before that, to the end of an answer's delay.
    bound_left: u32,
    /// For how many ms a frame has been lent, as the watchdog counts it.
    lent_ms: u32,
    pub(super) receiver: WakerRegistration,
    pub(super) user: WakerRegistration,
}

impl State {
    const fn new(port: usize) -> Self {
        Self {
            machine: LineMachine::new(),
            driver: Driver {
                port: port as u8,
                adu: &ADUS[port],
                registers: Registers::of(port),
                settings: Settings::NONE,
                reception: Reception::new(),
                ascii: Ascii::new(),
                awaited: Awaited::Nothing,
                alarm_at: 0,
                bound_left: 0,
                lent_ms: 0,
                receiver: WakerRegistration::new(),
                user: WakerRegistration::new(),
            },
        }
    }

    /// Returns whether a frame that is lent may still be kept: for as long as the longest frame takes and is delayed or held, for
    /// the watchdog's time, and for the ms in which it was lent. Called `ms` milliseconds after the last call.
    pub fn may_keep_frame(&mut self, ms: u32, time_ms: u32) -> bool {
        let driver = &mut self.driver;
        if !self.machine.is_lent() {
            driver.lent_ms = 0;
            return true;
        }
        driver.lent_ms = driver.lent_ms.saturating_add(ms);
        let settings = &driver.settings;
        let characters = settings.framing.characters(LONGEST);
        let mut held_ms = u32::from(settings.response_delay_ms);
        if settings.rts_cts {
            held_ms += u32::from(settings.cts_timeout_ms);
        }
        let longest_ms =
            settings.intervals.character / (crate::TICK_HZ / 1000) * u32::from(characters);
        driver.lent_ms <= longest_ms + u32::from(characters) + held_ms + time_ms + ms
    }

    // ANCHOR: usart
    /// The interrupt of the USART. It handles the most frequent event here: one more good character of an RTU frame, received or
    /// sent.
    #[inline(always)]
    pub fn on_usart(&mut self) {
        let driver = &mut self.driver;
        let status = driver.registers.status();
        if driver.settings.framing == Framing::Rtu {
            match driver.awaited {
                Awaited::Ready if status & TXE != 0 => return self.machine.on_ready(driver),
                Awaited::Nothing
                    if status & (RXNE | ERRORS) == RXNE && self.machine.is_collecting() =>
                {
                    driver.begin_silence();
                    let byte = driver.registers.take();
                    if !driver.push(byte) {
                        self.machine.on_too_long(driver);
                    }
                    return;
                }
                _ => {}
            }
        }
        self.on_event(status);
    }
    // ANCHOR_END: usart

    /// Handles every other event of the USART.
    #[inline(never)]
    fn on_event(&mut self, status: u32) {
        let driver = &mut self.driver;
        match driver.awaited {
            Awaited::Nothing if status & (RXNE | ORE) != 0 => self.on_character(status),
            Awaited::Ready if status & TXE != 0 => self.machine.on_ready(driver),
            Awaited::Sent if status & TC != 0 => self.machine.on_sent(driver),
            _ => {}
        }
    }

    #[inline(always)]
    fn on_character(&mut self, status: u32) {
        let driver = &mut self.driver;
        let mut errors = registers::errors(status);
        driver.begin_silence();
        if driver.settings.framing == Framing::Ascii {
            let word = driver.registers.take();
            if word & driver.settings.mark != driver.settings.mark {
                // The first of two stop bits was missing.
                errors |= ReceiveErrors::FRAMING;
            }
            let character = word & driver.settings.data;
            return self.machine.on_ascii_character(driver, character, errors);
        }
        // The reception notes a byte that no longer fits. A character that the machine did not take interrupts again (RM0090
        // 30.3.3).
        if let Some(byte) = self.machine.on_character(driver, errors, false) {
            driver.push(byte);
        }
    }

    /// Handles the alarm of the port.
    #[inline(always)]
    pub fn on_alarm(&mut self) {
        self.machine.on_alarm(&mut self.driver);
    }
}

impl Driver {
    /// Puts settings into the USART.
    pub(super) fn set_up(&mut self, settings: &Settings) {
        self.settings = *settings;
        self.registers.set_up(settings);
        self.ascii.set_data_bits(settings.data_bits());
    }

    pub(super) fn set_delimiter(&mut self, delimiter: u8) {
        self.ascii.set_delimiter(delimiter);
    }

    /// Begins the silence after a character.
    #[inline(always)]
    fn begin_silence(&mut self) {
        self.set_alarm(platform::now().wrapping_add(self.settings.intervals.to_complete));
        self.registers.clear_start_bit();
    }

    /// Stores the next byte of the RTU frame. Returns whether there was room for the byte.
    #[inline(always)]
    fn push(&mut self, byte: u8) -> bool {
        // SAFETY: the machine collects a frame, and has a byte stored, only while the buffer is the line's.
        let adu = unsafe { self.adu.pointer().as_mut() };
        self.reception.push(adu, byte)
    }

    #[inline(always)]
    fn set_alarm(&mut self, at: u32) {
        self.alarm_at = at;
        platform::set_alarm(self.port.into(), at);
    }

    /// Sets the alarm to the end of the bound, or [`FARTHEST`] ticks towards it.
    fn set_bound(&mut self) {
        let ticks = self.bound_left.min(FARTHEST);
        self.bound_left -= ticks;
        self.set_alarm(self.alarm_at.wrapping_add(ticks));
        self.alarm_on();
    }

    /// Limits the time of a character: with flow control the peer may hold it for CTS_TIMEOUT, after the character under way.
    #[inline(never)]
    fn await_cts(&mut self) {
        let ticks = u32::from(self.settings.cts_timeout_ms) * (crate::TICK_HZ / 1000);
        self.bound_left = ticks.saturating_add(2 * self.settings.intervals.character);
        self.alarm_at = platform::now();
        self.set_bound();
    }

    #[inline(always)]
    fn put_character(&mut self, byte: u8) {
        self.registers.put(byte | self.settings.mark);
    }

    #[inline(always)]
    fn await_sent(&mut self) {
        self.awaited = Awaited::Sent;
        self.registers.send(&self.settings, TC);
    }
}

/// The most ticks to which an alarm is set: a tick farther away counts as passed.
const FARTHEST: u32 = 1 << 30;

impl Wire for Driver {
    const IS_BOUNDED: bool = !cfg!(feature = "bare");
    const HAS_DELAYS: bool = true;

    #[inline(always)]
    fn ascii(&mut self) -> Option<&mut Ascii> {
        (self.settings.framing == Framing::Ascii).then_some(&mut self.ascii)
    }

    #[inline(always)]
    fn is_text(&self) -> bool {
        self.settings.framing == Framing::Text
    }

    #[inline(always)]
    fn take(&mut self) -> u8 {
        self.registers.take() & self.settings.data
    }

    #[inline(always)]
    fn store(&mut self, at: u8, byte: u8) {
        // SAFETY: the machine says that the buffer is not lent.
        let adu = unsafe { self.adu.pointer().as_mut() };
        adu[usize::from(at)] = byte;
    }

    #[inline(always)]
    fn start_bit_seen(&mut self) -> bool {
        self.registers.start_bit_seen()
    }

    #[inline(always)]
    fn clear_start_bit(&mut self) {
        self.registers.clear_start_bit();
    }

    fn alarm(&mut self, interval: Interval) -> bool {
        let intervals = &self.settings.intervals;
        let ticks = match interval {
            Interval::ToStand => intervals.to_stand(),
            Interval::ToStandLessCharacter => {
                intervals.to_stand().saturating_sub(intervals.character)
            }
            Interval::ToStart => intervals.to_start,
            Interval::T3_5Then => intervals.t3_5,
            Interval::Character => intervals.character,
            Interval::T3_5 => {
                self.set_alarm(platform::now().wrapping_add(intervals.t3_5));
                return true;
            }
            Interval::Fortieth => intervals.to_complete,
        };
        if ticks > 0 {
            self.set_alarm(self.alarm_at.wrapping_add(ticks));
        }
        ticks > 0
    }

    #[inline(always)]
    fn alarm_on(&mut self) {
        platform::alarm_on(self.port.into());
    }

    #[inline(always)]
    fn alarm_off(&mut self) {
        platform::alarm_off(self.port.into());
    }

    #[inline(always)]
    fn restart(&mut self) {
        self.reception.restart();
    }

    #[inline(always)]
    fn finish(&mut self) -> Received {
        self.reception.finish()
    }

    #[inline(always)]
    fn adu(&self) -> &Adu {
        // SAFETY: these bytes are read while an answer is sent, and are not changed then.
        unsafe { self.adu.pointer().as_ref() }
    }

    #[inline(always)]
    fn talk(&mut self, first: u8) {
        self.registers.raise_de();
        self.registers.send(&self.settings, 0);
        self.alarm_off();
        self.put_character(first);
        self.awaited = Awaited::Ready;
        self.registers.send(&self.settings, TXE);
    }

    fn bound(&mut self, len: u8) {
        if self.settings.rts_cts {
            return self.await_cts();
        }
        let characters = self.settings.framing.characters(len);
        self.bound_left = self.settings.intervals.character * (u32::from(characters) + 1);
        self.alarm_at = platform::now();
        self.set_bound();
    }

    fn is_bound_over(&mut self) -> bool {
        if self.bound_left == 0 {
            return true;
        }
        self.set_bound();
        false
    }

    #[inline(always)]
    fn begin_delay(&mut self) {
        self.bound_left = u32::from(self.settings.response_delay_ms) * (TICK_HZ / 1_000);
    }

    #[inline(always)]
    fn end_delay(&mut self) {
        self.bound_left = 0;
    }

    #[inline(always)]
    fn is_delay_over(&mut self) -> bool {
        if self.bound_left == 0 {
            return true;
        }
        self.set_bound();
        false
    }

    fn lead(&mut self) -> bool {
        let us = u32::from(self.settings.de_lead_us);
        if us == 0 || !self.registers.has_de() {
            return false;
        }
        self.registers.raise_de();
        self.registers.send(&self.settings, 0);
        self.set_alarm(platform::now().wrapping_add(us * (TICK_HZ / 1_000_000)));
        self.alarm_on();
        true
    }

    #[inline(always)]
    fn is_ready(&mut self) -> bool {
        self.registers.status() & TXE != 0
    }

    #[inline(always)]
    fn put(&mut self, byte: u8, last: bool) {
        self.put_character(byte);
        if Self::IS_BOUNDED && self.settings.rts_cts {
            self.await_cts();
        }
        if last {
            self.await_sent();
        }
    }

    #[inline(always)]
    fn end(&mut self) {
        self.await_sent();
    }

    #[inline(always)]
    fn listen(&mut self) {
        self.registers.lower_de();
        self.awaited = Awaited::Nothing;
        self.registers.listen(&self.settings);
    }

    fn cut(&mut self) {
        self.registers.lower_de();
        self.awaited = Awaited::Nothing;
        self.registers.reset();
        self.registers.set_up(&self.settings);
    }

    #[inline(always)]
    fn frame_is_back(&mut self) {
        self.lent_ms = 0;
    }

    #[inline(always)]
    fn wake_receiver(&mut self) {
        self.receiver.wake();
    }

    #[inline(always)]
    fn wake_user(&mut self) {
        self.user.wake();
    }
}
