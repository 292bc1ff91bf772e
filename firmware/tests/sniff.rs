//! A port that listens, and one that prints the frames on it. Frames and lines of text are written out here.

#[allow(dead_code, reason = "each test binary uses a part")]
mod bench;

use bench::{Bench, Event, TestLine, Wire};
use multidrop::PortConfig;
use multidrop::managed::{ManagedPort, managed_receive, managed_run};
use multidrop::protocol::format::Framing;
use multidrop::protocol::frame::ReceiveErrors;
use multidrop::protocol::port_registers::{Mode, PortRegisters, Register};
use multidrop::protocol::registers::{Bank, CoilBank, NoRules};
use multidrop::sniff::{Capture, Observer, Seen};

const RS4: PortConfig = PortConfig::new("RS4")
    .mode(Mode::Sniffer)
    .baud(38_400)
    .timeout_ms(100);
const RS2: PortConfig = PortConfig::new("RS2")
    .mode(Mode::Sniffer)
    .framing(Framing::Text)
    .baud(115_200);

type Port = ManagedPort<TestLine, PortRegisters<Bank<10>, CoilBank<2>, NoRules>>;

struct Setup {
    heard: &'static Wire,
    printed: &'static Wire,
    rs4: &'static Port,
    rs2: &'static Port,
    capture: &'static Capture<384>,
}

/// A port that listens, and one that prints it.
fn setup(bench: &mut Bench<'_>) -> Setup {
    let capture: &'static Capture<384> = Box::leak(Box::new(Capture::new()));
    let mut open = |config: PortConfig, prints: bool| {
        let wire = Wire::new(config.line());
        let port = Port::new(TestLine(wire), &config, Bank::new(0), CoilBank::new(0, 16));
        let port = if prints { port.printing(capture) } else { port };
        let port: &'static Port = Box::leak(Box::new(port));
        bench.wire(wire);
        bench.spawn(async move { managed_receive(port).await });
        bench.spawn(async move { managed_run(port).await });
        (wire, port)
    };
    let (heard, rs4) = open(RS4, false);
    let (printed, rs2) = open(RS2, true);
    heard.observer.set(Some(capture));
    bench.poll();
    Setup {
        heard,
        printed,
        rs4,
        rs2,
        capture,
    }
}

/// What was printed.
fn text(wire: &Wire) -> String {
    String::from_utf8(wire.sent().concat()).unwrap()
}

/// The printed lines without their times.
fn lines(wire: &Wire) -> Vec<String> {
    let text = text(wire);
    let lines = text.split_terminator("\r\n");
    lines
        .map(|line| line.split_once(' ').unwrap().1.to_owned())
        .collect()
}

#[test]
fn requests_answers_and_damaged_frames_are_printed_with_their_times() {
    let mut bench = Bench::new();
    let setup = setup(&mut bench);
    let frames = [
        Ok(vec![17, 3, 0, 0x6B, 0, 1]),
        Ok(vec![17, 3, 2, 0xAB, 0xCD]),
        Ok(vec![18, 3, 0, 0, 0, 1]),
        Err(ReceiveErrors::CHECK | ReceiveErrors::GAP),
        Ok(vec![18, 0x83, 2]),
    ];
    for frame in frames {
        setup.heard.hear(frame);
        bench.run(10);
    }
    bench.run(20);
    assert_eq!(
        text(setup.printed),
        "0.002000 req 11 03 00 6B 00 01\r\n\
         0.012000 ans 11 03 02 AB CD\r\n\
         0.022000 req 12 03 00 00 00 01\r\n\
         0.031000 bad gap check\r\n\
         0.042000 exc 12 83 02\r\n"
    );
    let heard = setup.capture.counts();
    assert_eq!(
        (
            heard.requests,
            heard.answers,
            heard.exceptions,
            heard.damaged
        ),
        (2, 1, 1, 1)
    );
    assert!(setup.heard.sent().is_empty(), "a sniffer does not talk");
    assert_eq!(setup.capture.dropped(), 0);
}

#[test]
fn the_longest_frame_is_printed_whole_in_pieces() {
    let mut bench = Bench::new();
    let setup = setup(&mut bench);
    // Lines of all lengths, those among them that leave one character for the last piece.
    for len in [2, 80, 81, 82, 165, 166, 167, 250, 251, 252, 253, 254] {
        // No unit answers another.
        let frame: Vec<u8> = (0..len).map(|byte| (byte ^ len) as u8).collect();
        setup.heard.hear(Ok(frame.clone()));
        bench.run(60);
        let hex: String = frame.iter().map(|byte| format!(" {byte:02X}")).collect();
        assert_eq!(lines(setup.printed).pop(), Some(format!("req{hex}")));
    }
}

