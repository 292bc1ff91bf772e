//! The ports of the STM32 while interrupts are held off: lost characters, alarms that are past before they are set,
//! and characters that are read late. In the image that is flashed: QEMU's USARTs do not overrun, and it has no pin
//! to hold interrupts off with.

use multidrop_bus::{Bus, BusConfig, HostId, HostPort, Line, MachineId, Stm32, Time, Tx, WireId};
use multidrop_testkit::frames::{adu, data, words};
use multidrop_testkit::{LINE, Runner, stm32_example};

const RS4: usize = 3;

/// How long the image may take to see PC0.
const LOOK: Time = Time::from_us(70);

/// The image `held`: a server on each port, unit 1, each on a wire of its own with a host.
struct Desk {
    bus: Bus,
    machine: MachineId,
    hosts: [HostId; 4],
    line: Line,
}

impl Desk {
    fn new() -> Self {
        Self::at(LINE)
    }

    fn at(line: Line) -> Self {
        let mut bus = Bus::new(BusConfig::default());
        let wires = [bus.add_wire(), bus.add_wire(), bus.add_wire()];
        let wires = [wires[0], wires[1], wires[2], WireId::default()];
        let hosts = wires.map(|wire| bus.add_host_on(wire, HostPort::new(line)));
        let stm32 = Stm32 {
            name: "held".to_owned(),
            image: stm32_example(Runner::Core, "held", line.baud),
            emulator: Runner::Core.emulator(),
            wires: wires.map(Some),
        };
        let machine = bus.add_stm32(stm32).expect("a valid image");
        let mut desk = Desk {
            bus,
            machine,
            hosts,
            line,
        };
        desk.hold(false);
        desk.bus.run_for(line.t35() + Time::from_ms(10));
        desk
    }

    /// Holds interrupts off, within [`LOOK`], or lets them come at once.
    fn hold(&mut self, held: bool) {
        let silicon = self.bus.machine_mut(self.machine).silicon();
        silicon
            .expect("it is not in QEMU")
            .drive('C', 0, Some(held));
    }

    /// Interrupts are held off at `from`, and come at `to`.
    fn hold_over(&mut self, from: Time, to: Time) {
        self.bus.run_to(from.saturating_sub(LOOK));
        self.hold(true);
        self.bus.run_to(to);
        self.hold(false);
    }

    /// Sends a frame to a port; when it ends.
    fn send(&mut self, port: usize, frame: &[u8]) -> Time {
        let host = self.bus.host(self.hosts[port]);
        host.take();
        host.send(frame)
    }

    /// What a port says within the time of its longest answer here, and when that begins.
    fn heard(&mut self, port: usize) -> (Vec<u8>, Option<Time>) {
        self.bus
            .run_for(self.line.t35() * 2 + self.line.character() * 24);
        let heard = self.bus.host(self.hosts[port]).take();
        assert!(heard.iter().all(|byte| byte.is_good()), "{heard:02x?}");
        let start = heard.first().map(|byte| byte.start);
        (heard.iter().map(|byte| byte.value).collect(), start)
    }

    #[track_caller]
    fn expect(&mut self, port: usize, request: &[u8], answer: &[u8]) {
        let end = self.send(port, request);
        self.bus.run_to(end);
        assert_eq!(self.heard(port).0, answer, "port {port}, {request:02x?}");
    }

    #[track_caller]
    fn expect_alive(&mut self, port: usize) {
        self.expect(port, &read(), &zero());
    }

    /// A counter of FC 08.
    #[track_caller]
    fn expect_counted(&mut self, port: usize, counter: u16, count: u16) {
        let (request, answer) = (words(1, 8, counter, 0), words(1, 8, counter, count));
        self.expect(port, &request, &answer);
    }

    fn overruns(&self, port: usize) -> u64 {
        self.bus.machine(self.machine).overruns(port)
    }
}

/// A read of one register, which is 0.
fn read() -> Vec<u8> {
    words(1, 3, 0, 1)
}

fn zero() -> Vec<u8> {
    data(1, 3, &[0, 0])
}

/// Counters of FC 08: damaged frames, overruns.
const DAMAGED: u16 = 0x0C;
const OVERRUNS: u16 = 0x12;

#[test]
fn unread_characters_are_reported_as_overruns_and_their_frame_is_not_answered() {
    let mut desk = Desk::new();
    for port in 0..4 {
        // The first of two characters waits, the second is lost: any two but the first of all and the one behind it, which begin
        // before interrupts are held off.
        for place in 1..=6 {
            let lost = desk.overruns(port);
            let begin = desk.bus.now();
            desk.send(port, &read());
            let waits = begin + LINE.character() * place;
            desk.hold_over(
                waits + LINE.bits(5),
                waits + LINE.character() * 2 + LINE.bits(2),
            );
            assert_eq!(desk.overruns(port), lost + 1, "{place}");
            assert_eq!(desk.heard(port), (vec![], None), "port {port}, {place}");
            desk.expect_alive(port);
            desk.expect_counted(port, OVERRUNS, place as u16);
            desk.expect_counted(port, DAMAGED, place as u16);
        }
        let clear = words(1, 8, 0x14, 0);
        desk.expect(port, &clear, &clear);
        desk.expect_counted(port, OVERRUNS, 0);
        desk.expect_counted(port, DAMAGED, 6);
        desk.expect_counted((port + 1) % 4, OVERRUNS, 0);
    }
}

