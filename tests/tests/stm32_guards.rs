//! The guards of the STM32's lines: characters with errors but right data, a transceiver with an echo, settings
//! changed during a transmission, pins, and interrupts. In the image that is flashed.

use multidrop_bus::{Bus, Format, Line, RxByte, Silicon, Time, Tx, WireByte};
use multidrop_testkit::conforms::Board;
use multidrop_testkit::four::{AS1, Desk, RS4, setting};
use multidrop_testkit::frames::{adu, block, words};
use multidrop_testkit::plain::wire::{Way, ascii};
use multidrop_testkit::{LINE, Rig, Runner, conformance, ports, stm32_example};

/// The image of unit 17, with every counter.
fn unit(way: Way, line: Line) -> Rig {
    let image = conformance(Board::Stm32(Runner::Core), way, line);
    Rig::stm32(&image, Runner::Core, line)
}

/// A read of holding register 5, which holds its own number.
const READ: [u8; 6] = [17, 3, 0, 5, 0, 1];
const FIVE: [u8; 5] = [17, 3, 2, 0, 5];

/// Counters of FC 08: damaged frames, overruns.
const DAMAGED: u16 = 0x0C;
const OVERRUNS: u16 = 0x12;

#[track_caller]
fn expect_counted(rig: &mut Rig, counter: u16, count: u16) {
    rig.expect(&words(17, 8, counter, 0), &words(17, 8, counter, count));
}

/// A frame with this done to one of its characters; the one behind it has its start bit to itself.
fn with(bytes: &[u8], at: usize, damage: impl Fn(Tx) -> Tx) -> Vec<Tx> {
    let characters = bytes.iter().enumerate().map(|(place, &byte)| {
        let character = Tx::byte(byte);
        match place {
            _ if place == at => damage(character),
            _ if place == at + 1 => character.after(LINE.bits(2)),
            _ => character,
        }
    });
    characters.collect()
}

#[test]
fn a_character_with_a_low_stop_bit_or_wrong_parity_voids_its_frame_though_its_data_is_right() {
    for (format, damage) in [
        (Format::N81, Tx::bad_stop as fn(Tx) -> Tx),
        (Format::E81, Tx::bad_parity),
        (Format::E81, Tx::bad_stop),
    ] {
        let mut rig = unit(Way::Rtu, Line { format, ..LINE });
        let (request, answer) = (adu(&READ), adu(&FIVE));
        for at in 0..request.len() {
            let heard = rig.ask_each(with(&request, at, damage));
            assert_eq!(heard, [], "{format}, {at}");
            rig.pause(rig.line.t35());
            rig.expect(&request, &answer);
            expect_counted(&mut rig, DAMAGED, at as u16 + 1);
        }
        expect_counted(&mut rig, OVERRUNS, 0);
    }
}

#[test]
fn a_character_with_noise_voids_its_frame_though_its_data_is_right() {
    let mut rig = unit(Way::Rtu, LINE);
    let (request, answer) = (adu(&READ), adu(&FIVE));
    for (at, byte) in request.iter().enumerate() {
        let begin = rig.bus.now();
        rig.bus.host(rig.host).send(&request);
        // One of three samples about the middle of bit 3 is another.
        let middle = begin + LINE.character() * at as u64 + LINE.bits(4) + LINE.bits(1) / 2;
        let level = byte >> 3 & 1 == 0;
        rig.bus
            .noise(middle + LINE.bits(1) / 25, LINE.bits(1) / 10, level);
        let answered = rig.bus.transact(rig.host, &[], Time::from_ms(10));
        assert_eq!(answered, None, "{at}");
        rig.bus.clear_record();
        rig.expect(&request, &answer);
        expect_counted(&mut rig, DAMAGED, at as u16 + 1);
    }
}

