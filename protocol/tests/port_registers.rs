//! The register set of a port: the accepted values, the refusals, and the data of its slave.

use multidrop_protocol::format::{Framing, LineFormat};
use multidrop_protocol::port_registers::{
    Change, InterCharacter, LineSettings, PortRegisters, PortSettings, Reason, Register,
};
use multidrop_protocol::registers::{Bank, CoilBank, NoCoils, NoRules, ScanList, SparseBank};
use multidrop_protocol::rules;
use multidrop_protocol::server::Server;
use multidrop_testkit::harness::random::Random;

type Plain = PortRegisters<Bank<10>, CoilBank<1>, NoRules>;

fn plain() -> Plain {
    PortRegisters::new(PortSettings::DEFAULT, Bank::new(0), CoilBank::new(0, 8))
}

/// The text with which a load is refused.
fn refused(port: &mut Plain, name: &str, value: u32) -> String {
    let register = Register::from_name(name).unwrap_or_else(|| panic!("{name}"));
    let before = port.read(register).ok();
    let refused = port.load_raw(register, value).unwrap_err();
    assert_eq!(port.read(register).ok(), before, "{name} := {value}");
    refused.to_string()
}

fn load(port: &mut Plain, name: &str, value: u32) -> Change {
    port.load_raw(Register::from_name(name).unwrap(), value)
        .unwrap()
}

#[test]
fn random_scripts_agree_with_the_plain_reading() {
    for seed in 0..400 {
        let mut random = Random::new(seed);
        let script: Vec<u8> = (0..random.below(600)).map(|_| random.byte()).collect();
        let judged = std::panic::catch_unwind(|| multidrop_testkit::harness::ports::run(&script));
        assert!(judged.is_ok(), "seed {seed}");
    }
}

#[test]
fn a_refusal_names_the_accepted_values() {
    let port = &mut plain();
    for (name, value, text) in [
        (
            "MODE",
            4,
            "MODE is 4, which is not in this version, must be 0 (master), 1 (slave), 2 (off) or 3 (sniffer)",
        ),
        (
            "MODE",
            5,
            "MODE is 5, must be 0 (master), 1 (slave), 2 (off) or 3 (sniffer)",
        ),
        (
            "FRAMING",
            2,
            "FRAMING is 2, must be 0 (RTU) or 1 (ASCII) for a master or a slave",
        ),
        (
            "FRAMING",
            3,
            "FRAMING is 3, must be 0 (RTU), 1 (ASCII) or 2 (text)",
        ),
        ("BASE", 65_536, "BASE is 65536, must be 0..=65535"),
        (
            "BASE",
            65_527,
            "BASE is 65527, must be 0..=65526: there are 10 items behind it",
        ),
        ("REGS.10", 0, "REGS.10 does not exist, must be REGS.0..=9"),
        ("REGS.9", 65_536, "REGS.9 is 65536, must be 0..=65535"),
        ("COILS.7", 2, "COILS.7 is 2, must be 0 (off) or 1 (on)"),
        ("SLAVEID", 248, "SLAVEID is 248, must be 1..=247"),
        ("SLAVEID", 0, "SLAVEID is 0, must be 1..=247"),
        (
            "FUNC",
            22,
            "FUNC is 22, must be 1, 2, 3, 4, 5, 6, 15, 16 or 23; other functions are methods of the client",
        ),
        ("REGOFF", 65_536, "REGOFF is 65536, must be 0..=65535"),
        ("REGCNT", 0, "REGCNT is 0, must be 1..=125"),
        ("REGCNT", 126, "REGCNT is 126, must be 1..=125"),
        ("COILCNT", 2001, "COILCNT is 2001, must be 1..=2000"),
        ("STATUS", 0, "STATUS is read only"),
        ("DATAOK", 0, "DATAOK is read only"),
        ("VALID_REG.0", 0, "VALID_REG.0 is read only"),
        (
            "DISABLE_FLG.0",
            1,
            "DISABLE_FLG.0 does not exist, there is none",
        ),
        ("TIMEOUT", 0, "TIMEOUT is 0, must be 1..=65535"),
        ("RETRIES", 256, "RETRIES is 256, must be 0..=255"),
        ("BAUD", 299, "BAUD is 299, must be 300..=10000000"),
        (
            "FORMAT",
            4,
            "FORMAT is 4, must be 8N1 (0), 8E1 (1), 8O1 (2) or 8N2 (3) for RTU",
        ),
        (
            "FORMAT",
            7,
            "FORMAT is 7, must be 8N1 (0), 8E1 (1), 8O1 (2), 8N2 (3), 7E1 (4), 7O1 (5) or 7N2 (6)",
        ),
        ("DUPLEX", 2, "DUPLEX is 2, must be 0 (half) or 1 (full)"),
        ("FLOW", 2, "FLOW is 2, must be 0 (none) or 1 (RTS/CTS)"),
        (
            "INTER_CHARACTER",
            51,
            "INTER_CHARACTER is 51, must be 0 (strict), 1 (off) or 2..=50 (ms that end a frame)",
        ),
        (
            "LATE_GUARD",
            65_536,
            "LATE_GUARD is 65536, must be 0..=65535",
        ),
        ("CTS_TIMEOUT", 0, "CTS_TIMEOUT is 0, must be 1..=65535"),
        (
            "CTS_TIMEOUT",
            65_536,
            "CTS_TIMEOUT is 65536, must be 1..=65535",
        ),
        (
            "REQUEST_GAP",
            65_536,
            "REQUEST_GAP is 65536, must be 0..=65535",
        ),
        ("DE_LEAD", 10_001, "DE_LEAD is 10001, must be 0..=10000"),
        (
            "RESPONSE_DELAY",
            1001,
            "RESPONSE_DELAY is 1001, must be 0..=1000",
        ),
        ("START", 1, "MODE is 1, must be 0 (master) for START"),
        ("START", 2, "START is 2, must be 1"),
    ] {
        assert_eq!(refused(port, name, value), text);
    }
}

