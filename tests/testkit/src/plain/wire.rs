//! Frames as characters, and the frames that a receiver must find in characters (SER 2.5.1, 2.5.2).

/// How frames are put on the line.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Way {
    Rtu,
    Ascii,
}

/// What is wrong with one character or with the time before it.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Flaw {
    #[default]
    None,
    /// More than t1.5 before it, and less than t3.5.
    Gap,
    Parity,
    Framing,
    /// One before it was lost.
    Overrun,
}

/// A character on the wire.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Character {
    pub value: u8,
    pub flaw: Flaw,
}

/// What a unit hears of what is sent in one piece.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Heard {
    /// Unit id and PDU.
    Good(Vec<u8>),
    Bad {
        overrun: bool,
    },
    /// No frame and no part of one.
    Nothing,
}

pub fn plain(bytes: &[u8]) -> Vec<Character> {
    let sound = |&value| Character {
        value,
        flaw: Flaw::None,
    };
    bytes.iter().map(sound).collect()
}

pub fn hex(bytes: &[u8]) -> String {
    let bytes: Vec<_> = bytes.iter().map(|byte| format!("{byte:02X}")).collect();
    bytes.join(" ")
}

/// CRC-16/MODBUS, bit by bit as SER 6.2.2 draws it.
pub fn crc(bytes: &[u8]) -> u16 {
    bytes.iter().fold(0xffff, |sum, &byte| {
        (0..8).fold(sum ^ u16::from(byte), |sum, _| match sum & 1 {
            1 => sum >> 1 ^ 0xa001,
            _ => sum >> 1,
        })
    })
}

/// Two's complement of the sum (SER 6.2.1).
pub fn lrc(bytes: &[u8]) -> u8 {
    0u8.wrapping_sub(
        bytes
            .iter()
            .fold(0, |sum: u8, byte| sum.wrapping_add(*byte)),
    )
}

/// `body` with its CRC.
pub fn rtu(body: &[u8]) -> Vec<u8> {
    [body, &crc(body).to_le_bytes()].concat()
}

/// `body` as an ASCII frame.
pub fn ascii(body: &[u8], delimiter: u8) -> Vec<u8> {
    let with_lrc = [body, &[lrc(body)]].concat();
    let digits: String = with_lrc.iter().map(|byte| format!("{byte:02X}")).collect();
    [b":", digits.as_bytes(), b"\r", &[delimiter]].concat()
}

/// Unit id and PDU of an RTU frame.
pub fn from_rtu(bytes: &[u8]) -> Option<Vec<u8>> {
    let good = (4..=256).contains(&bytes.len()) && crc(bytes) == 0;
    good.then(|| bytes[..bytes.len() - 2].to_vec())
}

/// Unit id and PDU of an ASCII frame, `:` and the end of it included.
pub fn from_ascii(bytes: &[u8], delimiter: u8) -> Option<Vec<u8>> {
    let digits = bytes
        .strip_prefix(b":")?
        .strip_suffix(&[b'\r', delimiter])?;
    if !digits.iter().all(u8::is_ascii_hexdigit) || digits.len() % 2 != 0 || bytes.len() > 513 {
        return None;
    }
    let digit = |digit: u8| char::from(digit).to_digit(16).unwrap_or(0) as u8;
    let pair = |pair: &[u8]| digit(pair[0]) << 4 | digit(pair[1]);
    let bytes: Vec<u8> = digits.chunks(2).map(pair).collect();
    let good = bytes.len() >= 3 && lrc(&bytes) == 0;
    good.then(|| bytes[..bytes.len() - 1].to_vec())
}

/// What is heard of characters between two silences.
pub fn heard(way: Way, delimiter: u8, characters: &[Character]) -> Heard {
    let values: Vec<u8> = characters.iter().map(|character| character.value).collect();
    let has = |flaw| characters.iter().any(|character| character.flaw == flaw);
    let overrun = has(Flaw::Overrun);
    match way {
        Way::Rtu => {
            let damaged = characters.iter().any(|one| one.flaw != Flaw::None);
            match from_rtu(&values).filter(|_| !damaged) {
                Some(body) => Heard::Good(body),
                None if values.is_empty() => Heard::Nothing,
                None => Heard::Bad { overrun },
            }
        }
        Way::Ascii => {
            // Before a colon there is nothing, and the last colon counts.
            let Some(begin) = values.iter().rposition(|&value| value == b':') else {
                return Heard::Nothing;
            };
            let damaged = overrun || has(Flaw::Parity) || has(Flaw::Framing);
            match from_ascii(&values[begin..], delimiter).filter(|_| !damaged) {
                Some(body) => Heard::Good(body),
                None => Heard::Bad { overrun },
            }
        }
    }
}
