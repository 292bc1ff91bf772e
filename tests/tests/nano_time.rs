//! `embassy-time` on the Nano: alarms are in time when counters wrap, and the CPU sleeps between them.

use multidrop_bus::{Bus, BusConfig, Nano, NodeId, Pin, Time};
use multidrop_testkit::example;

/// A node that runs an example with pins PB0 to PB4 watched, with nothing else on the bus.
fn alone(name: &str) -> (Bus, NodeId) {
    alone_at(name, 16_000_000)
}

/// A node alone on a bus at another clock.
fn alone_at(name: &str, clock_hz: u32) -> (Bus, NodeId) {
    let mut bus = Bus::new(BusConfig::default());
    let node = bus
        .add_nano(Nano {
            de: None,
            clock_hz,
            watch: (0..5).map(port_b).collect(),
            ..Nano::new(name, example(name))
        })
        .expect("a valid image");
    (bus, node)
}

fn port_b(bit: u8) -> Pin {
    Pin::new('B', bit).expect("a pin")
}

/// When a pin changed.
fn changes(bus: &Bus, pin: Pin) -> Vec<Time> {
    let edges = bus.record().pin_edges().iter();
    // The first is the pin becoming an output.
    edges
        .filter(|edge| edge.pin == pin)
        .map(|edge| edge.time)
        .skip(1)
        .collect()
}

/// What an alarm may be late by: the work for five that are due at once.
const LATE: Time = Time::from_us(1_500);

#[test]
fn a_wait_is_not_late_because_another_task_reads_the_time() {
    let (mut bus, _) = alone("clock_reader");
    bus.run_for(Time::from_s(60));
    let changes = changes(&bus, port_b(0));
    assert!(changes.len() > 1_400, "{}", changes.len());
    let waits = changes.windows(2).map(|pair| pair[1] - pair[0]);
    let late: Vec<_> = waits
        .clone()
        .filter(|wait| *wait > Time::from_ms(40) + LATE)
        .collect();
    assert!(
        late.is_empty(),
        "{} of {} waits of 40 ms are late: {late:?}",
        late.len(),
        changes.len() - 1
    );
    assert!(waits.min() >= Some(Time::from_ms(40)));
}

#[test]
fn a_task_that_waits_for_two_times_is_woken_at_the_first() {
    let (mut bus, _) = alone("clock_reader");
    bus.run_for(Time::from_s(1));
    let changes = changes(&bus, port_b(1));
    // 90 ms, and the 600 us in which the first time passes.
    assert!(changes.len() >= 10, "{changes:?}");
    for pair in changes.windows(2) {
        let wait = pair[1] - pair[0];
        assert!(wait >= Time::from_us(90_600), "{wait}");
        assert!(wait <= Time::from_us(90_600) + LATE, "{wait}");
    }
}

/// The periods of the examples' tasks, in ms, in the order of their pins.
const PERIODS: [u64; 5] = [7, 13, 40, 55, 70];

/// Every pin changes in its own period, without drift, until now.
fn assert_beats(bus: &Bus) {
    for (bit, period) in (0..).zip(PERIODS) {
        let period = Time::from_ms(period);
        let changes = changes(bus, port_b(bit));
        let first = changes[0];
        for (index, time) in (0..).zip(&changes) {
            let due = first + period * index;
            let off = time.max(&due).saturating_sub(*time.min(&due));
            assert!(off <= LATE, "PB{bit}: change {index} at {time}, not {due}");
        }
        let last = changes[changes.len() - 1];
        assert!(
            bus.now() - last <= period + LATE,
            "PB{bit}: none since {last}"
        );
    }
}

/// The share of the last two seconds that a node was asleep for.
fn asleep(bus: &mut Bus, node: NodeId) -> f64 {
    bus.node_mut(node).clear_stats();
    bus.run_for(Time::from_s(2));
    let stats = bus.node(node).stats();
    stats.asleep as f64 / (stats.asleep + stats.awake) as f64
}

#[test]
fn five_tasks_wait_in_five_slots_asleep_and_past_the_lower_half_of_the_time() {
    let (mut bus, node) = alone("waits");
    // Alarms of all are pending when the lower half is full, after a second.
    let share = asleep(&mut bus, node);
    assert_beats(&bus);
    // 278 alarms a second take some 3000 cycles each.
    assert!(share > 0.94, "asleep for {share}");
    bus.run_for(Time::from_s(2));
    assert_beats(&bus);
}

#[test]
fn five_tasks_in_four_slots_are_in_time() {
    let (mut bus, _) = alone("crowd");
    bus.run_for(Time::from_s(2));
    assert_beats(&bus);
}

#[test]
fn a_wait_longer_than_an_alarm_is_set_ahead_ends_in_time() {
    let (mut bus, node) = alone("long_wait");
    let period = Time::from_s(1_100);
    bus.run_for(period * 2 + Time::from_s(1));
    let changes = changes(&bus, port_b(0));
    assert_eq!(changes.len(), 2, "{changes:?}");
    let off = changes[1].saturating_sub(changes[0] + period);
    assert!(changes[0] >= period && off <= LATE, "{changes:?}");
    // One look at the alarms in each turn of Timer1.
    let stats = bus.node(node).stats();
    let turns = bus.now().ps() / Time::from_us(32_768).ps();
    assert!(stats.awake < turns * 3_000, "awake for {}", stats.awake);
}

/// 11.0592 MHz: 864 ticks of Timer1 are 625 us, and a turn of it is 47407.407 of them.
const ODD_CLOCK_HZ: u32 = 11_059_200;

#[test]
fn remainders_of_a_turn_add_up_to_no_drift() {
    let (mut bus, _) = alone_at("odd_clock", ODD_CLOCK_HZ);
    // The remainder of each turn is 0.4 us: 8.6 ms in all.
    bus.run_for(Time::from_s(1_000) + Time::from_ms(500));
    let beats = changes(&bus, port_b(0));
    assert_eq!(beats.len(), 1_000);
    for (index, time) in (0..).zip(&beats) {
        let due = beats[0] + Time::from_s(1) * index;
        let off = time.max(&due).saturating_sub(*time.min(&due));
        assert!(
            off <= Time::from_us(100),
            "beat {index} at {time}, not {due}"
        );
    }
}

#[test]
fn an_alarm_that_has_passed_before_it_is_set_is_not_waited_for() {
    let (mut bus, _) = alone_at("odd_clock", ODD_CLOCK_HZ);
    bus.run_for(Time::from_ms(1_500));
    let changes = changes(&bus, port_b(1));
    assert_eq!(changes.len(), 800);
    for (us, pair) in (1..).zip(changes.chunks(2)) {
        let wait = pair[1] - pair[0];
        let due = Time::from_us(us);
        assert!(wait >= due && wait <= due + LATE, "{wait}, not {due}");
    }
}
