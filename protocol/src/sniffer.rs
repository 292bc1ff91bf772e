//! What a port that only listens makes of the frames it hears: which is a request, which answers it, and a line of text for
//! each.
//!
//! Nothing in a frame says which way it goes; an answer is known by what it follows, and by its shape. A request that is
//! repeated because nobody answered it looks like the answer of Write Single Coil, Write Single Register, Mask Write
//! Register and Diagnostics, which repeat the request; the two cannot be told apart, and the second is taken for the answer.

use crate::BROADCAST;
use crate::function::{self, EXCEPTION_BIT};
use crate::rtu::Flaws;

/// Which way a frame goes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Direction {
    /// From the client.
    Request,
    /// From the server that was asked last.
    Answer,
    /// From the server that was asked last: it refuses.
    Exception,
}

/// What was heard, counted since the start. The counters go round.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Heard {
    /// Requests, broadcasts included.
    pub requests: u32,
    /// Requests to unit 0.
    pub broadcasts: u32,
    /// Answers, exceptions not included.
    pub answers: u32,
    /// Exceptions.
    pub exceptions: u32,
    /// Requests to a unit that another request followed before any answer.
    pub unanswered: u32,
    /// Damaged frames.
    pub damaged: u32,
}

/// Pairs requests with answers, and counts.
#[derive(Clone, Copy, Debug, Default)]
pub struct Sniffer {
    /// Unit id and function code of the request that is not answered yet.
    asked: Option<(u8, u8)>,
    heard: Heard,
}

impl Sniffer {
    /// Nothing heard yet.
    pub const fn new() -> Sniffer {
        Sniffer {
            asked: None,
            heard: Heard {
                requests: 0,
                broadcasts: 0,
                answers: 0,
                exceptions: 0,
                unanswered: 0,
                damaged: 0,
            },
        }
    }

    /// The counters.
    pub const fn heard(&self) -> Heard {
        self.heard
    }

    /// A good frame: unit id, function code and data.
    pub fn frame(&mut self, frame: &[u8]) -> Direction {
        let direction = self.direction(frame);
        let count = |counter: &mut u32| *counter = counter.wrapping_add(1);
        match direction {
            Direction::Answer => count(&mut self.heard.answers),
            Direction::Exception => count(&mut self.heard.exceptions),
            Direction::Request => {
                if self.asked.is_some() {
                    count(&mut self.heard.unanswered);
                }
                count(&mut self.heard.requests);
                let unit = frame.first().copied().unwrap_or(BROADCAST);
                if unit == BROADCAST {
                    count(&mut self.heard.broadcasts);
                }
                let function = frame.get(1).copied().unwrap_or(0);
                self.asked = (unit != BROADCAST).then_some((unit, function));
                return direction;
            }
        }
        self.asked = None;
        direction
    }

    /// A damaged frame. Whether it was the answer nobody can tell: the request stays open.
    pub fn damaged(&mut self) {
        self.heard.damaged = self.heard.damaged.wrapping_add(1);
    }

    fn direction(&self, frame: &[u8]) -> Direction {
        match (self.asked, frame) {
            (Some((unit, function)), [from, code, data @ ..]) if unit == *from => {
                if *code == function | EXCEPTION_BIT && function & EXCEPTION_BIT == 0 {
                    match data {
                        [_] => Direction::Exception,
                        _ => Direction::Request,
                    }
                } else if *code == function && may_answer(function, data) {
                    Direction::Answer
                } else {
                    Direction::Request
                }
            }
            _ => Direction::Request,
        }
    }
}

