//! `relay-panel` on the bus, its server a plain model on a host: requests, display, and the reaction to every fault.

use multidrop_bus::{
    Bus, BusConfig, Frame, Framing, HostId, HostPort, Level, Nano, NodeId, Pin, Station, Time, Tx,
    framed,
};
use multidrop_testkit::frames::{adu, data, exception, words};
use multidrop_testkit::{LINE, Rules, assert_bus_rules, image};

const BUTTONS: [Pin; 2] = [Pin::D3, Pin::D4];
const LEDS: [Pin; 2] = [Pin::D5, Pin::D6];
const ERROR: Pin = Pin::B5;

const POLL: Time = Time::from_ms(250);
/// From the start to a little before the second poll.
const UP_TO_A_POLL: Time = Time::from_ms(220);
const TIMEOUT: Time = Time::from_ms(150);
const SHOWN: Time = Time::from_ms(500);
/// A button is looked at every 10 ms, twice.
const PRESS: Time = Time::from_ms(40);

/// What [`Rig::check`] takes.
const CHECK: Time = Time::from_ms(5);

/// What the board does with a request.
type Answer = Vec<Tx>;

/// A panel, and a relay board by the book.
struct Rig {
    bus: Bus,
    panel: NodeId,
    host: HostId,
    relays: [bool; 2],
    /// Requests since they were looked at last, and when they ended.
    asked: Vec<(Time, Vec<u8>)>,
}

impl Rig {
    fn new() -> Self {
        let mut bus = Bus::new(BusConfig::default());
        let mut nano = Nano::new("panel", image("relay-panel", &[]));
        nano.watch = vec![LEDS[0], LEDS[1], ERROR];
        let panel = bus.add_nano(nano).expect("a valid image");
        let host = bus.add_host(HostPort::new(LINE));
        for button in BUTTONS {
            bus.node_mut(panel).set_input(button, Some(true));
        }
        Rig {
            bus,
            panel,
            host,
            relays: [false; 2],
            asked: Vec::new(),
        }
    }

    /// The right answer, the relays moved.
    fn answer(&mut self, request: &[u8]) -> Vec<u8> {
        assert_eq!(request, adu(&request[..6]), "a damaged request");
        let register = usize::from(request[3]);
        if request[1] == 6 {
            assert_eq!(request[..6], [1, 6, 0, register as u8, 3, 0]);
            self.relays[register - 1] ^= true;
            return request.to_vec();
        }
        assert_eq!(request[..6], [1, 3, 0, 1, 0, 2]);
        let [first, second] = self.relays.map(u8::from);
        data(1, 3, &[0, first, 0, second])
    }

    /// Runs for a time. `board` says what goes on the wire, t3.5 and a ms after each request.
    fn run_with(&mut self, span: Time, mut board: impl FnMut(&mut Rig, &[u8]) -> Answer) {
        let end = self.bus.now() + span;
        let mut heard = Vec::new();
        while self.bus.now() < end {
            let host = self.host;
            let left = end - self.bus.now();
            self.bus
                .run_until(|bus| bus.host(host).heard().len() > 0, left);
            for byte in self.bus.host(host).take() {
                assert!(byte.is_good(), "{}", self.bus.record());
                heard.push(byte.value);
            }
            if heard.len() == 8 {
                let request = std::mem::take(&mut heard);
                self.asked.push((self.bus.now(), request.clone()));
                let answer = board(self, &request);
                if !answer.is_empty() {
                    self.bus.run_for(LINE.t35() + Time::from_ms(1));
                    let over = self.bus.host(host).send_each(answer);
                    self.bus.run_to(over);
                }
            }
        }
        assert!(heard.is_empty(), "half a request: {heard:02x?}");
    }

    /// Runs with a board that does all right.
    fn run(&mut self, span: Time) {
        self.run_with(span, |rig, request| good(&rig.answer(request)));
    }

    /// Runs; the first answer to this function is spoilt.
    fn run_spoilt(&mut self, span: Time, function: u8, spoil: impl Fn(Vec<u8>) -> Answer) {
        let mut spoilt = false;
        self.run_with(span, |rig, request| {
            let answer = rig.answer(request);
            if !spoilt && request[1] == function {
                spoilt = true;
                spoil(answer)
            } else {
                good(&answer)
            }
        });
        assert!(spoilt);
    }

