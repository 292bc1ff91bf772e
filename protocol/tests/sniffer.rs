//! Requests and answers of every function, told apart and formatted.

use multidrop_protocol::frame::ReceiveErrors;
use multidrop_protocol::sniffer::{
    Counts, Direction, LINE_MAX, Sniffer, Text, write_damaged, write_frame,
};

struct Page(Vec<u8>);

impl Text for Page {
    fn push(&mut self, character: u8) {
        self.0.push(character);
    }
}

fn bytes(hex: &str) -> Vec<u8> {
    let words = hex.split_whitespace();
    words
        .map(|word| u8::from_str_radix(word, 16).unwrap())
        .collect()
}

/// Requests with their answers, as the standard has them in its examples (APP 6), to unit 17.
const EXCHANGES: &[(&str, &str)] = &[
    ("01 00 13 00 13", "01 03 CD 6B 05"),
    // As long as its request, and a byte count where that has an address.
    ("01 03 13 00 13", "01 03 CD 6B 05"),
    ("02 00 C4 00 16", "02 03 AC DB 35"),
    ("03 00 6B 00 03", "03 06 02 2B 00 00 00 64"),
    ("04 00 08 00 01", "04 02 00 0A"),
    ("05 00 AC FF 00", "05 00 AC FF 00"),
    ("06 00 01 00 03", "06 00 01 00 03"),
    ("07", "07 6D"),
    ("08 00 00 A5 37", "08 00 00 A5 37"),
    ("0B", "0B FF FF 01 08"),
    ("0C", "0C 08 00 00 01 08 01 21 20 00"),
    ("0F 00 13 00 0A 02 CD 01", "0F 00 13 00 0A"),
    ("10 00 01 00 02 04 00 0A 01 02", "10 00 01 00 02"),
    ("11", "11 02 11 FF"),
    (
        "14 0E 06 00 04 00 01 00 02 06 00 03 00 09 00 02",
        "14 0C 05 06 0D FE 00 20 05 06 33 CD 00 40",
    ),
    (
        "15 0D 06 00 04 00 07 00 03 06 AF 04 BE 10 0D",
        "15 0D 06 00 04 00 07 00 03 06 AF 04 BE 10 0D",
    ),
    ("16 00 04 00 F2 00 25", "16 00 04 00 F2 00 25"),
    (
        "17 00 03 00 06 00 0E 00 03 06 00 FF 00 FF 00 FF",
        "17 0C 00 FE 0A CD 00 01 00 03 00 0D 00 FF",
    ),
    ("18 04 DE", "18 00 06 00 02 01 B8 12 84"),
    ("2B 0E 01 00", "2B 0E 01 01 00 00 01 00 02 41 42"),
    ("41 01 02", "41 02 01"),
];

/// Frames of a bus, each 10 ms after the one before.
struct Bus {
    sniffer: Sniffer,
    time_us: u64,
}

const PATIENCE_MS: u32 = 100;

impl Bus {
    fn new() -> Self {
        Bus {
            sniffer: Sniffer::new(PATIENCE_MS),
            time_us: 0,
        }
    }

    fn frame(&mut self, frame: &[u8]) -> Direction {
        self.frame_after(10, frame)
    }

    fn frame_after(&mut self, ms: u64, frame: &[u8]) -> Direction {
        self.time_us += 1000 * ms;
        self.sniffer.frame(frame, self.time_us)
    }
}

#[test]
fn an_answer_is_known_by_what_it_follows() {
    let mut sniffer = Bus::new();
    for (request, answer) in EXCHANGES {
        let to_17 = |pdu: &str| bytes(&format!("11 {pdu}"));
        assert_eq!(
            sniffer.frame(&to_17(request)),
            Direction::Request,
            "{request}"
        );
        assert_eq!(sniffer.frame(&to_17(answer)), Direction::Answer, "{answer}");
        // Refused.
        let code = request[..2].to_owned();
        let code = u8::from_str_radix(&code, 16).unwrap() | 0x80;
        assert_eq!(sniffer.frame(&to_17(request)), Direction::Request);
        assert_eq!(sniffer.frame(&[17, code, 2]), Direction::Exception);
    }
    let count = EXCHANGES.len() as u32;
    assert_eq!(
        sniffer.sniffer.counts(),
        Counts {
            requests: 2 * count,
            answers: count,
            exceptions: count,
            ..Counts::default()
        }
    );
}

