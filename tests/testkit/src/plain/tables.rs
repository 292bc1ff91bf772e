//! The tables of the conformance map, and the functions that read and write them.

/// Holding registers and coils; what is only read follows from its address.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Tables {
    /// From address 0.
    pub holding: Vec<u16>,
    /// From address 0; those between 128 and 999 do not exist and stay off.
    pub coils: Vec<bool>,
    /// Whether the model is [`super::Plain::with_extras`].
    pub extras: bool,
}

/// The registers that coil 120 disables while it is on.
const DISABLED: std::ops::RangeInclusive<u16> = 120..=125;

fn is_bit(address: u16) -> bool {
    matches!(address, 0..=127 | 1000..=2999)
}

fn is_register(address: u16) -> bool {
    address <= 127
}

/// What declared rules allow to be written.
fn allows(address: u16, value: u16) -> bool {
    match address {
        100..=109 => (100..=200).contains(&value),
        110..=111 => (1..=3).contains(&value),
        _ => true,
    }
}

/// A request's fields, checked in the order in which they stand.
struct Fields<'a>(&'a [u8]);

impl Fields<'_> {
    fn word(&mut self) -> Result<u16, u8> {
        let (word, rest) = self.0.split_first_chunk::<2>().ok_or(3)?;
        self.0 = rest;
        Ok(u16::from_be_bytes(*word))
    }

    /// A byte count and as many bytes as it must say, and no more.
    fn block(&mut self, len: u16) -> Result<&[u8], u8> {
        match self.0 {
            [count, data @ ..] if u16::from(*count) == len && data.len() == usize::from(*count) => {
                Ok(data)
            }
            _ => Err(3),
        }
    }

    fn end(&self) -> Result<(), u8> {
        if self.0.is_empty() { Ok(()) } else { Err(3) }
    }
}

fn quantity(quantity: u16, most: u16) -> Result<u16, u8> {
    match quantity {
        0 => Err(3),
        n if n > most => Err(3),
        n => Ok(n),
    }
}

/// The addresses of a block, if all of them exist; none is past 65535.
fn span(first: u16, count: u16, exists: fn(u16) -> bool) -> Result<Vec<u16>, u8> {
    let all: Option<Vec<u16>> = (0..count).map(|n| first.checked_add(n)).collect();
    all.filter(|all| all.iter().all(|&address| exists(address)))
        .ok_or(2)
}

fn words(bytes: &[u8]) -> Vec<u16> {
    let pairs = bytes.chunks(2);
    pairs
        .map(|pair| u16::from_be_bytes([pair[0], pair[1]]))
        .collect()
}

fn with_count(bytes: Vec<u8>) -> Vec<u8> {
    [&[bytes.len() as u8], &bytes[..]].concat()
}

/// The first bit is the lowest of the first byte (APP 6.1).
fn packed(bits: &[bool]) -> Vec<u8> {
    let byte = |bits: &[bool]| (0..).zip(bits).map(|(n, &on)| u8::from(on) << n).sum();
    bits.chunks(8).map(byte).collect()
}

impl Tables {
    /// As at boot.
    pub fn new() -> Self {
        let mut coils = vec![false; 3000];
        coils[120] = true;
        Tables {
            holding: (0..128).collect(),
            coils,
            extras: false,
        }
    }

    /// The exception status of FC 07.
    pub fn exception_status(&self) -> u8 {
        packed(&self.coils[..8])[0]
    }

