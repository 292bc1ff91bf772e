//! Random traffic: requests of all functions, right, at the edge and wrong, and frames that are damaged on the way.

use super::UNIT;
use super::wire::{Character, Flaw, Way, ascii, hex, plain, rtu};

/// A source of numbers below a limit.
pub type Below<'a> = &'a mut dyn FnMut(u32) -> u32;

/// A frame on the bus.
#[derive(Clone, PartialEq, Eq)]
pub struct Step {
    /// Unit id and PDU.
    pub body: Vec<u8>,
    /// What happens to it on its way.
    pub damage: Option<Damage>,
}

/// What happens to a frame on its way. Places count characters from its beginning and go round.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Damage {
    /// Bits of the check at the end are wrong.
    Check(u16),
    /// It ends early: this number of characters is missing, though not all.
    Cut(usize),
    /// A request with this number of characters over the most that a frame may have.
    Long(usize),
    /// One bit is wrong.
    Flip(usize, u8),
    /// A character or the time before it is wrong.
    At(usize, Flaw),
    /// It has no function code, but a right check.
    Bare,
    /// One more character, too late to be part of it and too early for the next.
    Late(u8),
}

impl std::fmt::Debug for Step {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "{}", hex(&self.body))?;
        match self.damage {
            Some(damage) => write!(f, ", {damage:?}"),
            None => Ok(()),
        }
    }
}

impl Step {
    /// A sound frame.
    pub fn of(body: &[u8]) -> Step {
        Step {
            body: body.to_vec(),
            damage: None,
        }
    }

    /// Tells of an answer that is not what it must be.
    pub fn answered(&self, is: Option<Vec<u8>>, must: Option<Vec<u8>>) -> String {
        let [is, must] =
            [is, must].map(|answer| answer.map_or("nothing".to_owned(), |answer| hex(&answer)));
        format!("{self:?}: answered {is}, must be {must}")
    }

    /// As it is on the wire.
    pub fn characters(&self, way: Way, delimiter: u8) -> Vec<Character> {
        let body = match self.damage {
            Some(Damage::Bare) => &self.body[..1],
            _ => &self.body,
        };
        let mut bytes = match way {
            Way::Rtu => rtu(body),
            Way::Ascii => ascii(body, delimiter),
        };
        let len = bytes.len();
        match (self.damage, way) {
            (Some(Damage::Check(bits)), Way::Rtu) => {
                bytes[len - 2] ^= bits as u8;
                bytes[len - 1] ^= (bits >> 8) as u8;
            }
            // The last digit of the LRC, and hex it stays.
            (Some(Damage::Check(bits)), Way::Ascii) => {
                let digit = char::from(bytes[len - 3]).to_digit(16).unwrap_or(0);
                let other = (digit + 1 + u32::from(bits) % 15) % 16;
                bytes[len - 3] = char::from_digit(other, 16).unwrap_or('0') as u8;
            }
            (Some(Damage::Cut(missing)), Way::Rtu) => bytes.truncate(len - 1 - missing % (len - 1)),
            // The end stays, so that the frame does.
            (Some(Damage::Cut(missing)), Way::Ascii) => {
                bytes.drain(len - 3 - missing % (len - 4)..len - 2);
            }
            (Some(Damage::Long(more)), Way::Rtu) => bytes.resize(257 + more % 64, 0x55),
            (Some(Damage::Long(more)), Way::Ascii) => {
                let digits = (513 - len + 1 + more % 64) / 2 * 2 + 2;
                bytes.splice(1..1, std::iter::repeat_n(b'0', digits));
            }
            (Some(Damage::Flip(at, bit)), Way::Rtu) => bytes[at % len] ^= 1 << (bit % 8),
            // A digit becomes none.
            (Some(Damage::Flip(at, bit)), Way::Ascii) => {
                let wrong = b"GZ g/;@`";
                bytes[1 + at % (len - 3)] = wrong[usize::from(bit) % wrong.len()];
            }
            (Some(Damage::At(..) | Damage::Bare | Damage::Late(_)) | None, _) => {}
        }
        let mut characters = plain(&bytes);
        if let Some(Damage::At(at, flaw)) = self.damage {
            let place = match (flaw, way) {
                // A silence has a character before it.
                (Flaw::Gap, _) => 1 + at % (len - 1),
                (_, Way::Rtu) => at % len,
                // With another first character it would be no frame at all.
                (_, Way::Ascii) => 1 + at % (len - 3),
            };
            characters[place].flaw = flaw;
        }
        // ASCII has no silence that would end a frame.
        if let (Some(Damage::Late(value)), Way::Rtu) = (self.damage, way) {
            let flaw = Flaw::Gap;
            characters.push(Character { value, flaw });
        }
        characters
    }
}

