//! Frames out of the record of the wire, and what they mean.
//!
//! A reader of its own, for people's eyes: it shares nothing with the firmware it shows.

use std::fmt;

use crate::line::Line;
use crate::record::{Record, Station, WireByte};
use crate::time::Time;

const CRC: crc::Crc<u16> = crc::Crc::<u16>::new(&crc::CRC_16_MODBUS);

/// `body` and its CRC, low byte first (SER 2.5.1.2).
pub fn with_crc(body: &[u8]) -> Vec<u8> {
    [body, &CRC.checksum(body).to_le_bytes()].concat()
}

/// How the characters on the wire make frames.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Framing {
    /// Silence ends a frame, a CRC is its check (SER 2.5.1).
    Rtu,
    /// From `:` to CR and another character, LF unless it was changed; an LRC is its check (SER 2.5.2).
    Ascii,
}

impl Framing {
    fn check(self) -> &'static str {
        match self {
            Framing::Rtu => "CRC",
            Framing::Ascii => "LRC",
        }
    }

    /// The longest pause inside a frame.
    fn pause(self, line: Line) -> Time {
        match self {
            Framing::Rtu => line.t15(),
            Framing::Ascii => Time::from_ms(1_000),
        }
    }

    /// Whether a character of the same sender after a pause still belongs to a frame.
    fn goes_on(self, frame: &Frame, byte: &WireByte, pause: Time, line: Line) -> bool {
        match self {
            Framing::Rtu => pause < line.t35(),
            Framing::Ascii => {
                let over = matches!(frame.characters[..], [.., cr, _] if cr.value == 0x0d);
                byte.value != u16::from(b':') && !over && pause <= self.pause(line)
            }
        }
    }
}

/// Characters of one sender that a receiver takes for one frame.
///
/// As text, [`fmt::Display`], it is one line: when it began, who sent it, its bytes, what they mean
/// and what is wrong with them.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Frame {
    /// Who sent it.
    pub from: Station,
    /// What makes it one.
    pub framing: Framing,
    /// Its characters, in the order they were sent.
    pub characters: Vec<WireByte>,
    /// Pauses inside of it that are too long, t1.5 for RTU: the index of the character behind, and how long.
    /// Receivers drop the frame (SER 2.5.1.1).
    pub pauses: Vec<(usize, Time)>,
    /// From the end of the frame before, where that was another station's.
    pub turnaround: Option<Time>,
    /// It began before the frame before it was over by t3.5: receivers take both for one.
    pub early: bool,
    /// It is an answer: it follows another station's request to the same unit with the same function. Whether a
    /// node or a host sent it says nothing: both can be client and server.
    pub answer: bool,
}

impl Frame {
    fn new(first: &WireByte, before: Option<&Frame>, framing: Framing, line: Line) -> Self {
        let turnaround = before
            .filter(|frame| frame.from != first.from)
            .map(|frame| first.start.saturating_sub(frame.end()));
        Frame {
            from: first.from,
            framing,
            characters: Vec::new(),
            pauses: Vec::new(),
            turnaround,
            early: turnaround.is_some_and(|time| time < line.t35()),
            answer: false,
        }
    }

    fn push(&mut self, byte: &WireByte, line: Line) {
        if let Some(last) = self.characters.last() {
            let pause = byte.start.saturating_sub(last.end);
            if pause > self.framing.pause(line) {
                self.pauses.push((self.characters.len(), pause));
            }
        }
        self.characters.push(*byte);
    }

    /// Once it is whole: whether it answers the frame before.
    fn look_back(&mut self, before: Option<&Frame>) {
        let head = |frame: &Frame| match frame.content()[..] {
            // A broadcast is not answered.
            [unit, function, ..] if unit != 0 => Some((unit, function & 0x7F)),
            _ => None,
        };
        self.answer = before.is_some_and(|before| {
            let own = head(self);
            before.from != self.from && !before.answer && own.is_some() && head(before) == own
        });
    }

    /// When its first start bit began.
    pub fn start(&self) -> Time {
        self.characters.first().map_or(Time::ZERO, |c| c.start)
    }

    /// When its last stop bit ended.
    pub fn end(&self) -> Time {
        self.characters.last().map_or(Time::ZERO, |c| c.end)
    }

    /// Its bytes, as they were on the wire.
    pub fn bytes(&self) -> Vec<u8> {
        self.characters.iter().map(|c| c.value as u8).collect()
    }

