//! Frames out of the record of the wire, and what they mean.
//!
//! A reader of its own, for people's eyes: it shares nothing with the firmware it shows.

use multidrop_bus::{Line, Record, Station, Time, WireByte};

const CRC: crc::Crc<u16> = crc::Crc::<u16>::new(&crc::CRC_16_MODBUS);

/// `body` and its checksum, low byte first (SER 2.5.1.2).
pub fn with_crc(body: &[u8]) -> Vec<u8> {
    [body, &CRC.checksum(body).to_le_bytes()].concat()
}

/// Characters of one sender without a silence between them.
#[derive(Clone, Debug)]
pub struct Frame {
    pub from: Station,
    pub bytes: Vec<u8>,
    pub end: Time,
    /// Every character reached the wire as it was sent.
    pub intact: bool,
    /// From the end of the frame before, where that was another station's.
    pub turnaround: Option<Time>,
}

impl Frame {
    fn new(first: &WireByte, before: Option<&Frame>) -> Self {
        Frame {
            from: first.from,
            bytes: Vec::new(),
            end: first.start,
            intact: true,
            turnaround: before
                .filter(|frame| frame.from != first.from)
                .map(|frame| first.start.saturating_sub(frame.end)),
        }
    }

    fn push(&mut self, byte: &WireByte) {
        self.bytes.push(byte.value as u8);
        self.end = byte.end;
        self.intact &= byte.is_good();
    }

    /// Without the checksum, if that is right.
    pub fn body(&self) -> Option<&[u8]> {
        let (body, sum) = self.bytes.split_last_chunk::<2>()?;
        (CRC.checksum(body).to_le_bytes() == *sum).then_some(body)
    }

    pub fn is_answer(&self) -> bool {
        matches!(self.from, Station::Node(_))
    }

    pub fn is_exception(&self) -> bool {
        self.is_answer()
            && self
                .bytes
                .get(1)
                .is_some_and(|function| function & 0x80 != 0)
    }

    pub fn hex(&self) -> String {
        let bytes: Vec<_> = self.bytes.iter().map(|b| format!("{b:02X}")).collect();
        bytes.join(" ")
    }

    /// In words.
    pub fn meaning(&self) -> String {
        let Some(body) = self.body() else {
            return "CRC wrong: no frame for anybody".to_owned();
        };
        let text = match body {
            [0, pdu @ ..] => format!("broadcast: {}", request(pdu)),
            [unit, pdu @ ..] if self.is_answer() => format!("unit {unit}: {}", answer(pdu)),
            [unit, pdu @ ..] => format!("unit {unit}: {}", request(pdu)),
            [] => "nothing".to_owned(),
        };
        format!("{text}, CRC ok")
    }
}

/// The frames in `record`, in the order of time.
pub fn frames(record: &Record, line: Line) -> Vec<Frame> {
    let mut bytes: Vec<_> = record.bytes().iter().collect();
    bytes.sort_by_key(|byte| byte.start);
    let mut frames: Vec<Frame> = Vec::new();
    for byte in bytes {
        let before = frames.last();
        let goes_on = before.is_some_and(|frame| {
            frame.from == byte.from && byte.start.saturating_sub(frame.end) < line.t35()
        });
        if !goes_on {
            frames.push(Frame::new(byte, before));
        }
        if let Some(frame) = frames.last_mut() {
            frame.push(byte);
        }
    }
    frames
}

fn request(pdu: &[u8]) -> String {
    let name = function(pdu.first().copied().unwrap_or(0));
    match *pdu {
        [1..=4, a, b, c, d] => {
            format!("{name}, {} from {}", u16::from_be_bytes([c, d]), word(a, b))
        }
        [5, a, b, 0xFF, 0] => format!("{name} {} on", word(a, b)),
        [5, a, b, 0, 0] => format!("{name} {} off", word(a, b)),
        [6, a, b, c, d] => format!("{name} {} := 0x{c:02X}{d:02X}", word(a, b)),
        [15, a, b, c, d, _, ref data @ ..] => {
            let count = usize::from(word(c, d));
            format!("{name} from {} := {:.count$}", word(a, b), bits(data))
        }
        [16, a, b, _, _, _, ref data @ ..] => {
            format!("{name} from {} := {}", word(a, b), registers(data))
        }
        _ => name,
    }
}

fn answer(pdu: &[u8]) -> String {
    let name = function(pdu.first().copied().unwrap_or(0) & 0x7F);
    match *pdu {
        [0x80..=0xFF, code] => format!("exception {code:02X} {} ({name})", exception(code)),
        [1 | 2, _, ref data @ ..] => format!("{name}: {}", bits(data)),
        [3 | 4, _, ref data @ ..] => format!("{name}: {}", registers(data)),
        [5 | 6, _, _, _, _] => format!("{name}: done"),
        [15 | 16, a, b, c, d] => format!("{name}: done, {} from {}", word(c, d), word(a, b)),
        _ => name,
    }
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

/// APP 6.
fn function(code: u8) -> String {
    let name = match code {
        0x01 => "Read Coils",
        0x02 => "Read Discrete Inputs",
        0x03 => "Read Holding Registers",
        0x04 => "Read Input Registers",
        0x05 => "Write Single Coil",
        0x06 => "Write Single Register",
        0x0F => "Write Multiple Coils",
        0x10 => "Write Multiple Registers",
        0x11 => "Report Server ID",
        _ => return format!("function {code:02X}"),
    };
    name.to_owned()
}

/// APP 7.
fn exception(code: u8) -> &'static str {
    match code {
        0x01 => "illegal function",
        0x02 => "illegal data address",
        0x03 => "illegal data value",
        0x04 => "server device failure",
        _ => "of another kind",
    }
}
