//! Every limit of a port's configuration from both sides, and the use of each value. The checks are those of the
//! build, run here.

use std::panic::{AssertUnwindSafe, catch_unwind};

use multidrop::line::{InterCharacter, LineConfig, Role};
use multidrop::manager;
use multidrop::protocol::format::{Framing, LineFormat};
use multidrop::protocol::port_registers::{Duplex, Flow, Mode, PortSettings};
use multidrop::protocol::registers::{Bank, CoilBank, Items};
use multidrop::{ClientConfig, PortConfig};

/// What would stop the build; `None` if nothing does.
fn refused<R>(build: impl FnOnce() -> R) -> Option<String> {
    let panic = catch_unwind(AssertUnwindSafe(|| drop(build()))).err()?;
    Some(
        panic
            .downcast_ref::<String>()
            .cloned()
            .expect("a message that was put together"),
    )
}

fn port() -> PortConfig {
    PortConfig::new("RS4")
}

/// A number of a port: how it is set and read, its name, its limits and how they are told.
struct Number {
    set: fn(u32) -> PortConfig,
    get: fn(&PortConfig) -> u32,
    name: &'static str,
    limits: (u32, u32),
    rule: &'static str,
}

const NUMBERS: &[Number] = &[
    Number {
        set: |id| port().slave_id(id),
        get: |port| port.unit().into(),
        name: "slave_id",
        limits: (1, 247),
        rule: "1..=247",
    },
    Number {
        set: |id| port().client().slave_id(id),
        get: |port| port.settings().slave_id.into(),
        name: "slave_id",
        limits: (0, 247),
        rule: "0..=247",
    },
    Number {
        set: |id| port().mode(Mode::Off).slave_id(id),
        get: |port| port.unit().into(),
        name: "slave_id",
        limits: (0, 247),
        rule: "0..=247",
    },
    Number {
        set: |base| port().base(base),
        get: |port| port.settings().base.into(),
        name: "base",
        limits: (0, 65_535),
        rule: "0..=65535",
    },
    Number {
        set: |ms| port().timeout_ms(ms),
        get: |port| port.settings().timeout_ms.into(),
        name: "timeout_ms",
        limits: (1, 65_535),
        rule: "1..=65535",
    },
    Number {
        set: |retries| port().retries(retries),
        get: |port| port.settings().retries.into(),
        name: "retries",
        limits: (0, 255),
        rule: "0..=255",
    },
    Number {
        set: |ms| port().turnaround_ms(ms),
        get: |port| port.settings().turnaround_ms.into(),
        name: "turnaround_ms",
        limits: (0, 65_535),
        rule: "0..=65535",
    },
    Number {
        set: |ms| port().late_guard_ms(ms),
        get: |port| port.settings().late_guard_ms.into(),
        name: "late_guard_ms",
        limits: (0, 65_535),
        rule: "0..=65535",
    },
    Number {
        set: |ms| port().request_gap_ms(ms),
        get: |port| port.settings().request_gap_ms.into(),
        name: "request_gap_ms",
        limits: (0, 65_535),
        rule: "0..=65535",
    },
    Number {
        set: |baud| port().baud(baud),
        get: |port| port.line().baud,
        name: "baud",
        limits: (300, 10_000_000),
        rule: "300..=10000000",
    },
    Number {
        set: |ms| port().inter_character(InterCharacter::Gap(ms as u8)),
        get: |port| match port.line().inter_character {
            InterCharacter::Gap(ms) => ms.into(),
            other => panic!("{other:?}"),
        },
        name: "inter_character gap",
        limits: (2, 50),
        rule: "2..=50 ms",
    },
    Number {
        set: |ms| port().cts_timeout_ms(ms),
        get: |port| port.line().cts_timeout_ms.into(),
        name: "cts_timeout_ms",
        limits: (1, 65_535),
        rule: "1..=65535",
    },
    Number {
        set: |us| port().de_lead_us(us),
        get: |port| port.line().de_lead_us.into(),
        name: "de_lead_us",
        limits: (0, 10_000),
        rule: "0..=10000",
    },
    Number {
        set: |ms| port().response_delay_ms(ms),
        get: |port| port.line().response_delay_ms.into(),
        name: "response_delay_ms",
        limits: (0, 1000),
        rule: "0..=1000",
    },
];