#[test]
fn seven_bits_and_two_stop_bits_are_eight_of_which_the_last_is_one() {
    let format: Format = "7N2".parse().expect("a format");
    let mut rig = unit(Way::Ascii, Line { format, ..LINE }).ascii();
    let (request, answer) = (ascii(&READ, b'\n'), ascii(&FIVE, b'\n'));
    rig.expect(&request, &answer);
    // Not the first: what begins with another character than the colon is no frame.
    for at in 1..request.len() - 2 {
        // The first of the two stop bits is low.
        let heard = rig.ask_each(with(&request, at, |character| character.flip_bit(7)));
        assert_eq!(heard, [], "{at}");
        rig.pause(Time::from_ms(2));
        rig.expect(&request, &answer);
    }
    let sent = rig.bus.record().bytes().iter();
    assert!(sent.clone().all(WireByte::is_good));
}

#[test]
fn another_ascii_delimiter_fits_the_data_bits() {
    // Bit 7 of what FC 08/03 sets is there where a character has it.
    for (format, end) in [(Format::E71, 0x23), (Format::N81, 0xA3)] {
        let mut rig = unit(Way::Ascii, Line { format, ..LINE }).ascii();
        let change = [17, 8, 0, 3, 0xA3, 0];
        let heard = rig.ask(&ascii(&change, b'\n'));
        assert_eq!(
            heard[..heard.len() - 1],
            ascii(&change, 0)[..heard.len() - 1]
        );
        rig.expect_silence(&ascii(&READ, b'\n'));
        rig.pause(Time::from_ms(1_100));
        let heard = rig.ask(&ascii(&READ, end));
        assert_eq!(heard, ascii(&FIVE, end), "{format}");
    }
}

#[test]
fn de_lead_is_for_a_port_that_has_de() {
    let mut desk = Desk::new(&ports(Runner::Core), Runner::Core.emulator(), &[]).expect("an image");
    // DE_LEAD of AS1, which has none: 10 ms.
    let register = setting(AS1, 31);
    let load = block(10, 16, register, 2, &[0, 0, 0x27, 0x10]);
    for request in [&load, &words(10, 3, register, 2)] {
        let answer = desk.bus.transact(desk.pc, request, Time::from_ms(100));
        let after = answer.expect("an answer").turnaround();
        assert!(after < LINE.t35() + LINE.bits(2), "{after}");
    }
}

/// Answers and when they begin, of a server whose transceiver hears itself, if `echo`.
fn answers(echo: bool) -> Vec<(Vec<u8>, Time)> {
    let mut rig = unit(Way::Rtu, LINE);
    let stm32 = rig.bus.machines().next().expect("it is on the bus");
    let station = stm32.station(RS4).expect("it is on the wire");
    rig.bus.set_echo(station, echo);
    let requests = [
        adu(&READ),
        words(17, 6, 1, 0xFFFF),
        words(17, 3, 0, 100),
        words(17, 8, 0, 0x5500),
        words(17, 8, DAMAGED, 0),
        words(17, 8, OVERRUNS, 0),
        // Messages, and what was not answered.
        words(17, 8, 0x0B, 0),
        words(17, 8, 0x0E, 0),
        words(17, 8, 0x0F, 0),
    ];
    let answers = requests.iter().map(|request| {
        let answer = rig.exchange(request).expect("an answer");
        let begin = answer.received[0].start;
        // The next request comes when t3.5 is just over.
        (answer.bytes, begin)
    });
    answers.collect()
}

#[test]
fn a_server_with_an_echo_answers_like_one_without() {
    let deaf = answers(false);
    assert_eq!(deaf[0].0, adu(&FIVE));
    assert_eq!(deaf[4].0, words(17, 8, DAMAGED, 0));
    assert_eq!(answers(true), deaf);
}

/// When RS4 of `ports` sends in a second in which no unit answers.
fn polls(echo: bool) -> Vec<(Time, Time, u16)> {
    let mut desk = Desk::new(&ports(Runner::Core), Runner::Core.emulator(), &[]).expect("an image");
    let station = desk.station(RS4);
    desk.bus.set_echo(station, echo);
    desk.bus.run_for(Time::from_ms(1_000));
    let sent = desk.bus.record().sent_by(station);
    sent.map(|byte| (byte.start, byte.end, byte.value))
        .collect()
}

