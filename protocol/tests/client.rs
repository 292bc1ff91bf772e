//! Requests and answers of the client: the examples of the standard, byte for byte, and every deviation from them.

mod client_examples;

use client_examples::examples;
use multidrop_protocol::client::{
    AnswerError, Encoded, FileRange, GetEventLog, ReadFiles, ReadIdentification, ReportServerId,
    RequestError, encode, judge,
};
use multidrop_protocol::exception::Exception;
use multidrop_testkit::reference_client::{self, Ask};

const UNIT: u8 = 17;

#[test]
fn requests_are_those_of_the_standard() {
    for (ask, request, _) in examples() {
        let mut adu = [0xEE; 256];
        let encoded = ask.request(|it| encode(it, UNIT, &mut adu));
        let expected = Encoded {
            len: request.len() as u8,
            answered: true,
        };
        assert_eq!(encoded, Ok(expected), "{ask:?}");
        assert_eq!(adu[..request.len()], request, "{ask:?}");
        assert!(
            adu[request.len()..].iter().all(|&byte| byte == 0xEE),
            "{ask:?}"
        );
        assert_eq!(ask.frame(UNIT).as_ref(), Some(&request), "the test's own");
    }
}

#[test]
fn only_the_right_answer_is_accepted() {
    for (ask, request, answer) in examples() {
        let function = request[1];
        let judged = |answer: &[u8]| ask.request(|it| judge(it, UNIT, function, answer));
        assert_eq!(judged(&answer), Ok(()), "{ask:?}");
        for len in 0..answer.len() {
            let cut = &answer[..len];
            assert!(judged(cut).is_err(), "{ask:?} {cut:02X?}");
        }
        for more in [0, 1, 0xFF] {
            let longer = [&answer[..], &[more]].concat();
            assert!(judged(&longer).is_err(), "{ask:?} {longer:02X?}");
        }
        let doubled = answer.repeat(2);
        assert!(judged(&doubled).is_err(), "{ask:?} {doubled:02X?}");
        for place in 0..answer.len() {
            for bit in 0..8 {
                let mut wrong = answer.clone();
                wrong[place] ^= 1 << bit;
                let expected = ask.judge(&request, &wrong);
                let judged = judged(&wrong);
                match expected {
                    reference_client::Verdict::Answer => assert_eq!(judged, Ok(()), "{wrong:02X?}"),
                    reference_client::Verdict::Unit(unit) => {
                        assert_eq!(judged, Err(AnswerError::Unit(unit)))
                    }
                    reference_client::Verdict::Function(function) => {
                        assert_eq!(judged, Err(AnswerError::Function(function)));
                    }
                    reference_client::Verdict::Exception(_) => {
                        assert!(judged.is_err_and(AnswerError::is_exception));
                    }
                    reference_client::Verdict::Malformed => assert!(
                        matches!(judged, Err(AnswerError::Length(_) | AnswerError::Content)),
                        "{ask:?} {wrong:02X?} {judged:?}"
                    ),
                }
            }
        }
        for code in 0..=255 {
            let refused = [UNIT, function | 0x80, code];
            let expected = match Exception::from_code(code) {
                Some(exception) => AnswerError::Exception(exception),
                None => AnswerError::UnknownException(code),
            };
            assert_eq!(judged(&refused), Err(expected));
            assert!(expected.is_exception());
        }
    }
}

#[test]
fn only_writes_are_broadcast_and_have_no_answer_then() {
    for (ask, request, _) in examples() {
        let mut adu = [0; 256];
        let encoded = ask.request(|it| encode(it, 0, &mut adu));
        let writes = matches!(request[1], 5 | 6 | 0x0F | 0x10 | 0x15 | 0x16)
            || request[1] == 8 && matches!(request[3], 1 | 3 | 4 | 0x0A | 0x14);
        if writes {
            let expected = Encoded {
                len: request.len() as u8,
                answered: false,
            };
            assert_eq!(encoded, Ok(expected), "{ask:?}");
        } else {
            let expected = RequestError::Broadcast {
                function: request[1],
            };
            assert_eq!(encoded, Err(expected), "{ask:?}");
        }
        for unit in [248, 255] {
            let encoded = ask.request(|it| encode(it, unit, &mut adu));
            assert_eq!(encoded, Err(RequestError::Unit { unit }));
        }
    }
    let listen_only = Ask::Diagnostic {
        place: 4,
        character: 0,
    };
    let encoded = listen_only.request(|it| encode(it, UNIT, &mut [0; 256]));
    assert_eq!(
        encoded,
        Ok(Encoded {
            len: 6,
            answered: false
        })
    );
}

