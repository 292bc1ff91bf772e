//! A plain model of a unit that runs `registers`.

use super::frames::{adu, data, exception};

/// A unit and its tables, `count` of each.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Model {
    unit: u8,
    registers: Vec<u16>,
    coils: Vec<bool>,
}

impl Model {
    /// As it is at boot.
    pub fn new(unit: u8, count: usize) -> Self {
        Model {
            unit,
            registers: vec![0; count],
            coils: vec![false; count],
        }
    }

    /// The whole frame that answers a whole frame; empty for none. Follows APP 6.1 to 6.12 and the
    /// state diagrams there, and SER 2.1 for unit ids.
    pub fn answer(&mut self, request: &[u8]) -> Vec<u8> {
        let intact = (4..=256).contains(&request.len()) && adu(request).ends_with(&[0, 0]);
        if !intact || (request[0] != self.unit && request[0] != 0) {
            return Vec::new();
        }
        let (unit, function) = (self.unit, request[1]);
        let body = &request[2..request.len() - 2];
        let reads = (1..=4).contains(&function);
        if request[0] == 0 && reads {
            return Vec::new();
        }
        let answer = match self.execute(function, body) {
            Ok(answer) => answer,
            Err(code) => exception(unit, function, code),
        };
        match request[0] {
            0 => Vec::new(),
            _ => answer,
        }
    }

    fn execute(&mut self, function: u8, body: &[u8]) -> Result<Vec<u8>, u8> {
        let word = |at: usize| match body.get(at..at + 2) {
            Some(&[high, low]) => Ok(u16::from_be_bytes([high, low])),
            _ => Err(3),
        };
        let count = self.registers.len();
        let span = |first: u16, quantity: u16| {
            let end = usize::from(first) + usize::from(quantity);
            (end <= count).then_some(usize::from(first)..end).ok_or(2)
        };
        let echo = |len: usize| adu(&[&[self.unit, function], &body[..len]].concat());
        match function {
            1..=6 => {
                let (first, second) = (word(0)?, word(2)?);
                let limit = match function {
                    1 | 2 => 2000,
                    _ => 125,
                };
                let legal = match function {
                    1..=4 => (1..=limit).contains(&second),
                    5 => second == 0xff00 || second == 0,
                    _ => true,
                };
                if !legal || body.len() != 4 {
                    return Err(3);
                }
                if function >= 5 {
                    let at = span(first, 1)?.start;
                    if function == 5 {
                        self.coils[at] = second != 0;
                    } else {
                        self.registers[at] = second;
                    }
                    return Ok(echo(4));
                }
                let items = span(first, second)?;
                let bytes = match function {
                    1 => packed(items.map(|at| self.coils[at])),
                    2 => packed(items.map(|at| at.is_multiple_of(3))),
                    3 => items
                        .flat_map(|at| self.registers[at].to_be_bytes())
                        .collect(),
                    _ => items
                        .flat_map(|at| (0x1000 + at as u16).to_be_bytes())
                        .collect(),
                };
                Ok(data(self.unit, function, &bytes))
            }
            0x0f | 0x10 => {
                let (first, quantity) = (word(0)?, word(2)?);
                let values = body.get(5..).ok_or(3)?;
                let (limit, need) = match function {
                    0x0f => (1968, quantity.div_ceil(8)),
                    _ => (123, quantity.saturating_mul(2)),
                };
                if !(1..=limit).contains(&quantity)
                    || u16::from(body[4]) != need
                    || values.len() != usize::from(need)
                {
                    return Err(3);
                }
                for (index, at) in span(first, quantity)?.enumerate() {
                    if function == 0x0f {
                        self.coils[at] = values[index / 8] >> (index % 8) & 1 == 1;
                    } else {
                        self.registers[at] =
                            u16::from_be_bytes([values[2 * index], values[2 * index + 1]]);
                    }
                }
                Ok(echo(4))
            }
            _ => Err(1),
        }
    }
}

/// Bits as they are on the wire: the first is the lowest of the first byte (APP 6.1).
fn packed(bits: impl Iterator<Item = bool>) -> Vec<u8> {
    let mut bytes = Vec::new();
    for (index, bit) in bits.enumerate() {
        if index.is_multiple_of(8) {
            bytes.push(0);
        }
        bytes[index / 8] |= u8::from(bit) << (index % 8);
    }
    bytes
}