#[test]
fn a_start_is_refused_before_anything_is_sent() {
    let port = &mut plain();
    assert_eq!(load(port, "MODE", 0), Change::Mode);
    let setting: [(&[(&str, u32)], &str); 8] = [
        (
            &[("FUNC", 16), ("REGCNT", 124)],
            "REGCNT is 124, must be 1..=123 with FUNC 16",
        ),
        (
            &[("FUNC", 23), ("REGCNT", 122)],
            "REGCNT is 122, must be 1..=121 with FUNC 23",
        ),
        (
            &[("FUNC", 6), ("REGCNT", 2)],
            "REGCNT is 2, must be 1 with FUNC 6",
        ),
        (
            &[("FUNC", 3), ("REGOFF", 9)],
            "REGOFF is 9, must be 0..=8 for 2 items: the array has 10",
        ),
        (
            &[("REGCNT", 11)],
            "REGOFF is 9, which with 11 items is too much: the array has 10",
        ),
        (
            &[("FUNC", 15), ("COILCNT", 1969)],
            "COILCNT is 1969, must be 1..=1968 with FUNC 15",
        ),
        (
            &[("FUNC", 1), ("COILCNT", 9)],
            "COILCNT is 9, must be 1..=8",
        ),
        (
            &[("BASE", 100), ("COILOFF", 65_434), ("COILCNT", 3)],
            "COILOFF is 65434, must be 0..=65433 with BASE 100 and 3 items",
        ),
    ];
    for (loads, text) in setting {
        for (name, value) in loads {
            load(port, name, *value);
        }
        assert_eq!(refused(port, "START", 1), text);
    }
    load(port, "COILOFF", 65_433);
    assert_eq!(load(port, "START", 1), Change::Start);
    assert_eq!(
        refused(port, "START", 1),
        "START is 1, must wait: a transaction is under way"
    );
    assert_eq!(port.read(Register::Status), Ok(1));
}

