//! Each register of a port by number, name, range, default and message, as the description of the set and the guide have them. The
//! table here is written by hand: nothing of it comes from the declaration.

use multidrop_protocol::format::{Framing, LineFormat};
use multidrop_protocol::port_registers::{
    Change, Duplex, Flow, InterCharacter, Mode, PortRegisters, PortSettings, Register, Value,
};
use multidrop_protocol::registers::{Bank, CoilBank};
use multidrop_protocol::rules;

rules! {
    struct One: "RS4";
    DISABLE_REG { 3..=7 }
}

type Port = PortRegisters<Bank<1>, CoilBank<1>, One>;

/// A master: what stands in the way of START in a slave.
fn port() -> Port {
    let settings = PortSettings {
        mode: Mode::Master,
        ..PortSettings::DEFAULT
    };
    PortRegisters::new(settings, Bank::new(0), CoilBank::new(0, 1))
}

/// What a load is told, and what follows one.
#[derive(Clone, Copy)]
enum Takes {
    /// All numbers of this range and no other, which is what a wrong one is told.
    Range(u32, u32, Change),
    /// These alone; a wrong one is told this.
    Few(&'static [u32], &'static str, Change),
    Nothing,
}

use Change::{Done, Line, Mode as Part, Start};
use Takes::{Few, Nothing, Range};

/// Number, name, whether it is an array, the default, and what it takes.
const REGISTERS: [(u8, &str, bool, u32, Takes); 33] = [
    (
        0,
        "MODE",
        false,
        1,
        Few(
            &[0, 1, 2, 3],
            "0 (master), 1 (slave), 2 (off) or 3 (sniffer)",
            Part,
        ),
    ),
    (
        1,
        "FRAMING",
        false,
        0,
        Few(&[0, 1], "0 (RTU), 1 (ASCII) or 2 (text)", Line),
    ),
    (2, "BASE", false, 0, Range(0, 65_535, Done)),
    (3, "REGS", true, 0, Range(0, 65_535, Done)),
    (
        4,
        "COILS",
        true,
        0,
        Few(&[0, 1, 255], "0 (off) or 1 (on)", Done),
    ),
    (5, "SLAVEID", false, 1, Range(0, 247, Part)),
    (
        6,
        "FUNC",
        false,
        3,
        Few(
            &[1, 2, 3, 4, 5, 6, 15, 16, 23],
            "1, 2, 3, 4, 5, 6, 15, 16 or 23; other functions are methods of the client",
            Done,
        ),
    ),
    (7, "REGOFF", false, 0, Range(0, 65_535, Done)),
    (8, "REGCNT", false, 1, Range(1, 125, Done)),
    (9, "COILOFF", false, 0, Range(0, 65_535, Done)),
    (10, "COILCNT", false, 1, Range(1, 2000, Done)),
    (11, "STATUS", false, 0, Nothing),
    (12, "ERROR", false, 0, Nothing),
    (13, "TIMEOUT", false, 1000, Range(1, 65_535, Done)),
    (14, "RETRIES", false, 0, Range(0, 255, Done)),
    (15, "TURNAROUND", false, 100, Range(0, 65_535, Done)),
    (16, "DATAOK", false, 0, Nothing),
    (17, "DATAERR", false, 0, Nothing),
    (18, "VALID_DATA", true, 0, Nothing),
    (19, "VALID_REG", true, 0, Nothing),
    (20, "DISABLE_REG", true, 3 << 16 | 7, Nothing),
    (
        21,
        "DISABLE_FLG",
        true,
        0,
        Few(&[0, 1], "0 (enabled) or 1 (disabled)", Done),
    ),
    (22, "BAUD", false, 19_200, Range(300, 10_000_000, Line)),
    (
        23,
        "FORMAT",
        false,
        1,
        Few(
            &[0, 1, 2, 3],
            "8N1 (0), 8E1 (1), 8O1 (2), 8N2 (3), 7E1 (4), 7O1 (5) or 7N2 (6)",
            Line,
        ),
    ),
    (
        24,
        "DUPLEX",
        false,
        0,
        Few(&[0, 1], "0 (half) or 1 (full)", Line),
    ),
    (
        25,
        "FLOW",
        false,
        0,
        Few(&[0, 1], "0 (none) or 1 (RTS/CTS)", Line),
    ),
    (
        26,
        "INTER_CHARACTER",
        false,
        0,
        Few(
            &[0, 1, 2, 49, 50],
            "0 (strict), 1 (off) or 2..=50 (ms that end a frame)",
            Line,
        ),
    ),
    (27, "START", false, 0, Few(&[1], "1", Start)),
    (28, "LATE_GUARD", false, 0, Range(0, 65_535, Done)),
    (29, "CTS_TIMEOUT", false, 1000, Range(1, 65_535, Line)),
    (30, "REQUEST_GAP", false, 0, Range(0, 65_535, Done)),
    (31, "DE_LEAD", false, 0, Range(0, 10_000, Line)),
    (32, "RESPONSE_DELAY", false, 0, Range(0, 1000, Line)),
];

