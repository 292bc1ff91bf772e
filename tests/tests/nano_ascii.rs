//! ASCII on the line, with the HAL's example `ascii_line`, which echoes frames: the bytes here are text.

use multidrop_bus::{Bus, BusConfig, Format, HostId, HostPort, Line, Nano, Time, Tx};
use multidrop_testkit::{Rig, Rules, assert_bus_rules, example, frames};

/// As the example starts.
const START: Line = Line {
    baud: 19_200,
    format: Format::E71,
};

/// In the order in which the example knows them.
const FORMATS: [Format; 7] = [
    Format::N81,
    Format::E81,
    Format::O81,
    Format::N82,
    Format::E71,
    Format::O71,
    Format::N72,
];

/// ReceiveErrors as the example tells them.
const GAP: u8 = 1 << 0;
const PARITY: u8 = 1 << 1;
const FRAMING: u8 = 1 << 2;
const LENGTH: u8 = 1 << 4;
const CHECK: u8 = 1 << 5;
const CHARACTER: u8 = 1 << 6;

/// Read holding registers 107 to 109 from unit 17.
const REQUEST: &[u8] = b":1103006B00037E\r\n";

fn rig() -> Rig {
    Rig::with(&[&example("ascii_line")], START).ascii()
}

/// Unit id and PDU as a frame.
fn text(body: &[u8]) -> Vec<u8> {
    let sum: u32 = body.iter().map(|byte| u32::from(*byte)).sum();
    let mut text = String::from(":");
    for byte in body {
        text += &format!("{byte:02X}");
    }
    text += &format!("{:02X}\r\n", (256 - sum % 256) % 256);
    text.into_bytes()
}

fn plain(bytes: &[u8]) -> Vec<Tx> {
    bytes.iter().map(|&byte| Tx::byte(byte)).collect()
}

/// How many damaged frames the node has heard since it was asked last, and their errors.
fn damaged(rig: &mut Rig) -> (u8, u8) {
    let answer = rig.ask(&text(&[17, 0x44, 0, 0]));
    assert_eq!(answer[..5], *b":1144", "{answer:02x?}");
    let byte = |at: usize| {
        let digits = std::str::from_utf8(&answer[at..at + 2]).expect("digits");
        u8::from_str_radix(digits, 16).expect("digits")
    };
    (byte(5), byte(7))
}

#[test]
fn a_frame_is_sent_back_by_the_rules_and_within_two_bits_of_t3_5() {
    let mut rig = rig();
    for body in [
        &[17, 3, 0, 0x6B, 0, 3][..],
        &[17, 0],
        &[17, 0xAB, 0xCD, 0xEF, 0x3A, 0x0D, 0x0A],
        &[17; 254],
    ] {
        let answer = rig.exchange(&text(body)).expect("an answer");
        assert_eq!(answer.bytes, text(body));
        let late = answer.turnaround() - START.t35();
        assert!(late < START.bits(2), "{late:?}");
    }
    rig.expect(REQUEST, REQUEST);
    assert_eq!(damaged(&mut rig), (0, 0));
}

#[test]
fn lower_case_is_read_and_upper_case_sent() {
    let mut rig = rig();
    let sent = text(&[17, 0xAB, 0xCD, 0xEF]);
    rig.expect(&sent.to_ascii_lowercase(), &sent);
    rig.expect(b":1103006b00037e\r\n", REQUEST);
}

#[test]
fn a_colon_begins_a_new_frame_and_the_old_one_is_not_reported() {
    let mut rig = rig();
    for cut in 0..REQUEST.len() {
        let whole = [&REQUEST[..cut], REQUEST].concat();
        assert_eq!(rig.ask(&whole), REQUEST, "{cut}");
    }
    // A CR that no delimiter follows.
    assert_eq!(damaged(&mut rig), (1, CHARACTER));
}