#[test]
fn mode_and_slave_id_go_together() {
    let port = &mut plain();
    load(port, "MODE", 0);
    load(port, "SLAVEID", 0);
    assert_eq!(
        refused(port, "MODE", 1),
        "MODE is 1, but SLAVEID is 0, must be 1..=247 first"
    );
    load(port, "SLAVEID", 247);
    load(port, "MODE", 1);
    assert_eq!(refused(port, "SLAVEID", 0), "SLAVEID is 0, must be 1..=247");
    assert_eq!(port.read(Register::SlaveId), Ok(247));
}

#[test]
fn text_is_for_a_sniffer() {
    let port = &mut plain();
    load(port, "MODE", 3);
    assert_eq!(load(port, "FRAMING", 2), Change::Line);
    for mode in [0, 1] {
        let text =
            format!("MODE is {mode}, but FRAMING is 2 (text), must be 0 (RTU) or 1 (ASCII) first");
        assert_eq!(refused(port, "MODE", mode), text);
    }
    load(port, "FRAMING", 0);
    assert_eq!(load(port, "MODE", 1), Change::Mode);
}

#[test]
fn seven_bits_are_for_ascii() {
    let port = &mut plain();
    assert_eq!(load(port, "FRAMING", 1), Change::Line);
    load(port, "FORMAT", 4);
    assert_eq!(
        refused(port, "FRAMING", 0),
        "FRAMING is 0, but FORMAT has 7 data bits, must have 8 for RTU"
    );
    load(port, "FORMAT", 0);
    load(port, "FRAMING", 0);
    assert_eq!(port.settings().line.format, LineFormat::F8N1);
}

#[test]
fn each_number_of_a_setting_is_one_thing() {
    let port = &mut plain();
    load(port, "MODE", 2);
    load(port, "FRAMING", 1);
    for (number, format) in (0..).zip(LineFormat::ALL) {
        load(port, "FORMAT", number);
        assert_eq!(port.settings().line.format, format);
        assert_eq!(port.read(Register::Format), Ok(number));
    }
    load(port, "FORMAT", 0);
    for (number, framing) in (0..).zip([Framing::Rtu, Framing::Ascii, Framing::Text]) {
        load(port, "FRAMING", number);
        assert_eq!(port.settings().line.framing, framing);
        assert_eq!(port.read(Register::Framing), Ok(number));
    }
    for (number, rule) in [
        (0, InterCharacter::Strict),
        (1, InterCharacter::Off),
        (2, InterCharacter::Gap(2)),
        (50, InterCharacter::Gap(50)),
    ] {
        load(port, "INTER_CHARACTER", number);
        assert_eq!(port.settings().line.inter_character, rule);
        assert_eq!(port.read(Register::InterCharacter), Ok(number));
    }
    for name in ["TURNAROUND", "LATE_GUARD", "REQUEST_GAP"] {
        for value in [0, 1, 65_535] {
            load(port, name, value);
            assert_eq!(port.read(Register::from_name(name).unwrap()), Ok(value));
        }
        refused(port, name, 65_536);
    }
}

#[test]
fn a_port_without_coils_has_no_function_for_them() {
    let mut port: PortRegisters<Bank<10>, NoCoils, NoRules> =
        PortRegisters::new(PortSettings::DEFAULT, Bank::new(0), NoCoils);
    for function in 0..=255 {
        let loaded = port.load_raw(Register::Func, function);
        match function {
            3 | 4 | 6 | 16 | 23 => assert!(loaded.is_ok(), "{function}"),
            1 | 2 | 5 | 15 => assert_eq!(loaded.unwrap_err().reason, Reason::NoCoils),
            _ => assert_eq!(loaded.unwrap_err().reason, Reason::Value),
        }
    }
    let coil = port.load_raw(Register::Coils(0), 1).unwrap_err();
    assert_eq!(coil.to_string(), "COILS.0 does not exist, there is none");
    let port = &mut plain();
    for function in [1, 2, 3, 4, 5, 6, 15, 16, 23] {
        load(port, "FUNC", function);
    }
    port.regs_mut().cells_mut()[3] = 77;
    port.coils_mut().bytes_mut()[0] = 0b100;
    assert_eq!(port.read(Register::Regs(3)), Ok(77));
    assert_eq!(
        (port.regs().get(3), port.coils().get(2)),
        (Some(77), Some(true))
    );
}