fn register(number: u8) -> Register {
    Register::from_number(number, 0).unwrap_or_else(|| panic!("{number}"))
}

/// Loads and reads back; `255` of a coil reads 1.
fn taken(register: Register, number: u32, change: Change) {
    let mut port = port();
    // The last item stays below 65536 in any case, and a slave has an id.
    assert_eq!(
        port.load_raw(register, number),
        Ok(change),
        "{register} := {number}"
    );
    let read = if register == Register::Coils(0) {
        number.min(1)
    } else {
        number
    };
    assert_eq!(port.read(register), Ok(read), "{register} := {number}");
}

fn refused(register: Register, number: u32, rule: &str) {
    let mut port = port();
    let before = port.read(register);
    let refused = port.load_raw(register, number).unwrap_err();
    assert_eq!(
        refused.to_string(),
        format!("{register} is {number}, must be {rule}")
    );
    assert_eq!(port.read(register), before, "{register} := {number}");
}

#[test]
fn each_register_has_its_number_its_name_and_its_default() {
    assert_eq!(usize::from(Register::COUNT), REGISTERS.len());
    assert_eq!(Register::from_number(33, 0), None);
    let settings = PortSettings::DEFAULT;
    let port: Port = PortRegisters::new(settings, Bank::new(0), CoilBank::new(0, 1));
    for (number, name, is_array, default, _) in REGISTERS {
        let register = register(number);
        assert_eq!((register.number(), register.name()), (number, name));
        assert_eq!(Register::from_name(name), Some(register));
        assert_eq!(register.index(), is_array.then_some(0), "{name}");
        let read = port.read(register).ok();
        let is_rule = name == "VALID_DATA" || name == "VALID_REG";
        assert_eq!(read, (!is_rule).then_some(default), "{name}");
    }
}

#[test]
fn each_register_takes_its_range_and_says_so() {
    for (number, name, _, _, takes) in REGISTERS {
        let register = register(number);
        match takes {
            Range(low, high, change) => {
                let rule = format!("{low}..={high}");
                assert_eq!(register.range(), Some((low, high)), "{name}");
                for number in [low, low + 1, high - 1, high] {
                    // One item fits in behind any base.
                    taken(register, number, change);
                }
                refused(register, high + 1, &rule);
                refused(register, u32::MAX, &rule);
                if let Some(below) = low.checked_sub(1) {
                    refused(register, below, &rule);
                }
            }
            Few(few, rule, change) => {
                assert_eq!(register.choices(), Some(rule), "{name}");
                for number in few {
                    taken(register, *number, change);
                }
                for number in (0..300).chain([65_536, u32::MAX]) {
                    // What the mode, the framing and this version stand in the way of, and what is between 2 and 50.
                    let other = match name {
                        "MODE" => number == 4,
                        "FRAMING" => number == 2,
                        "FORMAT" => (4..=6).contains(&number),
                        "INTER_CHARACTER" => number <= 50,
                        _ => false,
                    };
                    if !few.contains(&number) && !other {
                        refused(register, number, rule);
                    }
                }
            }
            Nothing => {
                assert_eq!(
                    (register.range(), register.choices()),
                    (None, None),
                    "{name}"
                );
                let refused = port().load_raw(register, 0).unwrap_err();
                assert_eq!(refused.to_string(), format!("{register} is read only"));
            }
        }
    }
}