#[test]
fn a_pause_of_most_of_a_second_is_allowed_anywhere_and_a_longer_one_nowhere() {
    let mut rig = rig();
    for at in 1..REQUEST.len() {
        for (pause, answered) in [(900, true), (995, true), (1005, false), (1100, false)] {
            let mut characters = plain(REQUEST);
            characters[at] = characters[at].after(Time::from_ms(pause));
            let heard = rig.ask_each(characters);
            let expected = if answered { REQUEST } else { &[] };
            assert_eq!(heard, expected, "{pause} ms before {at}");
        }
    }
    let cut_off = 2 * (REQUEST.len() - 1) as u8;
    let (count, errors) = damaged(&mut rig);
    assert_eq!((count, errors & GAP), (cut_off, GAP));
}

#[test]
fn a_frame_that_never_ends_is_reported_after_a_second() {
    let mut rig = rig();
    for cut in 1..REQUEST.len() {
        rig.expect_silence(&REQUEST[..cut]);
        rig.pause(Time::from_ms(1100));
    }
    rig.expect(REQUEST, REQUEST);
    let (count, errors) = damaged(&mut rig);
    assert_eq!((count, errors), (REQUEST.len() as u8 - 1, GAP));
}

/// One good request follows at once: it is answered, and the damaged one is not. Without its `:` it is no frame at all.
#[test]
fn a_character_damaged_on_the_wire_voids_its_frame_and_no_other() {
    for format in [Format::E71, Format::N81] {
        let line = Line { format, ..START };
        let mut rig = rig();
        set_up(&mut rig, 1, line);
        for at in 0..REQUEST.len() {
            let mut spoilt = 0;
            for bit in 0..format.data_bits() {
                let mut characters = plain(REQUEST);
                characters[at] = characters[at].flip_bit(bit);
                // Upper case or lower.
                let same = format == Format::N81 && bit == 5 && REQUEST[at].is_ascii_alphabetic();
                if same {
                    continue;
                }
                characters.extend(plain(REQUEST));
                let what = format!("bit {bit} of {at}, {format}");
                assert_eq!(rig.ask_each(characters), REQUEST, "{what}");
                spoilt += u8::from(at > 0);
            }
            let (count, errors) = damaged(&mut rig);
            assert_eq!(count, spoilt, "{at}, {format}");
            let seen = match format {
                Format::E71 => PARITY,
                _ => LENGTH | CHECK | CHARACTER,
            };
            assert!(at == 0 || errors & seen != 0, "{at}: {errors:02x}");
            let mut characters = plain(REQUEST);
            characters[at] = characters[at].bad_stop();
            // A receiver finds the next start bit after a high level only.
            let next = plain(REQUEST).into_iter().enumerate();
            if let Some(next) = characters.get_mut(at + 1) {
                *next = next.after(line.character());
            }
            characters.extend(next.map(|(index, character)| match index {
                0 => character.after(line.character()),
                _ => character,
            }));
            assert_eq!(rig.ask_each(characters), REQUEST, "stop bit of {at}");
            let (count, errors) = damaged(&mut rig);
            assert_eq!(count, u8::from(at > 0), "stop bit of {at}");
            assert!(at == 0 || errors & FRAMING != 0, "stop bit of {at}");
        }
    }
}

#[test]
fn an_invalid_frame_is_reported_once() {
    let mut rig = rig();
    let longest = text(&[17; 255]);
    for (wrong, errors) in [
        (&b":1103006B00037F\r\n"[..], CHECK),
        (b":1103006B000037E\r\n", LENGTH),
        (b":1103006G00037E\r\n", CHARACTER),
        (b":11030 06B00037E\r\n", CHARACTER),
        (b":11EF\r\n", LENGTH),
        (b":\r\n", LENGTH),
        (b":1103006B00037E\r\r\n", CHARACTER),
        (b":1103006B00037E\n\r\n", CHARACTER),
        (&longest, LENGTH),
    ] {
        rig.expect_silence(wrong);
        let (count, told) = damaged(&mut rig);
        assert_eq!(
            (count, told & errors),
            (1, errors),
            "{wrong:02x?}: {told:02x}"
        );
    }
}

