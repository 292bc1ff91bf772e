//! Units behind RS4 that answer by a script, and hosts that send them requests: none of it is the firmware under
//! test.

use std::path::Path;

use multidrop_bus::{BusError, Emulator, HostId, HostPort, Parts, Time, Tx, frames};

use super::super::plain::wire::{Way, ascii, from_ascii, from_rtu, rtu};
use super::{BOOT, Desk, LINE, RS4, TIMEOUT};

/// How often all look at what they have heard.
const STEP: Time = Time::from_us(250);

/// An answer: how long after the end of the request it begins, at least 2.1 ms, and unit id and PDU.
pub type Reply = (Time, Vec<u8>);

type Script<'a> = dyn FnMut(&[u8]) -> Vec<Reply> + 'a;

/// A desk on which one host plays all units, by a script: it gets each request as unit id and PDU.
pub struct Played<'a> {
    /// The desk with the units.
    pub desk: Desk,
    units: HostId,
    script: Box<Script<'a>>,
}

/// What a client has heard.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Told {
    /// Unit id and PDU; empty if there was no good frame.
    pub body: Vec<u8>,
    /// From the end of the request to the answer's first start bit.
    pub turnaround: Time,
}

impl<'a> Played<'a> {
    /// Boots the image of `ports`; from its first poll on the units are there.
    ///
    /// # Errors
    /// Where the image cannot be run.
    pub fn new(
        ports: &Path,
        emulator: Emulator,
        script: impl FnMut(&[u8]) -> Vec<Reply> + 'a,
    ) -> Result<Self, BusError> {
        let mut desk = Desk::at_zero(ports, emulator, &[], Parts::default())?;
        let wire = desk.wires[RS4];
        let units = desk.bus.add_host_on(wire, HostPort::new(LINE));
        let mut played = Played {
            desk,
            units,
            script: Box::new(script),
        };
        played.run_for(BOOT, |_| ());
        Ok(played)
    }

    /// Lets time pass; `each` looks at the bus again and again.
    pub fn run_for(&mut self, span: Time, mut each: impl FnMut(&mut Desk)) {
        let end = self.desk.bus.now() + span;
        while self.desk.bus.now() < end {
            self.desk.bus.run_for(STEP);
            self.play();
            each(&mut self.desk);
        }
    }

    /// Asks on AS1 (RTU) or AS2 (ASCII), waits for an answer for 400 ms at most, and a little more than t3.5.
    pub fn ask(&mut self, way: Way, request: &[u8]) -> Told {
        let (host, frame) = match way {
            Way::Rtu => (self.desk.pc, rtu(request)),
            Way::Ascii => (self.desk.ascii, ascii(request, b'\n')),
        };
        self.desk.bus.host(host).take();
        let end = self.desk.bus.host(host).send(&frame);
        let deadline = end + Time::from_ms(400);
        let line = self.desk.bus.host(host).line();
        let silence = line.t35() + line.character();
        loop {
            self.run_for(STEP, |_| ());
            let now = self.desk.bus.now();
            let host = self.desk.bus.host(host);
            let last = host
                .heard()
                .last()
                .map_or(deadline, |last| last.end + silence);
            if now < last.min(deadline) || host.is_receiving() {
                continue;
            }
            let heard = host.take();
            let bytes: Vec<u8> = heard.iter().map(|byte| byte.value).collect();
            let body = match way {
                Way::Rtu => from_rtu(&bytes),
                Way::Ascii => from_ascii(&bytes, b'\n'),
            };
            let first = heard.first().map_or(end, |first| first.start);
            return Told {
                body: body.unwrap_or_default(),
                turnaround: first.saturating_sub(end),
            };
        }
    }

    fn play(&mut self) {
        let now = self.desk.bus.now();
        let host = self.desk.bus.host(self.units);
        let Some(last) = host.heard().last() else {
            return;
        };
        let end = last.end;
        if host.is_receiving() || now < end + LINE.t35() {
            return;
        }
        let bytes: Vec<u8> = host.take().iter().map(|byte| byte.value).collect();
        let Some(request) = from_rtu(&bytes) else {
            return;
        };
        for (delay, body) in (self.script)(&request) {
            // Not at once behind its last one: the two would be one frame.
            let idle = host.busy_until().max(now);
            let start = (end + delay).max(host.busy_until() + LINE.t35());
            let mut gap = start.saturating_sub(idle);
            host.send_each(rtu(&body).into_iter().map(|byte| {
                let character = Tx::byte(byte).after(gap);
                gap = Time::ZERO;
                character
            }));
        }
    }
}

/// A request on RS4.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Asked {
    /// Unit id and PDU.
    pub body: Vec<u8>,
    /// When its first start bit began.
    pub start: Time,
    /// When its answer ended; `None` if none came.
    pub answered: Option<Time>,
    /// When it was over: then, or when the time for it was.
    pub over: Time,
}

/// All requests on RS4 so far; one that is still on the wire is none yet.
///
/// # Panics
/// If one began before the one before was over, or before t3.5 of silence, or two talked at once.
pub fn asked(desk: &Desk) -> Vec<Asked> {
    let (asked, cut) = whole(desk);
    assert_eq!(cut, 0, "a request was cut off");
    asked
}

/// The requests of a desk on which clients give up: a request that was cut off, since no client waits any more, does
/// not count.
///
/// # Panics
/// As [`asked`].
pub fn asked_or_cut(desk: &Desk) -> Vec<Asked> {
    whole(desk).0
}

/// Requests, and how many more were cut off.
fn whole(desk: &Desk) -> (Vec<Asked>, usize) {
    let mut cut = 0;
    let record = desk.bus.record();
    assert_eq!(record.conflicts(), []);
    let mut asked: Vec<Asked> = Vec::new();
    for frame in frames(record, LINE) {
        if frame.end() + LINE.t15() > desk.bus.now() {
            break;
        }
        let Some(body) = frame.body() else {
            assert!(frame.from == desk.station(RS4), "{frame} is damaged");
            cut += 1;
            continue;
        };
        let last = asked.last_mut();
        if frame.from == desk.station(RS4) {
            assert!(!frame.early, "{frame}");
            if let Some(last) = last {
                assert!(frame.start() >= last.over, "{frame}\nbehind {last:02x?}");
            }
            asked.push(Asked {
                body,
                start: frame.start(),
                answered: None,
                over: frame.end() + TIMEOUT,
            });
        } else if let Some(last) = last
            && last.answered.is_none()
            && frame.start() < last.over
            && last.body[0] == body[0]
            && last.body[1] == body[1] & 0x7F
        {
            last.answered = Some(frame.end());
            last.over = frame.end() + LINE.t35();
        }
    }
    (asked, cut)
}
