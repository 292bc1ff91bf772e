//! Counters, listen-only mode and event log, with FC 08, 0B and 0C (APP 6.8, 6.9, 6.10; SER appendix A).

use core::cell::Cell;

use super::diagnostics::Diagnostics;
use super::event_log::{self, EventLog};
use super::{Plan, REQUEST_HEAD, two_words};
use crate::ascii::DELIMITER;
use crate::exception::Exception;
use crate::frame::ReceiveErrors;
use crate::function::{
    DIAGNOSTICS, EVENTS_MAX, EXCEPTION_BIT, GET_COMM_EVENT_COUNTER, GET_COMM_EVENT_LOG,
};
use crate::{Adu, BROADCAST};

/// The sub-functions of Diagnostics (APP 6.8.1).
mod sub {
    pub const RETURN_QUERY_DATA: u16 = 0x00;
    pub const RESTART_COMMUNICATIONS: u16 = 0x01;
    pub const RETURN_DIAGNOSTIC_REGISTER: u16 = 0x02;
    pub const CHANGE_ASCII_DELIMITER: u16 = 0x03;
    pub const FORCE_LISTEN_ONLY: u16 = 0x04;
    pub const CLEAR_COUNTERS: u16 = 0x0A;
    pub const FIRST_COUNTER: u16 = 0x0B;
    pub const LAST_COUNTER: u16 = 0x12;
    pub const CLEAR_OVERRUN: u16 = 0x14;
}

/// Data of Restart Communications Option that clears the event log as well (APP 6.8.1).
const CLEAR_LOG: u16 = 0xFF00;

/// Unit id, function code, sub-function, data: the length of all sub-functions except Return Query Data.
const DIAGNOSTICS_LEN: u8 = 6;

/// The counters of FC 08, in the order of their sub-functions 0B to 12 (SER appendix A).
#[derive(Clone, Copy)]
#[repr(u8)]
enum Counter {
    BusMessage,
    BusError,
    Exception,
    ServerMessage,
    NoResponse,
    NegativeAcknowledge,
    Busy,
    Overrun,
}

/// The counters of a server, its event log of `LOG` events (0 to 64), and its listen-only mode.
///
/// Counters have 16 bits and wrap around. In RAM they take 24 bytes, and the log `LOG` bytes.
#[derive(Debug)]
pub struct Counted<const LOG: usize> {
    counters: [Cell<u16>; 8],
    /// The counter of Get Comm Event Counter.
    completions: Cell<u16>,
    diagnostic_register: Cell<u16>,
    log: EventLog<LOG>,
    listens_only: Cell<bool>,
    delimiter: Cell<u8>,
}

impl<const LOG: usize> Counted<LOG> {
    /// Counters that are 0, with an empty log.
    ///
    /// # Panics
    ///
    /// If `LOG` is over 64; in a `const` that is a build error.
    pub const fn new() -> Counted<LOG> {
        const { assert!(LOG <= EVENTS_MAX, "the event log must hold 0..=64 events") };
        Counted {
            counters: [const { Cell::new(0) }; 8],
            completions: Cell::new(0),
            diagnostic_register: Cell::new(0),
            log: EventLog::new(),
            listens_only: Cell::new(false),
            delimiter: Cell::new(DELIMITER),
        }
    }

    /// Sets the value of Return Diagnostic Register: 16 bits that the application defines (APP 6.8.1, sub-function
    /// 02). Clear Counters sets it to 0.
    pub fn set_diagnostic_register(&self, value: u16) {
        self.diagnostic_register.set(value);
    }

    /// Whether a client has put the server in listen-only mode.
    pub fn listens_only(&self) -> bool {
        self.listens_only.get()
    }

    #[inline(never)]
    fn count(&self, counter: Counter) {
        if let Some(cell) = self.counters.get(counter as usize) {
            cell.set(cell.get().wrapping_add(1));
        }
    }

    fn clear_counters(&self) {
        for cell in &self.counters {
            cell.set(0);
        }
        self.completions.set(0);
    }