#[test]
fn what_is_outside_of_a_frame_puts_an_answer_off_and_counts_nowhere() {
    let mut rig = rig();
    for noise in [&b"\n"[..], b"17\r\n", b"\0\x7f  "] {
        rig.expect_silence(noise);
        for gap in [Time::ZERO, START.t15(), START.t35() * 95 / 100] {
            let mut characters = plain(REQUEST);
            let noise = plain(noise).into_iter().enumerate();
            characters.extend(noise.map(|(index, character)| match index {
                0 => character.after(gap),
                _ => character,
            }));
            // The rules of the bus say that it is not answered into.
            assert_eq!(rig.ask_each(characters), REQUEST, "{gap:?}");
        }
    }
    assert_eq!(damaged(&mut rig), (0, 0));
}

#[test]
fn a_new_request_before_t3_5_is_answered_instead() {
    let mut rig = rig();
    let first = text(&[17, 1, 2, 3]);
    for gap in [Time::ZERO, START.t15(), START.t35() * 99 / 100] {
        let mut characters = plain(&first);
        characters.extend(plain(REQUEST));
        characters[first.len()] = characters[first.len()].after(gap);
        assert_eq!(rig.ask_each(characters), REQUEST, "{gap:?}");
    }
    assert_eq!(damaged(&mut rig), (0, 0));
}

#[test]
fn frames_of_neighbours_without_silence_are_not_answered() {
    let mut rig = rig();
    let other = text(&[5, 3, 6, 2, 0x2B, 0, 0, 0, 0x64]);
    let mut all = b":0503000000".to_vec();
    all.extend((0..20).flat_map(|_| other.clone()));
    all.extend(REQUEST);
    rig.expect(&all, REQUEST);
    assert_eq!(damaged(&mut rig), (0, 0));
}

#[test]
fn any_character_can_be_the_delimiter() {
    let mut rig = rig();
    let mut old = b'\n';
    for new in [b'!', b':', b'0', b'\r', 0, 0x7F, b'\n'] {
        let ended = |body: &[u8], delimiter| {
            let mut text = text(body);
            *text.last_mut().expect("a delimiter") = delimiter;
            text
        };
        let change = [17, 0x43, new];
        rig.expect(&ended(&change, old), &ended(&change, new));
        let body = [17, 0xC0, 0xFF, 0xEE];
        rig.expect(&ended(&body, new), &ended(&body, new));
        if old != new {
            rig.expect_silence(&ended(&body, old));
            rig.pause(Time::from_ms(1100));
        }
        rig.expect(&ended(&body, new), &ended(&body, new));
        old = new;
    }
}

/// Sets node and host up anew, to RTU (0) or ASCII (1).
fn set_up(rig: &mut Rig, framing: u8, line: Line) {
    let request = change(framing, line);
    let Rig { bus, host, .. } = rig;
    let end = bus.host(*host).send(&text(&request));
    bus.run_to(end);
    bus.host(*host).set_line(line);
    bus.run_for(Time::from_ms(100));
    bus.host(*host).take();
    bus.clear_record();
    rig.line = line;
}

fn change(framing: u8, line: Line) -> Vec<u8> {
    let format = FORMATS.iter().position(|format| *format == line.format);
    let [high, low] = ((line.baud / 100) as u16).to_be_bytes();
    let format = format.expect("one of them") as u8;
    vec![17, 0x42, framing, format, high, low]
}

struct Wires {
    bus: Bus,
    host: HostId,
    ascii: bool,
}

impl Wires {
    fn new() -> Self {
        let mut bus = Bus::new(BusConfig::default());
        bus.add_nano(Nano::new("ascii_line", example("ascii_line")))
            .expect("a valid image");
        let host = bus.add_host(HostPort::new(START));
        bus.run_for(Time::from_ms(20));
        let ascii = true;
        Wires { bus, host, ascii }
    }

