//! Any request of a client, and any answers to it, compared with a plain reading of the standard.

use multidrop_protocol::client::{
    AnswerError, FileRange, GetEventLog, ReadBits, ReadFifo, ReadFiles, ReadIdentification,
    ReadRegisters, ReportServerId, encode, judge,
};
use multidrop_protocol::exception::Exception;

use crate::input::Input;
use multidrop_testkit::reference_client::{Ask, Verdict};

/// Takes the number of a request and a unit id, then frames, each as a byte that tells how it is made of the right
/// answer, and some bytes to make it of.
pub fn client_answers(data: &[u8]) {
    let mut input = Input(data);
    let ask = ask(&mut input);
    let unit = input.byte();
    let mut adu = [0xEE; 256];
    let encoded = ask.request(|it| encode(it, unit, &mut adu));
    let sent = encoded.map(|encoded| adu[..encoded.len.into()].to_vec());
    assert_eq!(sent.clone().ok(), ask.frame(unit), "{ask:?} {encoded:?}");
    // What was not sent may be answered by somebody all the same.
    let frame = sent.unwrap_or_else(|_| vec![unit, 3, 0, 0, 0, 1]);
    let whole = ask.frame(unit).is_some();
    for _ in 0..16 {
        if input.is_over() {
            break;
        }
        let heard = heard(&ask, &frame, whole, &mut input);
        read(&ask, &heard);
        let judged = ask.request(|it| judge(it, unit, frame[1], &heard));
        if whole {
            assert!(
                agree(judged, ask.judge(&frame, &heard)),
                "{ask:?} {heard:02X?} {judged:?}"
            );
        }
    }
}

fn agree(judged: Result<(), AnswerError>, expected: Verdict) -> bool {
    match judged {
        Ok(()) => expected == Verdict::Answer,
        Err(AnswerError::Unit(unit)) => expected == Verdict::Unit(unit),
        Err(AnswerError::Function(function)) => expected == Verdict::Function(function),
        Err(AnswerError::Length(_) | AnswerError::Content) => expected == Verdict::Malformed,
        Err(AnswerError::Exception(exception)) => expected == Verdict::Exception(exception.code()),
        Err(AnswerError::UnknownException(code)) => {
            expected == Verdict::Exception(code) && Exception::from_code(code).is_none()
        }
    }
}

fn word(input: &mut Input) -> u16 {
    u16::from_be_bytes([input.byte(), input.byte()])
}

fn words(input: &mut Input) -> Vec<u16> {
    let count = input.byte();
    let bytes = input.bytes(2 * usize::from(count));
    bytes
        .chunks(2)
        .map(|pair| pair.iter().fold(0, |sum, &byte| sum << 8 | u16::from(byte)))
        .collect()
}

fn ask(input: &mut Input) -> Ask {
    match input.byte() % 20 {
        0 => Ask::Bits {
            inputs: input.byte() & 1 == 1,
            first: word(input),
            count: word(input),
        },
        1 => Ask::Registers {
            inputs: input.byte() & 1 == 1,
            first: word(input),
            count: u16::from(input.byte()),
        },
        2 => Ask::Coil {
            address: word(input),
            on: input.byte() & 1 == 1,
        },
        3 => Ask::Register {
            address: word(input),
            value: word(input),
        },
        4 => Ask::Status,
        5 => {
            let len = input.byte();
            Ask::Query {
                data: input.bytes(len.into()).to_vec(),
            }
        }
        6 => Ask::Diagnostic {
            place: input.byte(),
            character: input.byte(),
        },
        7 => Ask::Counter,
        8 => Ask::Log,
        9 => {
            let (first, count) = (word(input), word(input) % 2200);
            let bytes = input.bytes(usize::from(count).div_ceil(8));
            let bit = |place: usize| {
                bytes
                    .get(place / 8)
                    .is_some_and(|byte| byte >> (place % 8) & 1 == 1)
            };
            Ask::Coils {
                first,
                values: (0..count.into()).map(bit).collect(),
            }
        }
        10 => {
            let (first, count, len) = (word(input), word(input), input.byte());
            Ask::Packed {
                first,
                count,
                bytes: input.bytes(len.into()).to_vec(),
            }
        }
        11 => Ask::Write {
            first: word(input),
            values: words(input),
        },
        12 => Ask::Id,
        13 => {
            let count = input.byte() % 40;
            let mut range = || FileRange {
                file: word(input),
                record: word(input),
                count: u16::from(input.byte()),
            };
            Ask::ReadFile {
                groups: (0..count).map(|_| range()).collect(),
            }
        }
        14 => {
            let count = input.byte() % 6;
            let mut group = || (word(input), word(input), words(input));
            Ask::WriteFile {
                groups: (0..count).map(|_| group()).collect(),
            }
        }
        15 => Ask::Mask {
            address: word(input),
            and: word(input),
            or: word(input),
        },
        16 => Ask::Both {
            first: word(input),
            count: u16::from(input.byte()),
            write_first: word(input),
            values: words(input),
        },
        17 => Ask::Fifo {
            pointer: word(input),
        },
        18 => Ask::Device {
            code: input.byte(),
            object: input.byte(),
        },
        _ => {
            let (function, len) = (input.byte(), input.byte());
            Ask::Raw {
                function,
                data: input.bytes(len.into()).to_vec(),
            }
        }
    }
}

