//! A port of a board that has no other: it has no functions for other ports, and everything else works.

#[allow(dead_code, reason = "each test binary uses a part")]
mod bench;

use std::cell::RefCell;

use bench::{Bench, SENDS, TestLine, Wire};
use multidrop::PortConfig;
use multidrop::managed::{ManagedPort, managed_receive, managed_run};
use multidrop::protocol::format::Framing;
use multidrop::protocol::frame::ReceiveErrors;
use multidrop::protocol::port_registers::{Mode, PortRegisters, Reason, Refused, Register};
use multidrop::protocol::registers::{Bank, NoCoils, NoRules};
use multidrop::protocol::server::Counted;
use multidrop::sniff::{Capture, Observer};

type Port<const HAS_NEIGHBOURS: bool> =
    ManagedPort<TestLine<HAS_NEIGHBOURS>, PortRegisters<Bank<4>, NoCoils, NoRules>, Counted<8>>;

/// Who looks at a line.
#[derive(Default)]
struct Eyes(RefCell<Vec<Result<Vec<u8>, ReceiveErrors>>>);

impl Observer for Eyes {
    fn hear(&self, seen: Result<&[u8], ReceiveErrors>) {
        self.0.borrow_mut().push(seen.map(<[u8]>::to_vec));
    }
}

struct Opened<const HAS_NEIGHBOURS: bool> {
    wire: &'static Wire,
    port: &'static Port<HAS_NEIGHBOURS>,
    eyes: &'static Eyes,
}

/// A port that counts, with its tasks; `capture` has what it prints.
fn open<const HAS_NEIGHBOURS: bool>(
    bench: &mut Bench<'_>,
    config: PortConfig,
    capture: Option<&'static Capture<264>>,
) -> Opened<HAS_NEIGHBOURS> {
    let wire = Wire::new(config.line());
    let eyes: &'static Eyes = Box::leak(Box::default());
    wire.observer.set(Some(eyes));
    let port = Port::counted(TestLine(wire), &config, config.bank(), NoCoils);
    let port = match capture {
        Some(capture) => port.printing(capture),
        None => port,
    };
    let port: &'static Port<HAS_NEIGHBOURS> = Box::leak(Box::new(port));
    bench.wire(wire);
    bench.spawn(async move { managed_receive(port).await });
    bench.spawn(async move { managed_run(port).await });
    bench.poll();
    Opened { wire, port, eyes }
}

const SLAVE: PortConfig = PortConfig::new("RS4").slave_id(17).timeout_ms(50);
const READ: [u8; 6] = [17, 3, 0, 0, 0, 1];

#[test]
fn a_port_alone_is_no_sniffer() {
    let mut bench = Bench::new();
    let alone = open::<false>(&mut bench, SLAVE, None);
    let refused = Refused {
        register: Register::Mode,
        value: 3,
        reason: Reason::NoSniffer,
    };
    assert_eq!(alone.port.load_raw(Register::Mode, 3), Err(refused));
    assert_eq!(alone.port.read(Register::Mode), Ok(1));
    // That value of MODE, and no other, nor that of another register.
    for (register, value) in [
        (Register::Mode, 0),
        (Register::Mode, 1),
        (Register::Mode, 2),
        (Register::Func, 3),
        (Register::Regs(0), 3),
        (Register::Retries, 3),
    ] {
        assert_eq!(alone.port.load_raw(register, value), Ok(()), "{register}");
        assert_eq!(alone.port.read(register), Ok(value), "{register}");
    }
    let beside = open::<true>(&mut bench, SLAVE, None);
    assert_eq!(beside.port.load_raw(Register::Mode, 3), Ok(()));
    assert_eq!(beside.port.read(Register::Mode), Ok(3));
}