    fn press(&mut self, button: usize, down: bool) {
        let pin = BUTTONS[button];
        self.bus.node_mut(self.panel).set_input(pin, Some(!down));
    }

    fn is_on(&self, pin: Pin) -> bool {
        self.bus.node(self.panel).output(pin) == Level::High
    }

    fn shown(&self) -> [bool; 2] {
        LEDS.map(|led| self.is_on(led))
    }

    /// Requests with this function since they were looked at last.
    fn count(&self, function: u8) -> usize {
        let asked = self.asked.iter();
        asked.filter(|(_, request)| request[1] == function).count()
    }

    /// Checks the rules of the bus and forgets what was.
    fn check(&mut self) {
        self.bus.run_for(CHECK);
        assert_bus_rules(&self.bus, Rules::client(LINE));
        self.bus.clear_record();
        self.asked.clear();
    }
}

fn good(bytes: &[u8]) -> Answer {
    bytes.iter().map(|&byte| Tx::byte(byte)).collect()
}

#[test]
fn the_panel_polls_and_shows_the_relays() {
    let mut rig = Rig::new();
    rig.relays = [false, true];
    rig.run(Time::from_ms(1100));
    assert_eq!(rig.shown(), [false, true]);
    assert!(!rig.is_on(ERROR));
    let times: Vec<Time> = rig.asked.iter().map(|(time, _)| *time).collect();
    assert_eq!(times.len(), 5);
    // The first waits until the line is known to be silent.
    for pair in times[1..].windows(2) {
        let apart = (pair[1] - pair[0]).us();
        assert!((apart - POLL.us()).abs() < 200.0, "{apart} us apart");
    }
    // Somebody else moves a relay.
    rig.relays = [true, false];
    rig.run(Time::from_ms(260));
    assert_eq!(rig.shown(), [true, false]);
    rig.check();
}

#[test]
fn a_button_toggles_its_relay_once_and_the_state_is_read_back_at_once() {
    let mut rig = Rig::new();
    rig.run(Time::from_ms(300));
    for (button, expected) in [(0, [true, false]), (1, [true, true]), (0, [false, true])] {
        rig.check();
        rig.press(button, true);
        // Held, and not twice.
        rig.run(PRESS + Time::from_ms(400));
        rig.press(button, false);
        rig.run(Time::from_ms(60));
        assert_eq!(rig.relays, expected);
        assert_eq!(rig.shown(), expected);
        assert_eq!(rig.count(6), 1);
        assert!(!rig.is_on(ERROR));
    }
    rig.check();
    // Both at once.
    rig.press(0, true);
    rig.press(1, true);
    rig.run(Time::from_ms(200));
    assert_eq!((rig.relays, rig.count(6)), ([true, false], 2));
    rig.check();
}

#[test]
fn the_state_is_asked_for_as_soon_as_the_toggle_is_answered() {
    let mut rig = Rig::new();
    rig.run(Time::from_ms(300));
    rig.check();
    rig.press(0, true);
    rig.run(Time::from_ms(100));
    let frames = framed(rig.bus.record(), LINE, Framing::Rtu);
    let toggled = |frame: &Frame| frame.from != Station::Node(rig.panel) && frame.bytes()[1] == 6;
    let answer = frames.iter().position(toggled).expect("an answer");
    let gap = frames[answer + 1].start() - frames[answer].end();
    println!("{} us after t3.5", gap.us() - LINE.t35().us());
    assert!(
        gap >= LINE.t35() && gap <= LINE.t35() + LINE.bits(2),
        "{} us",
        gap.us()
    );
    rig.check();
}

