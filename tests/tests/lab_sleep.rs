//! No wake-up is lost: an interrupt at every cycle of a task's work and around falling asleep. The example `edges` of
//! the HAL changes PB1 for every pin-change interrupt of PB0, in a task that the interrupt wakes.

use multidrop_bus::{Bus, BusConfig, Nano, NodeId, Pin, Time};
use multidrop_testkit::example;

/// PCINT0 (DS40002061B, 12.1).
const PCINT0: usize = 3;
/// Cycles from the edge before that the sweep goes through: more than the work for one edge takes,
/// which is checked.
const SWEEP: u64 = 800;

struct Rig {
    bus: Bus,
    node: NodeId,
    input: Pin,
    output: Pin,
    level: bool,
}

/// What came of some edges.
struct Outcome {
    /// Cycles at which the output changed.
    toggles: Vec<u64>,
    interrupts: u64,
    /// Cycles in which the CPU was awake.
    work: u64,
}

impl Rig {
    fn new() -> Self {
        let pin = |bit| Pin::new('B', bit).expect("a pin");
        let (input, output) = (pin(0), pin(1));
        let mut bus = Bus::new(BusConfig::default());
        let node = bus
            .add_nano(Nano {
                de: None,
                watch: vec![output],
                ..Nano::new("edges", example("edges"))
            })
            .expect("a valid image");
        bus.run_for(Time::from_ms(5));
        assert!(bus.node(node).is_asleep());
        Rig {
            bus,
            node,
            input,
            output,
            level: true,
        }
    }

    /// Changes the input at each of `edges`, cycles from now on in their order, and waits for three
    /// times the sweep after the last.
    fn drive(&mut self, edges: &[u64]) -> (u64, Outcome) {
        self.bus.clear_record();
        self.bus.node_mut(self.node).clear_stats();
        let start = self.bus.node(self.node).cycle() + 100;
        for edge in edges {
            self.level = !self.level;
            let (pin, level) = (self.input, self.level);
            let node = self.bus.node_mut(self.node);
            node.set_input_at(pin, level, start + edge);
        }
        let clock = self.bus.node(self.node).clock();
        let last = edges.last().expect("an edge");
        self.bus.run_to(clock.time(start + last + 3 * SWEEP));
        let toggles = self.bus.record().pin_edges().iter();
        let toggles = toggles
            .filter(|edge| edge.pin == self.output)
            .map(|edge| clock.tick_at_or_after(edge.time))
            .collect();
        let stats = self.bus.node(self.node).stats();
        let outcome = Outcome {
            toggles,
            interrupts: stats.vectors[PCINT0].count,
            work: stats.awake,
        };
        (start, outcome)
    }
}

/// The cycles from an edge to the change of the output when nothing else is going on, and the
/// cycles the node is awake for it.
fn lone(rig: &mut Rig) -> (u64, u64) {
    // The first connects the pin, at the level that it had by its pull-up.
    rig.level = false;
    rig.drive(&[0]);
    let (start, outcome) = rig.drive(&[0]);
    assert_eq!(outcome.interrupts, 1);
    assert_eq!(outcome.toggles.len(), 1);
    assert!(outcome.work < SWEEP, "{} cycles of work", outcome.work);
    (outcome.toggles[0] - start, outcome.work)
}

/// Drives edges and holds what came of them against what must:
/// - each edge has its change of the output, at the latest when the work for all others and for
///   itself is done;
/// - each interrupt has one of its own;
/// - edges further apart than the work for one have an interrupt each: closer ones may find the
///   flag still set (13.2.4), which is one bit.
fn follow(rig: &mut Rig, latency: u64, work: u64, edges: &[u64]) -> u64 {
    let (start, outcome) = rig.drive(edges);
    let toggles = &outcome.toggles;
    let others = edges.len() as u64 - 1;
    let shown: Vec<_> = toggles.iter().map(|toggle| toggle - start).collect();
    for edge in edges {
        let bound = edge + others * work + latency;
        let after = shown.iter().find(|toggle| *toggle > edge);
        assert!(
            after.is_some_and(|toggle| *toggle <= bound),
            "edges at {edges:?}: the one at {edge} was not followed by {bound}, but by {shown:?}"
        );
    }
    assert_eq!(shown.len() as u64, outcome.interrupts, "edges at {edges:?}");
    let apart = edges.windows(2).filter(|pair| pair[1] - pair[0] > work);
    assert!(outcome.interrupts > apart.count() as u64, "{edges:?}");
    assert!(rig.bus.node(rig.node).is_asleep(), "edges at {edges:?}");
    outcome.interrupts
}

#[test]
fn an_edge_at_every_cycle_after_another() {
    let mut rig = Rig::new();
    let (latency, work) = lone(&mut rig);
    let mut merged = 0;
    for offset in 1..=SWEEP {
        merged += 2 - follow(&mut rig, latency, work, &[0, offset]);
    }
    println!("{latency} cycles to the output, {work} awake, {merged} found the flag set");
}

#[test]
fn two_edges_close_together_at_every_cycle_after_another() {
    let mut rig = Rig::new();
    let (latency, work) = lone(&mut rig);
    let mut merged = 0;
    for offset in 1..=SWEEP {
        for gap in [1, 2, 4, 7, 12, 20, 33, 54, 88] {
            merged += 3 - follow(&mut rig, latency, work, &[0, offset, offset + gap]);
        }
    }
    println!("{merged} edges found the flag set");
}
