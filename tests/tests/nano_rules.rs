//! The cost of rules on the Nano: cycles and RAM of the HAL's example `rules`.

use multidrop_bus::{Bus, BusConfig, Level, Nano, Pin, Time};
use multidrop_testkit::example;

/// 32 rules may cost a write of 16 registers so much.
const CYCLES_MAX: u64 = 2_000;

/// Cycles from one pin edge to the next that are not the check itself; all are judged alike, so it is
/// taken from the write without rules.
fn judged() -> Vec<(u64, bool)> {
    let busy = Pin::new('B', 0).expect("a pin");
    let allowed = Pin::new('B', 1).expect("a pin");
    let mut bus = Bus::new(BusConfig::default());
    let node = bus
        .add_nano(Nano {
            de: None,
            watch: vec![busy, allowed],
            ..Nano::new("rules", example("rules"))
        })
        .expect("a valid image");
    bus.run_for(Time::from_ms(20));
    assert_eq!(bus.node(node).bad_opcodes(), 0);
    // The byte that says that the peripherals are taken, and two that outlive a reset; of the rules nothing.
    assert_eq!(bus.node(node).static_ram(), 3);

    let clock = bus.node(node).clock();
    let (mut high, mut is_allowed, mut writes) = (None, false, Vec::new());
    for edge in bus.record().pin_edges() {
        let cycle = clock.tick_at_or_after(edge.time);
        match (edge.pin == busy, edge.level) {
            (false, level) => is_allowed = level == Level::High,
            (true, Level::High) => high = Some(cycle),
            (true, _) => writes.extend(high.take().map(|from| (cycle - from, is_allowed))),
        }
    }
    writes
}

#[test]
fn thirty_two_rules_cost_a_write_of_16_registers_under_2000_cycles() {
    let writes = judged();
    let verdicts: Vec<bool> = writes.iter().map(|(_, allowed)| *allowed).collect();
    assert_eq!(verdicts, [true, true, true, true, true, false, false]);
    let (without, _) = writes[0];
    let names = [
        "a rule each",
        "a rule for each two",
        "one range",
        "the last range",
        "refused by the last rule",
        "outside",
    ];
    for (name, (cycles, _)) in names.iter().zip(&writes[1..]) {
        let cost = cycles.saturating_sub(without);
        println!("{name}: {cost} cycles");
        assert!(cost < CYCLES_MAX, "{name}: {cost} cycles");
    }
}