    /// Whether every character reached the wire as it was sent.
    pub fn is_intact(&self) -> bool {
        self.characters.iter().all(WireByte::is_good)
    }

    /// Unit id, PDU and check, right or wrong; of ASCII what its digits say, nothing if they say nothing.
    fn content(&self) -> Vec<u8> {
        let bytes = self.bytes();
        match self.framing {
            Framing::Rtu => bytes,
            Framing::Ascii => digits(&bytes).unwrap_or_default(),
        }
    }

    /// Unit id and PDU, if the check is right.
    pub fn body(&self) -> Option<Vec<u8>> {
        let content = self.content();
        match self.framing {
            Framing::Rtu => {
                let (body, sum) = content.split_last_chunk::<2>()?;
                (CRC.checksum(body).to_le_bytes() == *sum).then(|| body.to_vec())
            }
            Framing::Ascii => {
                let (_, body) = content.split_last()?;
                (sum(&content) == 0).then(|| body.to_vec())
            }
        }
    }

    /// Whether it is an exception response (APP 7).
    pub fn is_exception(&self) -> bool {
        let function = self.content().get(1).copied();
        self.answer && function.is_some_and(|function| function & 0x80 != 0)
    }

    /// Its bytes in hex, of ASCII its characters. A pause that is too long stands in brackets where it was, `!` behind
    /// a character that is not on the wire as it was sent.
    pub fn hex(&self) -> String {
        let mut words = Vec::new();
        for (index, character) in self.characters.iter().enumerate() {
            let pause = self.pauses.iter().find(|(at, _)| *at == index);
            words.extend(pause.map(|(_, time)| format!("[{time}]")));
            let mark = if character.is_good() { "" } else { "!" };
            words.push(match self.framing {
                Framing::Rtu => format!("{:02X}{mark}", character.value),
                Framing::Ascii => format!("{}{mark}", (character.value as u8).escape_ascii()),
            });
        }
        words.join(match self.framing {
            Framing::Rtu => " ",
            Framing::Ascii => "",
        })
    }

    /// The meaning of the frame in words.
    pub fn meaning(&self) -> String {
        let check = self.framing.check();
        let Some(body) = self.body() else {
            return format!("{check} wrong: no frame for anybody");
        };
        let text = match &body[..] {
            [0, pdu @ ..] => format!("broadcast: {}", request(pdu)),
            [unit, pdu @ ..] if self.answer => format!("unit {unit}: {}", answer(pdu)),
            [unit, pdu @ ..] => format!("unit {unit}: {}", request(pdu)),
            [] => "nothing".to_owned(),
        };
        format!("{text}, {check} ok")
    }

    /// What is wrong with it on the wire, whatever its bytes say.
    pub fn troubles(&self) -> Vec<&'static str> {
        let any = |wrong: fn(&WireByte) -> bool| self.characters.iter().any(wrong);
        let pause = match self.framing {
            Framing::Rtu => "a pause over t1.5",
            Framing::Ascii => "a pause over 1 s",
        };
        let all = [
            (!self.pauses.is_empty(), pause),
            (self.early, "before t3.5"),
            (any(|c| c.framing_error), "framing error"),
            (any(|c| c.parity_error), "parity error"),
            (any(|c| c.lost), "driver off"),
            (any(|c| c.truncated.is_some()), "driver off too early"),
            (any(|c| c.conflict), "conflict"),
            (any(|c| c.value != c.sent), "other bits than sent"),
        ];
        let there = all.into_iter().filter(|(wrong, _)| *wrong);
        there.map(|(_, name)| name).collect()
    }
}

impl fmt::Display for Frame {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let start = self.start().to_string();
        let arrow = if self.answer { "<-" } else { "->" };
        let (from, hex, meaning) = (self.from, self.hex(), self.meaning());
        write!(f, "{start:>16}  {from}  {arrow} {hex}  {meaning}")?;
        for trouble in self.troubles() {
            write!(f, "; {trouble}")?;
        }
        match self.turnaround {
            Some(time) if self.answer => write!(f, "; after {time}"),
            _ => Ok(()),
        }
    }
}

