//! A plain reading of an ASCII line that judges the actions of a unit. Shares no code with the crate under test.

use super::book::{Book, Outcome};
use super::bus::{Bus, Char, SECOND, Settings, Talk};
use super::judge::{Circumstances, Verdict};
use super::script::{self, Config, Lab, Op};
use super::unit::{Event, Unit};
use multidrop_protocol::frame::ReceiveErrors;

/// The frame of a unit id and a PDU, as text.
pub fn framed(body: &[u8]) -> Vec<u8> {
    let sum: u32 = body.iter().map(|&byte| u32::from(byte)).sum();
    let check = (0x10000 - sum) % 0x100;
    let digits: String = body.iter().map(|byte| format!("{byte:02X}")).collect();
    format!(":{digits}{check:02X}\r\n").into_bytes()
}

/// Unit id and PDU, if the text between `:` and CR is one of a good frame.
fn unframed(text: &[u8]) -> Option<Vec<u8>> {
    if !text.len().is_multiple_of(2) || !(6..=510).contains(&text.len()) {
        return None;
    }
    let mut bytes = Vec::new();
    for two in text.chunks(2) {
        bytes.push((value(two[0])? * 16 + value(two[1])?) as u8);
    }
    let sum: u32 = bytes.iter().map(|&byte| u32::from(byte)).sum();
    bytes.pop();
    sum.is_multiple_of(256).then_some(bytes)
}

fn value(digit: u8) -> Option<u32> {
    char::from(digit).to_digit(16)
}

/// What a listener has heard.
#[derive(Clone, Debug, PartialEq)]
pub struct Heard {
    /// The character that began it, and the one that ended it.
    pub first: usize,
    pub last: usize,
    /// Unit id and PDU; `None` if it is damaged.
    pub body: Option<Vec<u8>>,
}

/// A frame that is not over.
struct Open {
    first: usize,
    text: Vec<u8>,
    flawed: bool,
    /// Where the last character ended.
    end: u64,
}

impl Open {
    /// Whether no end could make it good any more.
    fn is_lost(&self) -> bool {
        let odd = |&character: &u8| value(character).is_none();
        self.flawed || self.text.len() >= 512 || self.text.iter().any(odd)
    }
}

/// Every frame among these characters, in the order in which they were over, as far as the unit was not talking itself.
pub fn read(settings: &Settings, chars: &[Char], talks: &[Talk], until: u64) -> Vec<Heard> {
    let received = settings.character - settings.character / 20;
    // One that begins up to half a bit late is received with one that began in time.
    let longest = SECOND + settings.character / 20;
    let mut heard = Vec::new();
    let mut open: Option<Open> = None;
    for (index, char) in chars.iter().enumerate() {
        let during = |talk: &Talk| char.start + received > talk.start && char.start < talk.end;
        if talks.iter().any(during) {
            continue;
        }
        if let Some(frame) = open.take_if(|frame| char.start >= frame.end + longest) {
            heard.push(frame.damaged(index - 1));
        }
        let good = char.errors.is_empty();
        let Some(frame) = &mut open else {
            if good && char.byte == b':' {
                open = Some(Open::at(index, char, settings));
            }
            continue;
        };
        frame.end = char.start + settings.character;
        let after_cr = frame.text.last() == Some(&b'\r');
        if good && after_cr && char.byte == b'\n' {
            frame.text.pop();
            let body = unframed(&frame.text).filter(|_| !frame.flawed);
            heard.push(Heard {
                first: frame.first,
                last: index,
                body,
            });
            open = None;
        } else if good && char.byte == b':' {
            if frame.is_lost() {
                heard.push(frame.damaged(index));
            }
            open = Some(Open::at(index, char, settings));
        } else {
            frame.flawed |= !good;
            // What came with a flaw is nothing that could end a frame.
            frame.text.push(if good { char.byte } else { b'?' });
        }
    }
    if let Some(frame) = open.take_if(|frame| until > frame.end + longest) {
        heard.push(frame.damaged(chars.len() - 1));
    }
    heard
}

