//! What a port that only listens makes of the frames it hears: which is a request, which answers it, and a line of text for
//! each.
//!
//! Nothing in a frame says which way it goes; an answer is known by what it follows, and by its shape. Where the shape leaves
//! both open, time tells and repetition. Functions 05, 06, 08, 15 and 16 are answered with the same bytes, so the same bytes
//! are the answer if they come within the time that an answer takes to begin, and after that the request once more. Those of
//! other functions are never answered with the same bytes. Three bytes of coils or discrete inputs look like a request at
//! 0x0300 to 0x03FF: they are the answer to a request of so many, within that time.

use crate::BROADCAST;
use crate::crc;
use crate::function::{self, EXCEPTION_BIT};
use crate::rtu::ReceiveErrors;

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
pub struct Counts {
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

/// A request that is not answered yet.
#[derive(Clone, Copy, Debug)]
struct Asked {
    unit: u8,
    function: u8,
    len: u8,
    crc: u16,
    /// The first data: an address and a number, mostly.
    head: [u8; 4],
    time_us: u64,
}

impl Asked {
    fn new(frame: &[u8], time_us: u64) -> Asked {
        let byte = |at: usize| frame.get(at).copied().unwrap_or(0);
        Asked {
            unit: byte(0),
            function: byte(1),
            len: frame.len() as u8,
            crc: crc::checksum(frame),
            head: [byte(2), byte(3), byte(4), byte(5)],
            time_us,
        }
    }

    fn is_repeated(&self, frame: &[u8]) -> bool {
        frame.len() == usize::from(self.len) && crc::checksum(frame) == self.crc
    }

    /// Whether the answer has as many coils or discrete inputs as were asked for.
    fn has_bits(&self, count: u8) -> bool {
        let [.., high, low] = self.head;
        u16::from_be_bytes([high, low]).div_ceil(8) == count.into()
    }
}

/// Pairs requests with answers, and counts.
#[derive(Clone, Copy, Debug)]
pub struct Sniffer {
    asked: Option<Asked>,
    patience_us: u64,
    counts: Counts,
}

impl Sniffer {
    /// How long after a request what may be either is its answer, in ms, if not said otherwise: longer than servers take,
    /// shorter than most clients wait before they ask once more.
    pub const PATIENCE_MS: u32 = 200;

    /// Nothing heard yet. What may be either is an answer within `patience_ms` of the request: no longer than the client's
    /// timeout.
    pub const fn new(patience_ms: u32) -> Sniffer {
        Sniffer {
            asked: None,
            patience_us: 1000 * patience_ms as u64,
            counts: Counts {
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
    pub const fn counts(&self) -> Counts {
        self.counts
    }

    /// A good frame: unit id, function code and data, and when it was over, in us since any moment.
    pub fn frame(&mut self, frame: &[u8], time_us: u64) -> Direction {
        let direction = self.direction(frame, time_us);
        let count = |counter: &mut u32| *counter = counter.wrapping_add(1);
        match direction {
            Direction::Answer => count(&mut self.counts.answers),
            Direction::Exception => count(&mut self.counts.exceptions),
            Direction::Request => {
                if self.asked.is_some() {
                    count(&mut self.counts.unanswered);
                }
                count(&mut self.counts.requests);
                let unit = frame.first().copied().unwrap_or(BROADCAST);
                if unit == BROADCAST {
                    count(&mut self.counts.broadcasts);
                }
                self.asked = (unit != BROADCAST).then(|| Asked::new(frame, time_us));
                return direction;
            }
        }
        self.asked = None;
        direction
    }

    /// A damaged frame. Whether it was the answer nobody can tell: the request stays open.
    pub fn damaged(&mut self) {
        self.counts.damaged = self.counts.damaged.wrapping_add(1);
    }

    fn direction(&self, frame: &[u8], time_us: u64) -> Direction {
        let (Some(asked), [from, code, data @ ..]) = (&self.asked, frame) else {
            return Direction::Request;
        };
        let function = asked.function;
        let is_exception = *code == function | EXCEPTION_BIT && function & EXCEPTION_BIT == 0;
        if asked.unit != *from {
            Direction::Request
        } else if is_exception && data.len() == 1 {
            Direction::Exception
        } else if *code != function || !may_answer(function, data) {
            Direction::Request
        } else {
            let in_time = time_us.saturating_sub(asked.time_us) <= self.patience_us;
            let is_answer = match (likeness(function), data) {
                (Likeness::Same, _) => asked.is_repeated(frame) && in_time,
                (Likeness::Any, _) => in_time,
                (Likeness::Bits, [count, _, _, _]) => {
                    asked.has_bits(*count) && in_time && !asked.is_repeated(frame)
                }
                _ => !asked.is_repeated(frame),
            };
            if is_answer {
                Direction::Answer
            } else {
                Direction::Request
            }
        }
    }
}

/// How much an answer looks like a request of the same function.
enum Likeness {
    /// It is the same, byte for byte.
    Same,
    /// It may be, or anything else.
    Any,
    /// One of three bytes of coils or discrete inputs may look like another request.
    Bits,
    /// Not at all.
    None,
}

const fn likeness(function: u8) -> Likeness {
    match function {
        function::WRITE_SINGLE_COIL
        | function::WRITE_SINGLE_REGISTER
        | function::WRITE_FILE_RECORD
        | function::MASK_WRITE_REGISTER => Likeness::Same,
        function::READ_COILS | function::READ_DISCRETE_INPUTS => Likeness::Bits,
        function::READ_HOLDING_REGISTERS
        | function::READ_INPUT_REGISTERS
        | function::READ_EXCEPTION_STATUS
        | function::GET_COMM_EVENT_COUNTER
        | function::GET_COMM_EVENT_LOG
        | function::WRITE_MULTIPLE_COILS
        | function::WRITE_MULTIPLE_REGISTERS
        | function::REPORT_SERVER_ID
        | function::READ_FILE_RECORD
        | function::READ_WRITE_REGISTERS
        | function::READ_FIFO_QUEUE
        | function::ENCAPSULATED_INTERFACE => Likeness::None,
        // Diagnostics and what is the application's.
        _ => Likeness::Any,
    }
}

/// Whether data behind this function code may be an answer's.
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
pub fn write_damaged(text: &mut impl Text, time_us: u64, errors: ReceiveErrors) {
    write_time(text, time_us);
    text.extend(b" bad");
    for (flaw, name) in [
        (ReceiveErrors::GAP, " gap"),
        (ReceiveErrors::PARITY, " parity"),
        (ReceiveErrors::FRAMING, " framing"),
        (ReceiveErrors::OVERRUN, " overrun"),
        (ReceiveErrors::LENGTH, " length"),
        (ReceiveErrors::CHECK, " check"),
        (ReceiveErrors::CHARACTER, " character"),
    ] {
        if errors.contains(flaw) {
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