/// Delayed, cut, doubled, corrupted at every byte, wrong: tried once more, and then right.
#[test]
fn a_poll_whose_answer_is_damaged_is_sent_again() {
    let mut rig = Rig::new();
    rig.relays = [true, false];
    rig.run(UP_TO_A_POLL);
    let len = data(1, 3, &[0, 1, 0, 0]).len();
    let mut faults: Vec<Box<dyn Fn(Vec<u8>) -> Answer>> = Vec::new();
    for place in 0..len {
        faults.push(Box::new(move |answer| {
            let mut answer = good(&answer);
            answer[place] = answer[place].flip_bit((place % 8) as u8);
            answer
        }));
        faults.push(Box::new(move |answer| {
            let mut answer = good(&answer);
            answer[place] = answer[place].bad_stop();
            answer
        }));
        faults.push(Box::new(move |answer| good(&answer[..place])));
    }
    for wrong in [
        data(2, 3, &[0, 9, 0, 9]),
        data(1, 4, &[0, 9, 0, 9]),
        data(1, 3, &[0, 9]),
        data(1, 3, &[0, 9, 0, 9, 0, 9]),
        exception(1, 4, 2),
    ] {
        faults.push(Box::new(move |_| good(&wrong)));
    }
    // Twice in one frame.
    faults.push(Box::new(|answer| good(&answer.repeat(2))));
    // A silence inside.
    faults.push(Box::new(|answer| {
        let mut answer = good(&answer);
        answer[4] = answer[4].after(Time::from_us(1000));
        answer
    }));
    for (number, fault) in faults.iter().enumerate() {
        rig.relays[1] ^= true;
        rig.check();
        rig.run_spoilt(POLL - CHECK, 3, fault);
        assert_eq!(rig.count(3), 2, "fault {number}\n{}", rig.bus.record());
        let apart = rig.asked[1].0 - rig.asked[0].0;
        assert!(
            (TIMEOUT..TIMEOUT + Time::from_ms(5)).contains(&apart),
            "fault {number}: {} us",
            apart.us()
        );
        assert_eq!(rig.shown(), rig.relays, "fault {number}");
        assert!(!rig.is_on(ERROR), "fault {number}");
        // The poll behind it waits for the second answer, which is owed.
        rig.check();
        rig.run(POLL - CHECK);
        assert_eq!(rig.count(3), 1, "fault {number}");
    }
    rig.check();
}

/// Fault 10 of other clients: another unit's answer ended the wait. And an answer that comes twice.
#[test]
fn what_comes_before_and_after_the_right_answer_is_skipped() {
    let mut rig = Rig::new();
    rig.run(UP_TO_A_POLL);
    for before in [
        data(2, 3, &[0, 9, 0, 9]),
        vec![0x55; 7],
        data(1, 4, &[0, 9, 0, 9]),
    ] {
        for after in [vec![], data(1, 3, &[0, 9, 0, 9])] {
            rig.relays[0] ^= true;
            rig.check();
            rig.run_spoilt(POLL - CHECK, 3, |answer| {
                let mut all = good(&before);
                for frame in [&answer, &after] {
                    let begin = all.len();
                    all.extend(good(frame));
                    if let Some(first) = all.get_mut(begin) {
                        *first = first.after(Time::from_ms(3));
                    }
                }
                all
            });
            assert_eq!(rig.count(3), 1);
            assert_eq!(rig.shown(), rig.relays);
            assert!(!rig.is_on(ERROR));
        }
    }
    rig.check();
}

#[test]
fn a_toggle_whose_answer_is_lost_is_not_done_twice() {
    let mut rig = Rig::new();
    rig.run(Time::from_ms(300));
    rig.check();
    rig.press(0, true);
    rig.run_spoilt(Time::from_ms(400), 6, |_| vec![]);
    assert_eq!((rig.relays, rig.count(6)), ([true, false], 1));
    assert_eq!(rig.shown(), [true, false]);
    assert!(!rig.is_on(ERROR));
    rig.check();
}

#[test]
fn a_toggle_that_did_not_arrive_is_sent_again() {
    let mut rig = Rig::new();
    rig.run(Time::from_ms(300));
    rig.check();
    rig.press(1, true);
    let mut lost = false;
    rig.run_with(Time::from_ms(400), |rig, request| {
        if request[1] == 6 && !lost {
            lost = true;
            return vec![];
        }
        good(&rig.answer(request))
    });
    assert_eq!((rig.relays, rig.count(6)), ([false, true], 2));
    assert_eq!(rig.shown(), [false, true]);
    assert!(!rig.is_on(ERROR));
    rig.check();
}

