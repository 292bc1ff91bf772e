//! A plain model of a unit that runs `conformance`: the standard read line by line, with nothing of the firmware in it.
//!
//! It is told every frame on the bus and says what is answered. Sources: APP V1.1b3, SER V1.02; where they leave room,
//! the guide says how this project reads them.
#![allow(
    missing_docs,
    reason = "names of fields, variants and constants that tell all there is to tell"
)]

mod files;
pub mod requests;
pub mod shrink;
mod tables;
pub mod wire;

use std::collections::VecDeque;

pub use tables::Tables;
pub use wire::Heard;

/// The unit id of the conformance image.
pub const UNIT: u8 = 0x11;

/// Events that the log holds (APP 6.10).
const LOG: usize = 64;

/// The counters of FC 08, by sub-function 000B..=0012 (APP 6.8, SER appendix A).
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Counters {
    pub messages: u16,
    pub errors: u16,
    pub exceptions: u16,
    pub addressed: u16,
    pub unanswered: u16,
    pub nak: u16,
    pub busy: u16,
    pub overruns: u16,
}

/// What a request came to.
enum Done {
    /// It is answered, and a message completed.
    Answer(Vec<u8>),
    /// The request is answered, but the event counter does not count it: FC 0B, 0C, and what clears it.
    Uncounted(Vec<u8>),
    /// FC 08/0001: answered, then restarted.
    Restart(Vec<u8>, bool),
    /// FC 08/0004: not answered, and listening only from now on.
    Listen,
    /// A broadcast of something that is not executed when broadcast.
    Ignored,
}

/// A unit with its state.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Plain {
    pub tables: Tables,
    /// Of file 4.
    pub records: Vec<u16>,
    /// Whether there is what the map has not: see [`Plain::with_extras`].
    extras: bool,
    pub counters: Counters,
    /// The counter of FC 0B.
    pub events: u16,
    /// The event log, newest first.
    pub log: VecDeque<u8>,
    pub listening_only: bool,
    /// What ends an ASCII frame behind CR.
    pub delimiter: u8,
    /// Objects 1 and 2 of FC 2B/0E.
    product: &'static str,
    version: String,
}

impl Plain {
    /// The model at boot, with this number of records in file 4; with 0 there are no files.
    pub fn new(product: &'static str, version: &str, records: u16) -> Self {
        Plain {
            tables: Tables::new(),
            records: (0..records).collect(),
            extras: false,
            product,
            counters: Counters::default(),
            events: 0,
            log: VecDeque::new(),
            listening_only: false,
            delimiter: b'\n',
            version: version.to_owned(),
        }
    }

    /// With what no conformance image has, so that every limit and every exception is reached: function 44, which is
    /// refused with the exception that its one byte names and echoes others, broadcast too; queues of n registers at
    /// 1000 + n, file 5 with the records from 9990, and register 127, which cannot take DEAD.
    pub fn with_extras(mut self) -> Self {
        self.extras = true;
        self.tables.extras = true;
        self
    }

    /// Takes in what is on the bus; gives unit id and PDU of the answer, nothing where it stays silent.
    pub fn hears(&mut self, heard: &Heard) -> Option<Vec<u8>> {
        match heard {
            Heard::Nothing => None,
            Heard::Bad { overrun } => {
                self.counters.errors = self.counters.errors.wrapping_add(1);
                let overruns = &mut self.counters.overruns;
                *overruns = overruns.wrapping_add(u16::from(*overrun));
                self.record(0x82 | if *overrun { 0x10 } else { 0 } | self.listening_bit());
                None
            }
            Heard::Good(body) => self.good(body),
        }
    }