#[test]
fn a_value_with_a_type_is_a_register_and_a_number() {
    let values = [
        (Value::Mode(Mode::Master), "MODE", 0),
        (Value::Mode(Mode::Slave), "MODE", 1),
        (Value::Mode(Mode::Off), "MODE", 2),
        (Value::Mode(Mode::Sniffer), "MODE", 3),
        (Value::Framing(Framing::Rtu), "FRAMING", 0),
        (Value::Framing(Framing::Ascii), "FRAMING", 1),
        (Value::Framing(Framing::Text), "FRAMING", 2),
        (Value::Base(40_001), "BASE", 40_001),
        (Value::Regs(7, 65_535), "REGS.7", 65_535),
        (Value::Coils(8, true), "COILS.8", 1),
        (Value::Coils(300, false), "COILS.300", 0),
        (Value::SlaveId(247), "SLAVEID", 247),
        (Value::Func(16), "FUNC", 16),
        (Value::RegOff(1), "REGOFF", 1),
        (Value::RegCnt(2), "REGCNT", 2),
        (Value::CoilOff(3), "COILOFF", 3),
        (Value::CoilCnt(4), "COILCNT", 4),
        (Value::Timeout(150), "TIMEOUT", 150),
        (Value::Retries(5), "RETRIES", 5),
        (Value::Turnaround(6), "TURNAROUND", 6),
        (Value::DisableFlg(2, true), "DISABLE_FLG.2", 1),
        (Value::Baud(10_000_000), "BAUD", 10_000_000),
        (Value::Format(LineFormat::F8N1), "FORMAT", 0),
        (Value::Format(LineFormat::F8E1), "FORMAT", 1),
        (Value::Format(LineFormat::F8O1), "FORMAT", 2),
        (Value::Format(LineFormat::F8N2), "FORMAT", 3),
        (Value::Format(LineFormat::F7E1), "FORMAT", 4),
        (Value::Format(LineFormat::F7O1), "FORMAT", 5),
        (Value::Format(LineFormat::F7N2), "FORMAT", 6),
        (Value::Duplex(Duplex::Half), "DUPLEX", 0),
        (Value::Duplex(Duplex::Full), "DUPLEX", 1),
        (Value::Flow(Flow::None), "FLOW", 0),
        (Value::Flow(Flow::RtsCts), "FLOW", 1),
        (
            Value::InterCharacter(InterCharacter::Strict),
            "INTER_CHARACTER",
            0,
        ),
        (
            Value::InterCharacter(InterCharacter::Off),
            "INTER_CHARACTER",
            1,
        ),
        (
            Value::InterCharacter(InterCharacter::Gap(16)),
            "INTER_CHARACTER",
            16,
        ),
        (Value::LateGuard(7), "LATE_GUARD", 7),
        (Value::CtsTimeout(8), "CTS_TIMEOUT", 8),
        (Value::RequestGap(9), "REQUEST_GAP", 9),
        (Value::DeLead(10), "DE_LEAD", 10),
        (Value::ResponseDelay(11), "RESPONSE_DELAY", 11),
    ];
    for (value, name, number) in values {
        assert_eq!(value.register().to_string(), name);
        assert_eq!(value.number(), number, "{name}");
        // It is loaded as its number is.
        let (mut typed, mut raw) = (port(), port());
        let loaded = raw.load_raw(Register::from_name(name).unwrap(), number);
        assert_eq!(typed.load(value), loaded, "{name}");
        assert_eq!(typed.settings(), raw.settings(), "{name}");
    }
    // Nothing that can be loaded is left out, but START, which has no value.
    for (_, name, _, _, takes) in REGISTERS {
        let has = values
            .iter()
            .any(|(value, ..)| value.register().name() == name);
        let is_loaded = !matches!(takes, Nothing) && name != "START";
        assert_eq!(has, is_loaded, "{name}");
    }
}

#[test]
fn a_type_does_not_make_a_value_right() {
    let text = |value| port().load(value).unwrap_err().to_string();
    assert_eq!(text(Value::Timeout(0)), "TIMEOUT is 0, must be 1..=65535");
    assert_eq!(text(Value::SlaveId(248)), "SLAVEID is 248, must be 0..=247");
    assert_eq!(
        text(Value::InterCharacter(InterCharacter::Gap(51))),
        "INTER_CHARACTER is 51, must be 0 (strict), 1 (off) or 2..=50 (ms that end a frame)"
    );
    for ms in [0, 1] {
        let gap = Value::InterCharacter(InterCharacter::Gap(ms));
        assert!(port().load(gap).is_err(), "{ms}");
    }
    assert_eq!(
        text(Value::Regs(1, 0)),
        "REGS.1 does not exist, must be REGS.0..=0"
    );
}

#[test]
fn names_and_numbers() {
    for number in 0..=255 {
        for index in [0, 1, 255, 256, 65_535] {
            let Some(register) = Register::from_number(number, index) else {
                continue;
            };
            assert!(number < Register::COUNT);
            assert_eq!(register.number(), number);
            assert_eq!(register.index().unwrap_or(0), index);
            assert_eq!(Register::from_name(&register.to_string()), Some(register));
        }
    }
    assert_eq!(Register::from_name("REGS"), Some(Register::Regs(0)));
    for wrong in [
        "",
        "regs",
        "REGS.",
        "REGS.-1",
        "REGS.+1",
        "REGS.65536",
        "BAUD.0",
        "VALID_REG.256",
        "REGS.1.2",
    ] {
        assert_eq!(Register::from_name(wrong), None, "{wrong}");
    }
}
