//! The line by itself: transmitted frames, and settings changed at run time, with the HAL's example `line`.

use multidrop_bus::{
    Answer, Bus, BusConfig, Format, HostId, HostPort, Line, Nano, NodeId, Time, Tx,
};
use multidrop_testkit::{Rules, assert_bus_rules, example, frames};

const START: Line = Line::n81(38_400);
/// The first of [`FORMATS`]: RTU needs eight data bits.
const RTU_FORMATS: usize = 4;
const GREETING: &[u8] = b"here again";

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

fn rig() -> (Bus, NodeId, HostId) {
    let mut bus = Bus::new(BusConfig::default());
    let node = bus
        .add_nano(Nano::new("line", example("line")))
        .expect("a valid image");
    let host = bus.add_host(HostPort::new(START));
    bus.run_for(Time::from_ms(20));
    (bus, node, host)
}

/// What ends a frame, as the register INTER_CHARACTER has it.
const STRICT: u8 = 0;
const OFF: u8 = 1;

fn set_up(format: usize, baud: u32, inter_character: u8) -> Vec<u8> {
    let hundreds = u16::try_from(baud / 100).expect("a rate in hundreds");
    let [high, low] = hundreds.to_be_bytes();
    frames::adu(&[1, 0x42, format as u8, high, low, inter_character])
}

/// Sets the line up anew and listens for the greeting at the new settings.
fn change(bus: &mut Bus, host: HostId, format: usize, baud: u32) -> Vec<u8> {
    change_to(bus, host, &set_up(format, baud, STRICT), format, baud)
}

/// Changes the line by this request.
fn change_to(bus: &mut Bus, host: HostId, request: &[u8], format: usize, baud: u32) -> Vec<u8> {
    bus.host(host).take();
    let end = bus.host(host).send(request);
    bus.run_to(end);
    let line = Line {
        baud,
        format: FORMATS[format],
    };
    bus.host(host).set_line(line);
    bus.run_for(Time::from_ms(100) + line.character() * 20);
    let heard = bus.host(host).take();
    assert!(
        heard.iter().all(|byte| byte.is_good()),
        "{baud} {}: {heard:?}",
        line.format
    );
    heard.iter().map(|byte| byte.value).collect()
}

#[test]
fn a_frame_is_echoed_whole_and_in_time() {
    let (mut bus, _, host) = rig();
    for len in [2, 3, 17, 100, 254] {
        let body: Vec<u8> = (0..len).map(|index| (index * 37) as u8).collect();
        let frame = frames::adu(&body);
        let answer = bus.transact(host, &frame, Time::from_ms(300));
        assert_eq!(answer.expect("it comes back").bytes, frame, "{len} bytes");
    }
    assert_bus_rules(&bus, START);
}

#[test]
fn the_line_uses_every_format_that_is_loaded() {
    for (index, format) in FORMATS.into_iter().enumerate().take(RTU_FORMATS) {
        let (mut bus, _, host) = rig();
        let heard = change(&mut bus, host, index, 19_200);
        assert_eq!(heard, frames::adu(GREETING), "{format}");
        let conflicts = bus.record().conflicts();
        assert_eq!(conflicts, []);
    }
}

#[test]
fn settings_change_back_and_forth_and_every_frame_is_good() {
    let (mut bus, node, host) = rig();
    let settings = [
        (1, 19_200),
        (0, 115_200),
        (3, 9_600),
        (2, 57_600),
        (0, 500_000),
        (1, 2_400),
        (0, 38_400),
    ];
    for (format, baud) in settings {
        let heard = change(&mut bus, host, format, baud);
        assert_eq!(heard, frames::adu(GREETING), "{baud} {}", FORMATS[format]);
        let frame = frames::adu(&[7, 1, 2, 3]);
        let answer = bus.transact(host, &frame, Time::from_ms(300));
        assert_eq!(answer.expect("it comes back").bytes, frame);
    }
    assert!(bus.node(node).is_asleep());
    assert_eq!(bus.node(node).bad_opcodes(), 0);
}

