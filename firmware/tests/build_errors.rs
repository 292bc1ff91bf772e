//! The messages for wrong configurations: each wrong port, rule and bank is built, and its message is compared word
//! by word.
//!
//! All cases are examples of one package that the test writes and checks with one run of cargo.

use std::collections::BTreeMap;
use std::fs;
use std::path::Path;
use std::process::Command;

/// Name, source, and the message of rustc: behind its code where it has one, as in `E0382: use of moved value`.
type Case = (&'static str, String, &'static str);

/// A port built so.
fn port(builder: &str) -> String {
    format!("const _: PortConfig = PortConfig::new(\"RS4\"){builder};")
}

/// Something made of a port built so.
fn of_port(builder: &str, type_name: &str, call: &str) -> String {
    format!(
        "const PORT: PortConfig = PortConfig::new(\"RS4\"){builder};\nconst _: {type_name} = PORT{call};"
    )
}

/// Rules with these lists.
fn rules(lists: &str) -> String {
    format!("rules! {{ pub struct Limits: \"RS4\"; {lists} }}")
}

/// Something done with frames of a line.
fn frame(function: &str) -> String {
    format!("use multidrop::line::{{Frame, Key, Lend, Line, Released}};\n{function}")
}

fn constant(type_name: &str, value: &str) -> String {
    format!("const _: {type_name} = {value};")
}