/// Requests in random steps.
pub struct Requests<'a> {
    below: Below<'a>,
    /// The ways in which characters can be wrong where they go.
    errors: &'a [Flaw],
}

impl<'a> Requests<'a> {
    pub fn new(below: Below<'a>, errors: &'a [Flaw]) -> Self {
        Requests { below, errors }
    }

    fn below(&mut self, end: u32) -> u32 {
        (self.below)(end)
    }

    fn one_in(&mut self, n: u32) -> bool {
        self.below(n) == 0
    }

    fn pick<T: Copy>(&mut self, all: &[T]) -> T {
        all[self.below(all.len() as u32) as usize]
    }

    fn word(&mut self) -> u16 {
        self.below(0x1_0000) as u16
    }

    fn byte(&mut self) -> u8 {
        self.below(0x100) as u8
    }

    /// The next frame.
    pub fn step(&mut self) -> Step {
        let unit = match self.below(100) {
            0..=79 => UNIT,
            80..=89 => 0,
            90..=94 => self.pick(&[1, 2, 16, 18, 247, 0x91]),
            _ => self.pick(&[248, 249, 254, 255]),
        };
        let mut pdu = self.pdu();
        if self.one_in(12) {
            self.spoil(&mut pdu);
        }
        pdu.truncate(253);
        let body = [&[unit], &pdu[..]].concat();
        let damage = self.one_in(10).then(|| self.damage());
        Step { body, damage }
    }

    fn damage(&mut self) -> Damage {
        let place = self.below(600) as usize;
        match self.below(7) {
            0 => Damage::Check(self.word().max(1)),
            1 => Damage::Cut(place),
            2 => Damage::Long(place),
            3 => Damage::Flip(place, self.byte()),
            4 => Damage::Late(self.byte()),
            5 => Damage::Bare,
            _ => Damage::At(place, self.pick(self.errors)),
        }
    }

    /// Makes a PDU wrong, mostly in its length.
    fn spoil(&mut self, pdu: &mut Vec<u8>) {
        let len = pdu.len() as u32;
        match self.below(5) {
            0 => pdu.truncate(self.below(len) as usize + 1),
            1 => pdu.push(0),
            2 => {
                for _ in 0..self.below(8) + 1 {
                    pdu.push((self.below)(0x100) as u8);
                }
            }
            3 => {
                let at = self.below(len) as usize;
                pdu[at] = self.byte();
            }
            // The byte count of the writes, where there is one.
            _ => {
                let at = if pdu[0] == 0x17 { 9 } else { 5 };
                if let Some(count) = pdu.get_mut(at) {
                    *count = (self.below)(0x100) as u8;
                }
            }
        }
    }

