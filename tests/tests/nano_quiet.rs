//! A node drives the bus only for answers, also during boot and reset, and sleeps when it has nothing to do.

use std::path::{Path, PathBuf};

use multidrop_bus::{Bus, BusConfig, Level, Line, Nano, Pin, Time, Tx};
use multidrop_testkit::frames::{adu, words};
use multidrop_testkit::random::Random;
use multidrop_testkit::{LINE, Rig, image, registers};

fn images() -> [PathBuf; 3] {
    [
        registers(128, multidrop_testkit::LINE),
        image("demo-unit", &[]),
        registers(16, Line::n81(115_200)),
    ]
}

/// A bus with this node alone.
fn alone(nano: Nano) -> Bus {
    let mut bus = Bus::new(BusConfig::default());
    bus.add_nano(nano).expect("a valid image");
    bus
}

/// Nothing was driven.
#[track_caller]
fn assert_untouched(bus: &Bus) {
    let record = bus.record();
    assert_eq!(record.de_edges(), [], "\n{record}");
    assert_eq!(record.wire_edges(), [], "\n{record}");
    assert_eq!(record.bytes(), [], "\n{record}");
    for edge in record.pin_edges() {
        assert_ne!(edge.level, Level::High, "{edge:?}");
    }
}

/// A node like that of [`Nano::new`], with the SRAM content of power-up.
fn nano(image: &Path, seed: u64) -> Nano {
    Nano {
        seed,
        ..Nano::new("unit", image)
    }
}

#[test]
fn boot_drives_nothing() {
    for image in images() {
        for seed in 1..=8 {
            let mut bus = alone(nano(&image, seed));
            bus.run_for(Time::from_ms(500));
            assert_untouched(&bus);
        }
    }
}

#[test]
fn boot_leaves_txd_at_its_idle_level() {
    // Without DE what the transmitter does is what the wire does.
    for image in images() {
        let mut bus = alone(Nano {
            de: None,
            watch: vec![Pin::D2],
            ..nano(&image, 3)
        });
        bus.run_for(Time::from_ms(500));
        assert_untouched(&bus);
    }
}

#[test]
fn a_reset_at_any_time_of_the_boot_drives_nothing() {
    for image in images() {
        let mut bus = alone(nano(&image, 5));
        let id = bus.nodes().next().expect("a node").0;
        for us in (0..400).step_by(3) {
            bus.reset(id);
            bus.run_for(Time::from_us(us));
            bus.power_cut(id);
            bus.run_for(Time::from_us(50));
            bus.power_up(id);
            bus.run_for(Time::from_us(us));
        }
        bus.run_for(Time::from_ms(100));
        assert_untouched(&bus);
    }
}

#[test]
fn traffic_of_other_units_is_not_answered() {
    let mut rig = Rig::full();
    let mut random = Random::new(7);
    for _ in 0..400 {
        let len = usize::from(random.below(40)) + 1;
        let bytes = match random.below(4) {
            0 => random.bytes(len),
            1 => adu(&[&[2], &random.bytes(len)[..]].concat()),
            2 => [&[1, 3], &random.bytes(len)[..]].concat(),
            _ => vec![random.pick(&[0x00, 0xff, 0x01, 0x55]); len],
        };
        let pause = Time::from_us(u64::from(random.below(4000)));
        let heard = rig.ask_each(bytes.iter().enumerate().map(|(index, byte)| {
            if index == len / 2 {
                Tx::byte(*byte).after(pause)
            } else {
                Tx::byte(*byte)
            }
        }));
        assert_eq!(heard, [], "{bytes:02x?}");
    }
    rig.expect_alive();
}

#[test]
fn noise_on_an_idle_bus_is_not_answered() {
    let mut rig = Rig::full();
    let mut random = Random::new(8);
    for _ in 0..500 {
        let from = rig.bus.now() + Time::from_ns(u64::from(random.below(40_000)));
        let length = Time::from_ns(u64::from(random.next() as u16) * 4);
        rig.bus.noise(from, length, false);
        rig.pause(Time::from_us(u64::from(random.below(6_000)) + 500));
    }
    rig.pause(Time::from_ms(5));
    rig.expect_alive();
}

#[test]
fn an_idle_node_sleeps_and_is_woken_by_the_line_only() {
    for (image, line) in [
        (
            registers(16, multidrop_testkit::LINE),
            multidrop_testkit::LINE,
        ),
        (
            registers(128, multidrop_testkit::LINE),
            multidrop_testkit::LINE,
        ),
        (image("demo-unit", &[]), multidrop_testkit::LINE),
        (registers(16, Line::n81(115_200)), Line::n81(115_200)),
    ] {
        let mut rig = Rig::with(&[&image], line);
        rig.expect(&words(1, 6, 0, 1), &words(1, 6, 0, 1));
        let node = rig.node();
        rig.bus.node_mut(node).clear_stats();
        rig.pause(Time::from_s(1));
        let stats = rig.bus.node(node).stats();
        let share = stats.asleep as f64 / (stats.asleep + stats.awake) as f64;
        assert!(share > 0.99, "{image:?} is asleep for {share}");
        assert!(rig.bus.node(node).is_asleep());
    }
}

#[test]
fn rxd_has_its_pull_up_for_when_the_receiver_of_the_transceiver_is_off() {
    for image in images() {
        let mut rig = Rig::with(&[&image], LINE);
        let (port, direction) = rig.bus.node(rig.node()).port_state('D').expect("a port");
        let rxd = 1 << 0;
        assert_eq!(
            (port & rxd, direction & rxd),
            (rxd, 0),
            "{}",
            image.display()
        );
        rig.pause(Time::from_ms(1));
    }
}