#[test]
fn a_port_alone_is_a_slave_and_a_master_as_others_are() {
    let mut bench = Bench::new();
    let Opened { wire, port, eyes } = open::<false>(&mut bench, SLAVE, None);
    port.load_raw(Register::Regs(0), 0x1234).unwrap();
    wire.hear(Ok(READ.to_vec()));
    bench.run(SENDS + 3);
    assert_eq!(wire.sent(), [[17, 3, 2, 0x12, 0x34]]);
    // Another unit's, and one that is damaged: counted, and not answered.
    wire.hear(Ok(vec![18, 3, 0, 0, 0, 1]));
    bench.run(SENDS + 3);
    wire.hear(Err(ReceiveErrors::CHECK));
    bench.run(SENDS + 3);
    for (sub, count) in [(0x0B, 3), (0x0C, 1), (0x0E, 4)] {
        wire.hear(Ok(vec![17, 8, 0, sub, 0, 0]));
        bench.run(SENDS + 3);
        assert_eq!(wire.sent().last(), Some(&vec![17, 8, 0, sub, 0, count]));
    }
    assert!(eyes.0.borrow().is_empty(), "a slave shows nothing");

    port.load_raw(Register::Mode, 0).unwrap();
    wire.answered_by(|request| vec![(5, Ok(vec![request[0], 3, 2, 0, 7]))]);
    port.start().unwrap();
    bench.run(SENDS + 10);
    assert_eq!(port.read(Register::DataOk), Ok(1));
    assert_eq!(port.read(Register::Regs(0)), Ok(7));
    assert_eq!(
        *eyes.0.borrow(),
        [Ok(READ.to_vec()), Ok(vec![17, 3, 2, 0, 7])]
    );

    // Off it says nothing, whatever comes.
    port.load_raw(Register::Mode, 2).unwrap();
    let before = wire.sent().len();
    for heard in [Ok(READ.to_vec()), Err(ReceiveErrors::CHECK)] {
        wire.hear(heard);
        bench.run(SENDS + 3);
    }
    assert_eq!(wire.sent().len(), before);
    assert_eq!(eyes.0.borrow().len(), 2);
}

/// What a port that prints hears is nobody's: text goes out there.
#[test]
fn a_port_that_prints_does_not_show_its_own_line() {
    const PRINTS: PortConfig = PortConfig::new("RS2")
        .mode(Mode::Sniffer)
        .framing(Framing::Text);
    let mut bench = Bench::new();
    let capture: &'static Capture<264> = Box::leak(Box::new(Capture::new()));
    let Opened { wire, port, eyes } = open::<true>(&mut bench, PRINTS, Some(capture));
    for heard in [Ok(READ.to_vec()), Err(ReceiveErrors::CHECK)] {
        wire.hear(heard);
        bench.run(10);
    }
    assert!(eyes.0.borrow().is_empty());
    assert!(wire.sent().is_empty());
    capture.hear(Ok(&READ));
    bench.run(10);
    assert_eq!(wire.sent().len(), 1);
    // With another framing it listens, and prints nothing.
    port.load_raw(Register::Framing, 0).unwrap();
    bench.run(2);
    capture.hear(Ok(&READ));
    for heard in [Ok(READ.to_vec()), Err(ReceiveErrors::CHECK)] {
        wire.hear(heard);
        bench.run(10);
    }
    assert_eq!(wire.sent().len(), 1);
    assert_eq!(
        *eyes.0.borrow(),
        [Ok(READ.to_vec()), Err(ReceiveErrors::CHECK)]
    );
    // A damaged frame of others is no matter of a slave that this port may be: it counts as that only.
    let errors = |bench: &mut Bench<'_>| {
        wire.hear(Ok(vec![1, 8, 0, 0x0C, 0, 0]));
        bench.run(SENDS + 3);
        wire.sent().last().map(|sent| sent[5])
    };
    port.load_raw(Register::Mode, 1).unwrap();
    bench.run(2);
    assert_eq!(errors(&mut bench), Some(0));
    wire.hear(Err(ReceiveErrors::PARITY));
    bench.run(3);
    assert_eq!(errors(&mut bench), Some(1));
}
