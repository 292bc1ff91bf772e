//! Random requests and answers: what is sent and accepted equals a plain reading of the standard.

use multidrop_protocol::client::{AnswerError, FileRange, encode, judge};
use multidrop_protocol::exception::Exception;
use multidrop_testkit::reference_client::{Ask, Verdict};
use proptest::collection::vec;
use proptest::prelude::*;

/// A count at or near a limit, or any.
fn count(limit: u16) -> impl Strategy<Value = u16> {
    prop_oneof![1..=limit, limit - 1..=limit + 2, 0..4_u16, any::<u16>()]
}

fn address() -> impl Strategy<Value = u16> {
    prop_oneof![0..3000_u16, 65_400..=u16::MAX]
}

fn ask() -> impl Strategy<Value = Ask> {
    let group = (0..4_u16, 0..10_010_u16, 0..130_u16);
    let range = group.prop_map(|(file, record, count)| FileRange {
        file,
        record,
        count,
    });
    let data = (0..3_u16, 0..10_010_u16, vec(any::<u16>(), 0..40));
    prop_oneof![
        (any::<bool>(), address(), count(2000)).prop_map(|(inputs, first, count)| Ask::Bits {
            inputs,
            first,
            count
        }),
        (any::<bool>(), address(), count(125)).prop_map(|(inputs, first, count)| Ask::Registers {
            inputs,
            first,
            count
        }),
        (any::<u16>(), any::<bool>()).prop_map(|(address, on)| Ask::Coil { address, on }),
        (any::<u16>(), any::<u16>()).prop_map(|(address, value)| Ask::Register { address, value }),
        Just(Ask::Status),
        vec(any::<u8>(), 0..260).prop_map(|data| Ask::Query { data }),
        (0..15_u8, any::<u8>()).prop_map(|(place, character)| Ask::Diagnostic { place, character }),
        Just(Ask::Counter),
        Just(Ask::Log),
        (address(), vec(any::<bool>(), 0..2000))
            .prop_map(|(first, values)| Ask::Coils { first, values }),
        (
            address(),
            count(1968),
            vec(any::<u8>(), 0..250),
            any::<bool>()
        )
            .prop_map(|(first, count, mut bytes, fits)| {
                if fits {
                    bytes.resize(usize::from(count).div_ceil(8), 0xA5);
                }
                Ask::Packed {
                    first,
                    count,
                    bytes,
                }
            }),
        (address(), vec(any::<u16>(), 0..126))
            .prop_map(|(first, values)| Ask::Write { first, values }),
        Just(Ask::Id),
        vec(range, 0..38).prop_map(|groups| Ask::ReadFile { groups }),
        vec(data, 0..6).prop_map(|groups| Ask::WriteFile { groups }),
        (any::<u16>(), any::<u16>(), any::<u16>()).prop_map(|(address, and, or)| Ask::Mask {
            address,
            and,
            or
        }),
        (address(), count(125), address(), vec(any::<u16>(), 0..124)).prop_map(
            |(first, count, write_first, values)| Ask::Both {
                first,
                count,
                write_first,
                values
            }
        ),
        any::<u16>().prop_map(|pointer| Ask::Fifo { pointer }),
        (0..6_u8, any::<u8>()).prop_map(|(code, object)| Ask::Device { code, object }),
        (any::<u8>(), vec(any::<u8>(), 0..256))
            .prop_map(|(function, data)| Ask::Raw { function, data }),
    ]
}

/// What is done to a right answer.
#[derive(Clone, Debug)]
enum Harm {
    None,
    Set(usize, u8),
    Cut(usize),
    Grow(Vec<u8>),
    Replace(Vec<u8>),
    /// As many bytes as it says, whatever was asked for.
    Counted(u8),
}

fn harm() -> impl Strategy<Value = Harm> {
    prop_oneof![
        Just(Harm::None),
        (any::<usize>(), any::<u8>()).prop_map(|(place, byte)| Harm::Set(place, byte)),
        (0..8_usize, any::<u8>()).prop_map(|(place, byte)| Harm::Set(place, byte)),
        any::<usize>().prop_map(Harm::Cut),
        vec(any::<u8>(), 1..5).prop_map(Harm::Grow),
        vec(any::<u8>(), 0..254).prop_map(Harm::Replace),
        prop_oneof![0..10_u8, 0..=251_u8].prop_map(Harm::Counted),
    ]
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(2000))]

    #[test]
    fn requests_and_answers(
        ask in ask(),
        unit in prop_oneof![1..=247_u8, 0..4_u8, 240..=255_u8],
        data in vec(any::<u8>(), 300),
        harm in harm(),
    ) {
        let mut adu = [0xEE; 256];
        let encoded = ask.request(|it| encode(it, unit, &mut adu));
        let expected = ask.frame(unit);
        let sent = encoded.ok().map(|encoded| adu[..encoded.len.into()].to_vec());
        prop_assert_eq!(&sent, &expected, "{:?}", encoded);
        let Some(frame) = sent else { return Ok(()) };

        let mut data = data.into_iter();
        let mut heard = ask.answer(&frame, || data.next().unwrap_or(0));
        prop_assert_eq!(ask.judge(&frame, &heard), Verdict::Answer, "the test's own");
        match harm {
            Harm::None => {}
            Harm::Set(place, byte) => {
                let place = place % heard.len();
                heard[place] = byte;
            }
            Harm::Cut(len) => heard.truncate(len % heard.len()),
            Harm::Grow(more) => heard.extend(more),
            Harm::Replace(bytes) => heard = bytes,
            Harm::Counted(count) => {
                heard.truncate(2);
                heard.push(count);
                heard.resize(3 + usize::from(count), 0x55);
            }
        }
        let judged = ask.request(|it| judge(it, unit, frame[1], &heard));
        let expected = ask.judge(&frame, &heard);
        let agrees = match judged {
            Ok(()) => expected == Verdict::Answer,
            Err(AnswerError::Unit(unit)) => expected == Verdict::Unit(unit),
            Err(AnswerError::Function(function)) => expected == Verdict::Function(function),
            Err(AnswerError::Length(_) | AnswerError::Content) => expected == Verdict::Malformed,
            Err(AnswerError::Exception(exception)) => {
                expected == Verdict::Exception(exception.code())
            }
            Err(AnswerError::UnknownException(code)) => {
                expected == Verdict::Exception(code) && Exception::from_code(code).is_none()
            }
        };
        prop_assert!(agrees, "{:02X?} {:?}, expected {:?}", heard, judged, expected);
    }
}