#[test]
fn a_setting_that_the_chip_does_not_support_is_refused_by_name() {
    let port = &mut plain();
    let check = |line: &LineSettings| {
        if line.baud > 1_000_000 {
            Err(Reason::Baud(1_000_000))
        } else if line.framing == Framing::Ascii {
            Err(Reason::Framing(Framing::Ascii))
        } else if line.flow as u8 == 1 || line.de_lead_us > 0 || line.response_delay_ms > 0 {
            Err(Reason::Chip)
        } else if line.duplex as u8 == 1 {
            Err(Reason::Wiring)
        } else if line.baud < 1_400 || line.inter_character == InterCharacter::Gap(50) {
            Err(Reason::Silence)
        } else {
            Ok(())
        }
    };
    for (name, value, text) in [
        (
            "BAUD",
            2_000_000,
            "BAUD is 2000000, the clock does not make it within 2.5 %, nearest is 1000000",
        ),
        (
            "FRAMING",
            1,
            "FRAMING is 1, the line was built without ASCII",
        ),
        ("FLOW", 1, "FLOW is 1, the chip does not have it"),
        ("DE_LEAD", 1, "DE_LEAD is 1, the chip does not have it"),
        (
            "RESPONSE_DELAY",
            1000,
            "RESPONSE_DELAY is 1000, the chip does not have it",
        ),
        ("DUPLEX", 1, "DUPLEX is 1, must be 0: the port is wired so"),
        (
            "BAUD",
            1_200,
            "BAUD is 1200, the line was built without silences of that length",
        ),
        (
            "INTER_CHARACTER",
            50,
            "INTER_CHARACTER is 50, the line was built without silences of that length",
        ),
    ] {
        let register = Register::from_name(name).unwrap();
        let before = port.read(register);
        let refused = port.load_checked(register, value, &check).unwrap_err();
        assert_eq!(refused.to_string(), text);
        assert_eq!(port.read(register), before);
    }
}

rules! {
    struct Example: "RS4";
    VALID_REG { 10..=90, 120..=190 }
    VALID_DATA { 10..=15 => range(100..=200), 130..=130 => list(1, 2, 3) }
    DISABLE_REG { 10..=20, 109..=130, 191..=199 }
}

/// What a slave answers to unit id 1 and this PDU.
fn answer(port: &mut PortRegisters<Bank<200>, CoilBank<1>, Example>, pdu: &[u8]) -> Vec<u8> {
    let server = Server::new(1);
    let mut adu = [0; 256];
    adu[0] = 1;
    adu[1..=pdu.len()].copy_from_slice(pdu);
    let len = pdu.len() as u8 + 1;
    let plan = server.prepare(port, &mut adu, len);
    let len = server.commit(port, &mut adu, len, plan);
    adu[1..len.into()].to_vec()
}