#[test]
fn what_is_not_answered_is_followed_by_a_request() {
    let mut sniffer = Bus::new();
    for request in [
        "11 03 00 6B 00 03",
        // The same once more, to another unit, with another function, a broadcast.
        "11 03 00 6B 00 03",
        "12 03 00 6B 00 03",
        "12 04 00 6B 00 03",
        "00 06 00 01 00 03",
        "00 06 00 01 00 03",
        "12 06 00 01 00 03",
    ] {
        assert_eq!(
            sniffer.frame(&bytes(request)),
            Direction::Request,
            "{request}"
        );
    }
    sniffer.sniffer.damaged();
    assert_eq!(
        sniffer.frame(&bytes("12 06 00 01 00 03")),
        Direction::Answer
    );
    // An answer to nothing.
    assert_eq!(sniffer.frame(&bytes("12 86 02")), Direction::Request);
    assert_eq!(
        sniffer.sniffer.counts(),
        Counts {
            requests: 8,
            broadcasts: 2,
            answers: 1,
            exceptions: 0,
            unanswered: 4,
            damaged: 1,
        }
    );
}

/// Those whose answer may be the request once more.
const ECHOES: &[u8] = &[0x05, 0x06, 0x08, 0x15, 0x16, 0x41];

#[test]
fn a_request_that_is_repeated_is_one() {
    let looks_like_an_answer = [
        ("01 03 13 00 18", ""),
        ("02 03 FF 00 01", ""),
        ("17 0A 00 00 06 00 0E 00 01 02 00 FF", ""),
    ];
    for (request, answer) in EXCHANGES.iter().chain(&looks_like_an_answer) {
        let frame = bytes(&format!("11 {request}"));
        let mut sniffer = Bus::new();
        assert_eq!(sniffer.frame(&frame), Direction::Request);
        for _ in 0..3 {
            let late = u64::from(PATIENCE_MS) + 1;
            let seen = sniffer.frame_after(late, &frame);
            assert_eq!(seen, Direction::Request, "{request}");
        }
        // What may be the answer is it soon after; other functions have none that is the same.
        let echoes = ECHOES.contains(&frame[1]);
        let seen = sniffer.frame_after(PATIENCE_MS.into(), &frame);
        assert_eq!(seen == Direction::Answer, echoes, "{request}");
        if !answer.is_empty() && !echoes {
            let answer = bytes(&format!("11 {answer}"));
            assert_eq!(sniffer.frame(&answer), Direction::Answer, "{request}");
        }
    }
}

#[test]
fn another_request_that_looks_like_an_answer_is_one() {
    for (first, second, after_ms) in [
        // Another address, as many as fill three bytes: later than any answer.
        ("01 00 13 00 18", "01 03 13 00 18", 101),
        ("02 03 00 00 11", "02 03 11 00 11", 101),
        // Three bytes where fewer or more were asked for.
        ("01 00 13 00 10", "01 03 13 00 10", 10),
        ("02 00 13 00 19", "02 03 13 00 19", 10),
        // Another value, address, group.
        ("06 00 01 00 03", "06 00 01 00 04", 10),
        ("05 00 01 FF 00", "05 00 02 FF 00", 10),
        ("16 00 04 00 F2 00 25", "16 00 05 00 F2 00 25", 10),
        ("41 01 02", "41 01 02", 101),
    ] {
        let mut sniffer = Bus::new();
        sniffer.frame(&bytes(&format!("11 {first}")));
        let seen = sniffer.frame_after(after_ms, &bytes(&format!("11 {second}")));
        assert_eq!(seen, Direction::Request, "{first}, {second}");
        assert_eq!(sniffer.sniffer.counts().unanswered, 1);
    }
}

#[test]
fn any_bytes_are_taken() {
    let mut sniffer = Bus::new();
    for first in [
        &[][..],
        &[17],
        &[17, 3],
        &[17, 0x83],
        &[0],
        &[255, 255, 255],
    ] {
        for second in [
            &[][..],
            &[17],
            &[17, 3],
            &[17, 3, 0],
            &[17, 0x83],
            &[17, 0x83, 2, 3],
        ] {
            sniffer.frame(first);
            sniffer.frame(second);
        }
    }
}

#[test]
fn a_line_of_text_for_each() {
    let mut page = Page(Vec::new());
    let frame = bytes("11 03 00 6B 00 03");
    write_frame(&mut page, 12_345_678, Direction::Request, &frame);
    write_frame(&mut page, 0, Direction::Answer, &[0x0A, 0xFF]);
    write_frame(&mut page, 1_000_000, Direction::Exception, &[17, 0x83, 2]);
    write_damaged(
        &mut page,
        59_999_999,
        ReceiveErrors::GAP | ReceiveErrors::CHECK,
    );
    write_damaged(&mut page, 10, ReceiveErrors::OVERRUN);
    assert_eq!(
        String::from_utf8(page.0).unwrap(),
        "12.345678 req 11 03 00 6B 00 03\r\n\
         0.000000 ans 0A FF\r\n\
         1.000000 exc 11 83 02\r\n\
         59.999999 bad gap check\r\n\
         0.000010 bad overrun\r\n"
    );
    let mut longest = Page(Vec::new());
    write_frame(&mut longest, u64::MAX, Direction::Request, &[0xEE; 254]);
    assert!(longest.0.len() <= LINE_MAX, "{}", longest.0.len());
}
