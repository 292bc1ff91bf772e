//! A plain reading of the standard for the client: the bytes of a request, whether it may be sent, and its answers.
//! Nothing here uses the code under test, except [`Ask::request`], which is what is tested.
#![allow(
    missing_docs,
    reason = "names of fields, variants and constants that tell all there is to tell"
)]

mod frame;

use multidrop_protocol::client::{
    Diagnostic, FileData, FileRange, GetEventCounter, GetEventLog, MaskWrite, Raw, ReadBits,
    ReadExceptionStatus, ReadFifo, ReadFiles, ReadIdentification, ReadRegisters,
    ReadWriteRegisters, ReportServerId, Request, ReturnQueryData, WriteCoil, WriteCoils,
    WriteFiles, WritePackedCoils, WriteRegister, WriteRegisters,
};

/// A request with its data.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Ask {
    Bits {
        inputs: bool,
        first: u16,
        count: u16,
    },
    Registers {
        inputs: bool,
        first: u16,
        count: u16,
    },
    Coil {
        address: u16,
        on: bool,
    },
    Register {
        address: u16,
        value: u16,
    },
    Status,
    Query {
        data: Vec<u8>,
    },
    Diagnostic {
        place: u8,
        character: u8,
    },
    Counter,
    Log,
    Coils {
        first: u16,
        values: Vec<bool>,
    },
    Packed {
        first: u16,
        count: u16,
        bytes: Vec<u8>,
    },
    Write {
        first: u16,
        values: Vec<u16>,
    },
    Id,
    ReadFile {
        groups: Vec<FileRange>,
    },
    WriteFile {
        groups: Vec<(u16, u16, Vec<u16>)>,
    },
    Mask {
        address: u16,
        and: u16,
        or: u16,
    },
    Both {
        first: u16,
        count: u16,
        write_first: u16,
        values: Vec<u16>,
    },
    Fifo {
        pointer: u16,
    },
    Device {
        code: u8,
        object: u8,
    },
    Raw {
        function: u8,
        data: Vec<u8>,
    },
}

/// Sub-functions of 08 with a word of data, by place: the code, the data (a character goes to its high byte),
/// whether the answer has a value of its own.
const SUBS: [(u16, u16, bool); 15] = [
    (1, 0, false),
    (1, 0xFF00, false),
    (2, 0, true),
    (3, 0, false),
    (4, 0, false),
    (0x0A, 0, false),
    (0x0B, 0, true),
    (0x0C, 0, true),
    (0x0D, 0, true),
    (0x0E, 0, true),
    (0x0F, 0, true),
    (0x10, 0, true),
    (0x11, 0, true),
    (0x12, 0, true),
    (0x14, 0, false),
];

fn diagnostic(place: u8, character: u8) -> Diagnostic {
    match place % 15 {
        0 => Diagnostic::Restart { clear_log: false },
        1 => Diagnostic::Restart { clear_log: true },
        2 => Diagnostic::Register,
        3 => Diagnostic::Delimiter(character),
        4 => Diagnostic::ListenOnly,
        5 => Diagnostic::Clear,
        6 => Diagnostic::BusMessages,
        7 => Diagnostic::BusErrors,
        8 => Diagnostic::Exceptions,
        9 => Diagnostic::ServerMessages,
        10 => Diagnostic::NoResponses,
        11 => Diagnostic::Naks,
        12 => Diagnostic::Busy,
        13 => Diagnostic::Overruns,
        _ => Diagnostic::ClearOverruns,
    }
}