#[test]
fn a_slave_serves_its_arrays_under_its_rules() {
    let mut port = PortRegisters::new(PortSettings::DEFAULT, Bank::new(0), CoilBank::new(0, 8));
    let port = &mut port;
    // Write 150 to 10, read it back as holding and as input register.
    assert_eq!(answer(port, &[6, 0, 10, 0, 150]), [6, 0, 10, 0, 150]);
    assert_eq!(answer(port, &[3, 0, 10, 0, 2]), [3, 4, 0, 150, 0, 0]);
    assert_eq!(answer(port, &[4, 0, 10, 0, 1]), [4, 2, 0, 150]);
    // 9 is no valid register, 15 takes 100 to 200, of a block nothing is written.
    assert_eq!(answer(port, &[3, 0, 9, 0, 2]), [0x83, 2]);
    assert_eq!(
        answer(port, &[16, 0, 14, 0, 2, 4, 0, 100, 0, 201]),
        [0x90, 3]
    );
    assert_eq!(port.read(Register::Regs(14)), Ok(0));
    // Mask write: the rule binds the result. 150 is 0x96; with bit 6 it is 214.
    assert_eq!(
        answer(port, &[22, 0, 10, 0xFF, 0xFF, 0, 0x40]),
        [22, 0, 10, 0xFF, 0xFF, 0, 0x40]
    );
    assert_eq!(answer(port, &[22, 0, 10, 0xFF, 0xBF, 0, 0x40]), [0x96, 3]);
    // Read/Write: a write that is not allowed is not done, nor the read.
    assert_eq!(
        answer(port, &[23, 0, 10, 0, 1, 0, 130, 0, 1, 2, 0, 4]),
        [0x97, 3]
    );
    assert_eq!(
        answer(port, &[23, 0, 10, 0, 1, 0, 130, 0, 1, 2, 0, 3]),
        [23, 2, 0, 150]
    );
    // Disabled at run time: 06, 10, 16 and 17 are refused, reads are not.
    port.load_raw(Register::DisableFlg(0), 1).unwrap();
    for pdu in [
        &[6, 0, 20, 0, 1][..],
        &[16, 0, 20, 0, 2, 4, 0, 0, 0, 0],
        &[22, 0, 20, 0, 0, 0, 0],
        &[23, 0, 30, 0, 1, 0, 20, 0, 1, 2, 0, 0],
        // Disabled comes before the value.
        &[6, 0, 10, 0, 0],
    ] {
        assert_eq!(answer(port, pdu), [pdu[0] | 0x80, 7]);
    }
    assert_eq!(answer(port, &[3, 0, 10, 0, 1]), [3, 2, 0, 150]);
    // An address that does not exist comes before disabled.
    assert_eq!(
        answer(port, &[16, 0, 9, 0, 2, 4, 0, 100, 0, 100]),
        [0x90, 2]
    );
    assert_eq!(answer(port, &[6, 0, 130, 0, 1]), [6, 0, 130, 0, 1]);
    port.load_raw(Register::DisableFlg(0), 0).unwrap();
    assert_eq!(answer(port, &[6, 0, 20, 0, 1]), [6, 0, 20, 0, 1]);
    // BASE moves the array: register 20 is element 10 now. COILS are moved with it.
    port.load_raw(Register::Base, 10).unwrap();
    assert_eq!(answer(port, &[3, 0, 20, 0, 1]), [3, 2, 0, 150]);
    assert_eq!(answer(port, &[5, 0, 17, 0xFF, 0]), [5, 0, 17, 0xFF, 0]);
    assert_eq!(port.read(Register::Coils(7)), Ok(1));
    assert_eq!(answer(port, &[2, 0, 10, 0, 8]), [2, 1, 0x80]);
    assert_eq!(answer(port, &[1, 0, 9, 0, 1]), [0x81, 2]);
}

#[test]
fn two_ports_have_separate_register_sets() {
    let (mut as1, mut rs4) = (plain(), plain());
    load(&mut as1, "BAUD", 9600);
    load(&mut as1, "REGS.3", 7);
    load(&mut as1, "MODE", 2);
    assert_eq!(rs4.read(Register::Baud), Ok(19_200));
    assert_eq!(rs4.read(Register::Regs(3)), Ok(0));
    load(&mut rs4, "SLAVEID", 9);
    assert_eq!(
        (as1.read(Register::SlaveId), as1.read(Register::Mode)),
        (Ok(1), Ok(2))
    );
}

#[test]
fn base_leaves_tables_where_they_are() {
    let mut port: PortRegisters<_, _, NoRules> = PortRegisters::new(
        PortSettings {
            base: 40_001,
            ..PortSettings::DEFAULT
        },
        SparseBank::new([4, 65_535]),
        CoilBank::<1>::new(0, 8),
    );
    assert!(port.load_raw(Register::Base, 65_528).is_ok());
    assert!(port.load_raw(Register::Base, 65_529).is_err());
    let mut scan: PortRegisters<_, _, NoRules> = PortRegisters::new(
        PortSettings::DEFAULT,
        ScanList::new([1, 2, 3], [1, 2, 3]),
        CoilBank::<1>::new(0, 8),
    );
    // How many places of a list are walked is not bound by what one request can carry.
    assert!(scan.load_raw(Register::RegCnt, 300).is_ok());
}