    fn good(&mut self, body: &[u8]) -> Option<Vec<u8>> {
        let add = |counter: &mut u16| *counter = counter.wrapping_add(1);
        add(&mut self.counters.messages);
        let broadcast = body[0] == 0;
        if !broadcast && body[0] != UNIT {
            return None;
        }
        add(&mut self.counters.addressed);
        let to_all = if broadcast { 0x40 } else { 0 };
        self.record(0x80 | to_all | self.listening_bit());

        let was_listening = self.listening_only;
        let done = match was_listening && !restarts(&body[1..]) {
            true => Ok(Done::Ignored),
            false => self.execute(&body[1..], broadcast),
        };
        let silent = broadcast || was_listening;
        let mut sent = 0x40;
        let mut restart = None;
        let mut answer = None;
        match done {
            Ok(Done::Answer(pdu)) => {
                add(&mut self.events);
                answer = Some(pdu);
            }
            Ok(Done::Uncounted(pdu)) => answer = Some(pdu),
            Ok(Done::Restart(pdu, clear)) => {
                answer = Some(pdu);
                restart = Some(clear);
            }
            Ok(Done::Listen) => {
                add(&mut self.events);
                self.listening_only = true;
                self.record(0x04);
            }
            Ok(Done::Ignored) => {}
            Err(code) => {
                add(&mut self.counters.exceptions);
                match code {
                    7 => add(&mut self.counters.nak),
                    6 => add(&mut self.counters.busy),
                    _ => {}
                }
                if !silent {
                    sent |= match code {
                        1..=3 => 0x01,
                        4 => 0x02,
                        5 | 6 => 0x04,
                        7 => 0x08,
                        // The log has no bit for the others.
                        _ => 0,
                    };
                }
                answer = Some(vec![body[1] | 0x80, code]);
            }
        }
        if silent {
            answer = None;
        }
        if answer.is_none() {
            add(&mut self.counters.unanswered);
        }
        self.record(sent | self.listening_bit());
        if let Some(clear) = restart {
            self.counters = Counters::default();
            self.events = 0;
            self.listening_only = false;
            if clear {
                self.log.clear();
            }
            self.record(0x00);
        }
        answer.map(|pdu| [&[UNIT], &pdu[..]].concat())
    }

    fn listening_bit(&self) -> u8 {
        if self.listening_only { 0x20 } else { 0 }
    }

    fn record(&mut self, event: u8) {
        self.log.push_front(event);
        self.log.truncate(LOG);
    }

    /// Function first, then length and quantity, addresses, disabled registers, values (APP 6, the state diagrams).
    fn execute(&mut self, pdu: &[u8], broadcast: bool) -> Result<Done, u8> {
        let (function, data) = (pdu[0], &pdu[1..]);
        let known = match function {
            0x14 | 0x15 => !self.records.is_empty(),
            1..=8 | 0x0b | 0x0c | 0x0f | 0x10 | 0x11 | 0x16..=0x18 | 0x2b | 0x41 => true,
            0x44 => self.extras,
            _ => false,
        };
        if !known {
            return Err(1);
        }
        let executed = matches!(function, 5 | 6 | 0x0f | 0x10 | 0x15..=0x17 | 0x44)
            || function == 8 && matches!(data, [0, 1 | 4, ..]);
        if broadcast && !executed {
            return Ok(Done::Ignored);
        }
        let nothing_more = || if data.is_empty() { Ok(()) } else { Err(3) };
        let answer = |data: Vec<u8>| Ok(Done::Answer([&[function], &data[..]].concat()));
        match function {
            7 => {
                nothing_more()?;
                answer(vec![self.tables.exception_status()])
            }
            8 => self.diagnose(data),
            0x0b => {
                nothing_more()?;
                let count = self.events.to_be_bytes();
                Ok(Done::Uncounted([&[0x0b, 0, 0], &count[..]].concat()))
            }
            0x0c => {
                nothing_more()?;
                let mut pdu = vec![0x0c, 6 + self.log.len() as u8, 0, 0];
                pdu.extend(self.events.to_be_bytes());
                pdu.extend(self.counters.messages.to_be_bytes());
                pdu.extend(&self.log);
                Ok(Done::Uncounted(pdu))
            }
            0x11 => {
                nothing_more()?;
                answer([&[11, UNIT, 0xff], &b"multidrop"[..]].concat())
            }
            0x14 => answer(files::read(&self.records, self.extras, data)?),
            0x15 => answer(files::write(&mut self.records, data)?),
            0x2b => answer(self.identify(data)?),
            0x41 => answer(data.iter().rev().copied().collect()),
            0x44 => match data {
                [code @ (1..=8 | 0x0a | 0x0b)] => Err(*code),
                _ => answer(data.to_vec()),
            },
            _ => answer(self.tables.execute(function, data)?),
        }
    }

