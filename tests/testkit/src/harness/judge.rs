//! Judges whether the actions of a unit are those that the standard demands for the characters on the wire.

use super::book::{Book, Outcome, framed, unframed};
use super::bus::{Bus, Char, Settings, Talk};
use super::unit::{Event, Unit};
use multidrop_protocol::frame::ReceiveErrors;

/// How a script makes judging easier or harder.
pub struct Circumstances {
    /// The most it takes a task to run.
    pub latency: u64,
    /// Edges on the wire that are no characters: they may cost frames.
    pub glitches: bool,
    /// Futures dropped or the line set up anew: answers may be missing or cut.
    pub interference: bool,
}

/// What was seen, for counting.
#[derive(Clone, Copy, Debug, Default)]
pub struct Verdict {
    pub good: usize,
    pub bad: usize,
    pub answered: usize,
    pub executed: usize,
    /// By how much the latest answer came later than it could.
    pub latest: u64,
}

/// Characters with no silence of t3.5 between them.
#[derive(Clone, Debug)]
pub struct Run {
    /// Index of the first.
    pub first: usize,
    pub last: usize,
    pub end: u64,
    bytes: Vec<u8>,
    damaged: bool,
    /// There was a silence over t1.5 in it.
    gap: bool,
}

impl Run {
    /// Unit id and PDU, if it is a good frame.
    pub fn body(&self) -> Option<&[u8]> {
        unframed(&self.bytes).filter(|_| !self.damaged)
    }
}

/// The runs on the wire, as far as the unit was not talking itself. A character that begins in the very tick in which a
/// silence is over is still within it. After one of the edges in `glitches` the line waits for a character for so long that one
/// which begins half a bit too late is received in time.
pub fn runs(settings: &Settings, chars: &[Char], talks: &[Talk], glitches: &[u64]) -> Vec<Run> {
    let half_bit = settings.character / 20;
    let received = settings.character - half_bit;
    let mut runs: Vec<Run> = Vec::new();
    let mut talks = talks.iter().peekable();
    let mut talked = false;
    for (index, char) in chars.iter().enumerate() {
        while talks.next_if(|talk| talk.end <= char.start).is_some() {
            talked = true;
        }
        if talks
            .peek()
            .is_some_and(|talk| char.start + received > talk.start)
        {
            continue;
        }
        let gap = runs
            .last()
            .map(|run| as_seen(settings, run.end, char.start, glitches));
        let begins = talked || gap.is_none_or(|gap| gap > settings.judged());
        talked = false;
        if begins {
            runs.push(Run {
                first: index,
                last: index,
                end: 0,
                bytes: Vec::new(),
                damaged: false,
                gap: false,
            });
        }
        let run = runs.last_mut().unwrap();
        if !begins && settings.strict && gap.is_some_and(|gap| gap > settings.t1_5) {
            run.damaged = true;
            run.gap = true;
        }
        run.damaged |= !char.errors.is_empty();
        run.last = index;
        run.bytes.push(char.byte);
        run.end = char.start + settings.character;
    }
    runs
}

/// The gap from `end` to a character that begins at `start`, as a line sees it that looks for start bits when t1.5 is over and
/// when it judges: where it has seen one of the edges in `glitches`, it takes a character for in time that is received within
/// the time of one.
fn as_seen(settings: &Settings, end: u64, start: u64, glitches: &[u64]) -> u64 {
    let half_bit = settings.character / 20;
    let gap = start - end;
    let mut cleared = end - half_bit;
    let complete = if settings.strict {
        settings.t1_5
    } else {
        settings.judged()
    };
    for limit in [complete, settings.judged()] {
        if gap <= limit {
            break;
        }
        let seen = |at: &u64| cleared < *at && *at <= end + limit;
        if glitches.iter().any(seen) {
            if gap < limit + half_bit {
                return limit;
            }
            cleared = end + limit;
        }
    }
    gap
}

/// Judges all that has been, from a model as `book` says; leaves `book` as the model must be now.
pub fn judge<const MAY_FAIL: bool>(
    bus: &Bus,
    unit: &Unit<MAY_FAIL>,
    book: &mut Book,
    circumstances: &Circumstances,
) -> Verdict {
    let settings = &bus.chip.settings;
    for talk in &bus.chip.talks {
        let time = talk.bytes.len() as u64 * settings.character;
        if settings.ready_latency < settings.character {
            assert_eq!(talk.end - talk.start, time, "idle between characters");
        } else {
            assert!(talk.end - talk.start >= time);
        }
    }
    let prompt = 4 * circumstances.latency <= settings.character
        && (settings.sees_start_bits || circumstances.latency == 0);
    let verdict = if prompt && !circumstances.glitches && !circumstances.interference {
        judge_exactly(bus, unit, book, circumstances.latency)
    } else {
        judge_what_was_done(bus, unit, book, circumstances)
    };
    assert!(unit.memory.is(book), "the model is not as it must be");
    verdict
}

