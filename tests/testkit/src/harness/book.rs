//! The answers of the standard to a request, in the plainest way. Shares no code with the crate under test.

/// The unit id of the server under test.
pub const UNIT: u8 = 17;

/// First address and number of each table.
pub const HOLDING: (u16, usize) = (3, 133);
/// Ends at the last address there is.
pub const INPUT: (u16, usize) = (65_531, 5);
/// Begins and ends within a byte.
pub const COILS: (u16, usize) = (7, 43);
/// Longer than one answer.
pub const DISCRETE: (u16, usize) = (100, 2003);

/// Functions of the application.
pub const REVERSE: u8 = 0x41;
pub const COUNT: u8 = 0x42;
pub const TOO_LONG: u8 = 0x43;
pub const BUSY: u8 = 0x44;
pub const MUTE: u8 = 0x45;

/// The tables of the server.
#[derive(Clone, Debug, PartialEq)]
pub struct Book {
    pub holding: Vec<u16>,
    pub input: Vec<u16>,
    pub coils: Vec<bool>,
}

/// The discrete inputs, which never change.
pub fn discrete_inputs() -> Vec<bool> {
    (0..DISCRETE.1).map(|i| i % 3 == 0).collect()
}

/// What is to come of a request.
#[derive(Clone, Debug, PartialEq)]
pub struct Outcome {
    /// Unit id and PDU.
    pub answer: Option<Vec<u8>>,
    /// Whether the server goes through with something once the frame stands.
    pub executes: bool,
}

impl Book {
    pub fn new() -> Book {
        Book {
            holding: (0..HOLDING.1 as u16).map(|i| i * 259).collect(),
            input: (0..INPUT.1 as u16).map(|i| 0x1000 + i).collect(),
            coils: (0..COILS.1).map(|i| i % 5 == 0).collect(),
        }
    }

    /// A good frame without its CRC: changes the tables as it demands.
    pub fn ask(&mut self, request: &[u8]) -> Outcome {
        let mut outcome = Outcome {
            answer: None,
            executes: false,
        };
        let (unit, function) = (request[0], request[1]);
        if unit != UNIT && unit != 0 || unit == 0 && (1..=4).contains(&function) {
            return outcome;
        }
        let answer = match self.act(unit, function, &request[2..], &mut outcome.executes) {
            Ok(answer) => answer.map(|data| [&[unit, function], &data[..]].concat()),
            Err(code) => Some(vec![unit, function | 0x80, code]),
        };
        outcome.answer = answer.filter(|_| unit != 0);
        outcome
    }

    fn act(
        &mut self,
        unit: u8,
        function: u8,
        data: &[u8],
        executes: &mut bool,
    ) -> Result<Option<Vec<u8>>, u8> {
        let word = |at: usize| usize::from(data[at]) * 256 + usize::from(data[at + 1]);
        match function {
            1 | 2 => {
                if data.len() != 4 || !(1..=2000).contains(&word(2)) {
                    return Err(3);
                }
                let (table, base) = match function {
                    1 => (self.coils.clone(), COILS.0),
                    _ => (discrete_inputs(), DISCRETE.0),
                };
                let bits = &table[place(table.len(), base, word(0), word(2))?];
                let bytes = bits.chunks(8).map(|eight| {
                    let weighted = (0..).zip(eight).map(|(i, &on)| u8::from(on) * 2u8.pow(i));
                    weighted.sum()
                });
                Ok(Some(counted(bytes.collect())))
            }
            3 | 4 => {
                if data.len() != 4 || !(1..=125).contains(&word(2)) {
                    return Err(3);
                }
                let (table, base) = match function {
                    3 => (&self.holding, HOLDING.0),
                    _ => (&self.input, INPUT.0),
                };
                let cells = &table[place(table.len(), base, word(0), word(2))?];
                let bytes = cells
                    .iter()
                    .flat_map(|cell| [(cell / 256) as u8, (cell % 256) as u8]);
                Ok(Some(counted(bytes.collect())))
            }
            5 | 6 => {
                if data.len() != 4 || function == 5 && ![0, 0xFF00].contains(&word(2)) {
                    return Err(3);
                }
                if function == 5 {
                    let block = place(COILS.1, COILS.0, word(0), 1)?;
                    self.coils[block].fill(word(2) != 0);
                } else {
                    let block = place(HOLDING.1, HOLDING.0, word(0), 1)?;
                    self.holding[block].fill(word(2) as u16);
                }
                *executes = true;
                Ok(Some(data.to_vec()))
            }
            15 | 16 => {
                if data.len() < 5 {
                    return Err(3);
                }
                let (most, bytes) = match function {
                    15 => (1968, word(2).div_ceil(8)),
                    _ => (123, word(2) * 2),
                };
                let fits = usize::from(data[4]) == bytes && data.len() == 5 + bytes;
                if !fits || !(1..=most).contains(&word(2)) {
                    return Err(3);
                }
                if function == 15 {
                    let block = place(COILS.1, COILS.0, word(0), word(2))?;
                    for (index, coil) in self.coils[block].iter_mut().enumerate() {
                        *coil = data[5 + index / 8] / 2u8.pow(index as u32 % 8) % 2 == 1;
                    }
                } else {
                    let block = place(HOLDING.1, HOLDING.0, word(0), word(2))?;
                    for (index, cell) in self.holding[block].iter_mut().enumerate() {
                        *cell = word(5 + 2 * index) as u16;
                    }
                }
                *executes = true;
                Ok(Some(data[..4].to_vec()))
            }
            0 | 0x80.. => Err(1),
            REVERSE => {
                *executes = true;
                self.coils[0] = !data.is_empty();
                Ok(Some(data.iter().rev().copied().collect()))
            }
            // What follows is not for a broadcast, apart from what only fails.
            BUSY => {
                *executes = true;
                Err(6)
            }
            _ if unit == 0 => Ok(None),
            COUNT => {
                *executes = true;
                if !data.is_empty() {
                    return Err(3);
                }
                self.holding[0] = self.holding[0].wrapping_add(1);
                Ok(Some(self.holding[0].to_be_bytes().to_vec()))
            }
            TOO_LONG => {
                *executes = true;
                Err(4)
            }
            MUTE => {
                *executes = true;
                Ok(None)
            }
            _ => {
                *executes = true;
                Ok(Some(data.to_vec()))
            }
        }
    }
}

fn counted(data: Vec<u8>) -> Vec<u8> {
    [&[data.len() as u8], &data[..]].concat()
}

fn place(len: usize, base: u16, first: usize, count: usize) -> Result<std::ops::Range<usize>, u8> {
    let base = usize::from(base);
    if first < base || first + count > base + len {
        return Err(2);
    }
    Ok(first - base..first - base + count)
}

/// The CRC, bit by bit as SER 6.2.2 tells it.
pub fn crc(bytes: &[u8]) -> [u8; 2] {
    let mut sum: u16 = 0xFFFF;
    for &byte in bytes {
        sum ^= u16::from(byte);
        for _ in 0..8 {
            let carry = sum & 1 == 1;
            sum >>= 1;
            if carry {
                sum ^= 0xA001;
            }
        }
    }
    sum.to_le_bytes()
}

/// The frame of a unit id and a PDU.
pub fn framed(body: &[u8]) -> Vec<u8> {
    [body, &crc(body)].concat()
}

/// Unit id and PDU, if these bytes are a good frame.
pub fn unframed(frame: &[u8]) -> Option<&[u8]> {
    if !(4..=256).contains(&frame.len()) {
        return None;
    }
    let (body, check) = frame.split_at(frame.len() - 2);
    (crc(body) == check).then_some(body)
}