/// Whether data behind this function code may be an answer's. An answer that is as long as the request may be either.
fn may_answer(function: u8, data: &[u8]) -> bool {
    // A block behind its byte count.
    let counted = |data: &[u8]| match data {
        [count, rest @ ..] => usize::from(*count) == rest.len(),
        [] => false,
    };
    match function {
        function::READ_COILS
        | function::READ_DISCRETE_INPUTS
        | function::GET_COMM_EVENT_LOG
        | function::REPORT_SERVER_ID => counted(data),
        function::READ_HOLDING_REGISTERS
        | function::READ_INPUT_REGISTERS
        | function::READ_WRITE_REGISTERS => counted(data) && data.len() % 2 == 1,
        function::READ_FILE_RECORD => {
            // The groups of a request begin with the reference type, those of an answer with their length.
            counted(data) && data.get(1) != Some(&function::REFERENCE_TYPE)
        }
        function::WRITE_SINGLE_COIL
        | function::WRITE_SINGLE_REGISTER
        | function::WRITE_MULTIPLE_COILS
        | function::WRITE_MULTIPLE_REGISTERS
        | function::GET_COMM_EVENT_COUNTER => data.len() == 4,
        function::READ_EXCEPTION_STATUS => data.len() == 1,
        function::MASK_WRITE_REGISTER => data.len() == 6,
        function::READ_FIFO_QUEUE => data.len() >= 4,
        function::ENCAPSULATED_INTERFACE => data.len() >= 6,
        _ => true,
    }
}

/// Where a line of text goes, piece by piece.
pub trait Text {
    /// One more character of ASCII.
    fn push(&mut self, character: u8);

    /// More of them.
    fn extend(&mut self, text: &[u8]) {
        for &character in text {
            self.push(character);
        }
    }
}

/// The longest line, in characters: a time of 20 digits, and a frame of 254 bytes.
pub const LINE_MAX: usize = 20 + 1 + 1 + 3 + 3 * 254 + 2;

/// Writes a frame as a line: seconds with six decimals, `req`, `ans` or `exc`, the bytes of unit id and PDU in hexadecimal,
/// CR and LF. Such as `12.345678 req 11 03 00 6B 00 03`.
pub fn write_frame(text: &mut impl Text, time_us: u64, direction: Direction, frame: &[u8]) {
    write_time(text, time_us);
    text.extend(match direction {
        Direction::Request => b" req",
        Direction::Answer => b" ans",
        Direction::Exception => b" exc",
    });
    for byte in frame {
        text.push(b' ');
        text.push(digit(byte >> 4));
        text.push(digit(byte & 0x0F));
    }
    text.extend(b"\r\n");
}

/// Writes a damaged frame as a line: time, `bad`, and each flaw by name. Such as `12.345678 bad gap check`.
pub fn write_damaged(text: &mut impl Text, time_us: u64, flaws: Flaws) {
    write_time(text, time_us);
    text.extend(b" bad");
    for (flaw, name) in [
        (Flaws::GAP, " gap"),
        (Flaws::PARITY, " parity"),
        (Flaws::FRAMING, " framing"),
        (Flaws::OVERRUN, " overrun"),
        (Flaws::LENGTH, " length"),
        (Flaws::CHECK, " check"),
        (Flaws::CHARACTER, " character"),
    ] {
        if flaws.contains(flaw) {
            text.extend(name.as_bytes());
        }
    }
    text.extend(b"\r\n");
}

fn write_time(text: &mut impl Text, time_us: u64) {
    write_number(text, time_us / 1_000_000, 1);
    text.push(b'.');
    write_number(text, time_us % 1_000_000, 6);
}

/// In decimal, with leading zeros up to so many digits.
fn write_number(text: &mut impl Text, number: u64, digits: usize) {
    let mut written = [b'0'; 20];
    let mut first = written.len();
    let mut rest = number;
    while rest > 0 || written.len() - first < digits {
        first -= 1;
        written[first] = b'0' + (rest % 10) as u8;
        rest /= 10;
    }
    text.extend(&written[first..]);
}

const fn digit(value: u8) -> u8 {
    match value {
        0..=9 => b'0' + value,
        _ => b'A' + value - 10,
    }
}