/// Tasks that are fast enough: everything is known.
fn judge_exactly<const MAY_FAIL: bool>(
    bus: &Bus,
    unit: &Unit<MAY_FAIL>,
    book: &mut Book,
    latency: u64,
) -> Verdict {
    let settings = &bus.chip.settings;
    let mut talks = bus.chip.talks.iter().peekable();
    let mut executed = unit.events.iter().filter_map(|event| match event {
        Event::Executed(request, at) => Some((*request, *at)),
        _ => None,
    });
    let mut told = unit.events.iter().filter_map(|event| match event {
        Event::Damaged(errors) => Some(*errors),
        _ => None,
    });
    let mut verdict = Verdict::default();
    for run in runs(settings, &bus.chip.chars, &bus.chip.talks, &[]) {
        let Some(body) = run.body() else {
            verdict.bad += 1;
            let errors = told.next().expect("a damaged frame is not told");
            assert_eq!(errors.contains(ReceiveErrors::GAP), run.gap, "{errors:?}");
            continue;
        };
        verdict.good += 1;
        let Outcome { answer, executes } = book.ask(body);
        if executes {
            verdict.executed += 1;
            let executed = executed.next();
            let (request, at) = executed.unwrap_or_else(|| panic!("not executed: {body:02X?}"));
            assert_eq!(request, run.first, "executed something else");
            // Not only when the answer is over.
            let due = run.end + settings.to_stand();
            assert!((due..=due + 3 * latency).contains(&at), "executed late");
        }
        let Some(answer) = answer else { continue };
        // Ready when the silence is over, unless something had to wait for that.
        let waited =
            !settings.strict || executes && (MAY_FAIL || !matches!(body[1], 5 | 6 | 15 | 16));
        let late = if waited { 3 * latency } else { 0 };
        let next = bus.chip.chars.get(run.last + 1).map(|char| char.start);
        let somebody_by = |at| next.is_some_and(|next| next <= run.end + at);
        if somebody_by(settings.t3_5) {
            continue;
        }
        let withheld = somebody_by(settings.to_answer() + late);
        let Some(talk) = talks.next_if(|talk| talk.request == run.first) else {
            assert!(late > 0 && withheld, "not answered: {body:02X?}");
            continue;
        };
        verdict.answered += 1;
        assert_eq!(talk.bytes, framed(&answer), "wrong answer to {body:02X?}");
        let after = talk.start - run.end;
        let due = settings.to_answer();
        assert!(
            (due..=due + late).contains(&after),
            "answered after {after}, due after {due}"
        );
        verdict.latest = verdict.latest.max(after - due);
    }
    assert_eq!(
        talks.next().map(|talk| talk.request),
        None,
        "talked unasked"
    );
    assert_eq!(executed.next(), None, "executed unasked");
    assert_eq!(told.next(), None, "told of a frame that was not damaged");
    verdict
}

/// Frames may be lost; what was done must have been right to do.
fn judge_what_was_done<const MAY_FAIL: bool>(
    bus: &Bus,
    unit: &Unit<MAY_FAIL>,
    book: &mut Book,
    circumstances: &Circumstances,
) -> Verdict {
    let settings = &bus.chip.settings;
    let (chars, talks) = (&bus.chip.chars, &bus.chip.talks);
    let received = settings.character - settings.character / 20;
    let seen: &[u64] = if settings.sees_start_bits {
        &bus.chip.glitches
    } else {
        &[]
    };
    let runs = runs(settings, chars, talks, seen);
    let mut verdict = Verdict::default();
    let mut talks = talks.iter().peekable();
    let mut current: Option<(usize, Outcome, Book)> = None;
    let mut told_unexecuted = None;
    for event in unit.events.iter().copied() {
        match event {
            Event::Damaged(_) => {}
            Event::Fetched(first) => {
                assert_eq!(told_unexecuted, None, "told what it has not done");
                let talk = talks.next_if(|talk| talk.request == first);
                let run = runs.iter().find(|run| run.first == first);
                let Some((run, body)) = run.and_then(|run| Some((run, run.body()?))) else {
                    assert!(talk.is_none(), "answered a bad frame");
                    // It seemed one at t1.5.
                    current = None;
                    verdict.bad += 1;
                    continue;
                };
                verdict.good += 1;
                let mut after = book.clone();
                let outcome = after.ask(body);
                if let Some(talk) = talk {
                    let answer = outcome.answer.as_ref();
                    let answer = framed(answer.unwrap_or_else(|| panic!("answered {body:02X?}")));
                    if let Some(most) = talk.cut {
                        assert!(circumstances.interference && answer.starts_with(&talk.bytes));
                        assert!(talk.bytes.len() <= most, "goes on without its buffer");
                    } else {
                        assert_eq!(talk.bytes, answer, "wrong answer to {body:02X?}");
                    }
                    assert!(talk.start >= run.end + settings.t3_5, "too early");
                    let between = chars.iter().map(|char| char.start + received);
                    let stale = between
                        .filter(|&at| at > run.end && at < talk.start)
                        .count();
                    assert_eq!(stale, 0, "answered after others have talked");
                    verdict.answered += 1;
                    let due = run.end + settings.to_answer();
                    verdict.latest = verdict.latest.max(talk.start.saturating_sub(due));
                    if outcome.executes && !circumstances.interference {
                        told_unexecuted = Some(first);
                    }
                }
                current = Some((first, outcome, after));
            }
            Event::Executed(first, _) => {
                let (fetched, outcome, after) = current.take().expect("executed unasked");
                assert_eq!(fetched, first);
                assert!(outcome.executes, "executed what it must not");
                *book = after;
                told_unexecuted = None;
                verdict.executed += 1;
            }
        }
    }
    assert_eq!(told_unexecuted, None, "told what it has not done");
    assert_eq!(
        talks.next().map(|talk| talk.request),
        None,
        "talked unasked"
    );
    verdict
}
