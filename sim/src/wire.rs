//! The wire pair and the transceivers on it.
//!
//! No driver: the bias holds the wire at the mark. One driver: its level. Two that disagree: the
//! wire is low from there on for a character (see [`crate::BusConfig::conflict_hold`]), which every
//! receiver takes for damaged bits and a missing stop bit.

use std::collections::VecDeque;

use crate::bus::Event;
use crate::host::Frame;
use crate::record::{Conflict, DataEdge, DeEdge, Record, Station, WireByte, WireEdge};
use crate::time::Time;

/// How long edges are remembered for characters that have not ended: longer than a character at
/// 300 baud.
const MEMORY: Time = Time::from_ms(40);

#[derive(Debug)]
struct Transceiver {
    station: Station,
    plugged: bool,
    powered: bool,
    driving: bool,
    data: bool,
    /// Hears while it drives.
    echo: bool,
    /// Its driver is switched by a pin, whose edges are recorded.
    has_pin: bool,
    /// What it hears now.
    heard: bool,
}

impl Transceiver {
    fn drives(&self) -> bool {
        self.driving && self.plugged && self.powered
    }
}

#[derive(Debug)]
struct Open {
    from: Station,
    frame: Frame,
    lost: bool,
    truncated: Option<Time>,
    conflict: bool,
}

#[derive(Debug)]
pub(crate) struct Wire {
    transceivers: Vec<Transceiver>,
    hold: Time,
    held_until: Time,
    in_conflict: bool,
    noise: Option<bool>,
    level: bool,
    edges: VecDeque<WireEdge>,
    open: Vec<Open>,
    heard: Vec<(Station, bool)>,
    /// Something happened since it was last resolved.
    changed: bool,
}

impl Wire {
    pub fn new(hold: Time) -> Self {
        Wire {
            transceivers: Vec::new(),
            hold,
            held_until: Time::ZERO,
            in_conflict: false,
            noise: None,
            level: true,
            edges: VecDeque::new(),
            open: Vec::new(),
            heard: Vec::new(),
            changed: false,
        }
    }

    pub fn add(&mut self, station: Station, driving: bool, echo: bool, has_pin: bool) {
        self.transceivers.push(Transceiver {
            station,
            plugged: true,
            powered: true,
            driving,
            data: true,
            echo: echo || driving,
            has_pin,
            heard: true,
        });
    }

    pub fn level(&self) -> bool {
        self.level
    }

    fn of(&mut self, station: Station) -> Option<&mut Transceiver> {
        self.transceivers.iter_mut().find(|t| t.station == station)
    }

    pub fn set_plugged(&mut self, station: Station, plugged: bool) {
        if let Some(transceiver) = self.of(station) {
            transceiver.plugged = plugged;
        }
    }

    pub fn set_echo(&mut self, station: Station, echo: bool) {
        if let Some(transceiver) = self.of(station) {
            transceiver.echo = echo;
        }
    }

    pub fn echoes(&self, station: Station) -> bool {
        let mut transceivers = self.transceivers.iter();
        transceivers.any(|t| t.station == station && t.echo)
    }

    pub fn set_powered(&mut self, station: Station, powered: bool) {
        if let Some(transceiver) = self.of(station) {
            transceiver.powered = powered;
        }
    }

    fn cut(&mut self, station: Station, now: Time, record: &mut Record) {
        while let Some(index) = self.open.iter().position(|open| open.from == station) {
            let mut open = self.open.remove(index);
            open.truncated.get_or_insert(now);
            record.bytes.push(self.judge(&open));
        }
        self.put(station, true, now, record);
    }

    fn put(&mut self, from: Station, level: bool, time: Time, record: &mut Record) {
        if let Some(transceiver) = self.of(from)
            && transceiver.data != level
        {
            transceiver.data = level;
            record.data.push(DataEdge { from, time, level });
        }
    }

    /// Whether an event was applied that is not resolved yet.
    pub fn is_changed(&self) -> bool {
        self.changed
    }