    /// Logs an event, with the bit of listen-only mode.
    fn log(&self, event: u8) {
        let listens_only = if self.listens_only.get() {
            event_log::LISTENS_ONLY
        } else {
            0
        };
        self.log.push(event | listens_only);
    }

    fn diagnose(&self, frame: &mut Adu, len: u8) -> Result<Plan, Exception> {
        let broadcast = frame[0] == BROADCAST;
        if len < REQUEST_HEAD {
            // The request has no sub-function.
            return if broadcast {
                Ok(Plan::Silent { refused: None })
            } else {
                Err(Exception::IllegalDataValue)
            };
        }
        let (sub, data) = two_words(frame);
        if broadcast && !matches!(sub, sub::RESTART_COMMUNICATIONS | sub::FORCE_LISTEN_ONLY) {
            return Ok(Plan::Silent { refused: None });
        }
        if sub == sub::RETURN_QUERY_DATA {
            return Ok(Plan::Answer { len });
        }
        if !matches!(
            sub,
            sub::RESTART_COMMUNICATIONS..=sub::FORCE_LISTEN_ONLY
                | sub::CLEAR_COUNTERS..=sub::LAST_COUNTER
                | sub::CLEAR_OVERRUN
        ) {
            return Err(Exception::IllegalFunction);
        }
        let data_is_right = match sub {
            sub::RESTART_COMMUNICATIONS => data == 0 || data == CLEAR_LOG,
            sub::CHANGE_ASCII_DELIMITER => data & 0xFF == 0,
            _ => data == 0,
        };
        if len != DIAGNOSTICS_LEN || !data_is_right {
            return Err(Exception::IllegalDataValue);
        }
        let told = match sub {
            sub::RETURN_DIAGNOSTIC_REGISTER => self.diagnostic_register.get(),
            sub::FIRST_COUNTER..=sub::LAST_COUNTER => {
                let place = (sub - sub::FIRST_COUNTER) as u8;
                let counted = self
                    .counters
                    .get(usize::from(place))
                    .map_or(0, |cell| cell.get());
                // The request is counted after it was handled.
                let own =
                    place == Counter::BusMessage as u8 || place == Counter::ServerMessage as u8;
                counted.wrapping_add(own.into())
            }
            _ => {
                let silent = broadcast || sub == sub::FORCE_LISTEN_ONLY || self.listens_only.get();
                return Ok(Plan::Diagnose {
                    len: if silent { 0 } else { len },
                });
            }
        };
        [frame[4], frame[5]] = told.to_be_bytes();
        Ok(Plan::Answer { len })
    }

    /// Writes the status of FC 0B and 0C, and the event counter.
    fn put_status(&self, frame: &mut Adu, at: usize, busy: bool) {
        let status = if busy { 0xFF } else { 0 };
        let [high, low] = self.completions.get().to_be_bytes();
        if let Some(bytes) = frame.get_mut(at..at + 4) {
            bytes.copy_from_slice(&[status, status, high, low]);
        }
    }

    fn tell_log(&self, frame: &mut Adu, busy: bool) -> Plan {
        self.put_status(frame, 3, busy);
        let messages = self.counters[Counter::BusMessage as usize]
            .get()
            .wrapping_add(1);
        [frame[7], frame[8]] = messages.to_be_bytes();
        let [_, _, _, _, _, _, _, _, _, events @ ..] = frame;
        let mut count = 0;
        if let Some((own, before)) = events.split_first_mut()
            && LOG > 0
        {
            *own = event_log::RECEIVE;
            let (room, _) = before.split_at_mut(LOG.saturating_sub(1).min(before.len()));
            count = 1 + self.log.copy_to(room);
        }
        frame[2] = 6 + count;
        Plan::Answer { len: 9 + count }
    }