    fn framed(&self, body: &[u8]) -> Vec<u8> {
        if self.ascii {
            text(body)
        } else {
            frames::adu(body)
        }
    }

    fn heard(&mut self) -> Vec<u8> {
        let heard = self.bus.host(self.host).take();
        assert!(heard.iter().all(|byte| byte.is_good()), "{heard:02x?}");
        heard.iter().map(|byte| byte.value).collect()
    }

    /// Asks the node to change, in the framing it has; what it says at the new settings.
    fn change(&mut self, framing: u8, line: Line) -> Vec<u8> {
        self.heard();
        let request = self.framed(&change(framing, line));
        let end = self.bus.host(self.host).send(&request);
        self.bus.run_to(end);
        self.bus.host(self.host).set_line(line);
        self.ascii = framing == 1;
        self.bus.run_for(Time::from_ms(200));
        self.heard()
    }

    fn ask(&mut self, body: &[u8]) -> Vec<u8> {
        let request = self.framed(body);
        let answer = self.bus.transact(self.host, &request, Time::from_ms(300));
        answer.map_or(Vec::new(), |answer| answer.bytes)
    }
}

#[test]
fn every_format_and_either_framing_back_and_forth() {
    let mut wires = Wires::new();
    let body = [17, 0xAB, 0x55, 0xAA, 0xFF, 0];
    let mut rounds = 0;
    for format in FORMATS {
        for baud in [2_400, 115_200] {
            let line = Line { baud, format };
            let heard = wires.change(1, line);
            assert_eq!(heard, text(b"here again"), "{baud} {format}");
            assert_eq!(wires.ask(&body), text(&body), "{baud} {format}");
            if format.data_bits() == 8 {
                let heard = wires.change(0, line);
                assert_eq!(heard, frames::adu(b"here again"), "{baud} {format}");
                assert_eq!(wires.ask(&body), frames::adu(&body), "{baud} {format}");
                rounds += 1;
            }
        }
    }
    assert_eq!(rounds, 8);
    let (_, node) = wires.bus.nodes().next().expect("the node");
    assert!(node.is_asleep());
    assert_eq!(node.bad_opcodes(), 0);
    assert_eq!(wires.bus.record().conflicts(), []);
}

#[test]
fn rtu_with_seven_bits_is_refused_and_the_old_settings_are_kept() {
    let mut wires = Wires::new();
    for format in [Format::E71, Format::O71, Format::N72] {
        let line = Line { format, ..START };
        let request = text(&change(0, line));
        let answer = wires.bus.transact(wires.host, &request, Time::from_ms(300));
        assert_eq!(answer.expect("an answer").bytes, text(b"no"), "{format}");
    }
    assert_eq!(wires.ask(&[17, 1, 2]), text(&[17, 1, 2]));
    assert_bus_rules(&wires.bus, Rules::ascii(START));
}

/// Frames of neighbours and a request, without a gap between characters nor between frames. At 1 Mbaud, where RTU works, some are
/// lost: each character of ASCII is decided in Rust.
#[test]
fn nothing_is_lost_at_high_rates() {
    for baud in [115_200, 250_000, 500_000] {
        for format in [Format::E71, Format::N81] {
            let mut rig = rig();
            set_up(&mut rig, 1, Line { baud, format });
            let mut all = Vec::new();
            for _ in 0..20 {
                all.extend(text(&[5, 3, 6, 2, 0x2B, 0, 0, 0, 0x64]));
            }
            let body: Vec<u8> = (0..254)
                .map(|byte| if byte == 0 { 17 } else { byte })
                .collect();
            all.extend(text(&body));
            assert_eq!(rig.ask(&all), text(&body), "{baud} {format}");
            assert_eq!(damaged(&mut rig), (0, 0), "{baud} {format}");
        }
    }
}