/// The bytes between `:` and CR, two digits each.
fn digits(bytes: &[u8]) -> Option<Vec<u8>> {
    let digits = match bytes.strip_prefix(b":")? {
        [digits @ .., b'\r', _] => digits,
        _ => return None,
    };
    let digit = |byte: u8| char::from(byte).to_digit(16).map(|digit| digit as u8);
    let (pairs, rest) = digits.as_chunks::<2>();
    let byte = |[high, low]: &[u8; 2]| Some(digit(*high)? << 4 | digit(*low)?);
    pairs
        .iter()
        .map(byte)
        .collect::<Option<_>>()
        .filter(|_| rest.is_empty())
}

/// Of all bytes of an ASCII frame, the LRC included, it is 0 (SER 2.5.2.2).
fn sum(bytes: &[u8]) -> u8 {
    bytes.iter().fold(0, |sum, byte| sum.wrapping_add(*byte))
}

/// The RTU frames in `record`, in the order of time.
pub fn frames(record: &Record, line: Line) -> Vec<Frame> {
    framed(record, line, Framing::Rtu)
}

/// The frames in `record`, in the order of time.
pub fn framed(record: &Record, line: Line, framing: Framing) -> Vec<Frame> {
    let mut bytes: Vec<_> = record.bytes().iter().collect();
    bytes.sort_by_key(|byte| byte.start);
    let mut frames: Vec<Frame> = Vec::new();
    for byte in bytes {
        let before = frames.last();
        let goes_on = before.is_some_and(|frame| {
            let pause = byte.start.saturating_sub(frame.end());
            frame.from == byte.from && framing.goes_on(frame, byte, pause, line)
        });
        if !goes_on {
            let frame = Frame::new(byte, before, framing, line);
            frames.push(frame);
        }
        if let Some(frame) = frames.last_mut() {
            frame.push(byte, line);
        }
    }
    for index in 1..frames.len() {
        let (before, rest) = frames.split_at_mut(index);
        rest[0].look_back(before.last());
    }
    frames
}

fn request(pdu: &[u8]) -> String {
    let name = function(pdu.first().copied().unwrap_or(0));
    match *pdu {
        [1..=4, a, b, c, d] => format!("{name}, {} from {}", word(c, d), word(a, b)),
        [5, a, b, 0xFF, 0] => format!("{name} {} on", word(a, b)),
        [5, a, b, 0, 0] => format!("{name} {} off", word(a, b)),
        [6, a, b, c, d] => format!("{name} {} := 0x{c:02X}{d:02X}", word(a, b)),
        [8, a, b, ref data @ ..] => format!("{name} {}: {}", word(a, b), registers(data)),
        [15, a, b, c, d, _, ref data @ ..] => {
            let count = usize::from(word(c, d));
            format!("{name} from {} := {:.count$}", word(a, b), bits(data))
        }
        [16, a, b, _, _, _, ref data @ ..] => {
            format!("{name} from {} := {}", word(a, b), registers(data))
        }
        [0x16, a, b, c, d, e, g] => format!(
            "{name} {} := value & 0x{c:02X}{d:02X} | 0x{e:02X}{g:02X} & !0x{c:02X}{d:02X}",
            word(a, b)
        ),
        [0x17, a, b, c, d, e, g, _, _, _, ref data @ ..] => format!(
            "{name}, {} from {}, from {} := {}",
            word(c, d),
            word(a, b),
            word(e, g),
            registers(data)
        ),
        [0x18, a, b] => format!("{name} at {}", word(a, b)),
        [0x14, _, ref groups @ ..] => format!("{name}:{}", records(groups, false)),
        [0x15, _, ref groups @ ..] => format!("{name}:{}", records(groups, true)),
        [0x2B, 0x0E, code, object] => {
            format!("Read Device Identification, code {code} from object {object}")
        }
        _ => name,
    }
}