#[test]
fn the_log_has_the_overrun_in_its_receive_event() {
    let mut desk = Desk::new();
    let begin = desk.bus.now();
    desk.send(RS4, &read());
    desk.hold_over(begin + LINE.character() * 2, begin + LINE.character() * 5);
    assert_eq!(desk.heard(RS4).0, []);
    // A communication error and an overrun, and in front of it the receive event of this request.
    let log = [1, 0x0C, 8, 0, 0, 0, 0, 0, 1, 0x80, 0x92];
    desk.expect(RS4, &adu(&[1, 0x0C]), &adu(&log));
}

#[test]
fn a_character_lost_between_two_reads_of_the_receiver_is_reported_too() {
    let mut desk = Desk::new();
    let (mut answered, mut damaged) = (0, 0);
    // The last but one is taken about when the last is complete, in the middle of its stop bit.
    for step in 0..80 {
        let lost = desk.overruns(RS4);
        let begin = desk.bus.now();
        desk.send(RS4, &read());
        let complete = begin + LINE.character() * 8 - LINE.bits(1) / 2;
        let release = complete + Time::from_ns(step * 10) - Time::from_ns(700);
        desk.hold_over(begin + LINE.character() * 6 + LINE.bits(5), release);
        let heard = desk.heard(RS4).0;
        if desk.overruns(RS4) == lost {
            assert_eq!(heard, zero(), "{step}");
            answered += 1;
        } else {
            assert_eq!(heard, [], "{step}");
            damaged += 1;
            desk.expect_counted(RS4, OVERRUNS, damaged);
        }
    }
    assert!(answered > 10 && damaged > 10, "{answered}, {damaged}");
}

#[test]
fn a_late_alarm_delays_no_answer() {
    let mut desk = Desk::new();
    let t35 = LINE.t35();
    // t1.5 is over after 750 us, the frame stands after 1677, the answer begins after 1750.
    for (us, due) in [
        (400, t35),
        (1_000, t35),
        (1_400, t35),
        (1_690, t35),
        (2_500, Time::from_us(2_500)),
        (4_000, Time::from_us(4_000)),
    ] {
        for port in 0..4 {
            let end = desk.send(port, &read());
            desk.hold_over(end + Time::from_us(100), end + Time::from_us(us));
            let (heard, start) = desk.heard(port);
            assert_eq!(heard, zero(), "port {port}, {us} us");
            let after = start.expect("an answer") - end;
            assert!(
                after >= due && after < due + LINE.bits(2),
                "port {port}: {after}, {us} us"
            );
        }
    }
}

#[test]
fn alarms_of_all_ports_at_once_go_off_all() {
    let mut desk = Desk::new();
    for held in [false, true] {
        let ends = [0, 1, 2, 3].map(|port| desk.send(port, &read()));
        let end = ends[0];
        assert_eq!(ends, [end; 4]);
        if held {
            desk.hold_over(end + Time::from_us(100), end + Time::from_us(1_200));
        }
        desk.bus.run_to(end + LINE.t35() + LINE.character() * 10);
        for port in 0..4 {
            let (heard, start) = desk.heard(port);
            assert_eq!(heard, zero(), "port {port}");
            let after = start.expect("an answer") - end;
            assert!(
                after >= LINE.t35() && after < LINE.t35() + LINE.bits(2),
                "port {port}: {after}"
            );
        }
    }
}

#[test]
fn a_character_on_one_port_does_not_suppress_the_alarm_of_another() {
    let mut desk = Desk::new();
    for (port, other) in [(RS4, 0), (0, RS4), (1, 2)] {
        let end = desk.send(port, &read());
        // It is complete at 750 us; the other port's only character is before that is seen.
        desk.bus.run_to(end + Time::from_us(600));
        desk.send(other, &[0x55]);
        desk.hold_over(end + Time::from_us(700), end + Time::from_us(1_200));
        assert_eq!(desk.heard(port).0, zero(), "port {port}");
        assert_eq!(desk.heard(other).0, [], "port {other}");
    }
}