    /// Executes the sub-function of [`Plan::Diagnose`] after the request was handled.
    fn execute(&self, frame: &Adu) {
        let (sub, data) = two_words(frame);
        match sub {
            sub::RESTART_COMMUNICATIONS => {
                self.clear_counters();
                if data == CLEAR_LOG {
                    self.log.clear();
                }
                self.listens_only.set(false);
                self.log.push(event_log::RESTARTED);
            }
            sub::CHANGE_ASCII_DELIMITER => self.delimiter.set((data >> 8) as u8),
            sub::CLEAR_COUNTERS => {
                self.clear_counters();
                self.diagnostic_register.set(0);
            }
            sub::CLEAR_OVERRUN => self.counters[Counter::Overrun as usize].set(0),
            _ => {}
        }
    }
}

impl<const LOG: usize> Default for Counted<LOG> {
    fn default() -> Counted<LOG> {
        Counted::new()
    }
}

impl<const LOG: usize> Diagnostics for Counted<LOG> {
    const COUNTS: bool = true;

    fn is_deaf_to(&self, frame: &Adu, len: u8) -> bool {
        if !self.listens_only.get() {
            return false;
        }
        let (sub, data) = two_words(frame);
        let restarts = frame[1] == DIAGNOSTICS
            && len == DIAGNOSTICS_LEN
            && sub == sub::RESTART_COMMUNICATIONS
            && (data == 0 || data == CLEAR_LOG);
        !restarts
    }

    fn prepare(&self, frame: &mut Adu, len: u8, busy: bool) -> Result<Plan, Exception> {
        let code = frame[1];
        if code == DIAGNOSTICS {
            return self.diagnose(frame, len);
        }
        if frame[0] == BROADCAST {
            return Ok(Plan::Silent { refused: None });
        }
        if len != 2 {
            return Err(Exception::IllegalDataValue);
        }
        if code == GET_COMM_EVENT_LOG {
            return Ok(self.tell_log(frame, busy));
        }
        self.put_status(frame, 2, busy);
        Ok(Plan::Answer { len: 6 })
    }

    fn completed(&self, frame: &Adu, plan: Plan, answer_len: u8, refused: Option<Exception>) {
        let broadcast = frame[0] == BROADCAST;
        self.count(Counter::BusMessage);
        self.count(Counter::ServerMessage);
        self.log(if broadcast {
            event_log::RECEIVE | event_log::BROADCAST_RECEIVED
        } else {
            event_log::RECEIVE
        });
        let executed = !matches!(plan, Plan::Silent { .. });
        let fetched = matches!(
            frame[1] & !EXCEPTION_BIT,
            GET_COMM_EVENT_COUNTER | GET_COMM_EVENT_LOG
        );
        if executed && refused.is_none() && !fetched {
            self.completions.set(self.completions.get().wrapping_add(1));
        }
        if answer_len == 0 {
            self.count(Counter::NoResponse);
        }
        let mut send_event = event_log::SEND;
        if let Some(exception) = refused {
            self.count(Counter::Exception);
            match exception {
                Exception::NegativeAcknowledge => self.count(Counter::NegativeAcknowledge),
                Exception::ServerDeviceBusy => self.count(Counter::Busy),
                _ => {}
            }
            if answer_len != 0 {
                send_event = event_log::sent(exception);
            }
        }
        let diagnose = matches!(plan, Plan::Diagnose { .. });
        if diagnose && two_words(frame).0 == sub::FORCE_LISTEN_ONLY {
            // Listen-only mode begins after the request, as the send event shows (APP 6.10).
            self.listens_only.set(true);
            self.log.push(event_log::ENTERED_LISTEN_ONLY);
        }
        self.log(send_event);
        if diagnose {
            self.execute(frame);
        }
    }

    fn cut_off(&self) {
        self.count(Counter::NoResponse);
    }

    fn overheard(&self) {
        self.count(Counter::BusMessage);
    }

    fn damaged(&self, errors: ReceiveErrors) {
        self.count(Counter::BusError);
        if errors.contains(ReceiveErrors::OVERRUN) {
            self.count(Counter::Overrun);
        }
        self.log(event_log::damaged(errors));
    }

    fn delimiter(&self) -> u8 {
        self.delimiter.get()
    }
}
