//! The frames on RS4's wire against the lines that RS2 prints, for any length of time.

use std::collections::VecDeque;

use multidrop_bus::{Line, Station, Time, WireByte};

use super::super::plain::wire::{from_rtu, hex};
use super::{LINE, RS2, RS4, Report, TIMEOUT};

/// A line is printed within this time of its frame's end.
const PRINTED: Time = Time::from_ms(20);

/// A request, and when its last stop bit ended.
struct Open {
    body: Vec<u8>,
    end: Time,
    /// Sent at a rate that no unit has.
    is_away: bool,
}

/// See the module.
pub struct Sniffed {
    /// The station of RS4.
    master: Station,
    /// Characters of the frame that may not be over.
    characters: Vec<WireByte>,
    open: Option<Open>,
    /// Lines to come without their time, and when their frames ended.
    expected: VecDeque<(String, Time)>,
    text: String,
    printed_at: f64,
}

impl Sniffed {
    /// Nothing heard yet: to be told of all that was since the start.
    pub fn new(master: Station) -> Self {
        Sniffed {
            master,
            characters: Vec::new(),
            open: None,
            expected: VecDeque::new(),
            text: String::new(),
            printed_at: 0.0,
        }
    }

    /// What was on the wire since the last call.
    pub fn heard(&mut self, characters: &[WireByte], now: Time, report: &mut Report) {
        let mut characters = characters.to_vec();
        characters.sort_by_key(|character| character.start);
        for character in characters {
            if let Some(last) = self.characters.last() {
                let pause = character.start.saturating_sub(last.end);
                let is_silence = pause >= LINE.t35();
                if last.from != character.from && !is_silence {
                    report.wrong(format!("{now}, RS4: {pause} between two frames"));
                }
                if last.from != character.from || is_silence {
                    self.judge(report);
                }
            }
            self.characters.push(character);
        }
        let last = self.characters.last();
        if last.is_some_and(|last| now >= last.end + LINE.t35() * 2) {
            self.judge(report);
        }
    }

    /// A frame is over. There is one request at a time: what follows it is its answer, or another one after the timeout.
    fn judge(&mut self, report: &mut Report) {
        let characters = std::mem::take(&mut self.characters);
        let (Some(first), Some(last)) = (characters.first(), characters.last()) else {
            return;
        };
        let bytes: Vec<u8> = characters.iter().map(|one| one.value as u8).collect();
        let told = format!("{}, RS4: {}", first.start, hex(&bytes));
        let Some(body) = from_rtu(&bytes).filter(|_| characters.iter().all(WireByte::is_good))
        else {
            return report.wrong(format!("{told} is damaged"));
        };
        let open = self.open.take();
        let way = if first.from == self.master {
            if let Some(open) = open {
                if first.start < open.end + TIMEOUT {
                    report.wrong(format!("{told} while {} was asked", hex(&open.body)));
                } else if !open.is_away {
                    report.lost(format!("{told} after {} without answer", hex(&open.body)));
                }
            }
            let character = last.end.saturating_sub(last.start);
            self.open = Some(Open {
                body: body.clone(),
                end: last.end,
                is_away: !is_about(character, LINE),
            });
            "req"
        } else {
            match open {
                Some(open) if open.body[0] == body[0] && open.body[1] == body[1] => {
                    report.answers[RS4] += 1;
                }
                _ => report.wrong(format!("{told} answers nobody")),
            }
            "ans"
        };
        let line = format!("{way} {}", hex(&body));
        self.expected.push_back((line, last.end));
    }

    /// What was printed since the last call.
    pub fn printed(&mut self, text: &str, report: &mut Report) {
        self.text.push_str(text);
        // A line may be there before its frame is known to be over.
        while let Some(len) = self.text.find("\r\n")
            && let Some((expected, _)) = self.expected.pop_front()
        {
            let line: String = self.text.drain(..len + 2).collect();
            let (time, rest) = line.trim_end().split_once(' ').unwrap_or(("", ""));
            let time = time.parse().unwrap_or(0.0);
            if rest != expected || time <= self.printed_at {
                report.wrong(format!("{line:?} was printed, not {expected}"));
            } else {
                report.answers[RS2] += 1;
            }
            self.printed_at = time;
        }
    }

    /// At the end.
    pub fn finish(&self, now: Time, report: &mut Report) {
        for (line, end) in &self.expected {
            if *end + PRINTED < now {
                report.lost(format!("{line}, which ended at {end}, was not printed"));
            }
        }
        let lines = self.text.matches("\r\n").count();
        if lines > 1 {
            report.wrong(format!("{lines} lines too many: {:?}", self.text));
        }
    }
}

/// Whether it is the time of a character, as far as a divider makes it.
fn is_about(character: Time, line: Line) -> bool {
    let exact = line.character();
    let off = character.saturating_sub(exact) + exact.saturating_sub(character);
    off * 40 < exact
}