#[test]
fn unsupported_settings_are_refused_and_the_old_ones_kept() {
    let (mut bus, _, host) = rig();
    let bauds = [100, 300, 3_000_000, 6_000_000].map(|baud| (0, baud));
    let formats = (RTU_FORMATS..FORMATS.len()).map(|format| (format, 38_400));
    for (format, baud) in bauds.into_iter().chain(formats) {
        let answer = bus.transact(host, &set_up(format, baud, STRICT), Time::from_ms(300));
        let bytes = answer.expect("an answer at the old settings").bytes;
        assert_eq!(bytes, frames::adu(b"no"), "{baud} {format}");
    }
    let frame = frames::adu(&[7, 1, 2, 3]);
    let answer = bus.transact(host, &frame, Time::from_ms(300));
    assert_eq!(answer.expect("it comes back").bytes, frame);
}

/// Sends pieces, so far apart, and gives what comes back.
fn say(bus: &mut Bus, host: HostId, pieces: &[&[u8]], apart: Time) -> Option<Answer> {
    let silence = bus.host(host).line().t35();
    bus.host(host).take();
    let mut end = bus.now();
    for (index, piece) in pieces.iter().enumerate() {
        let gap = if index == 0 { Time::ZERO } else { apart };
        let characters = piece.iter().enumerate();
        let characters = characters
            .map(|(at, &byte)| Tx::byte(byte).after(if at == 0 { gap } else { Time::ZERO }));
        end = bus.host(host).send_each(characters);
    }
    bus.run_to(end);
    assert_eq!(bus.host(host).take(), [], "talked over");
    let mut answer = bus.transact(host, &[], silence + Time::from_ms(100))?;
    answer.request_end = end;
    Some(answer)
}

/// Where gaps are allowed, `silence` less its last 1/24 ends a frame: two clocks measure it.
fn check_gaps(inter_character: u8, baud: u32, silence: Time) {
    let what = format!("{inter_character} at {baud} baud");
    let (mut bus, _, host) = rig();
    let line = Line::n81(baud);
    let request = set_up(0, baud, inter_character);
    let heard = change_to(&mut bus, host, &request, 0, baud);
    assert_eq!(heard, frames::adu(GREETING), "{what}");
    bus.run_for(silence);
    bus.clear_record();
    let frame = frames::adu(&[7, 1, 2, 3]);
    let (head, tail) = frame.split_at(3);
    // A gap in the frame, and one just before the end of the silence, which makes two that are damaged.
    for (percent, answered) in [(90, true), (95, true), (97, false), (99, false)] {
        let apart = silence * percent / 100;
        let answer = say(&mut bus, host, &[head, tail], apart);
        assert_eq!(answer.is_some(), answered, "{percent} % of {what}");
        if let Some(answer) = answer {
            assert_eq!(answer.bytes, frame);
            let after = answer.turnaround();
            let in_time = silence..silence + Time::from_us(40).max(line.bits(1));
            assert!(in_time.contains(&after), "{after}, {what}");
        }
        bus.run_for(Time::from_ms(50) + silence);
    }
    // Two frames: the answer to the first one is withdrawn.
    for percent in [97, 99, 100] {
        let other = frames::adu(&[8, 4, 5]);
        let answer = say(&mut bus, host, &[&frame, &other], silence * percent / 100);
        let bytes = answer.map(|answer| answer.bytes);
        assert_eq!(bytes, Some(other), "{percent} % of {what}");
        bus.run_for(Time::from_ms(50) + silence);
    }
    assert_bus_rules(&bus, Rules::with_gaps(line));
}

#[test]
fn with_gaps_allowed_t3_5_still_has_its_margin() {
    for baud in [1_200, 9_600, 19_200, 38_400, 115_200] {
        check_gaps(OFF, baud, Line::n81(baud).t35());
    }
}

/// Up to 50 ms, which Timer1 counts in parts; t3.5 where that is longer.
#[test]
fn a_gap_in_ms_ends_a_frame() {
    for baud in [1_200, 9_600, 115_200, 250_000] {
        for ms in [2, 16, 17, 32, 33, 50] {
            let silence = Time::from_ms(ms.into()).max(Line::n81(baud).t35());
            check_gaps(ms, baud, silence);
        }
    }
}