#[test]
fn a_character_that_waits_goes_before_the_alarm_that_would_end_its_frame() {
    // Slow enough that t1.5 is over before the character behind the one that waits.
    let line = Line::n81(9_600);
    let mut desk = Desk::at(line);
    for port in 0..4 {
        for place in 1..=6 {
            let begin = desk.bus.now();
            desk.send(port, &read());
            let comes = begin + line.character() * (place + 1) - line.bits(1) / 2;
            desk.hold_over(comes - line.bits(2), comes + line.character() * 7 / 10);
            assert_eq!(desk.heard(port).0, zero(), "port {port}, {place}");
        }
        assert_eq!(desk.overruns(port), 0);
    }
}

#[test]
fn silence_counts_from_the_last_character_also_where_that_is_taken_late() {
    let mut desk = Desk::new();
    for port in 0..4 {
        let end = desk.send(port, &read());
        let late = Time::from_us(200);
        desk.hold_over(end - LINE.bits(3), end + late);
        let (heard, start) = desk.heard(port);
        assert_eq!(heard, zero(), "port {port}");
        let after = start.expect("an answer") - end;
        let due = LINE.t35() + late;
        assert!(
            after >= LINE.t35() && after < due + LINE.bits(2),
            "port {port}: {after}"
        );
    }
}

#[test]
fn the_last_character_is_awaited_even_if_it_is_written_late() {
    let mut desk = Desk::new();
    // The transmitter runs dry when the one before the last is over, about when it is given the last one.
    for step in 0..100 {
        let end = desk.send(RS4, &read());
        desk.bus.run_to(end + LINE.t35());
        desk.bus.clear_record();
        let station = desk.bus.machine(desk.machine).station(RS4);
        let station = station.expect("it is on the wire");
        let begun = |bus: &mut Bus| bus.record().de_edges().len() == 1;
        assert!(desk.bus.run_until(begun, LINE.character()));
        let before_last = zero().len() as u64 - 1;
        let dry = desk.bus.now() + LINE.character() * before_last;
        let release = dry + Time::from_ns(step * 13) - Time::from_ns(900);
        desk.hold_over(dry - LINE.character() - LINE.bits(4), release);
        assert_eq!(desk.heard(RS4).0, zero(), "{step}");
        let sent: Vec<_> = desk.bus.record().sent_by(station).collect();
        assert!(sent.iter().all(|byte| byte.is_good()), "{step}: {sent:?}");
        let last = sent[sent.len() - 1].end;
        let down = desk.bus.record().de_edges()[1].time;
        assert!(
            down >= last && down < last + Time::from_us(10),
            "{step}: {down}, {last}"
        );
    }
}

/// A character with a gap in front of it.
fn late(byte: u8, gap_us: u64) -> Tx {
    Tx::byte(byte).after(Time::from_us(gap_us))
}

#[test]
fn start_bits_are_each_ports_own() {
    let mut desk = Desk::new();
    for (port, other) in [(RS4, 0), (1, 2)] {
        // The other port's characters begin and end at every place about t1.5 and t3.5.
        for step in 0..33 {
            let begin = desk.bus.now();
            desk.bus.host(desk.hosts[other]).send(&[0x55; 24]);
            desk.bus.run_for(Time::from_us(300 + step * 8));
            // A character that begins just before t1.5 belongs to the frame.
            let characters = read().into_iter().enumerate();
            let characters = characters.map(|(at, byte)| late(byte, if at == 4 { 740 } else { 0 }));
            let characters: Vec<_> = characters.collect();
            let host = desk.bus.host(desk.hosts[port]);
            host.take();
            let end = host.send_each(characters);
            assert!(end + LINE.t35() < begin + LINE.character() * 24);
            desk.bus.run_to(end);
            let (heard, start) = desk.heard(port);
            assert_eq!(heard, zero(), "port {port}, {step}");
            let after = start.expect("an answer") - end;
            assert!(
                after < LINE.t35() + LINE.bits(2),
                "port {port}, {step}: {after}"
            );
        }
    }
}

#[test]
fn a_port_with_an_echo_takes_no_time_from_others() {
    let mut desk = Desk::new();
    for (loud, other) in [(RS4, 0), (0, RS4), (2, 1)] {
        for port in [loud, other] {
            let station = desk.bus.machine(desk.machine).station(port);
            desk.bus.set_echo(station.expect("it is on a wire"), true);
        }
        // 37 characters.
        let end = desk.send(loud, &words(1, 3, 0, 16));
        desk.bus.run_to(end + LINE.t35() + LINE.character() * 4);
        let end = desk.send(other, &read());
        desk.bus.run_to(end);
        let (heard, start) = desk.heard(other);
        assert_eq!(heard, zero(), "port {other}");
        let after = start.expect("an answer") - end;
        assert!(
            after >= LINE.t35() && after < LINE.t35() + LINE.bits(1),
            "port {other}: {after}"
        );
        let heard = desk.bus.host(desk.hosts[loud]).take();
        assert_eq!(heard.len(), 37, "port {loud}");
        desk.expect_counted(loud, DAMAGED, 0);
        desk.expect_counted(loud, OVERRUNS, 0);
    }
}