#[test]
fn a_failure_is_shown_for_500_ms() {
    let mut rig = Rig::new();
    rig.run(Time::from_ms(300));
    rig.check();
    // One poll fails, with its retry.
    let mut failed = 0;
    rig.run_with(Time::from_ms(1500), |rig, request| {
        if failed < 2 {
            failed += 1;
            return vec![];
        }
        good(&rig.answer(request))
    });
    let edges: Vec<_> = rig
        .bus
        .record()
        .pin_edges()
        .iter()
        .filter(|edge| edge.pin == ERROR)
        .collect();
    let [on, off] = edges[..] else {
        panic!("{edges:?}");
    };
    let asked = rig.asked[1].0;
    let after = on.time - asked;
    assert!(
        (TIMEOUT..TIMEOUT + Time::from_ms(2)).contains(&after),
        "{} us",
        after.us()
    );
    let shown = off.time - on.time;
    assert!(
        (SHOWN..SHOWN + Time::from_ms(2)).contains(&shown),
        "{} us",
        shown.us()
    );
    rig.check();

    // A toggle that is refused.
    rig.press(0, true);
    rig.run_with(Time::from_ms(100), |rig, request| match request[1] {
        6 => good(&exception(1, 6, 4)),
        _ => good(&rig.answer(request)),
    });
    assert!(rig.is_on(ERROR));
    assert_eq!(rig.relays, [false; 2]);
    rig.check();
}

#[test]
fn a_missing_board_is_shown_and_found_again() {
    let mut rig = Rig::new();
    rig.run_with(Time::from_s(2), |_, _| vec![]);
    assert!(rig.is_on(ERROR));
    assert_eq!(rig.count(6), 0);
    // 150 ms, 150 ms, 50 ms in which an answer may be late, and again.
    assert!((11..=12).contains(&rig.count(3)), "{}", rig.count(3));
    rig.relays = [true, true];
    rig.run(Time::from_ms(900));
    assert!(!rig.is_on(ERROR));
    assert_eq!(rig.shown(), [true, true]);
    rig.check();
}

#[test]
fn it_works_with_relay_board() {
    let mut bus = Bus::new(BusConfig::default());
    let panel = bus
        .add_nano(Nano::new("panel", image("relay-panel", &[])))
        .expect("a valid image");
    let board = bus
        .add_nano(Nano::new("board", image("relay-board", &[])))
        .expect("a valid image");
    let host = bus.add_host(HostPort::new(LINE));
    for button in BUTTONS {
        bus.node_mut(panel).set_input(button, Some(true));
    }
    bus.run_for(Time::from_ms(310));
    bus.node_mut(panel).set_input(BUTTONS[1], Some(false));
    bus.run_for(Time::from_ms(100));
    // Relays are on D4 to D7.
    assert_eq!(bus.node(board).output(Pin::D5), Level::High);
    assert_eq!(bus.node(board).output(Pin::D4), Level::Low);
    assert_eq!(bus.node(panel).output(LEDS[1]), Level::High);
    assert_bus_rules(&bus, Rules::client(LINE));
    bus.clear_record();

    // Between two polls a host may ask it too.
    let mut ask = |request: &[u8]| {
        let answer = bus.transact(host, request, Time::from_ms(10));
        answer.map(|answer| answer.bytes)
    };
    assert_eq!(ask(&words(1, 6, 4, 0x0100)), Some(words(1, 6, 4, 0x0100)));
    assert_eq!(
        ask(&words(1, 3, 1, 4)),
        Some(data(1, 3, &[0, 0, 0, 1, 0, 0, 0, 1]))
    );
    assert_eq!(ask(&words(1, 6, 2, 0x0200)), Some(words(1, 6, 2, 0x0200)));
    assert_eq!(ask(&words(1, 6, 1, 0x0400)), Some(exception(1, 6, 3)));
    assert_eq!(ask(&words(1, 6, 5, 0x0100)), Some(exception(1, 6, 2)));
    assert_eq!(ask(&words(1, 3, 0, 1)), Some(exception(1, 3, 2)));
    assert_eq!(
        ask(&words(1, 3, 1, 4)),
        Some(data(1, 3, &[0, 0, 0, 0, 0, 0, 0, 1]))
    );
}