#[test]
fn a_client_with_an_echo_sends_like_one_without() {
    let deaf = polls(false);
    assert!(deaf.len() > 8 * 10, "{}", deaf.len());
    assert_eq!(polls(true), deaf);
}

/// What the host hears next, until the node's driver has been on so often.
fn heard_until(rig: &mut Rig, drives: usize) -> Vec<u8> {
    let over = |bus: &mut Bus| bus.record().de_edges().len() == 2 * drives;
    assert!(rig.bus.run_until(over, Time::from_ms(100)));
    let heard = rig.bus.host(rig.host).take();
    assert!(heard.iter().all(RxByte::is_good), "{heard:02x?}");
    heard.iter().map(|byte| byte.value).collect()
}

#[test]
fn a_frame_that_is_being_sent_goes_out_whole_before_settings_are_changed() {
    const GREETING: &[u8] = b"here again";
    let image = stm32_example(Runner::Core, "delays", LINE.baud);
    let faster = Line::n81(57_600);
    for (line, number, framing) in [
        (faster, 0, 0),
        (Line::n81(9_600), 0, 0),
        (
            Line {
                format: Format::E81,
                ..LINE
            },
            1,
            0,
        ),
        (
            Line {
                format: Format::E71,
                ..LINE
            },
            4,
            1,
        ),
        (
            Line {
                format: Format::E71,
                ..faster
            },
            4,
            1,
        ),
    ] {
        let mut rig = Rig::stm32(&image, Runner::Core, LINE);
        let [high, low] = ((line.baud / 100) as u16).to_be_bytes();
        rig.bus
            .host(rig.host)
            .send(&adu(&[7, 0x43, high, low, number, framing]));
        let what = format!("{line:?}, {framing}");
        assert_eq!(heard_until(&mut rig, 1), adu(GREETING), "{what}");
        rig.bus.host(rig.host).set_line(line);
        let second = match framing {
            0 => adu(GREETING),
            _ => ascii(GREETING, b'\n'),
        };
        assert_eq!(heard_until(&mut rig, 2), second, "{what}");
        let bytes = rig.bus.record().bytes();
        assert!(bytes.iter().all(WireByte::is_good), "{what}: {bytes:?}");
    }
}

fn silicon(desk: &mut Desk) -> &mut Silicon {
    let silicon = desk.bus.machine_mut(desk.machine).silicon();
    silicon.expect("it is not in QEMU")
}

#[test]
fn an_unconnected_port_receives_the_mark() {
    let mut desk = Desk::new(&ports(Runner::Core), Runner::Core.emulator(), &[]).expect("an image");
    let silicon = silicon(&mut desk);
    for (gpio, number) in [('A', 10), ('A', 3), ('B', 11), ('A', 1)] {
        silicon.drive(gpio, number, None);
        assert!(silicon.pin(gpio, number), "P{gpio}{number}");
    }
}

#[test]
fn interrupts_of_the_line_go_before_all_others_and_characters_before_alarms() {
    let mut desk = Desk::new(&ports(Runner::Core), Runner::Core.emulator(), &[]).expect("an image");
    let silicon = silicon(&mut desk);
    let mut priority = |irq: u32| {
        let word = silicon.register(0xE000_E400 + (irq & !3));
        word.expect("it is modelled") >> (8 * (irq & 3)) & 0xFF
    };
    // USART1, USART2, USART3, UART4; TIM5.
    for irq in [37, 38, 39, 52] {
        assert_eq!(priority(irq), 0x00, "{irq}");
    }
    assert_eq!(priority(50), 0x10);
    // TIM2, and the streams of DMA1 and DMA2 (RM0090 12.2).
    let streams = (11..=17).chain([47]).chain(56..=60).chain(68..=70);
    for irq in [28].into_iter().chain(streams) {
        assert_eq!(priority(irq), 0x80, "{irq}");
    }
}