#[test]
fn each_value_is_accepted_up_to_its_limits_and_not_beyond() {
    for Number {
        set,
        get,
        name,
        limits: (low, high),
        rule,
    } in NUMBERS
    {
        for value in [*low, low + 1, high - 1, *high] {
            let built = catch_unwind(|| get(&set(value)));
            assert_eq!(built.ok(), Some(value), "{name}");
        }
        for value in [high + 1, high + 2, low.wrapping_sub(1)] {
            // A gap is 8 bits.
            if value > 255 && *name == "inter_character gap" || value == u32::MAX {
                continue;
            }
            assert_eq!(
                refused(|| set(value)),
                Some(format!("port RS4: {name} is {value}, must be {rule}"))
            );
        }
        if *name != "inter_character gap" {
            assert!(refused(|| set(u32::MAX)).is_some(), "{name}");
        }
    }
}

#[test]
fn a_slave_has_a_unit_id_and_no_other_mode_needs_one() {
    let without = || port().client().slave_id(0);
    for mode in [Mode::Master, Mode::Off, Mode::Sniffer] {
        assert_eq!(without().mode(mode).settings().mode, mode);
    }
    assert_eq!(
        refused(|| without().mode(Mode::Slave)).as_deref(),
        Some("port RS4: slave_id is 0, must be 1..=247 for a slave")
    );
    assert_eq!(
        without().slave_id(1).mode(Mode::Slave).settings().mode,
        Mode::Slave
    );
    assert_eq!(port().settings().mode, Mode::Slave);
    assert_eq!(port().client().settings().mode, Mode::Master);
}

#[test]
fn text_is_refused_for_master_and_slave() {
    for mode in [Mode::Master, Mode::Slave, Mode::Off, Mode::Sniffer] {
        for framing in [Framing::Rtu, Framing::Ascii, Framing::Text] {
            let talks = matches!(mode, Mode::Master | Mode::Slave);
            let expected = (talks && framing == Framing::Text).then(|| {
                "port RS4: framing is 2, must be 0 (RTU) or 1 (ASCII) for a master or a slave"
                    .to_owned()
            });
            assert_eq!(refused(|| port().mode(mode).framing(framing)), expected);
            // In the other order: a sniffer's framing, and then the mode.
            let framed = || port().mode(Mode::Sniffer).framing(framing);
            assert_eq!(refused(|| framed().mode(mode)), expected);
            if expected.is_none() {
                assert_eq!(framed().mode(mode).line().framing, framing);
            }
        }
    }
}

#[test]
fn rtu_has_eight_data_bits() {
    let seven = [LineFormat::F7E1, LineFormat::F7O1, LineFormat::F7N2];
    let eight = [
        LineFormat::F8E1,
        LineFormat::F8O1,
        LineFormat::F8N2,
        LineFormat::F8N1,
    ];
    let sniffer = || port().mode(Mode::Sniffer);
    let expected = Some("port RS4: format: data bits is 7, must be 8 for RTU");
    for format in seven {
        assert_eq!(refused(|| port().format(format)).as_deref(), expected);
        for framing in [Framing::Ascii, Framing::Text] {
            let built = || sniffer().framing(framing).format(format);
            assert_eq!(built().line().format, format);
            let back = || built().framing(Framing::Rtu);
            assert_eq!(refused(back).as_deref(), expected);
        }
    }
    for format in eight {
        for framing in [Framing::Rtu, Framing::Ascii, Framing::Text] {
            let built = sniffer().framing(framing).format(format);
            assert_eq!(built.line().format, format);
        }
    }
}