fn heard(ask: &Ask, frame: &[u8], whole: bool, input: &mut Input) -> Vec<u8> {
    let how = input.byte();
    let raw = |input: &mut Input| {
        let len = input.byte();
        input.bytes(len.into()).to_vec()
    };
    if !whole || how.is_multiple_of(6) {
        return raw(input);
    }
    let mut heard = ask.answer(frame, || input.byte());
    match how % 6 {
        1 => {}
        2 => {
            let place = usize::from(input.byte()) % heard.len();
            heard[place] = input.byte();
        }
        3 => heard.truncate(usize::from(input.byte()) % heard.len()),
        4 => heard.extend(raw(input)),
        _ => {
            heard.truncate(2);
            heard[1] |= 0x80;
            heard.push(input.byte());
        }
    }
    heard
}

/// What is in it is read whole, whatever it is, and is what its bytes say.
fn read(ask: &Ask, heard: &[u8]) {
    match ask {
        &Ask::Bits { first, count, .. } => {
            if let Ok(coils) = ReadBits::coils(first, count).answer(heard) {
                assert_eq!(coils.iter().count(), usize::from(count));
                for (place, on) in coils.iter().enumerate() {
                    assert_eq!(on, heard[3 + place / 8] >> (place % 8) & 1 == 1);
                }
            }
        }
        &Ask::Registers { first, count, .. } => {
            if let Ok(registers) = ReadRegisters::holding(first, count).answer(heard) {
                assert_eq!(registers.len(), usize::from(count));
                for (place, register) in registers.iter().enumerate() {
                    assert_eq!(register.to_be_bytes(), heard[3 + 2 * place..5 + 2 * place]);
                }
            }
        }
        Ask::Log => {
            if let Ok(log) = GetEventLog.answer(heard) {
                assert_eq!(log.log, &heard[9..]);
            }
        }
        Ask::Id => {
            if let Ok(id) = ReportServerId.answer(heard) {
                for len in 0..=256 {
                    id.with_id_len(len);
                }
            }
        }
        Ask::ReadFile { groups } => {
            if let Ok(records) = (ReadFiles { groups }).answer(heard) {
                let counts: Vec<usize> = records.map(|group| group.len()).collect();
                let expected: Vec<usize> = groups.iter().map(|group| group.count.into()).collect();
                assert_eq!(counts, expected);
            }
        }
        &Ask::Fifo { pointer } => {
            if let Ok(queue) = (ReadFifo { pointer }).answer(heard) {
                assert!(queue.len() <= 31);
            }
        }
        &Ask::Device { code, object } => {
            if let Ok(device) = (ReadIdentification { code, object }).answer(heard) {
                let bytes: usize = device.objects.map(|(_, value)| 2 + value.len()).sum();
                assert_eq!(bytes, heard.len() - 8);
            }
        }
        _ => {}
    }
}