impl Open {
    fn at(first: usize, char: &Char, settings: &Settings) -> Open {
        Open {
            first,
            text: Vec::new(),
            flawed: false,
            end: char.start + settings.character,
        }
    }

    fn damaged(&self, last: usize) -> Heard {
        Heard {
            first: self.first,
            last,
            body: None,
        }
    }
}

/// Runs a script like [`script::run`], on a line that is set up for ASCII and sees start bits.
pub fn run<const MAY_FAIL: bool>(config: &Config, ops: &[Op], book: &mut Book) -> Verdict {
    assert!(config.settings.sees_start_bits);
    let bus = Bus::ascii(config.settings.clone());
    let request = framed(&[super::book::UNIT, 3, 0, 3, 0, 2]);
    let (lab, circumstances) = script::play::<MAY_FAIL>(config, bus, ops, book, &request);
    let Lab { bus, unit, .. } = &lab;
    let last = bus.chip.talks.last();
    assert_eq!(last.map(|talk| talk.bytes.len()), Some(19));
    for talk in &bus.chip.talks {
        let time = talk.bytes.len() as u64 * bus.chip.settings.character;
        assert!(talk.end - talk.start >= time);
        if bus.chip.settings.ready_latency < bus.chip.settings.character {
            assert_eq!(talk.end - talk.start, time, "idle between characters");
        }
    }
    let verdict = judge(bus, unit, book, &circumstances);
    assert!(unit.memory.is(book), "the model is not as it must be");
    verdict
}

/// What the unit did with one frame.
struct Done<'a> {
    fetched: bool,
    executed: Option<u64>,
    talk: Option<&'a Talk>,
}

fn judge<const MAY_FAIL: bool>(
    bus: &Bus,
    unit: &Unit<MAY_FAIL>,
    book: &mut Book,
    circumstances: &Circumstances,
) -> Verdict {
    let settings = &bus.chip.settings;
    let (chars, talks) = (&bus.chip.chars, &bus.chip.talks);
    let heard = read(settings, chars, talks, bus.chip.now);
    let prompt = 4 * circumstances.latency <= settings.character && !circumstances.interference;
    let mut verdict = Verdict::default();
    let mut events = unit
        .events
        .iter()
        .filter(|event| !matches!(event, Event::Damaged(_)))
        .peekable();
    let mut left = talks.iter().peekable();
    let mut lost = 0;
    for frame in &heard {
        let Some(body) = &frame.body else {
            verdict.bad += 1;
            continue;
        };
        let fetched = events
            .next_if(|event| **event == Event::Fetched(frame.first))
            .is_some();
        let executed = events.next_if(
            |event| matches!(event, Event::Executed(request, _) if *request == frame.first),
        );
        let done = Done {
            fetched,
            executed: executed.map(|event| match event {
                Event::Executed(_, at) => *at,
                _ => unreachable!(),
            }),
            talk: left.next_if(|talk| talk.request == frame.first),
        };
        if !done.fetched {
            assert!(!prompt, "not told of a good frame: {body:02X?}");
            lost += 1;
            continue;
        }
        verdict.good += 1;
        let mut after = book.clone();
        let outcome = after.ask(body);
        if done.executed.is_some() {
            assert!(outcome.executes, "executed what it must not");
            *book = after;
            verdict.executed += 1;
        } else if outcome.executes {
            assert!(circumstances.interference, "not executed: {body:02X?}");
        }
        judge_answer(bus, frame, &outcome, &done, circumstances, &mut verdict);
        if prompt {
            let end = chars[frame.last].start + settings.character;
            let at = done.executed.unwrap_or(end);
            assert!(at <= end + 3 * circumstances.latency, "executed late");
        }
    }
    assert_eq!(events.next(), None, "fetched or executed unasked");
    assert_eq!(left.next().map(|talk| talk.request), None, "talked unasked");
    if !circumstances.interference {
        // Each frame is fetched, or told as damaged. One that a slow task had no buffer for is damaged too when a `:` cuts it
        // short, which else is told of nobody.
        let told = unit.events.iter();
        let told = told.filter(|event| matches!(event, Event::Damaged(_)));
        let told = told.count().wrapping_sub(verdict.bad + lost);
        let colons = chars.iter().filter(|char| char.byte == b':').count();
        let most = if prompt { 0 } else { colons };
        assert!(told <= most, "damaged frames told: {told} too many");
    }
    verdict
}

