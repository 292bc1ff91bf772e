//! A unit that fails in the middle of its answer lets go of the bus: its neighbours are heard, and it answers again.

mod common;

use common::conforms::Board;
use common::frames::{data, words};
use common::{LINE, Runner, faults, image, on_both};
use multidrop_bus::{Bus, BusConfig, HostId, HostPort, Line, Station, Stm32, Time, WireId};

on_both! {
    the_stm32_lets_go_of_the_bus_when_it_faults,
    the_stm32_bounds_how_long_it_sends,
}

/// How the unit fails, as `multidrop_firmware::faults` numbers it.
#[derive(Clone, Copy, Debug)]
enum Failure {
    Panic = 1,
    PanicInInterrupt = 2,
    UnhandledInterrupt = 3,
    LostReady = 6,
    LostSent = 7,
}

/// Causes of a start, as `multidrop_firmware::ResetCause` numbers them.
const POWER: u8 = 1;
const PIN: u8 = 4;
const FAULT: u8 = 5;
const OTHER: u8 = 6;

/// What a unit starts for at first.
fn first(board: Board) -> u8 {
    match board {
        // QEMU's RCC has no flags of resets.
        Board::Stm32(Runner::Qemu) => OTHER,
        Board::Nano | Board::Stm32(Runner::Core) => POWER,
    }
}

/// The unit that fails.
const UNIT: u8 = 5;

/// A unit that fails, and unit 1 beside it.
struct Desk {
    bus: Bus,
    host: HostId,
    unit: Station,
    line: Line,
}

impl Desk {
    fn new(board: Board, line: Line) -> Self {
        let mut bus = Bus::new(BusConfig::default());
        let baud = line.baud.to_string();
        let options: &[&str] = if line == LINE {
            &[]
        } else {
            &["--baud", &baud]
        };
        bus.add_image("neighbour", &image("demo-unit", options))
            .expect("a valid image");
        let unit = match board {
            Board::Nano => {
                let unit = bus.add_image("unit", &faults(board, line));
                unit.expect("a valid image").into()
            }
            Board::Stm32(runner) => {
                let stm32 = Stm32 {
                    name: "unit".to_owned(),
                    image: faults(board, line),
                    emulator: runner.emulator(),
                    wires: [None, None, None, Some(WireId::default())],
                };
                let unit = bus.add_stm32(stm32).expect("a valid image");
                bus.machine(unit).station(3).expect("RS4 is on the wire")
            }
        };
        let host = bus.add_host(HostPort::new(line));
        let mut desk = Desk {
            bus,
            host,
            unit,
            line,
        };
        desk.bus.run_for(BOOT);
        desk.is_well(first(board));
        desk
    }

    fn ask(&mut self, request: &[u8]) -> Vec<u8> {
        let patience = self.line.t35() + Time::from_ms(20);
        let answer = self.bus.transact(self.host, request, patience);
        answer.map_or(Vec::new(), |answer| answer.bytes)
    }

    /// Whether the unit drives the bus.
    fn drives(&self) -> bool {
        let mut edges = self.bus.record().de_edges().iter();
        edges
            .rfind(|edge| edge.from == self.unit)
            .is_some_and(|edge| edge.on)
    }

    fn neighbour_is_well(&mut self) {
        let answer = self.ask(&words(1, 3, 0, 1));
        assert_eq!(
            answer,
            data(1, 3, &[0, 0]),
            "the neighbour\n{}",
            self.bus.record()
        );
    }

    /// Both answer, and the unit has started for this cause.
    fn is_well(&mut self, cause: u8) {
        self.neighbour_is_well();
        let answer = self.ask(&words(UNIT, 3, 0, 2));
        assert_eq!(
            answer,
            data(UNIT, 3, &[0, cause, 1, 1]),
            "the unit\n{}",
            self.bus.record()
        );
    }