    pub fn apply(&mut self, event: Event, now: Time, record: &mut Record) {
        self.changed = true;
        match event {
            Event::Data(station, level) => {
                self.put(station, level, now, record);
            }
            Event::Drive(station, on) => self.drive(station, on, now, record),
            Event::Begin(from, frame) => {
                let lost = self.of(from).is_none_or(|t| !t.drives());
                self.open.push(Open {
                    from,
                    frame,
                    lost,
                    truncated: None,
                    conflict: self.in_conflict,
                });
            }
            Event::End(station) => {
                if let Some(index) = self.open.iter().position(|open| open.from == station) {
                    let open = self.open.remove(index);
                    record.bytes.push(self.judge(&open));
                }
            }
            Event::Cut(station) => self.cut(station, now, record),
            Event::Noise(level) => self.noise = level,
            Event::Resolve => {}
        }
    }

    fn drive(&mut self, station: Station, on: bool, now: Time, record: &mut Record) {
        let Some(transceiver) = self.of(station) else {
            return;
        };
        if transceiver.driving == on {
            return;
        }
        transceiver.driving = on;
        let pin = transceiver.has_pin;
        if pin {
            record.de.push(DeEdge {
                from: station,
                time: now,
                on,
            });
        }
        if !on {
            for open in &mut self.open {
                if open.from == station && !open.lost && now < open.frame.times.end() {
                    open.truncated.get_or_insert(now);
                }
            }
        }
    }

    /// Works out the level and what everyone hears. Returns when to look again.
    pub fn resolve(&mut self, now: Time, record: &mut Record) -> Option<Time> {
        self.changed = false;
        let driver = |level: bool| {
            let mut drivers = self.transceivers.iter().filter(|t| t.drives());
            drivers.find(|t| t.data == level).map(|t| t.station)
        };
        let (low, high) = (driver(false), driver(true));
        let mut again = None;
        if let (Some(low), Some(high)) = (low, high) {
            if !self.in_conflict {
                self.held_until = now + self.hold;
                again = Some(self.held_until);
                record.conflicts.push(Conflict {
                    time: now,
                    low,
                    high,
                    end: None,
                });
            }
            self.in_conflict = true;
        } else if self.in_conflict {
            self.in_conflict = false;
            if let Some(conflict) = record.conflicts.last_mut() {
                conflict.end = Some(now);
            }
        }
        if self.in_conflict {
            self.open
                .iter_mut()
                .for_each(|open| open.conflict |= !open.lost);
        }
        let level = match self.noise {
            Some(level) => level,
            None => low.is_none() && now >= self.held_until,
        };
        if level != self.level {
            self.level = level;
            let edge = WireEdge { time: now, level };
            self.edges.push_back(edge);
            record.wire.push(edge);
            while self.edges.len() > 2 && self.edges[1].time + MEMORY < now {
                self.edges.pop_front();
            }
        }
        for transceiver in &mut self.transceivers {
            let on = transceiver.plugged && transceiver.powered;
            let hears = on && (transceiver.echo || !transceiver.driving);
            let heard = level || !hears;
            if heard != transceiver.heard {
                transceiver.heard = heard;
                self.heard.push((transceiver.station, heard));
            }
        }
        again
    }

    /// What changed for those who listen.
    pub fn take_heard(&mut self) -> Vec<(Station, bool)> {
        std::mem::take(&mut self.heard)
    }

    fn level_at(&self, t: Time) -> bool {
        match self.edges.iter().rev().find(|edge| edge.time <= t) {
            Some(edge) => edge.level,
            None => self.edges.front().is_none_or(|edge| !edge.level),
        }
    }

    fn judge(&self, open: &Open) -> WireByte {
        let frame = &open.frame;
        let bits = (0..frame.times.count)
            .map(|bit| u16::from(self.level_at(frame.times.middle(bit))) << bit)
            .fold(0, |bits, bit| bits | bit);
        let decoded = frame.format.decode(bits);
        WireByte {
            from: open.from,
            start: frame.times.start(),
            end: frame.times.end(),
            sent: frame.value,
            value: decoded.value,
            bits,
            framing_error: decoded.framing_error,
            parity_error: decoded.parity_error,
            lost: open.lost,
            truncated: open.truncated,
            conflict: open.conflict,
        }
    }
}