#[test]
fn limits_are_kept_at_both_ends() {
    let registers = |count| Ask::Registers {
        inputs: false,
        first: 0,
        count,
    };
    let bits = |count| Ask::Bits {
        inputs: true,
        first: 0,
        count,
    };
    let write = |count| Ask::Write {
        first: 0,
        values: vec![0; count],
    };
    let coils = |count| Ask::Coils {
        first: 0,
        values: vec![true; count],
    };
    let both = |count, write| Ask::Both {
        first: 0,
        count,
        write_first: 0,
        values: vec![0; write],
    };
    let query = |len| Ask::Query { data: vec![1; len] };
    let raw = |function, len| Ask::Raw {
        function,
        data: vec![1; len],
    };
    let device = |code| Ask::Device { code, object: 0 };
    let read_file = |file, record, count| Ask::ReadFile {
        groups: vec![FileRange {
            file,
            record,
            count,
        }],
    };
    let write_file = |file, record, count| Ask::WriteFile {
        groups: vec![(file, record, vec![7; count])],
    };
    for (right, wrong) in [
        (registers(1), registers(0)),
        (registers(125), registers(126)),
        (bits(1), bits(0)),
        (bits(2000), bits(2001)),
        (write(1), write(0)),
        (write(123), write(124)),
        (coils(1), coils(0)),
        (coils(1968), coils(1969)),
        (both(125, 121), both(126, 121)),
        (both(125, 121), both(125, 122)),
        (both(1, 1), both(0, 1)),
        (both(1, 1), both(1, 0)),
        (query(250), query(251)),
        (query(0), query(300)),
        (raw(1, 0), raw(0, 0)),
        (raw(127, 252), raw(128, 252)),
        (raw(65, 252), raw(65, 253)),
        (device(1), device(0)),
        (device(4), device(5)),
        (read_file(1, 0, 1), read_file(0, 0, 1)),
        (read_file(1, 9999, 1), read_file(1, 9999, 2)),
        (read_file(1, 0, 121), read_file(1, 0, 122)),
        (read_file(1, 0, 1), read_file(1, 0, 0)),
        (write_file(1, 9878, 122), write_file(1, 9878, 123)),
        (write_file(1, 9999, 1), write_file(1, 9999, 2)),
        (write_file(1, 0, 1), write_file(0, 0, 1)),
        (write_file(1, 0, 1), write_file(1, 0, 0)),
        (
            Ask::Registers {
                inputs: true,
                first: 65_535,
                count: 1,
            },
            Ask::Registers {
                inputs: true,
                first: 65_535,
                count: 2,
            },
        ),
        (
            Ask::Packed {
                first: 0,
                count: 9,
                bytes: vec![0; 2],
            },
            Ask::Packed {
                first: 0,
                count: 9,
                bytes: vec![0; 3],
            },
        ),
        (read_file(1, 0, 1), Ask::ReadFile { groups: vec![] }),
        (write_file(1, 0, 1), Ask::WriteFile { groups: vec![] }),
        (
            Ask::ReadFile {
                groups: vec![
                    FileRange {
                        file: 1,
                        record: 0,
                        count: 1
                    };
                    35
                ],
            },
            Ask::ReadFile {
                groups: vec![
                    FileRange {
                        file: 1,
                        record: 0,
                        count: 1
                    };
                    36
                ],
            },
        ),
    ] {
        let encoded = |ask: &Ask| {
            let mut adu = [0; 256];
            let encoded = ask.request(|it| encode(it, UNIT, &mut adu));
            encoded
                .map(|encoded| adu[..encoded.len.into()].to_vec())
                .ok()
        };
        assert!(encoded(&right).is_some(), "{right:?}");
        assert_eq!(encoded(&right), right.frame(UNIT));
        assert_eq!(encoded(&wrong), None, "{wrong:?}");
        assert_eq!(wrong.frame(UNIT), None, "the test's own: {wrong:?}");
    }
}

#[test]
fn errors_name_the_accepted_values() {
    for (ask, unit, text) in [
        (
            Ask::Write {
                first: 0,
                values: vec![0; 124],
            },
            1,
            "count is 124, must be 1..=123",
        ),
        (
            Ask::Bits {
                inputs: false,
                first: 65_530,
                count: 10,
            },
            1,
            "first is 65530, must be 0..=65526 for a count of 10",
        ),
        (
            Ask::Status,
            0,
            "unit is 0, must be 1..=247: function 7 reads, and a broadcast has no answer",
        ),
        (Ask::Status, 250, "unit is 250, must be 0..=247"),
        (
            Ask::Raw {
                function: 200,
                data: vec![],
            },
            1,
            "function is 200, must be 1..=127",
        ),
        (
            Ask::Device { code: 9, object: 0 },
            1,
            "code is 9, must be 1..=4",
        ),
    ] {
        let encoded = ask.request(|it| encode(it, unit, &mut [0; 256]));
        assert_eq!(encoded.expect_err("wrong").to_string(), text);
    }
}

#[test]
fn the_data_of_an_answer_is_read_from_its_frame() {
    let answer_to = |function: u8| {
        let mut examples = examples().into_iter();
        examples
            .find(|(_, request, _)| request[1] == function)
            .expect("an example")
            .2
    };
    let frame = answer_to(0x0C);
    let log = GetEventLog.answer(&frame).expect("right");
    assert_eq!(
        (log.busy, log.events, log.messages, log.log),
        (false, 0x0108, 0x0121, &[0x20, 0][..])
    );

    let frame = answer_to(0x11);
    let id = ReportServerId.answer(&frame).expect("right");
    assert_eq!(id.with_id_len(1), Some((&[0x11][..], true, &b"abc"[..])));
    assert_eq!(
        (id.with_id_len(2), id.with_id_len(9), id.bytes().len()),
        (None, None, 5)
    );

    let groups = [
        FileRange {
            file: 4,
            record: 1,
            count: 2,
        },
        FileRange {
            file: 3,
            record: 9,
            count: 2,
        },
    ];
    let frame = answer_to(0x14);
    let records = ReadFiles { groups: &groups }.answer(&frame).expect("right");
    let records: Vec<Vec<u16>> = records.map(|group| group.iter().collect()).collect();
    assert_eq!(records, [[0x0DFE, 0x0020], [0x33CD, 0x0040]]);

    let frame = answer_to(0x2B);
    let device = ReadIdentification { code: 1, object: 0 }
        .answer(&frame)
        .expect("right");
    let objects: Vec<_> = device.objects.collect();
    assert_eq!(objects, [(0, &b"AB"[..]), (1, &b"C"[..]), (2, &b"V2."[..])]);
    assert_eq!((device.conformity, device.next), (1, None));
}
