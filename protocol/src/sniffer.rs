//! The sniffer of a port that only listens: tells requests from answers, and formats each frame as a line of text.
//!
//! A frame does not contain its direction; an answer is recognised by the request before it and by its shape. Where
//! the shape allows both, time and repetition decide. Functions 05, 06, 08, 15 and 16 are answered with the bytes of
//! the request. If they are repeated within the time in which an answer begins, they are the answer; after that, they
//! are the request sent again. Other functions are never answered with the bytes of the request. Three bytes of coils
//! or discrete inputs look like a request at 0x0300 to 0x03FF: within that time, they are the answer to a request for
//! that number.

use crate::BROADCAST;
use crate::crc;
use crate::frame::ReceiveErrors;
use crate::function::{self, EXCEPTION_BIT};

/// The direction of a frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Direction {
    /// From the client.
    Request,
    /// From the server that was addressed last.
    Answer,
    /// From the server that was addressed last: an exception.
    Exception,
}

/// Counts of the frames since the start. The counters wrap around.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Counts {
    /// The number of requests, broadcasts included.
    pub requests: u32,
    /// The number of requests to unit 0.
    pub broadcasts: u32,
    /// The number of answers, exceptions not included.
    pub answers: u32,
    /// The number of exceptions.
    pub exceptions: u32,
    /// The number of requests that were followed by another request instead of an answer.
    pub unanswered: u32,
    /// The number of damaged frames.
    pub damaged: u32,
}

/// A request without an answer so far.
#[derive(Clone, Copy, Debug)]
struct Asked {
    unit: u8,
    function: u8,
    len: u8,
    crc: u16,
    /// The first bytes of data, in most functions an address and a number.
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

    /// Whether the answer has the number of coils or discrete inputs that was requested.
    fn has_bits(&self, count: u8) -> bool {
        let [.., high, low] = self.head;
        u16::from_be_bytes([high, low]).div_ceil(8) == count.into()
    }
}

/// Pairs requests with answers, and counts them.
#[derive(Clone, Copy, Debug)]
pub struct Sniffer {
    asked: Option<Asked>,
    patience_us: u64,
    counts: Counts,
}

impl Sniffer {
    /// The default of the time in ms after a request within which an ambiguous frame is its answer: longer than
    /// servers take, shorter than most clients wait before a retry.
    pub const PATIENCE_MS: u32 = 200;

    /// A sniffer that has received nothing. An ambiguous frame within `patience_ms` after a request is its answer;
    /// use no more than the client's timeout.
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

    /// The counts since the start.
    pub const fn counts(&self) -> Counts {
        self.counts
    }

    /// Takes a good frame (unit id, function code and data) and the time of its end in us; returns its direction.
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

    /// Counts a damaged frame. It may have been the answer or not, so the request stays open.
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

/// How much an answer looks like a request with the same function code.
enum Likeness {
    /// The answer repeats the bytes of the request.
    Same,
    /// The answer may have any bytes.
    Any,
    /// An answer with three bytes of coils or discrete inputs may look like another request.
    Bits,
    /// The answer never looks like a request.
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
        // Diagnostics and functions of the application.
        _ => Likeness::Any,
    }
}

/// Whether the data after this function code can be that of an answer.
fn may_answer(function: u8, data: &[u8]) -> bool {
    // A byte count and that number of bytes.
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

/// The destination of a line of text.
pub trait Text {
    /// Appends one ASCII character.
    fn push(&mut self, character: u8);

    /// Appends ASCII characters.
    fn extend(&mut self, text: &[u8]) {
        for &character in text {
            self.push(character);
        }
    }
}

/// The characters of the longest line: a time of 20 digits, and a frame of 254 bytes.
pub const LINE_MAX: usize = 20 + 1 + 1 + 3 + 3 * 254 + 2;

/// Writes a frame as a line: seconds with six decimals, `req`, `ans` or `exc`, the bytes of unit id and PDU in
/// hexadecimal, CR and LF. Example: `12.345678 req 11 03 00 6B 00 03`.
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

/// Writes a damaged frame as a line: time, `bad`, and the name of each error. Example: `12.345678 bad gap check`.
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

/// Writes a number in decimal, with leading zeros up to `digits` digits.
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