impl Ask {
    /// Hands the request, as the crate has it, to `use_it`.
    pub fn request<R>(&self, use_it: impl FnOnce(&dyn Request) -> R) -> R {
        match self {
            &Ask::Bits {
                inputs: false,
                first,
                count,
            } => use_it(&ReadBits::coils(first, count)),
            &Ask::Bits { first, count, .. } => use_it(&ReadBits::discrete_inputs(first, count)),
            &Ask::Registers {
                inputs: false,
                first,
                count,
            } => use_it(&ReadRegisters::holding(first, count)),
            &Ask::Registers { first, count, .. } => use_it(&ReadRegisters::input(first, count)),
            &Ask::Coil { address, on } => use_it(&WriteCoil { address, on }),
            &Ask::Register { address, value } => use_it(&WriteRegister { address, value }),
            Ask::Status => use_it(&ReadExceptionStatus),
            Ask::Query { data } => use_it(&ReturnQueryData { data }),
            &Ask::Diagnostic { place, character } => use_it(&diagnostic(place, character)),
            Ask::Counter => use_it(&GetEventCounter),
            Ask::Log => use_it(&GetEventLog),
            &Ask::Coils { first, ref values } => use_it(&WriteCoils { first, values }),
            &Ask::Packed {
                first,
                count,
                ref bytes,
            } => use_it(&WritePackedCoils {
                first,
                count,
                bytes,
            }),
            &Ask::Write { first, ref values } => use_it(&WriteRegisters { first, values }),
            Ask::Id => use_it(&ReportServerId),
            Ask::ReadFile { groups } => use_it(&ReadFiles { groups }),
            Ask::WriteFile { groups } => {
                let groups: Vec<_> = groups
                    .iter()
                    .map(|&(file, record, ref values)| FileData {
                        file,
                        record,
                        values,
                    })
                    .collect();
                use_it(&WriteFiles { groups: &groups })
            }
            &Ask::Mask { address, and, or } => use_it(&MaskWrite { address, and, or }),
            &Ask::Both {
                first,
                count,
                write_first,
                ref values,
            } => use_it(&ReadWriteRegisters {
                first,
                count,
                write_first,
                values,
            }),
            &Ask::Fifo { pointer } => use_it(&ReadFifo { pointer }),
            &Ask::Device { code, object } => use_it(&ReadIdentification { code, object }),
            &Ask::Raw { function, ref data } => use_it(&Raw { function, data }),
        }
    }

    /// A right answer to the request in `frame`, with data from `data`, as long as there is some and zeros then.
    pub fn answer(&self, frame: &[u8], mut data: impl FnMut() -> u8) -> Vec<u8> {
        let mut answer = frame[..2].to_vec();
        let mut bytes = |answer: &mut Vec<u8>, count: usize| {
            answer.push(count as u8);
            answer.extend((0..count).map(|_| data()));
        };
        match self {
            Ask::Bits { count, .. } => bytes(&mut answer, usize::from(*count).div_ceil(8)),
            Ask::Registers { count, .. } | Ask::Both { count, .. } => {
                bytes(&mut answer, 2 * usize::from(*count));
            }
            Ask::Status => answer.push(data()),
            Ask::Diagnostic { place, .. } if SUBS[usize::from(place % 15)].2 => {
                answer.extend([frame[2], frame[3], data(), data()]);
            }
            Ask::Counter => answer.extend([0, 0, data(), data()]),
            Ask::Log => {
                let events = usize::from(data() % 65);
                answer.extend([6 + events as u8, 0xFF, 0xFF]);
                answer.extend((0..4 + events).map(|_| data()));
            }
            Ask::Coils { .. } | Ask::Packed { .. } | Ask::Write { .. } => {
                answer.extend(&frame[2..6]);
            }
            Ask::Id => {
                let count = 1 + usize::from(data() % 250);
                answer.push(count as u8);
                answer.extend((0..count).map(|_| data()));
            }
            Ask::ReadFile { groups } => {
                answer.push(groups.iter().map(|group| 2 + 2 * group.count as u8).sum());
                for group in groups {
                    answer.extend([1 + 2 * group.count as u8, 6]);
                    answer.extend((0..2 * group.count).map(|_| data()));
                }
            }
            Ask::Fifo { .. } => {
                let count = data() % 32;
                answer.extend([0, 2 + 2 * count, 0, count]);
                answer.extend((0..2 * count).map(|_| data()));
            }
            Ask::Device { code, object } => {
                answer.extend([0x0E, *code, 0x83, 0, 0]);
                let count = if *code == 4 { 1 } else { data() % 5 };
                answer.push(count);
                for number in 0..count {
                    let len = data() % 40;
                    answer.extend([object.wrapping_add(number), len]);
                    answer.extend((0..len).map(|_| data()));
                }
            }
            Ask::Raw { .. } => {
                let count = data();
                answer.extend((0..count % 253).map(|_| data()));
            }
            // The request is its own answer.
            _ => answer = frame.to_vec(),
        }
        answer
    }