    /// FC 08 (APP 6.8.1).
    fn diagnose(&mut self, data: &[u8]) -> Result<Done, u8> {
        let [0, sub, rest @ ..] = data else {
            return Err(if data.len() < 2 { 3 } else { 1 });
        };
        let echo = [&[8], data].concat();
        let must_be = |good: bool| if good { Ok(()) } else { Err(3) };
        let Counters {
            messages,
            errors,
            exceptions,
            addressed,
            unanswered,
            nak,
            busy,
            overruns,
        } = self.counters;
        let value = match sub {
            0x00 => return Ok(Done::Answer(echo)),
            0x01 => {
                must_be(matches!(rest, [0 | 0xff, 0]))?;
                return Ok(Done::Restart(echo, rest[0] == 0xff));
            }
            0x03 => {
                must_be(matches!(rest, [_, 0]))?;
                self.delimiter = rest[0];
                return Ok(Done::Answer(echo));
            }
            0x02 => 0,
            0x04 => {
                must_be(rest == [0, 0])?;
                return Ok(Done::Listen);
            }
            0x0a => {
                must_be(rest == [0, 0])?;
                self.counters = Counters::default();
                self.events = 0;
                return Ok(Done::Uncounted(echo));
            }
            0x0b => messages,
            0x0c => errors,
            0x0d => exceptions,
            0x0e => addressed,
            0x0f => unanswered,
            0x10 => nak,
            0x11 => busy,
            0x12 => overruns,
            0x14 => {
                must_be(rest == [0, 0])?;
                self.counters.overruns = 0;
                return Ok(Done::Answer(echo));
            }
            _ => return Err(1),
        };
        must_be(rest == [0, 0])?;
        let value = value.to_be_bytes();
        Ok(Done::Answer([&[8, 0, *sub], &value[..]].concat()))
    }

    /// FC 2B (APP 6.21): all that follows the function code.
    fn identify(&self, data: &[u8]) -> Result<Vec<u8>, u8> {
        match data {
            [] => return Err(3),
            [0x0e, ..] => {}
            _ => return Err(1),
        }
        let &[_, code @ 1..=4, object] = data else {
            return Err(3);
        };
        let all = [
            (0, "multidrop"),
            (1, self.product),
            (2, self.version.as_str()),
            (6, "conformance"),
        ];
        let in_category = all.iter().filter(|(id, _)| match code {
            1 => *id <= 2,
            _ => true,
        });
        let exists = all.iter().any(|(id, _)| *id == object);
        let chosen: Vec<_> = match code {
            4 if !exists => return Err(2),
            4 => in_category.filter(|(id, _)| *id == object).collect(),
            _ => {
                let present = in_category.clone().any(|(id, _)| *id == object);
                let first = if present { object } else { 0 };
                in_category.filter(|(id, _)| *id >= first).collect()
            }
        };
        let mut answer = vec![0x0e, code, 0x82, 0, 0, chosen.len() as u8];
        for (id, text) in chosen {
            answer.extend([*id, text.len() as u8]);
            answer.extend(text.bytes());
        }
        Ok(answer)
    }
}

/// Whether it is FC 08/0001 with data that the standard has for it.
fn restarts(pdu: &[u8]) -> bool {
    matches!(pdu, [8, 0, 1, 0 | 0xff, 0])
}
