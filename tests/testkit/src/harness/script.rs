//! The events on the wire and in the unit, one after the other.

use multidrop_protocol::frame::ReceiveErrors;

use super::book::{self, Book};
use super::bus::{Bus, Char, Settings};
use super::judge::{self, Circumstances, Verdict};
use super::unit::Unit;

/// A line and its unit.
#[derive(Clone, Debug)]
pub struct Config {
    pub settings: Settings,
    /// What passes until a woken task runs, one after the other and round again.
    pub latencies: Vec<u64>,
}

/// A character, and the silence before it.
#[derive(Clone, Copy, Debug)]
pub struct Sent {
    pub gap: u64,
    pub byte: u8,
    pub errors: ReceiveErrors,
}

/// One thing after the other.
#[derive(Clone, Debug)]
pub enum Op {
    /// Another station sends; a polite one waits until the unit is at rest.
    Talk { polite: bool, chars: Vec<Sent> },
    /// An edge on the wire, in ticks after the last character so far.
    Glitch(u64),
    /// The task that has the frame is dropped then, and begun anew.
    Cancel(u64),
    /// The line is set up anew then.
    Reset(u64),
}

/// A frame without gaps, so long after whatever was before.
pub fn frame(gap: u64, bytes: &[u8]) -> Vec<Sent> {
    let gaps = std::iter::once(gap).chain(std::iter::repeat(0));
    let sent = |(gap, &byte)| Sent {
        gap,
        byte,
        errors: ReceiveErrors::NONE,
    };
    gaps.zip(bytes).map(sent).collect()
}

#[derive(Clone, Copy, Debug, PartialEq)]
enum Command {
    Cancel,
    Reset,
}

/// A line, its unit, and what is still to befall them.
pub struct Lab<const MAY_FAIL: bool> {
    pub bus: Bus,
    pub unit: Unit<MAY_FAIL>,
    commands: Vec<(u64, Command)>,
    /// When the line began to listen.
    listens: u64,
}

impl<const MAY_FAIL: bool> Lab<MAY_FAIL> {
    fn step(&mut self) -> bool {
        let now = self.bus.chip.now;
        let stepped = if self.bus.step() {
            true
        } else if let Some(at) = self.commands.iter().position(|command| command.0 <= now) {
            match self.commands.swap_remove(at).1 {
                Command::Cancel => self.unit.cancel(&mut self.bus),
                Command::Reset => self.bus.reset(),
            }
            true
        } else {
            self.unit.step(&mut self.bus)
        };
        self.unit.take_wakings(&mut self.bus);
        stepped
    }

    /// Until nothing more happens of itself.
    fn rest(&mut self) {
        let mut steps = 0;
        loop {
            while self.step() {
                steps += 1;
                assert!(steps < 10_000_000, "never comes to rest");
            }
            let commands = self.commands.iter().map(|command| command.0).min();
            let events = [self.bus.next_event(), self.unit.next_event(), commands];
            match events.into_iter().flatten().min() {
                Some(at) => self.bus.chip.now = at,
                None => return,
            }
        }
    }

    /// The end of the last character so far.
    fn last_end(&self) -> u64 {
        self.bus.last_end().max(self.listens)
    }

    fn talk(&mut self, polite: bool, chars: &[Sent]) {
        if polite {
            self.rest();
        }
        for &Sent { gap, byte, errors } in chars {
            // What is at this very tick has happened already.
            let start = (self.last_end() + gap).max(self.bus.chip.now + 1);
            self.bus.chip.chars.push(Char {
                start,
                byte,
                errors,
            });
        }
    }
}

/// Runs a script and a last good request, and judges everything. Panics where the unit does not do what it must. Leaves `book`
/// as the model is at the end.
pub fn run<const MAY_FAIL: bool>(config: &Config, ops: &[Op], book: &mut Book) -> Verdict {
    let bus = Bus::new(config.settings.clone());
    let request = book::framed(&[book::UNIT, 3, 0, 3, 0, 2]);
    let (lab, circumstances) = play::<MAY_FAIL>(config, bus, ops, book, &request);
    let last = lab.bus.chip.talks.last();
    assert_eq!(last.map(|talk| talk.bytes.len()), Some(9));
    judge::judge(&lab.bus, &lab.unit, book, &circumstances)
}

/// Runs a script and a last good request, which must be answered whatever has been. Nothing else is judged yet.
pub fn play<const MAY_FAIL: bool>(
    config: &Config,
    bus: Bus,
    ops: &[Op],
    book: &Book,
    request: &[u8],
) -> (Lab<MAY_FAIL>, Circumstances) {
    let mut lab = Lab {
        bus,
        unit: Unit::<MAY_FAIL>::new(book, config.latencies.clone()),
        commands: Vec::new(),
        listens: 0,
    };
    let mut circumstances = Circumstances {
        latency: config.latencies.iter().copied().max().unwrap_or(0),
        glitches: false,
        interference: false,
    };
    // The line listens once it was silent for t3.5.
    lab.rest();
    lab.listens = lab.bus.chip.now;
    for op in ops {
        let last = lab.last_end();
        match op {
            Op::Talk { polite, chars } => lab.talk(*polite, chars),
            Op::Glitch(after) => {
                circumstances.glitches = true;
                let at = (last + after).max(lab.bus.chip.now + 1);
                lab.bus.chip.glitches.push(at);
                lab.bus.chip.glitches.sort_unstable();
            }
            Op::Cancel(after) => {
                circumstances.interference = true;
                lab.commands.push((last + after, Command::Cancel));
            }
            Op::Reset(after) => {
                circumstances.interference = true;
                lab.commands.push((last + after, Command::Reset));
            }
        }
    }
    lab.rest();

    // Whatever it was: after a silence the next good request is answered.
    let talks = lab.bus.chip.talks.len();
    let gap = config.settings.t3_5 + config.settings.character + circumstances.latency;
    let gap = gap + (lab.bus.chip.now - lab.last_end());
    lab.talk(true, &frame(gap, request));
    lab.rest();
    assert_eq!(lab.bus.chip.talks.len(), talks + 1, "has not recovered");
    (lab, circumstances)
}