/// Where an answer must begin: t3.5 after the last character, those outside of frames included, unless a `:` comes before.
fn due(bus: &Bus, frame: &Heard) -> Option<u64> {
    let settings = &bus.chip.settings;
    let chars = &bus.chip.chars;
    let received = settings.character - settings.character / 20;
    let half_stop = settings.character - received;
    let mut from = chars[frame.last].start + settings.character;
    let mut seen = chars[frame.last].start + received;
    let mut at = from + settings.t3_5;
    let mut next = frame.last + 1;
    loop {
        match chars.get(next) {
            Some(char) if char.start + received <= at => {
                if char.byte == b':' && char.errors.is_empty() {
                    return None;
                }
                from = char.start + received + half_stop;
                seen = char.start + received;
                at = from + settings.t3_5;
                next += 1;
                continue;
            }
            _ => {}
        }
        // An edge holds it back for a character.
        if !edge_between(bus, seen, at) {
            return Some(at);
        }
        seen = at;
        at += settings.character;
    }
}

/// Whether the wire has changed after `from` and by `to`.
fn edge_between(bus: &Bus, from: u64, to: u64) -> bool {
    let bit = bus.chip.settings.character / 10;
    let in_time = |at: u64| from < at && at <= to;
    bus.chip.glitches.iter().any(|&at| in_time(at))
        || bus.chip.chars.iter().any(|char| {
            let mut level = true;
            (0..10).any(|index| {
                let now = match index {
                    0 => false,
                    9 => true,
                    _ => char.byte >> (index - 1) & 1 == 1,
                };
                std::mem::replace(&mut level, now) != now && in_time(char.start + index * bit)
            })
        })
}

fn judge_answer(
    bus: &Bus,
    frame: &Heard,
    outcome: &Outcome,
    done: &Done,
    circumstances: &Circumstances,
    verdict: &mut Verdict,
) {
    let settings = &bus.chip.settings;
    let chars = &bus.chip.chars;
    let end = chars[frame.last].start + settings.character;
    let received = settings.character - settings.character / 20;
    let prompt = 4 * circumstances.latency <= settings.character && !circumstances.interference;
    let Some(talk) = done.talk else {
        if let (Some(_), Some(at)) = (&outcome.answer, due(bus, frame)) {
            assert!(!prompt, "not answered, due at {at}: {:02X?}", frame.body);
        }
        return;
    };
    verdict.answered += 1;
    let answer = outcome
        .answer
        .as_ref()
        .expect("answered what asks for none");
    if let Some(most) = talk.cut {
        assert!(circumstances.interference && framed(answer).starts_with(&talk.bytes));
        assert!(talk.bytes.len() <= most, "goes on without its buffer");
    } else {
        assert_eq!(
            talk.bytes,
            framed(answer),
            "wrong answer to {:02X?}",
            frame.body
        );
    }
    assert!(talk.start >= end + settings.t3_5, "too early");
    for char in &chars[frame.last + 1..] {
        if char.start + received > talk.start {
            break;
        }
        let over = char.start + settings.character;
        assert!(talk.start >= over + settings.t3_5, "no silence before");
        assert!(
            char.byte != b':' || !char.errors.is_empty(),
            "answered after somebody has asked anew"
        );
    }
    if prompt {
        assert_eq!(Some(talk.start), due(bus, frame));
    }
    verdict.latest = verdict.latest.max(talk.start - end - settings.t3_5);
}

/// A character without errors.
pub fn plain(start: u64, byte: u8) -> Char {
    let errors = ReceiveErrors::NONE;
    Char {
        start,
        byte,
        errors,
    }
}