    /// Has the unit fail, and gives how long it has driven the bus.
    fn fail(&mut self, failure: Failure) -> Time {
        self.bus.clear_record();
        let request = words(UNIT, 4, failure as u16, 16);
        let end = self.bus.host(self.host).send(&request);
        let deadline = end + self.line.character() * 100;
        assert!(
            self.bus.run_until(
                |bus| bus.record().de_edges().iter().any(|edge| edge.on),
                self.line.character() * 30
            ),
            "{failure:?}: it does not answer"
        );
        let unit = self.unit;
        let let_go = self.bus.run_until(
            |bus| {
                let mut edges = bus.record().de_edges().iter();
                edges.any(|edge| edge.from == unit && !edge.on)
            },
            deadline.saturating_sub(self.bus.now()),
        );
        assert!(
            let_go,
            "{failure:?}: the bus is held\n{}",
            self.bus.record()
        );
        let edges = self.bus.record().de_edges().iter();
        let times: Vec<_> = edges
            .filter(|edge| edge.from == unit)
            .map(|edge| edge.time)
            .collect();
        // What was heard of it is no frame; the wire is silent before anybody asks again.
        self.bus
            .run_for(self.line.character() + self.line.t35() * 2);
        assert!(!self.drives(), "{failure:?}: the bus is driven again");
        self.bus.host(self.host).take();
        times[1] - times[0]
    }
}

/// Time to start anew.
const BOOT: Time = Time::from_ms(100);

/// How long the answer with 16 registers takes.
fn answer(line: Line) -> Time {
    line.character() * 37
}

fn starts_anew(board: Board, failures: &[Failure]) {
    let mut desk = Desk::new(board, LINE);
    for &failure in failures {
        let after = desk.fail(failure);
        assert!(after < answer(LINE), "{failure:?}: driven for {after}");
        desk.neighbour_is_well();
        desk.bus.run_for(BOOT);
        desk.is_well(FAULT);
        assert_eq!(desk.bus.record().conflicts(), [], "{failure:?}");
    }
}

fn the_stm32_lets_go_of_the_bus_when_it_faults(runner: Runner) {
    use Failure::{Panic, PanicInInterrupt, UnhandledInterrupt};
    starts_anew(
        Board::Stm32(runner),
        &[Panic, PanicInInterrupt, UnhandledInterrupt, Panic],
    );
}

/// By how much later a driver may let go: a character is rounded up to a tick of the timer, of 500 ns on the Nano, and the
/// interrupt takes its time.
const ROUNDED: Time = Time::from_us(40);

/// A transmission may take the time of its characters and of one more.
fn is_bounded(board: Board) {
    // At 2400 baud Timer1 of the Nano goes round four times in it.
    for line in [LINE, Line::n81(2_400)] {
        let mut desk = Desk::new(board, line);
        let bound = answer(line) + line.character();
        for failure in [Failure::LostReady, Failure::LostSent, Failure::LostReady] {
            let after = desk.fail(failure);
            let beyond = after.saturating_sub(bound);
            assert!(after > answer(line), "{failure:?}: driven for {after}");
            assert!(beyond < ROUNDED, "{failure:?}: {beyond} late");
            desk.neighbour_is_well();
            desk.bus.run_for(BOOT);
            // It goes on without a reset.
            desk.is_well(first(board));
            assert_eq!(desk.bus.record().conflicts(), [], "{failure:?}");
        }
    }
}

fn the_stm32_bounds_how_long_it_sends(runner: Runner) {
    is_bounded(Board::Stm32(runner));
}

#[test]
fn the_nano_bounds_how_long_it_sends() {
    is_bounded(Board::Nano);
}

/// Without a watchdog it says nothing more.
#[test]
fn the_nano_lets_go_of_the_bus_when_it_panics() {
    use Failure::{Panic, PanicInInterrupt, UnhandledInterrupt};
    for failure in [Panic, PanicInInterrupt, UnhandledInterrupt] {
        let mut desk = Desk::new(Board::Nano, LINE);
        let after = desk.fail(failure);
        assert!(after < answer(LINE), "{failure:?}: driven for {after}");
        for _ in 0..3 {
            desk.neighbour_is_well();
            desk.bus.run_for(BOOT);
        }
        assert_eq!(desk.ask(&words(UNIT, 3, 0, 2)), []);
        let Station::Node(node) = desk.unit else {
            unreachable!()
        };
        desk.bus.reset(node);
        desk.bus.run_for(BOOT);
        desk.is_well(FAULT);
        desk.bus.reset(node);
        desk.bus.run_for(BOOT);
        desk.is_well(PIN);
        desk.bus.power_cut(node);
        desk.bus.power_up(node);
        desk.bus.run_for(BOOT);
        desk.is_well(POWER);
        assert_eq!(desk.bus.record().conflicts(), [], "{failure:?}");
    }
}
