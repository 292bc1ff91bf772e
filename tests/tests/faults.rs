//! A unit that fails in the middle of its answer takes DE down: its neighbours can send, and it answers again.

use std::path::Path;

use multidrop_bus::{Bus, BusConfig, HostId, HostPort, Line, Station, Stm32, Time, WireId};
use multidrop_testkit::conforms::Board;
use multidrop_testkit::frames::{data, words};
use multidrop_testkit::{LINE, Runner, faults, image, on_both};

on_both! {
    the_stm32_lets_go_of_the_bus_when_it_faults,
    the_stm32_bounds_how_long_it_sends,
    the_stm32_tells_how_deep_its_stack_was,
    the_stm32_starts_anew_when_its_stack_is_used_up,
}

/// How the unit fails, as `multidrop_apps::faults` numbers it.
#[derive(Clone, Copy, Debug)]
enum Failure {
    Panic = 1,
    PanicInInterrupt = 2,
    UnhandledInterrupt = 3,
    Hang = 4,
    HangWithInterruptsOff = 5,
    LostReady = 6,
    LostSent = 7,
    Keep = 8,
    OverflowStack = 9,
}

/// Causes of a start, as `multidrop::ResetCause` numbers them.
const POWER: u8 = 1;
const WATCHDOG_RESET: u8 = 3;
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
        Self::with(board, line, &faults(board, line))
    }

    fn with(board: Board, line: Line, image_of_unit: &Path) -> Self {
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
                let unit = bus.add_image("unit", image_of_unit);
                unit.expect("a valid image").into()
            }
            Board::Stm32(runner) => {
                let stm32 = Stm32 {
                    name: "unit".to_owned(),
                    image: image_of_unit.to_path_buf(),
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
fn the_nano_limits_the_time_of_a_transmission() {
    is_bounded(Board::Nano);
}

#[test]
fn a_panic_of_the_nano_takes_de_down() {
    use Failure::{Panic, PanicInInterrupt, UnhandledInterrupt};
    starts_anew(
        Board::Nano,
        &[Panic, PanicInInterrupt, UnhandledInterrupt, Panic],
    );
}

#[test]
fn the_nano_reports_its_reset_cause() {
    let mut desk = Desk::new(Board::Nano, LINE);
    desk.fail(Failure::Panic);
    desk.bus.run_for(BOOT);
    desk.is_well(FAULT);
    let Station::Node(node) = desk.unit else {
        unreachable!()
    };
    desk.bus.reset(node);
    desk.bus.run_for(BOOT);
    desk.is_well(PIN);
    desk.bus.power_cut(node);
    desk.bus.power_up(node);
    desk.bus.run_for(BOOT);
    desk.is_well(POWER);
}

/// For the old boot loader there is no watchdog: the unit is silent for ever.
#[test]
fn the_nano_without_watchdog_is_silent_after_a_panic() {
    use Failure::{Panic, PanicInInterrupt, UnhandledInterrupt};
    for failure in [Panic, PanicInInterrupt, UnhandledInterrupt] {
        let image = image("faults", &["--bootloader", "old"]);
        let mut desk = Desk::with(Board::Nano, LINE, &image);
        let after = desk.fail(failure);
        assert!(after < answer(LINE), "{failure:?}: driven for {after}");
        for _ in 0..5 {
            desk.neighbour_is_well();
            desk.bus.run_for(Time::from_ms(900));
        }
        assert_eq!(desk.ask(&words(UNIT, 3, 0, 2)), [], "{failure:?}");
        let Station::Node(node) = desk.unit else {
            unreachable!()
        };
        desk.bus.reset(node);
        desk.bus.run_for(BOOT);
        desk.is_well(FAULT);
    }
}

/// The watchdog's time in the applications. That of the Nano is over between a half and the whole of it after the last time that
/// all tasks were alive, that of the STM32 from the last feeding on, which may be up to 666 ms before.
const WATCHDOG: Time = Time::from_s(2);

/// A unit that hangs is started anew by its watchdog, and not before its time may be over.
fn is_watched(board: Board) {
    let mut desk = Desk::new(board, LINE);
    // Its answer goes out by interrupts; the task that has worked it out does not come back.
    let after = desk.fail(Failure::Hang);
    assert!(after.saturating_sub(answer(LINE)) < ROUNDED, "{after}");
    desk.bus.run_for(WATCHDOG / 2 - Time::from_ms(100));
    desk.neighbour_is_well();
    assert_eq!(desk.ask(&words(UNIT, 3, 0, 2)), []);
    desk.bus.run_for(WATCHDOG / 2 + BOOT);
    desk.is_well(WATCHDOG_RESET);
    // Here nothing lets go of the bus but the reset.
    desk.bus.clear_record();
    let request = words(UNIT, 4, Failure::HangWithInterruptsOff as u16, 16);
    desk.bus.host(desk.host).send(&request);
    desk.bus.run_for(Time::from_ms(500));
    assert!(desk.drives());
    desk.bus.run_for(WATCHDOG + BOOT - Time::from_ms(500));
    assert!(!desk.drives());
    desk.bus.host(desk.host).take();
    desk.is_well(WATCHDOG_RESET);
}

#[test]
fn the_watchdog_of_the_nano_ends_a_hang() {
    is_watched(Board::Nano);
}

/// QEMU has no watchdog.
#[test]
fn the_watchdog_of_the_stm32_ends_a_hang() {
    is_watched(Board::Stm32(Runner::Core));
}

/// All tasks are alive, but one keeps the frame.
fn is_missed(board: Board) {
    let mut desk = Desk::new(board, LINE);
    desk.fail(Failure::Keep);
    desk.bus.run_for(WATCHDOG);
    assert_eq!(desk.ask(&words(UNIT, 3, 0, 2)), []);
    desk.neighbour_is_well();
    // Two seconds that a frame may be kept for, what is between two looks, and the watchdog's time.
    desk.bus.run_for(WATCHDOG * 2 + BOOT);
    desk.is_well(WATCHDOG_RESET);
}

#[test]
fn the_watchdog_of_the_nano_misses_a_frame_that_is_kept() {
    is_missed(Board::Nano);
}

#[test]
fn the_watchdog_of_the_stm32_misses_a_frame_that_is_kept() {
    is_missed(Board::Stm32(Runner::Core));
}

/// A unit whose stack grows into its variables starts anew.
fn is_guarded(board: Board, within: Time) {
    let mut desk = Desk::new(board, LINE);
    for _ in 0..2 {
        desk.bus.clear_record();
        let request = words(UNIT, 4, Failure::OverflowStack as u16, 16);
        desk.bus.host(desk.host).send(&request);
        desk.bus.run_for(within + BOOT);
        assert!(!desk.drives());
        desk.bus.host(desk.host).take();
        desk.is_well(FAULT);
        assert_eq!(desk.bus.record().conflicts(), []);
    }
}

/// Its end is looked at when the watchdog is fed.
#[test]
fn a_stack_overflow_resets_the_nano() {
    is_guarded(Board::Nano, WATCHDOG / 2 + Time::from_ms(100));
}

fn the_stm32_starts_anew_when_its_stack_is_used_up(runner: Runner) {
    is_guarded(Board::Stm32(runner), Time::from_ms(50));
}

/// What the unit tells of its stack: bytes that were in use, and all.
fn stack(desk: &mut Desk) -> (usize, usize) {
    let answer = desk.ask(&words(UNIT, 3, 2, 2));
    assert_eq!(answer.len(), 9, "{answer:02x?}");
    let word = |at| usize::from(u16::from_be_bytes([answer[at], answer[at + 1]]));
    (word(3), word(5))
}

#[test]
fn the_nano_reports_the_depth_of_its_stack() {
    let mut desk = Desk::new(Board::Nano, LINE);
    let (_, size) = stack(&mut desk);
    let (used, _) = stack(&mut desk);
    let Station::Node(node) = desk.unit else {
        unreachable!()
    };
    let node = desk.bus.node(node);
    assert_eq!(size, 2_048 - node.static_ram());
    // What was written there by chance looks painted.
    let peak = node.stack_peak();
    assert!(
        (peak.saturating_sub(2)..=peak).contains(&used),
        "{used}, {peak}"
    );
    assert!((50..400).contains(&used), "{used}");
}

fn the_stm32_tells_how_deep_its_stack_was(runner: Runner) {
    let mut desk = Desk::new(Board::Stm32(runner), LINE);
    let (used, size) = stack(&mut desk);
    assert!((200..4_096).contains(&used), "{used}");
    // More than the register can tell.
    assert_eq!(size, 65_535);
}