    fn pdu(&mut self) -> Vec<u8> {
        let function = self.pick(&[
            1, 2, 3, 3, 4, 5, 5, 6, 6, 6, 7, 8, 8, 8, 8, 8, 8, 0x0b, 0x0b, 0x0c, 0x0c, 0x0f, 0x0f,
            0x10, 0x10, 0x10, 0x11, 0x14, 0x15, 0x16, 0x16, 0x17, 0x17, 0x18, 0x2b, 0x2b, 0x41,
            0x44, 0xff,
        ]);
        let mut pdu = vec![function];
        let add = |pdu: &mut Vec<u8>, word: u16| pdu.extend(word.to_be_bytes());
        match function {
            1 | 2 => {
                let (first, count) = self.block(&[128, 3000, 1128], 2000);
                add(&mut pdu, first);
                add(&mut pdu, count);
            }
            3 | 4 => {
                let (first, count) = self.block(&[128], 125);
                add(&mut pdu, first);
                add(&mut pdu, count);
            }
            5 => {
                let near = self.pick(&[0, 7, 119, 120, 120, 121, 127, 128, 999, 1000, 2999, 3000]);
                let value = self.pick(&[0, 0xff00, 0xff00, 0, 1, 0xff01, 0x00ff]);
                add(&mut pdu, near);
                add(&mut pdu, value);
            }
            6 => {
                let address = self.register();
                let value = self.value(address);
                add(&mut pdu, address);
                add(&mut pdu, value);
            }
            8 => self.diagnostics(&mut pdu),
            0x0f => {
                let (first, count) = self.block(&[128, 3000, 1128], 1968);
                add(&mut pdu, first);
                add(&mut pdu, count);
                let bytes = count.div_ceil(8).min(247);
                pdu.push(bytes as u8);
                for _ in 0..bytes {
                    pdu.push(self.byte());
                }
            }
            0x10 => {
                let (first, count) = self.block(&[128], 123);
                add(&mut pdu, first);
                add(&mut pdu, count);
                self.values(&mut pdu, first, count);
            }
            0x14 | 0x15 => {
                let groups = self.groups(function == 0x15);
                pdu.push(groups.len() as u8);
                pdu.extend(groups);
            }
            0x16 => {
                let address = self.register();
                // With no bit kept the result is the second mask.
                let and = self.pick(&[0, 0, 0xffff, 0x00f2, 0xff00]);
                let or = match self.one_in(3) {
                    true => self.word(),
                    false => self.value(address),
                };
                for word in [address, and, or] {
                    add(&mut pdu, word);
                }
            }
            0x17 => {
                let (read, count) = self.block(&[128], 125);
                let (write, written) = self.block(&[128], 121);
                for word in [read, count, write, written] {
                    add(&mut pdu, word);
                }
                self.values(&mut pdu, write, written);
            }
            0x18 => {
                let pointer = self.pick(&[
                    0x04de, 0x04de, 0x04dd, 0x04df, 0, 0xffff, 0x1000, 0x1001, 0x101e, 0x101f,
                    0x1020,
                ]);
                add(&mut pdu, pointer);
            }
            0x2b => {
                pdu.push(self.pick(&[0x0e, 0x0e, 0x0e, 0x0e, 0x0e, 0x0d, 0x0f]));
                pdu.push(self.pick(&[1, 2, 3, 4, 4, 0, 5, 0xff]));
                pdu.push(self.pick(&[0, 1, 2, 3, 5, 6, 7, 0x80, 0xff]));
            }
            0x44 => {
                pdu.push(self.below(13) as u8);
            }
            0x41 => {
                for _ in 0..self.pick(&[0, 1, 2, 5, 251, 252]) {
                    pdu.push(self.byte());
                }
            }
            0xff => {
                pdu[0] = self.pick(&[
                    0, 9, 0x0a, 0x12, 0x13, 0x19, 0x40, 0x42, 0x7f, 0x80, 0x83, 0xff,
                ]);
                add(&mut pdu, 0);
                add(&mut pdu, 1);
            }
            _ => {}
        }
        pdu
    }

    /// A block of items: most end near the end of a table or before it, few are of a quantity that is wrong.
    fn block(&mut self, ends: &[u32], most: u16) -> (u16, u16) {
        let below = self.below(u32::from(most)) as u16;
        let count = match self.below(16) {
            0 => 0,
            1..=3 => most,
            4 => most + 1,
            5 => most - 1,
            6 => self.word(),
            7 | 8 => below.max(1),
            9 => 8,
            _ => 1 + below % 20,
        };
        let end = match self.below(40) {
            0 => 65_536,
            1 => 65_537,
            _ => self.pick(ends),
        };
        let end = match self.below(4) {
            0 => end + 1,
            1 => end,
            2 => end.saturating_sub(1),
            _ => self.below(end) + 1,
        };
        (end.saturating_sub(count.into()) as u16, count)
    }

    /// An address of a holding register, most of them where rules are.
    fn register(&mut self) -> u16 {
        match self.below(8) {
            0 => self.pick(&[0, 127, 128, 0xffff]),
            1 => self.below(130) as u16,
            _ => 98 + self.below(30) as u16,
        }
    }

    /// A value for it: mostly one that is allowed there.
    fn value(&mut self, address: u16) -> u16 {
        let few = self.one_in(12);
        match address {
            100..=109 if !few => self.pick(&[100, 101, 150, 199, 200]),
            100..=109 => self.pick(&[0, 99, 201, 0xffff]),
            110 | 111 if !few => self.pick(&[1, 2, 3]),
            110 | 111 => self.pick(&[0, 4, 110]),
            127 if few => 0xdead,
            _ => self.word(),
        }
    }