    /// What follows the function code in the answer.
    pub fn execute(&mut self, function: u8, data: &[u8]) -> Result<Vec<u8>, u8> {
        let mut fields = Fields(data);
        match function {
            1 | 2 => {
                let first = fields.word()?;
                let count = quantity(fields.word()?, 2000)?;
                fields.end()?;
                let bits: Vec<bool> = span(first, count, is_bit)?
                    .into_iter()
                    .map(|address| match function {
                        1 => self.coils[usize::from(address)],
                        _ => address.is_multiple_of(3),
                    })
                    .collect();
                Ok(with_count(packed(&bits)))
            }
            3 | 4 => {
                let first = fields.word()?;
                let count = quantity(fields.word()?, 125)?;
                fields.end()?;
                let addresses = span(first, count, is_register)?;
                let value = |address: u16| match function {
                    3 => self.holding[usize::from(address)],
                    _ => 0x1000 + address,
                };
                let bytes = addresses.into_iter().flat_map(|a| value(a).to_be_bytes());
                Ok(with_count(bytes.collect()))
            }
            5 => {
                let (address, value) = (fields.word()?, fields.word()?);
                fields.end()?;
                if value != 0xff00 && value != 0 {
                    return Err(3);
                }
                let address = span(address, 1, is_bit)?[0];
                self.coils[usize::from(address)] = value != 0;
                Ok(data.to_vec())
            }
            6 => {
                let (address, value) = (fields.word()?, fields.word()?);
                fields.end()?;
                self.write(address, &[value])?;
                Ok(data.to_vec())
            }
            0x0f => {
                let first = fields.word()?;
                let count = quantity(fields.word()?, 1968)?;
                let bytes = fields.block(count.div_ceil(8))?;
                let addresses = span(first, count, is_bit)?;
                for (n, address) in addresses.into_iter().enumerate() {
                    self.coils[usize::from(address)] = bytes[n / 8] & 1 << (n % 8) != 0;
                }
                Ok(data[..4].to_vec())
            }
            0x10 => {
                let first = fields.word()?;
                let count = quantity(fields.word()?, 123)?;
                let values = words(fields.block(2 * count)?);
                self.write(first, &values)?;
                Ok(data[..4].to_vec())
            }
            0x16 => {
                let (address, and, or) = (fields.word()?, fields.word()?, fields.word()?);
                fields.end()?;
                let was = self.holding[usize::from(span(address, 1, is_register)?[0])];
                self.write(address, &[was & and | or & !and])?;
                Ok(data.to_vec())
            }
            0x17 => {
                let (read, count) = (fields.word()?, quantity(fields.word()?, 125)?);
                let (write, written) = (fields.word()?, quantity(fields.word()?, 121)?);
                let values = words(fields.block(2 * written)?);
                let addresses = span(read, count, is_register)?;
                self.write(write, &values)?;
                let value = |address: u16| self.holding[usize::from(address)].to_be_bytes();
                Ok(with_count(addresses.into_iter().flat_map(value).collect()))
            }
            0x18 => {
                let pointer = fields.word()?;
                fields.end()?;
                let queue: Vec<u16> = match pointer {
                    0x04de => vec![0x01b8, 0x1284],
                    0x1000..=0x1030 if self.extras => (0x1000..pointer).collect(),
                    _ => return Err(2),
                };
                if queue.len() > 31 {
                    return Err(3);
                }
                let count = queue.len() as u16;
                let words = [&[2 + 2 * count, count], &queue[..]].concat();
                Ok(words.into_iter().flat_map(u16::to_be_bytes).collect())
            }
            other => unreachable!("function {other:02x} is none of the tables'"),
        }
    }

    /// All or nothing: every address, every disabled register, every value, then the first cell.
    fn write(&mut self, first: u16, values: &[u16]) -> Result<(), u8> {
        let addresses = span(first, values.len() as u16, is_register)?;
        if self.coils[120] && addresses.iter().any(|address| DISABLED.contains(address)) {
            return Err(7);
        }
        let mut pairs = addresses.iter().zip(values);
        if !pairs.all(|(&address, &value)| allows(address, value)) {
            return Err(3);
        }
        let mut pairs = addresses.iter().zip(values);
        if self.extras && pairs.any(|pair| pair == (&127, &0xdead)) {
            return Err(4);
        }
        for (address, value) in addresses.into_iter().zip(values) {
            self.holding[usize::from(address)] = *value;
        }
        Ok(())
    }
}
