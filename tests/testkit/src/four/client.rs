//! A host that sends requests all the time, beside others.

use multidrop_bus::{Bus, HostId, Line, Time};

use super::super::plain::wire::{Way, ascii, hex, rtu};
use super::Report;

/// How long it waits for an answer: longer than all timeouts of routes that it may have to wait for.
const PATIENCE: Time = Time::from_ms(400);

/// The source of the answers.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Source {
    /// The port that is asked.
    Port,
    /// A unit on RS4.
    Unit,
}

/// What is asked and not judged yet. Bodies are unit id and PDU.
#[derive(Debug)]
struct Waiting {
    request: Vec<u8>,
    answer: Vec<u8>,
    from: Source,
    end: Time,
}

/// See the module.
#[derive(Debug)]
pub struct BusClient {
    host: HostId,
    /// The place of its port in [`Report::answers`].
    port: usize,
    way: Way,
    line: Line,
    due: Time,
    waiting: Option<Waiting>,
}

impl BusClient {
    /// One that has asked nothing yet.
    pub fn new(host: HostId, port: usize, way: Way, line: Line) -> Self {
        BusClient {
            host,
            port,
            way,
            line,
            due: Time::ZERO,
            waiting: None,
        }
    }

    /// What it speaks from now on. It asks when its port, which begins to listen, has heard t3.5 of silence.
    pub fn speak(&mut self, bus: &mut Bus, way: Way, line: Line) {
        self.way = way;
        self.line = line;
        bus.host(self.host).set_line(line);
        self.due = bus.now() + line.t35() * 2;
    }

    /// Whether a unit's answer is waited for.
    pub fn awaits_unit(&self) -> bool {
        let waiting = self.waiting.as_ref();
        waiting.is_some_and(|waiting| waiting.from == Source::Unit)
    }

    /// Judges what was heard; returns whether it may ask.
    pub fn is_free(&mut self, bus: &mut Bus, report: &mut Report) -> bool {
        let now = bus.now();
        // It does not ask at the very edge of t3.5.
        let silence = self.line.t35() + self.line.character();
        let host = bus.host(self.host);
        let is_over = match host.heard().last() {
            Some(last) => now >= last.end + silence,
            None => match &self.waiting {
                Some(waiting) => now >= waiting.end + PATIENCE,
                None => return now >= self.due,
            },
        };
        if !is_over {
            return false;
        }
        let heard = host.take();
        let bytes: Vec<u8> = heard.iter().map(|byte| byte.value).collect();
        let at = |what: String| format!("{now}, port {}: {what}", self.port);
        let Some(waiting) = self.waiting.take() else {
            report.wrong(at(format!("{} unasked", hex(&bytes))));
            return false;
        };
        let request = hex(&waiting.request);
        let Some(first) = heard.first() else {
            report.lost(at(format!("no answer to {request}")));
            return true;
        };
        let turnaround = first.start.saturating_sub(waiting.end);
        if !heard.iter().all(|byte| byte.is_good()) || bytes != self.framed(&waiting.answer) {
            report.wrong(at(format!("{request} was answered {}", hex(&bytes))));
        } else if turnaround < self.line.t35() {
            report.wrong(at(format!("{request} was answered after {turnaround}")));
        } else {
            report.answers[self.port] += 1;
        }
        let longest = match waiting.from {
            Source::Port => &mut report.turnaround[self.port],
            Source::Unit => &mut report.routed[self.port],
        };
        *longest = turnaround.max(*longest);
        now >= self.due
    }

    /// Asks; this is to be answered.
    pub fn ask(&mut self, bus: &mut Bus, request: Vec<u8>, answer: Vec<u8>, from: Source) {
        let end = bus.host(self.host).send(&self.framed(&request));
        self.waiting = Some(Waiting {
            request,
            answer,
            from,
            end,
        });
    }

    fn framed(&self, body: &[u8]) -> Vec<u8> {
        match self.way {
            Way::Rtu => rtu(body),
            Way::Ascii => ascii(body, b'\n'),
        }
    }
}