    fn values(&mut self, pdu: &mut Vec<u8>, first: u16, count: u16) {
        let fit = count.min(124);
        pdu.push(count.wrapping_mul(2) as u8);
        for n in 0..fit {
            let value = self.value(first.wrapping_add(n));
            pdu.extend(value.to_be_bytes());
        }
    }

    /// Groups of records, as many as fit a request at most.
    fn groups(&mut self, with_data: bool) -> Vec<u8> {
        // An answer of 244 bytes and one of 246, the most groups of a read, the most bytes of a write.
        let lengths = match self.below(10) {
            0 => vec![32, 32, 32, 22],
            1 => vec![32, 32, 32, 23],
            2 => vec![1; 35],
            3 => vec![32, 32, 32, 6, 6],
            _ => {
                let groups = self.pick(&[1, 1, 1, 2, 2, 3, 4]);
                let lengths = [1, 1, 2, 3, 8, 31, 32, 33, 0, 118, 121, 122];
                (0..groups).map(|_| self.pick(&lengths)).collect()
            }
        };
        let mut groups = Vec::new();
        for count in lengths {
            let file = match self.one_in(20) {
                true => self.pick(&[0, 3, 6, 0xffff]),
                false => self.pick(&[4, 4, 4, 5]),
            };
            let last = if file == 5 { 10_000 } else { 32u16 }.saturating_sub(count);
            let first = match self.below(20) {
                0..=3 if file == 5 => last + 1,
                0 => last + 1,
                1..=9 => last,
                10 => self.pick(&[9_999, 10_000, 0xffff]),
                _ => last - self.below(u32::from(last.min(20)) + 1) as u16,
            };
            let reference = if self.one_in(30) { self.byte() } else { 6 };
            let mut group = vec![reference];
            for word in [file, first, count] {
                group.extend(word.to_be_bytes());
            }
            for _ in 0..if with_data { 2 * count } else { 0 } {
                group.push(self.byte());
            }
            if groups.len() + group.len() > 251 {
                break;
            }
            groups.extend(group);
        }
        groups
    }

    fn diagnostics(&mut self, pdu: &mut Vec<u8>) {
        let sub = match self.below(30) {
            0..=3 => 0,
            4..=7 => 1,
            8 => self.pick(&[2, 4]),
            9 => 3,
            10 => 1,
            11 => 0x0a,
            12 => 0x14,
            13 => self.pick(&[5, 6, 9, 0x13, 0x15, 0x16, 0xff, 0x100, 0x0400, 0xffff]),
            _ => 0x0b + self.below(8) as u16,
        };
        pdu.extend(sub.to_be_bytes());
        let wrong = self.one_in(10);
        let data: u16 = match sub {
            0 => {
                for _ in 0..self.pick(&[0, 1, 2, 3, 8, 250]) {
                    pdu.push((self.below)(0x100) as u8);
                }
                return;
            }
            _ if wrong => self.pick(&[1, 0x0100, 0xff01, 0xffff, 0x0a0a]),
            1 => self.pick(&[0, 0xff00]),
            3 => self.pick(&[0x0a00, 0x2100, 0x0a00]),
            _ => 0,
        };
        pdu.extend(data.to_be_bytes());
    }
}

/// Requests that read back all there is to read: every table, every counter, the log.
pub fn audit() -> Vec<Step> {
    let mut bodies: Vec<Vec<u8>> = (0x0b..=0x12).map(|sub| vec![8, 0, sub, 0, 0]).collect();
    bodies.extend([vec![0x0b], vec![0x0c], vec![7], vec![8, 0, 2, 0, 0]]);
    for (function, first, count) in [
        (3, 0, 125),
        (3, 125, 3),
        (1, 0, 128),
        (1, 1000, 2000),
        (4, 3, 125),
        (2, 1000, 2000),
    ] {
        let (first, count) = (u16::to_be_bytes(first), u16::to_be_bytes(count));
        bodies.push([&[function], &first[..], &count[..]].concat());
    }
    let step = |pdu: Vec<u8>| Step::of(&[&[UNIT], &pdu[..]].concat());
    bodies.into_iter().map(step).collect()
}