fn answer(pdu: &[u8]) -> String {
    let name = function(pdu.first().copied().unwrap_or(0) & 0x7F);
    match *pdu {
        [0x80..=0xFF, code] => format!("exception {code:02X} {} ({name})", exception(code)),
        [1 | 2, _, ref data @ ..] => format!("{name}: {}", bits(data)),
        [3 | 4 | 0x17, _, ref data @ ..] => format!("{name}: {}", registers(data)),
        [5 | 6, _, _, _, _] | [0x16, _, _, _, _, _, _] => format!("{name}: done"),
        [7, status] => format!("{name}: {}", bits(&[status])),
        [8, a, b, ref data @ ..] => format!("{name} {}: {}", word(a, b), registers(data)),
        [0x0B, a, b, c, d] => format!("{name}: status {}, {} events", word(a, b), word(c, d)),
        [0x0C, _, a, b, c, d, e, f, ref log @ ..] => format!(
            "{name}: status {}, {} events, {} messages, log {}",
            word(a, b),
            word(c, d),
            word(e, f),
            hex(log)
        ),
        [15 | 16, a, b, c, d] => format!("{name}: done, {} from {}", word(c, d), word(a, b)),
        [0x11, _, id, run, ref text @ ..] => {
            format!(
                "{name}: id {id}, run indicator {run:02X}, \"{}\"",
                text.escape_ascii()
            )
        }
        [0x15, _, ref groups @ ..] => format!("{name}: done,{}", records(groups, true)),
        [0x18, _, _, a, b, ref data @ ..] => {
            format!("{name}, {} in the queue: {}", word(a, b), registers(data))
        }
        [0x2B, 0x0E, _, _, _, _, _, ref data @ ..] => {
            format!("Read Device Identification:{}", objects(data))
        }
        _ => name,
    }
}

/// The groups of FC 14 and 15 (APP 6.14, 6.15).
fn records(mut groups: &[u8], with_data: bool) -> String {
    let mut text = String::new();
    while let [_, a, b, c, d, e, f, rest @ ..] = groups {
        let count = word(*e, *f);
        text += &format!(" {count} of file {} from {}", word(*a, *b), word(*c, *d));
        let data = if with_data { 2 * usize::from(count) } else { 0 };
        let Some((data, rest)) = rest.split_at_checked(data) else {
            return text + " and something";
        };
        if with_data {
            text += &format!(" := {}", registers(data));
        }
        groups = rest;
    }
    text
}

/// The objects of FC 2B/0E (APP 6.21).
fn objects(mut data: &[u8]) -> String {
    let mut text = String::new();
    while let [id, len, rest @ ..] = data {
        let Some((value, rest)) = rest.split_at_checked((*len).into()) else {
            return text + " and something";
        };
        text += &format!(" {id} \"{}\"", value.escape_ascii());
        data = rest;
    }
    text
}

fn hex(bytes: &[u8]) -> String {
    let bytes: Vec<_> = bytes.iter().map(|byte| format!("{byte:02X}")).collect();
    bytes.join(" ")
}

fn word(high: u8, low: u8) -> u16 {
    u16::from_be_bytes([high, low])
}

/// The first item first, as on the wire (APP 6.1).
fn bits(data: &[u8]) -> String {
    let all = data
        .iter()
        .flat_map(|byte| (0..8).map(move |bit| byte >> bit & 1));
    all.map(|bit| char::from(b'0' + bit)).collect()
}

fn registers(data: &[u8]) -> String {
    let words: Vec<_> = data
        .chunks_exact(2)
        .map(|pair| format!("0x{:02X}{:02X}", pair[0], pair[1]))
        .collect();
    words.join(" ")
}

/// The name of a function (APP 6).
fn function(code: u8) -> String {
    let name = match code {
        0x01 => "Read Coils",
        0x02 => "Read Discrete Inputs",
        0x03 => "Read Holding Registers",
        0x04 => "Read Input Registers",
        0x05 => "Write Single Coil",
        0x06 => "Write Single Register",
        0x07 => "Read Exception Status",
        0x08 => "Diagnostics",
        0x0B => "Get Comm Event Counter",
        0x0C => "Get Comm Event Log",
        0x0F => "Write Multiple Coils",
        0x10 => "Write Multiple Registers",
        0x11 => "Report Server ID",
        0x14 => "Read File Record",
        0x15 => "Write File Record",
        0x16 => "Mask Write Register",
        0x17 => "Read/Write Multiple Registers",
        0x18 => "Read FIFO Queue",
        0x2B => "Encapsulated Interface Transport",
        _ => return format!("function {code:02X}"),
    };
    name.to_owned()
}

/// APP 7; 07 is of its older editions.
fn exception(code: u8) -> &'static str {
    match code {
        0x01 => "illegal function",
        0x02 => "illegal data address",
        0x03 => "illegal data value",
        0x04 => "server device failure",
        0x05 => "acknowledge",
        0x06 => "server device busy",
        0x07 => "negative acknowledge",
        0x08 => "memory parity error",
        0x0A => "gateway path unavailable",
        0x0B => "gateway target failed to respond",
        _ => "of another kind",
    }
}
