//! The HAL's examples in the simulator: time without drift, EEPROM, sleep.

use multidrop_bus::{Bus, BusConfig, Nano, NodeId, Pin, Time};
use multidrop_testkit::example;

/// A node that runs an example, with nothing else on the bus.
fn alone(name: &str, watch: &[Pin]) -> (Bus, NodeId) {
    let mut bus = Bus::new(BusConfig::default());
    let node = bus
        .add_nano(Nano {
            de: None,
            watch: watch.to_vec(),
            ..Nano::new(name, example(name))
        })
        .expect("a valid image");
    (bus, node)
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

/// Runs for a second of bus time and checks that less than 1 % of it was spent awake.
fn assert_sleeps(bus: &mut Bus, node: NodeId) {
    bus.node_mut(node).clear_stats();
    bus.run_for(Time::from_s(1));
    let stats = bus.node(node).stats();
    let share = stats.asleep as f64 / (stats.asleep + stats.awake) as f64;
    assert!(share > 0.99, "asleep for {share}");
}

fn apart(a: Time, b: Time) -> Time {
    a.max(b) - a.min(b)
}

#[test]
fn blink_keeps_its_beat_without_drift() {
    let fast = Pin::new('B', 4).expect("a pin");
    let (mut bus, node) = alone("blink", &[Pin::B5, fast]);
    bus.run_for(Time::from_ms(1_020));
    assert_eq!(bus.node(node).bad_opcodes(), 0);

    let beats = changes(&bus, Pin::B5);
    assert!(beats.len() > 100, "{}", beats.len());
    let tolerance = Time::from_us(100);
    for (index, time) in (0..).zip(&beats) {
        let due = beats[0] + Time::from_ms(10) * index;
        assert!(
            apart(*time, due) <= tolerance,
            "beat {index} at {time}, not {due}"
        );
    }
    let waits = changes(&bus, fast);
    assert!(waits.len() > 100, "{}", waits.len());
    for pair in waits.windows(2) {
        let wait = pair[1] - pair[0];
        assert!(wait >= Time::from_ms(7), "a wait of {wait}");
        assert!(wait <= Time::from_ms(7) + tolerance * 2, "a wait of {wait}");
    }
}

/// What an alarm of `embassy-time` costs, from interrupt to asleep again, with its 64-bit instants: 137
/// us at 16 MHz when this was written.
const CYCLES_PER_ALARM: u64 = 2_300;

#[test]
fn blink_sleeps_between_its_beats() {
    let (mut bus, node) = alone("blink", &[]);
    bus.run_for(Time::from_ms(20));
    bus.node_mut(node).clear_stats();
    bus.run_for(Time::from_ms(1_000));
    // A beat every 10 ms and a wait of 7 ms.
    let alarms = 1_000 / 10 + 1_000 / 7 + 2;
    let awake = bus.node(node).stats().awake;
    assert!(
        awake < alarms * CYCLES_PER_ALARM,
        "awake for {awake} cycles in 1 s"
    );
}

/// What `boots` shows and keeps.
fn count(bus: &Bus, node: NodeId) -> (u8, u16) {
    let (port, direction) = bus.node(node).port_state('B').expect("a port");
    assert_eq!(direction, 0x3f);
    let kept = &bus.node(node).eeprom()[16..18];
    (port, u16::from_le_bytes([kept[0], kept[1]]))
}

#[test]
fn boots_counts_in_the_eeprom_through_reset_and_power_cut() {
    let (mut bus, node) = alone("boots", &[]);
    bus.run_for(Time::from_ms(50));
    assert_eq!(count(&bus, node), (0, 0));
    for boot in 1..=70 {
        if boot % 2 == 0 {
            bus.reset(node);
        } else {
            bus.power_cut(node);
            bus.run_for(Time::from_ms(1));
            bus.power_up(node);
        }
        bus.run_for(Time::from_ms(50));
        assert_eq!(count(&bus, node), (boot as u8 % 64, boot));
    }
    assert_eq!(bus.node(node).eeprom_misuses(), []);
    let others = bus.node(node).eeprom().iter().enumerate();
    for (address, byte) in others.filter(|(address, _)| !(16..18).contains(address)) {
        assert_eq!(*byte, 0xff, "at {address}");
    }
    assert_sleeps(&mut bus, node);
}

#[test]
fn division_and_memmove_are_right() {
    let (right, wrong) = (Pin::new('B', 0).unwrap(), Pin::new('B', 1).unwrap());
    let (mut bus, node) = alone("arithmetic", &[right, wrong]);
    bus.run_for(Time::from_s(1));
    assert_eq!(bus.node(node).bad_opcodes(), 0);
    assert_eq!(changes(&bus, right).len(), 1);
    assert_eq!(changes(&bus, wrong), []);
}
