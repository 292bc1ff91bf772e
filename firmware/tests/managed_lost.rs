//! Frames of a managed port that are not sent: another station begins to send, or they are cut off.

#[allow(dead_code, reason = "each test binary uses a part")]
mod bench;

use bench::{Bench, SENDS, TestLine, Wire};
use multidrop::PortConfig;
use multidrop::client::ClientError;
use multidrop::managed::{ManagedPort, managed_receive, managed_run};
use multidrop::protocol::format::Framing;
use multidrop::protocol::port_registers::{Mode, PortRegisters, Register};
use multidrop::protocol::registers::{Bank, NoCoils, NoRules};
use multidrop::protocol::server::Counted;
use multidrop::sniff::{Capture, Observer};

type Port = ManagedPort<TestLine, PortRegisters<Bank<4>, NoCoils, NoRules>, Counted<8>>;

const RS4: PortConfig = PortConfig::new("RS4").slave_id(17).timeout_ms(50);

fn open(
    bench: &mut Bench<'_>,
    config: PortConfig,
    capture: Option<&'static Capture<264>>,
) -> (&'static Wire, &'static Port) {
    let wire = Wire::new(config.line());
    let port = Port::counted(TestLine(wire), &config, config.bank(), NoCoils);
    let port = match capture {
        Some(capture) => port.printing(capture),
        None => port,
    };
    let port: &'static Port = Box::leak(Box::new(port));
    bench.wire(wire);
    bench.spawn(async move { managed_receive(port).await });
    bench.spawn(async move { managed_run(port).await });
    bench.poll();
    (wire, port)
}

#[test]
fn an_answer_that_was_cut_off_counts_as_no_response() {
    let mut bench = Bench::new();
    let (wire, _) = open(&mut bench, RS4, None);
    let asked = |bench: &mut Bench<'_>, pdu: &[u8], loses| {
        let before = wire.sent().len();
        wire.loses.set(loses);
        wire.hear(Ok([&[17], pdu].concat()));
        bench.run(SENDS + 3);
        let sent = wire.sent();
        assert_eq!(sent.len() - before, usize::from(loses.is_none()));
        sent.last().cloned()
    };
    // An answer that is made early, and one that is made late.
    for (pdu, missing) in [(&[3, 0, 0, 0, 1][..], 1), (&[6, 0, 0, 0, 1], 2)] {
        // The last one goes out, though the line still knows of the cut before.
        for loses in [Some(false), Some(true), None] {
            asked(&mut bench, pdu, loses);
        }
        let told = asked(&mut bench, &[8, 0, 0x0F, 0, 0], None);
        assert_eq!(told, Some(vec![17, 8, 0, 0x0F, 0, missing]));
    }
}

#[test]
fn a_request_that_was_overtaken_is_sent_again_and_one_that_was_cut_off_is_not() {
    let mut bench = Bench::new();
    let (wire, port) = open(&mut bench, RS4.client(), None);
    wire.answered_by(|request| vec![(5, Ok(vec![request[0], 3, 2, 0, 7]))]);
    wire.loses.set(Some(false));
    port.start().unwrap();
    let done = bench.ask(port.done());
    bench.run(SENDS + 10);
    assert_eq!(done.take(), Some(Ok(())));
    assert_eq!(wire.sent().len(), 1);

    wire.loses.set(Some(true));
    port.start().unwrap();
    let done = bench.ask(port.done());
    bench.run(SENDS + 10);
    let failure = done.take().expect("over").unwrap_err();
    assert_eq!(failure.cause, ClientError::CutOff);
    assert_eq!(port.read(Register::Status), Ok(6));
    assert_eq!(wire.sent().len(), 1);

    // Unless there are tries left.
    port.load_raw(Register::Retries, 1).unwrap();
    wire.loses.set(Some(true));
    port.start().unwrap();
    let done = bench.ask(port.done());
    bench.run(SENDS + 10);
    assert_eq!(done.take(), Some(Ok(())));
    assert_eq!(wire.sent().len(), 2);
}

#[test]
fn text_that_was_not_sent_is_sent_again() {
    const PRINTS: PortConfig = PortConfig::new("RS2")
        .mode(Mode::Sniffer)
        .framing(Framing::Text);
    let mut bench = Bench::new();
    let capture: &'static Capture<264> = Box::leak(Box::new(Capture::new()));
    let (wire, _) = open(&mut bench, PRINTS, Some(capture));
    for loses in [None, Some(false), Some(true)] {
        wire.loses.set(loses);
        capture.hear(Ok(&[17, 3, 0, 0, 0, 1]));
        bench.run(20);
    }
    let lines = String::from_utf8(wire.sent().concat()).unwrap();
    let lines: Vec<_> = lines.lines().map(|line| &line[9..]).collect();
    assert_eq!(lines, ["req 11 03 00 00 00 01"; 3]);
}