fn cases() -> Vec<Case> {
    vec![
        (
            "frame_is_released_once",
            frame(
                "async fn f<L: Line>(frame: Frame<'_, L>) { _ = frame.release(3); _ = frame.release(4); }",
            ),
            "E0382: use of moved value: `frame`",
        ),
        (
            "frame_changes_after_release",
            frame(
                "async fn f<L: Line>(mut frame: Frame<'_, L>) { let mut answer = frame.release(5); frame.adu()[2] = 0; answer.sent().await; }",
            ),
            "E0382: borrow of moved value: `frame`",
        ),
        (
            "released_frame_changes",
            frame("fn f<L: Line>(mut answer: Released<'_, L>) { answer.adu()[2] = 0; }"),
            "E0599: no method named `adu` found for struct `multidrop::Released<'l, L>` in the current scope",
        ),
        (
            "line_is_no_lender",
            frame("fn f<L: Line>(line: &L) { line.give_back(); }"),
            "E0061: this method takes 1 argument but 0 arguments were supplied",
        ),
        (
            "key_is_ours",
            frame("fn f<L: Line>(line: &L) { line.give_back(Key(())); }"),
            "E0423: cannot initialize a tuple struct which contains private fields",
        ),
        (
            "frame_is_ours",
            frame("fn f<'l, L: Line>(line: &'l L) -> Frame<'l, L> { Frame(line) }"),
            "E0423: cannot initialize a tuple struct which contains private fields",
        ),
        (
            "answer_on_its_way_changes",
            frame(
                "fn f(access: multidrop::protocol::server::Access<'_>) { use multidrop::protocol::server::Access; if let Access::Released(adu) = access { adu[0] = 1; } }",
            ),
            "E0594: cannot assign to `adu[_]`, which is behind a `&` reference",
        ),
        (
            "slave_id_0",
            port(".slave_id(0)"),
            "port RS4: slave_id is 0, must be 1..=247",
        ),
        (
            "slave_id_248",
            port(".slave_id(248)"),
            "port RS4: slave_id is 248, must be 1..=247",
        ),
        (
            "slave_id_256",
            port(".slave_id(256)"),
            "port RS4: slave_id is 256, must be 1..=247",
        ),
        (
            "master_id_248",
            port(".client().slave_id(248)"),
            "port RS4: slave_id is 248, must be 0..=247",
        ),
        (
            "name_twice",
            constant(
                "[PortConfig; 2]",
                "multidrop::manager::table([PortConfig::new(\"AS1\"), PortConfig::new(\"AS1\").client()])",
            ),
            "port AS1: two ports in the table have this name",
        ),
        (
            "mode",
            port(".client().slave_id(0).mode(Mode::Slave)"),
            "port RS4: slave_id is 0, must be 1..=247 for a slave",
        ),
        (
            "base",
            port(".base(65_536)"),
            "port RS4: base is 65536, must be 0..=65535",
        ),
        (
            "timeout_0",
            port(".timeout_ms(0)"),
            "port RS4: timeout_ms is 0, must be 1..=65535",
        ),
        (
            "timeout_high",
            port(".timeout_ms(65_536)"),
            "port RS4: timeout_ms is 65536, must be 1..=65535",
        ),
        (
            "late_guard",
            port(".late_guard_ms(65_536)"),
            "port RS4: late_guard_ms is 65536, must be 0..=65535",
        ),
        (
            "request_gap",
            port(".request_gap_ms(65_536)"),
            "port RS4: request_gap_ms is 65536, must be 0..=65535",
        ),
        (
            "cts_timeout_0",
            port(".cts_timeout_ms(0)"),
            "port RS4: cts_timeout_ms is 0, must be 1..=65535",
        ),
        (
            "cts_timeout_high",
            port(".cts_timeout_ms(65_536)"),
            "port RS4: cts_timeout_ms is 65536, must be 1..=65535",
        ),
        (
            "de_lead",
            port(".de_lead_us(10_001)"),
            "port RS4: de_lead_us is 10001, must be 0..=10000",
        ),
        (
            "response_delay",
            port(".response_delay_ms(1001)"),
            "port RS4: response_delay_ms is 1001, must be 0..=1000",
        ),
        (
            "gap_1",
            port(".inter_character(InterCharacter::Gap(1))"),
            "port RS4: inter_character gap is 1, must be 2..=50 ms",
        ),
        (
            "gap_51",
            port(".inter_character(InterCharacter::Gap(51))"),
            "port RS4: inter_character gap is 51, must be 2..=50 ms",
        ),
        (
            "retries",
            port(".retries(256)"),
            "port RS4: retries is 256, must be 0..=255",
        ),
        (
            "turnaround",
            port(".turnaround_ms(65_536)"),
            "port RS4: turnaround_ms is 65536, must be 0..=65535",
        ),
        (
            "baud_299",
            port(".baud(299)"),
            "port RS4: baud is 299, must be 300..=10000000",
        ),
        (
            "baud_high",
            port(".baud(10_000_001)"),
            "port RS4: baud is 10000001, must be 300..=10000000",
        ),
        (
            "format_rtu",
            port(".format(LineFormat::F7E1)"),
            "port RS4: format: data bits is 7, must be 8 for RTU",
        ),
        (
            "framing_rtu",
            port(".framing(Framing::Ascii).format(LineFormat::F7E1).framing(Framing::Rtu)"),
            "port RS4: format: data bits is 7, must be 8 for RTU",
        ),
        (
            "bank_end",
            of_port(".base(65_530)", "Bank<10>", ".bank()"),
            "port RS4: base is 65530, must be at most 65526 for 10 registers",
        ),
        (
            "coil_bank_end",
            of_port(".base(65_530)", "CoilBank<1>", ".coil_bank(7)"),
            "port RS4: base is 65530, must be at most 65529 for 7 coils",
        ),
        (
            "coil_bank_none",
            of_port("", "CoilBank<1>", ".coil_bank(0)"),
            "a coil bank must have at least one coil",
        ),
        (
            "coil_bank_bits",
            of_port("", "CoilBank<1>", ".coil_bank(9)"),
            "a coil bank must have a bit for each coil",
        ),
        (
            "dense_end",
            constant("Bank<2>", "Bank::new(65_535)"),
            "bank runs past address 65535",
        ),
        (
            "sparse_order",
            constant("SparseBank<3>", "SparseBank::new([4, 6, 5])"),
            "sparse bank: address 2 is 5, must be above the one before, which is 6",
        ),
        (
            "sparse_twice",
            constant("SparseCoilBank<2>", "SparseCoilBank::new([7, 7])"),
            "sparse bank: address 1 is 7, must be above the one before, which is 7",
        ),
        (
            "scan_unit",
            constant("ScanList<2>", "ScanList::new([4, 5], [1, 248])"),
            "scan list: place 1: slave id is 248, must be 0..=247",
        ),
        (
            "scan_offset",
            constant(
                "ScanList<2>",
                "ScanList::from_rows([4, 5], [0; 2], [1, 2], [0, 2])",
            ),
            "scan list: place 1: register offset is 2, must be 0..=1",
        ),
        (
            "valid_reversed",
            rules("VALID_REG { 10..=90, 190..=120 }"),
            "port RS4: VALID_REG 190..=120: the first register must not be above the last one",
        ),
        (
            "valid_overlap",
            rules("VALID_REG { 10..=90, 90..=120 }"),
            "port RS4: VALID_REG 90..=120 overlaps 10..=90",
        ),
        (
            "valid_empty",
            rules("VALID_REG {}"),
            "port RS4: VALID_REG is empty, must have a range or be left out",
        ),
        (
            "data_overlap",
            rules("VALID_DATA { 10..=15 => range(1..=2), 0..=20 => list(1) }"),
            "port RS4: VALID_DATA 0..=20 overlaps 10..=15",
        ),
        (
            "data_reversed",
            rules("VALID_DATA { 15..=10 => range(1..=2) }"),
            "port RS4: VALID_DATA 15..=10: the first register must not be above the last one",
        ),
        (
            "data_low",
            rules("VALID_DATA { 10..=15 => range(200..=100) }"),
            "port RS4: VALID_DATA 10..=15: low is 200, must not be above high, which is 100",
        ),
        (
            "data_no_value",
            rules("VALID_DATA { 10..=15 => list() }"),
            "port RS4: VALID_DATA 10..=15: list is empty, must have a value",
        ),
        (
            "data_kind",
            rules("VALID_DATA { 10..=15 => between(1, 2) }"),
            "a rule of VALID_DATA is range(low..=high) or list(value, ...)",
        ),
        (
            "data_value",
            rules("VALID_DATA { 10..=15 => list(1, 65_536) }"),
            "literal out of range for `u16`",
        ),
        (
            "valid_register",
            rules("VALID_REG { 0..=65_536 }"),
            "literal out of range for `u16`",
        ),
        (
            "disable_overlap",
            rules("DISABLE_REG { 109..=130, 120..=121 }"),
            "port RS4: DISABLE_REG 120..=121 overlaps 109..=130",
        ),
        (
            "disable_reversed",
            rules("DISABLE_REG { 20..=10 }"),
            "port RS4: DISABLE_REG 20..=10: the first register must not be above the last one",
        ),
        (
            "disable_many",
            rules(&format!(
                "DISABLE_REG {{ {} }}",
                (0..33)
                    .map(|register| format!("{register}..={register},"))
                    .collect::<String>()
            )),
            "port RS4: DISABLE_REG has 33 ranges, must be at most 32",
        ),
        (
            "unit",
            constant("Server", "Server::new(248)"),
            "unit id must be 1..=247",
        ),
        // What is right is built: a case that fails for another reason would not show otherwise.
        (
            "right",
            format!(
                "{}\n{}\n{}",
                port(
                    ".client().slave_id(0).base(65_526).timeout_ms(150).retries(255).turnaround_ms(0)\
                     .late_guard_ms(65_535).request_gap_ms(65_535).cts_timeout_ms(65_535).de_lead_us(10_000)\
                     .response_delay_ms(1000).inter_character(InterCharacter::Gap(50))\
                     .framing(Framing::Ascii).format(LineFormat::F7E1).baud(300)"
                ),
                rules(
                    "VALID_REG { 10..=90, 120..=190 } \
                     VALID_DATA { 10..=15 => range(100..=200), 150..=150 => list(1, 2, 3) } \
                     DISABLE_REG { 10..=20, 109..=130, 191..=199 }"
                ),
                constant("SparseBank<3>", "SparseBank::new([4, 5, 65_535])"),
            ),
            "",
        ),
    ]
}