    /// What a frame that was heard is to the request in `frame`.
    pub fn judge(&self, frame: &[u8], heard: &[u8]) -> Verdict {
        let [unit, function, data @ ..] = heard else {
            return Verdict::Malformed;
        };
        if *unit != frame[0] {
            return Verdict::Unit(*unit);
        }
        if *function == frame[1] + 0x80 {
            return match data {
                [code] => Verdict::Exception(*code),
                _ => Verdict::Malformed,
            };
        }
        if *function != frame[1] {
            return Verdict::Function(*function);
        }
        let counted = |count: usize| data.len() == 1 + count && usize::from(data[0]) == count;
        let word = |at: usize| data[at] as usize * 256 + data[at + 1] as usize;
        let right = match self {
            Ask::Bits { count, .. } => counted(usize::from(*count).div_ceil(8)),
            Ask::Registers { count, .. } | Ask::Both { count, .. } => {
                counted(2 * usize::from(*count))
            }
            Ask::Status => data.len() == 1,
            Ask::Diagnostic { place, .. } if SUBS[usize::from(place % 15)].2 => {
                data.len() == 4 && data[..2] == frame[2..4]
            }
            Ask::Counter => data.len() == 4 && matches!(word(0), 0 | 0xFFFF),
            Ask::Log => {
                (7..=71).contains(&data.len())
                    && counted(data.len() - 1)
                    && matches!(word(1), 0 | 0xFFFF)
            }
            Ask::Coils { .. } | Ask::Packed { .. } | Ask::Write { .. } => data == &frame[2..6],
            Ask::Id => data.len() > 1 && counted(data.len() - 1),
            Ask::ReadFile { groups } => {
                let mut expected = Vec::new();
                for group in groups {
                    expected.extend([Some(1 + 2 * group.count as u8), Some(6)]);
                    expected.extend(vec![None; 2 * usize::from(group.count)]);
                }
                counted(expected.len())
                    && data[1..]
                        .iter()
                        .zip(expected)
                        .all(|(byte, expected)| expected.is_none_or(|it| it == *byte))
            }
            Ask::Fifo { .. } => {
                data.len() >= 4
                    && word(0) == data.len() - 2
                    && word(2) <= 31
                    && data.len() == 4 + 2 * word(2)
            }
            Ask::Device { code, object } => device(data, *code, *object),
            Ask::Raw { .. } => true,
            _ => heard == frame,
        };
        if right {
            Verdict::Answer
        } else {
            Verdict::Malformed
        }
    }
}

fn device(data: &[u8], code: u8, object: u8) -> bool {
    let [
        0x0E,
        heard,
        1..=3 | 0x81..=0x83,
        0 | 0xFF,
        _,
        count,
        objects @ ..,
    ] = data
    else {
        return false;
    };
    let mut ids = Vec::new();
    let mut at = 0;
    while at < objects.len() {
        ids.push(objects[at]);
        let Some(len) = objects.get(at + 1) else {
            return false;
        };
        at += 2 + usize::from(*len);
    }
    *heard == code
        && at == objects.len()
        && ids.len() == usize::from(*count)
        && (code != 4 || ids == [object])
}

/// What a frame is to a request.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Verdict {
    Answer,
    Unit(u8),
    Function(u8),
    Malformed,
    Exception(u8),
}

fn words(frame: &mut Vec<u8>, words: &[u16]) {
    for word in words {
        frame.extend([(word >> 8) as u8, *word as u8]);
    }
}