#[test]
fn arrays_end_at_address_65535() {
    let bank = |base| port().base(base).bank::<10>();
    assert_eq!(bank(65_526).address_of(9), Some(65_535));
    assert_eq!(
        refused(|| bank(65_527)).as_deref(),
        Some("port RS4: base is 65527, must be at most 65526 for 10 registers")
    );
    let coils = |base| -> CoilBank<2> { port().base(base).coil_bank(9) };
    assert_eq!(coils(65_527).address_of(8), Some(65_535));
    assert_eq!(
        refused(|| coils(65_528)).as_deref(),
        Some("port RS4: base is 65528, must be at most 65527 for 9 coils")
    );
    let all: Bank<3> = port().bank();
    assert_eq!((all.address_of(0), all.address_of(2)), (Some(0), Some(2)));
    assert_eq!(port().base(100).coil_bank::<1>(8).address_of(0), Some(100));
}

/// Each setting with a value of its own.
fn full() -> PortConfig {
    PortConfig::new("AS2")
        .client()
        .slave_id(33)
        .base(7)
        .timeout_ms(111)
        .retries(4)
        .turnaround_ms(222)
        .late_guard_ms(333)
        .request_gap_ms(44)
        .baud(57_600)
        .framing(Framing::Ascii)
        .format(LineFormat::F7O1)
        .duplex(Duplex::Full)
        .flow(Flow::RtsCts)
        .inter_character(InterCharacter::Off)
        .cts_timeout_ms(555)
        .de_lead_us(66)
        .response_delay_ms(77)
}

#[test]
fn settings_reach_the_line_and_the_client() {
    let port = full();
    assert_eq!(port.name(), "AS2");
    assert_eq!(port.settings().line.duplex, Duplex::Full);
    let line = LineConfig {
        baud: 57_600,
        framing: Framing::Ascii,
        format: LineFormat::F7O1,
        inter_character: InterCharacter::Off,
        flow: Flow::RtsCts,
        role: Role::Client,
        cts_timeout_ms: 555,
        de_lead_us: 66,
        response_delay_ms: 77,
    };
    assert_eq!(port.line(), line);
    for mode in [Mode::Slave, Mode::Off, Mode::Sniffer] {
        let role = Role::Server;
        assert_eq!(port.mode(mode).line(), LineConfig { role, ..line });
    }
    assert_eq!(
        port.times(),
        ClientConfig::new()
            .timeout_ms(111)
            .retries(4)
            .turnaround_ms(222)
            .late_guard_ms(333)
            .request_gap_ms(44)
    );
}

#[test]
fn defaults_are_those_of_the_standard() {
    let port = PortConfig::new("RS4");
    assert_eq!((port.name(), port.unit()), ("RS4", 1));
    assert_eq!(*port.settings(), PortSettings::DEFAULT);
    assert_eq!(port.line(), LineConfig::DEFAULT);
    assert_eq!(port.times(), ClientConfig::new());
    assert_eq!(port.times(), ClientConfig::default());
    assert_eq!(
        (port.line().baud, port.line().format, port.line().role),
        (19_200, LineFormat::F8E1, Role::Server)
    );
}

#[test]
fn a_name_must_be_unique_in_a_table() {
    // Names of one length that differ in one place, and one that begins another.
    let names = ["AS1", "AS2", "RS2", "RS", "RS22"];
    let table = names.map(PortConfig::new);
    assert_eq!(manager::table(table).map(|port| port.name()), names);
    for first in 0..names.len() {
        for second in first + 1..names.len() {
            let mut twice = table;
            twice[second] = PortConfig::new(names[first]);
            let name = names[first];
            assert_eq!(
                refused(|| manager::table(twice)),
                Some(format!(
                    "port {name}: two ports in the table have this name"
                )),
                "{first} and {second}"
            );
        }
    }
    assert!(manager::table([]).is_empty());
}