const IMPORTS: &str = "#![no_std]
#![allow(unused_imports, clippy::all)]
use multidrop::PortConfig;
use multidrop::protocol::format::{Framing, LineFormat};
use multidrop::protocol::port_registers::{InterCharacter, Mode};
use multidrop::protocol::registers::{Bank, CoilBank, ScanList, SparseBank, SparseCoilBank};
use multidrop::protocol::rules;
use multidrop::protocol::server::Server;
";

/// Checks all cases; gives what rustc said of each that failed.
fn check(cases: &[Case]) -> BTreeMap<String, Vec<String>> {
    // Where they are now: a copied checkout may have been compiled elsewhere.
    let here = std::env::var("CARGO_MANIFEST_DIR").expect("cargo runs the test");
    let here = Path::new(&here);
    let test = std::env::current_exe().expect("the test's own path");
    let target = test.ancestors().nth(3).expect("TARGET/PROFILE/deps/TEST");
    let folder = target.join("tmp/build_errors");
    let _ = fs::remove_dir_all(folder.join("examples"));
    fs::create_dir_all(folder.join("examples")).unwrap();
    let mut manifest = format!(
        "[package]\nname = \"cases\"\nversion = \"0.0.0\"\nedition = \"2024\"\n\n[workspace]\n\n[lib]\npath = \"lib.rs\"\n\n\
         [dependencies]\nmultidrop = {{ path = {:?} }}\n",
        here.display().to_string()
    );
    for (name, source, _) in cases {
        let path = format!("examples/{name}.rs");
        fs::write(folder.join(&path), format!("{IMPORTS}{source}\n")).unwrap();
        manifest += &format!("\n[[example]]\nname = {name:?}\ncrate-type = [\"lib\"]\n");
    }
    fs::write(folder.join("Cargo.toml"), manifest).unwrap();
    fs::write(folder.join("lib.rs"), "#![no_std]\n").unwrap();
    // The versions that are tested, which are there already.
    fs::copy(here.join("../Cargo.lock"), folder.join("Cargo.lock")).unwrap();

    let output = Command::new(env!("CARGO"))
        .current_dir(&folder)
        .env("CARGO_TARGET_DIR", folder.join("target"))
        .env_remove("RUSTFLAGS")
        .args(["check", "--offline", "--keep-going", "--examples"])
        .args(["--message-format", "json"])
        .output()
        .unwrap();
    let mut said: BTreeMap<String, Vec<String>> = BTreeMap::new();
    for line in String::from_utf8_lossy(&output.stdout).lines() {
        // An error's line names its target, and its message is the first there.
        let Some(name) = cases
            .iter()
            .map(|(name, ..)| *name)
            .find(|name| line.contains(&format!("\"name\":{name:?}")))
        else {
            continue;
        };
        if line.contains("\"level\":\"error\"") {
            said.entry(name.to_owned())
                .or_default()
                .push(line.to_owned());
        }
    }
    assert!(
        !said.is_empty(),
        "{}",
        String::from_utf8_lossy(&output.stderr)
    );
    said
}

#[test]
fn every_wrong_configuration_stops_the_build_with_its_message() {
    let cases = cases();
    let said = check(&cases);
    for (name, source, message) in &cases {
        let errors = said.get(*name);
        if message.is_empty() {
            assert_eq!(errors, None, "{name}: {source}");
            continue;
        }
        let errors = errors.unwrap_or_else(|| panic!("{name} was built: {source}"));
        let (code, message) = match message.split_once(": ") {
            Some((code, message)) if code.starts_with("E0") => (Some(code), message),
            _ => (None, *message),
        };
        let code = code.map_or(String::new(), |code| format!("\"code\":{code:?}"));
        // As JSON has it; the message ends there, so nothing more is said.
        let whole = [
            format!("\"message\":\"evaluation panicked: {message}\""),
            format!("\"message\":\"{message}\""),
        ];
        assert!(
            errors
                .iter()
                .any(|line| line.contains(&code) && whole.iter().any(|whole| line.contains(whole))),
            "{name}: {source}\n{errors:#?}"
        );
    }
}