#[test]
fn frames_without_room_are_counted_and_the_others_kept_whole() {
    let mut bench = Bench::new();
    let setup = setup(&mut bench);
    for place in 0..100 {
        setup.heard.hear(Ok(vec![17, 6, 0, place, 0, 0]));
        // One goes out each 5 ms, two come.
        bench.run(2);
    }
    bench.run(300);
    let lines = lines(setup.printed);
    assert_eq!(lines.len() as u32 + setup.capture.dropped(), 100);
    assert!(setup.capture.dropped() > 10 && lines.len() > 40);
    for line in lines {
        assert!(line.starts_with("req 11 06 00 ") || line.starts_with("ans 11 06 00 "));
        assert_eq!(line.len(), 21);
    }
}

#[test]
fn a_frame_that_finds_no_room_leaves_no_part_of_it() {
    let mut bench = Bench::new();
    let capture: &'static Capture<264> = Box::leak(Box::new(Capture::new()));
    // The first leaves 40 bytes: room for time and length of the second, but not for its bytes.
    let frames = [vec![17; 214], vec![18; 31], vec![19; 30]];
    for frame in &frames {
        capture.hear(Ok(frame));
    }
    assert_eq!(capture.dropped(), 1);
    for expected in [&frames[0], &frames[2]] {
        let taken = bench.ask(capture.next(|_, seen| match seen {
            Seen::Frame(_, frame) => frame.to_vec(),
            Seen::Damaged(errors) => panic!("{errors}"),
        }));
        assert_eq!(taken.take().as_ref(), Some(expected));
    }
}

#[test]
fn text_that_was_not_sent_is_printed_again() {
    let mut bench = Bench::new();
    let setup = setup(&mut bench);
    setup.printed.loses.set(Some(false));
    setup.heard.hear(Ok(vec![17, 6, 0, 1, 0, 0]));
    bench.run(60);
    assert_eq!(lines(setup.printed), ["req 11 06 00 01 00 00"]);
}

#[test]
fn a_master_shows_its_requests_and_the_frames_it_receives() {
    let mut bench = Bench::new();
    let setup = setup(&mut bench);
    setup.rs4.load_raw(Register::Mode, 0).unwrap();
    let answers = [
        vec![],
        vec![(3, Err(ReceiveErrors::CHECK))],
        vec![(3, Ok(vec![1, 3, 2, 0, 7]))],
    ];
    for answer in answers {
        setup.heard.answered_by(move |_| answer.clone());
        setup.rs4.start().unwrap();
        // Until a late answer is not expected any more.
        bench.run(230);
    }
    assert_eq!(
        lines(setup.printed),
        [
            "req 01 03 00 00 00 01",
            "req 01 03 00 00 00 01",
            "bad check",
            "req 01 03 00 00 00 01",
            "ans 01 03 02 00 07"
        ]
    );
    assert_eq!(setup.capture.counts().unanswered, 2);
}

#[test]
fn a_port_that_prints_follows_loads() {
    let mut bench = Bench::new();
    let setup = setup(&mut bench);
    for round in 0..20 {
        setup.heard.hear(Ok(vec![17, 6, 0, round, 0, 0]));
        bench.run(u64::from(round) % 7);
        setup
            .rs2
            .load_raw(Register::Baud, 9600 + u32::from(round))
            .unwrap();
        bench.run(13);
    }
    assert_eq!(lines(setup.printed).len(), 20);
    let configured = |event: &&Event| matches!(event, Event::Configured(_));
    assert_eq!(
        setup.printed.log.borrow().iter().filter(configured).count(),
        20
    );
    // As a slave it answers, and prints no more.
    setup.rs2.load_raw(Register::Framing, 0).unwrap();
    setup.rs2.load_raw(Register::Mode, 1).unwrap();
    bench.run(2);
    setup.heard.hear(Ok(vec![17, 6, 0, 1, 0, 0]));
    setup.printed.hear(Ok(vec![1, 3, 0, 0, 0, 1]));
    bench.run(20);
    assert_eq!(setup.printed.sent()[20..], [vec![1, 3, 2, 0, 0]]);
}

#[test]
fn the_application_may_read_the_capture_itself() {
    let mut bench = Bench::new();
    let setup = setup(&mut bench);
    setup.rs2.load_raw(Register::Mode, 2).unwrap();
    bench.run(1);
    let first = bench.ask(setup.capture.next(|time, seen| {
        let Seen::Frame(direction, frame) = seen else {
            panic!("{seen:?}");
        };
        (time, format!("{direction:?}"), frame.to_vec())
    }));
    bench.run(5);
    assert!(first.borrow().is_none());
    setup.heard.hear(Ok(vec![17, 3, 0, 0, 0, 1]));
    bench.run(5);
    let expected = (8_000, "Request".to_owned(), vec![17, 3, 0, 0, 0, 1]);
    assert_eq!(first.take(), Some(expected));
    setup.heard.hear(Err(ReceiveErrors::PARITY));
    bench.run(5);
    let second = bench.ask(
        setup
            .capture
            .next(|_, seen| seen == Seen::Damaged(ReceiveErrors::PARITY)),
    );
    assert_eq!(second.take(), Some(true));
}
