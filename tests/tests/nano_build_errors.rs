//! The build errors of the Nano's board crate for settings that the chip does not support.
//!
//! Each case is an example of a package that the test writes; one run of the firmware's cargo checks them all.

use multidrop_testkit::places;

use std::fs;
use std::path::Path;
use std::process::Command;

const PORT: &str = "const PORT: PortConfig = PortConfig::new(\"RS4\")";
const SETTINGS: &str = "const _: Settings<RtuOnly> = settings(&PORT);";

/// Name, source, and what rustc has to say of it.
fn cases() -> Vec<(&'static str, String, &'static str)> {
    let port = |builder: &str| format!("{PORT}{builder};\n{SETTINGS}");
    vec![
        (
            "baud",
            port(".baud(921_600)"),
            "port RS4: baud is 921600, the clock does not make it within 2.5 %, nearest is 1000000",
        ),
        (
            "baud_low",
            port(".baud(300)"),
            "port RS4: baud is 300, too slow: a character is too long for Timer1, nearest is 338",
        ),
        (
            "baud_slow",
            port(".baud(1_200)"),
            "port RS4: baud is 1200, a silence is too long for one turn of Timer1: the line must be of type Rs485Slow or Rs485AsciiSlow",
        ),
        (
            "gap_long",
            port(".baud(38_400).inter_character(InterCharacter::Gap(50))"),
            "port RS4: inter_character gap is 50, a silence is too long for one turn of Timer1: the line must be of type Rs485Slow or Rs485AsciiSlow",
        ),
        (
            "slow_right",
            format!(
                "{PORT}.baud(1_200).inter_character(InterCharacter::Gap(50));\n\
                 const _: Settings<Slow<RtuOnly>> = settings(&PORT);"
            ),
            "",
        ),
        (
            "framing",
            port(".framing(Framing::Ascii).baud(38_400)"),
            "port RS4: framing is ASCII, must be RTU on a line of type Rs485; Rs485Ascii has both",
        ),
        (
            "duplex",
            port(".baud(38_400).duplex(Duplex::Full)"),
            "port RS4: duplex is 1, must be 0 (half): the line has a DE pin",
        ),
        (
            "flow",
            port(".baud(38_400).flow(Flow::RtsCts)"),
            "port RS4: flow is 1, must be 0 (none): the ATmega328P has no RTS and CTS",
        ),
        (
            "delay",
            port(".baud(38_400).de_lead_us(100)"),
            "port RS4: de_lead_us and response_delay_ms must be 0 on a line of type Rs485; Rs485Delayed has both",
        ),
        (
            "delayed",
            format!(
                "{PORT}.baud(38_400).de_lead_us(100).response_delay_ms(50);\n\
                 const _: Settings<Delayed<RtuOnly>> = settings(&PORT);"
            ),
            "",
        ),
        (
            "pin_twice",
            "pub fn take(pins: Pins) -> (Output<PD2>, Input<PD2>) {\n    \
             (Output::new(pins.PD2, false), Input::new(pins.PD2, true))\n}"
                .to_owned(),
            "use of moved value: `pins.PD2`",
        ),
        (
            "slots",
            format!("{WAITING}bind_interrupts!(struct Irqs {{ TIME => 16_000_000, slots = 1, tasks = [poll, blink]; }});"),
            "TIME: slots is 1, must be at least 2, for that many tasks are named",
        ),
        (
            "slots_none",
            "bind_interrupts!(struct Irqs { TIME => 16_000_000, slots = 0; });".to_owned(),
            "TIME: slots is 0, must be 1..=32",
        ),
        (
            "slots_many",
            "bind_interrupts!(struct Irqs { TIME => 16_000_000, slots = 33; });".to_owned(),
            "TIME: slots is 33, must be 1..=32",
        ),
        (
            "slots_right",
            format!("{WAITING}bind_interrupts!(struct Irqs {{ TIME => 16_000_000, tasks = [poll, blink]; }});"),
            "",
        ),
        (
            "edges",
            "bind_interrupts!(struct Irqs { INT1; });\n\
             pub fn take(pin: PD4) { EdgeInput::new(Input::new(pin, true), Irqs); }"
                .to_owned(),
            "the interrupt of PortD is not bound: name INT0 for PD2, INT1 for PD3, PCINT2 for PD4 to PD7 in bind_interrupts!",
        ),
        (
            "edges_right",
            "bind_interrupts!(struct Irqs { INT1; PCINT2; });\n\
             pub fn take(pin: PD4) { EdgeInput::new(Input::new(pin, true), Irqs); }"
                .to_owned(),
            "",
        ),
        (
            "watchdog",
            "const _: Watchdog = Watchdog::ms::<3000>();".to_owned(),
            "watchdog is 3000 ms, must be 32, 64, 125, 250, 500, 1000, 2000, 4000 or 8000",
        ),
        (
            "watchdog_right",
            "const _: Watchdog = Watchdog::ms::<8000>();".to_owned(),
            "",
        ),
        (
            "usart_not_bound",
            format!("bind_interrupts!(struct Irqs {{ EEPROM; }});\n{OPEN}"),
            "the interrupts of USART0 are not bound to this type of line: name it in bind_interrupts!, `USART0 => TYPE;`",
        ),
        (
            "usart_other_de",
            format!("bind_interrupts!(struct Irqs {{ USART0 => Usart0<PD4, 16_000_000>; }});\n{OPEN}"),
            "the interrupts of USART0 are not bound to this type of line: name it in bind_interrupts!, `USART0 => TYPE;`",
        ),
        (
            "usart_other_framings",
            format!("bind_interrupts!(struct Irqs {{ USART0 => Usart0<PD2, 16_000_000, Slow<RtuOnly>>; }});\n{OPEN}"),
            "the interrupts of USART0 are not bound to this type of line: name it in bind_interrupts!, `USART0 => TYPE;`",
        ),
        (
            "usart_right",
            format!("bind_interrupts!(struct Irqs {{ USART0 => Usart0<PD2, 16_000_000>; }});\n{OPEN}"),
            "",
        ),
        (
            "uart_not_bound",
            format!("bind_interrupts!(struct Irqs {{ USART0 => Usart0<PD2, 16_000_000>; }});\n{UART}"),
            "the interrupts of the UART are not bound: name UART in bind_interrupts!",
        ),
        (
            "uart_beside_the_line",
            format!("bind_interrupts!(struct Irqs {{ USART0 => Usart0<PD2, 16_000_000>; UART; }});\n{UART}"),
            "the name `__vector_18` is defined multiple times",
        ),
        (
            "uart_right",
            format!("bind_interrupts!(struct Irqs {{ UART; }});\n{UART}"),
            "",
        ),
        (
            "uart_baud",
            "const _: Config = Config::fixed(16_000_000, 921_600, LineFormat::F8N1);".to_owned(),
            "baud is 921600, the clock does not make it within 2.5 %, nearest is 1000000",
        ),
        (
            "eeprom_not_bound",
            "bind_interrupts!(struct Irqs { INT0; });\n\
             pub fn take(registers: pac::EEPROM) -> Eeprom { Eeprom::new(registers, Irqs) }"
                .to_owned(),
            "the interrupt of the EEPROM is not bound: name EEPROM in bind_interrupts!",
        ),
        (
            "eeprom_right",
            "bind_interrupts!(struct Irqs { EEPROM; });\n\
             pub fn take(registers: pac::EEPROM) -> Eeprom { Eeprom::new(registers, Irqs) }"
                .to_owned(),
            "",
        ),
        (
            "watchdog_not_bound",
            "bind_interrupts!(struct Irqs { EEPROM; });\n\
             pub fn start() { Watchdog::DEFAULT.start(Irqs) }"
                .to_owned(),
            "the interrupt of the watchdog is not bound: name WATCHDOG in bind_interrupts!",
        ),
        (
            "watchdog_not_of_the_board",
            "bind_interrupts!(struct Irqs { USART0 => Rs485; WATCHDOG; });\n\
             pub fn begin() -> Board { board_nano::init(Irqs) }"
                .to_owned(),
            "`Irqs` has no watchdog for a roll: define it by board_nano::bind_interrupts!",
        ),
        (
            "watchdog_not_fed",
            "board_nano::bind_interrupts!(struct Irqs { USART0 => Rs485; });\n\
             pub fn begin() -> ! { executor::run(Irqs, |_| {}) }"
                .to_owned(),
            "`Irqs` binds WATCHDOG, which has to be fed: run the executor by run_watched",
        ),
        (
            "watchdog_fed",
            "board_nano::bind_interrupts!(struct Irqs { USART0 => Rs485; });\n\
             static ROLL: Roll<Irqs, 0> = Roll::new();\n\
             pub fn begin() -> ! { board_nano::init(Irqs); board_nano::run(&ROLL, |_| {}) }"
                .to_owned(),
            "",
        ),
        (
            "run_without_token",
            "pub fn begin() -> ! { executor::run(|_| {}) }".to_owned(),
            "this function takes 2 arguments but 1 argument was supplied",
        ),
        (
            "bound_unknown",
            "bind_interrupts!(struct Irqs { USART1; });".to_owned(),
            "bind_interrupts! does not know `USART1;`: must be some of `USART0 => TYPE;`, `UART;`, `WATCHDOG;`, `EEPROM;`, `INT0;`, `INT1;`, `PCINT2;`, `TIME => HZ;`, each once",
        ),
        (
            "bound_twice",
            "bind_interrupts!(struct Irqs { EEPROM; });\nbind_interrupts!(struct Others { INT0; });"
                .to_owned(),
            "the name `bound_interrupts` is defined multiple times",
        ),
        ("right", port(".baud(38_400)"), ""),
    ]
}

/// What takes the token of the line.
const OPEN: &str = "type Line = Usart0<PD2, 16_000_000>;
pub fn open(chip: pac::Peripherals, pins: Pins) -> Line {
    Line::new(chip.USART0, &chip.TC1, pins.PD0, pins.PD1, pins.PD2, Irqs)
}";

/// What takes the token of the UART.
const UART: &str = "pub fn open(chip: pac::Peripherals, pins: Pins, config: Config, tx: &'static mut [u8; 32], rx: &'static mut [u8; 32]) \
    -> BufferedUart {
    BufferedUart::new(chip.USART0, pins.PD0, pins.PD1, Irqs, config, tx, rx)
}";

/// Two tasks that wait for time, as far as the macro looks at them.
const WAITING: &str = "fn poll() {}\nfn blink() {}\n";

const IMPORTS: &str = "#![no_std]
#![feature(abi_avr_interrupt)]
#![allow(unused_imports, dead_code)]
use board_nano::{Board, Rs485, Watchdog, settings};
use embassy_avr_hal::edge::EdgeInput;
use embassy_avr_hal::eeprom::Eeprom;
use embassy_avr_hal::gpio::{Input, Output, PD2, PD4, Pins};
use embassy_avr_hal::uart::{BufferedUart, Config, LineFormat};
use embassy_avr_hal::usart::{Delayed, RtuOnly, Settings, Slow, Usart0};
use embassy_avr_hal::{bind_interrupts, executor, pac};
use multidrop::{PortConfig, Roll};
use multidrop::line::InterCharacter;
use multidrop::protocol::format::Framing;
use multidrop::protocol::port_registers::{Duplex, Flow};
";

/// A program that waits for a time, with what its `bind_interrupts!` names.
fn waits(bound: &str) -> String {
    format!(
        "#![no_std]
#![no_main]
#![feature(abi_avr_interrupt)]
board_nano::bind_interrupts!(struct Irqs {{ USART0 => board_nano::Rs485; {bound} }});
multidrop::tasks! {{
    static ROLL: Roll<Irqs>;
    fn wait() = async {{ loop {{ embassy_time::Timer::after_millis(1).await }} }};
}}
#[avr_device::entry]
fn main() -> ! {{
    board_nano::init(Irqs);
    board_nano::run(&ROLL, |spawner| spawner.spawn(wait().unwrap()))
}}
"
    )
}

/// The compiler that the firmware is built with, as `cargo xtask` finds it.
fn cargo() -> Command {
    let has = |name: &str| {
        let listed = Command::new("rustup").args(["toolchain", "list"]).output();
        listed.is_ok_and(|output| {
            String::from_utf8_lossy(&output.stdout)
                .lines()
                .any(|line| line.starts_with(name))
        })
    };
    let (program, toolchain) = match ["1.96.0", "firmware"].into_iter().find(|name| has(name)) {
        Some(name) => ("cargo", Some(name)),
        None => ("/usr/bin/cargo", None),
    };
    let mut cargo = Command::new(program);
    for name in [
        "CARGO",
        "RUSTC",
        "RUSTFLAGS",
        "CARGO_TARGET_DIR",
        "RUSTUP_TOOLCHAIN",
    ] {
        cargo.env_remove(name);
    }
    cargo.env("RUSTC_BOOTSTRAP", "1");
    if let Some(name) = toolchain {
        cargo.env("RUSTUP_TOOLCHAIN", name);
    }
    cargo
}

#[test]
fn a_setting_that_the_nano_does_not_support_stops_the_build() {
    let root = places::root();
    let board = root.join("board-nano");
    let folder = places::scratch().join("nano_build_errors");
    let _ = fs::remove_dir_all(&folder);
    fs::create_dir_all(folder.join("examples")).unwrap();
    fs::create_dir_all(folder.join(".cargo")).unwrap();
    fs::copy(
        board.join(".cargo/config.toml"),
        folder.join(".cargo/config.toml"),
    )
    .unwrap();
    fs::copy(board.join("Cargo.lock"), folder.join("Cargo.lock")).unwrap();
    fs::write(folder.join("lib.rs"), "#![no_std]\n").unwrap();
    // The same profile, so that what the images are made of is not built once more.
    let manifest = fs::read_to_string(board.join("Cargo.toml")).unwrap();
    let profile = &manifest[manifest.find("[profile.release]").unwrap()..];
    let path = |folder: &Path| folder.display().to_string();
    let mut package = format!(
        "cargo-features = [\"panic-immediate-abort\"]\n\n[package]\nname = \"cases\"\nversion = \"0.0.0\"\nedition = \"2024\"\n\n\
         [workspace]\n\n[lib]\npath = \"lib.rs\"\n\n[dependencies]\nboard-nano = {{ path = {:?} }}\n\
         embassy-avr-hal = {{ path = {:?}, features = [\"modbus\"] }}\nmultidrop = {{ path = {:?} }}\n\
         avr-device = {{ version = \"0.8\", features = [\"atmega328p\", \"rt\"] }}\nembassy-executor = \"0.10\"\nembassy-time = \"0.5\"\n\n",
        path(&board),
        path(&board.join("embassy-avr-hal")),
        path(&root.join("firmware")),
    );
    let cases = cases();
    for (name, source, _) in &cases {
        let file = folder.join(format!("examples/{name}.rs"));
        fs::write(file, format!("{IMPORTS}{source}\n")).unwrap();
        package += &format!("[[example]]\nname = {name:?}\ncrate-type = [\"lib\"]\n\n");
    }
    let programs = [
        ("time_not_bound", waits("")),
        ("time_bound", waits("TIME => board_nano::CLOCK_HZ;")),
    ];
    for (name, source) in &programs {
        fs::write(folder.join(format!("examples/{name}.rs")), source).unwrap();
    }
    fs::write(folder.join("Cargo.toml"), package + profile).unwrap();

    let output = cargo()
        .current_dir(&folder)
        .args([
            "check",
            "--release",
            "--keep-going",
            "--examples",
            "--message-format",
            "json",
        ])
        .arg("--target-dir")
        .arg(root.join("target/avr"))
        .output()
        .expect("cargo runs");
    let text = String::from_utf8_lossy(&output.stdout);
    for (name, source, message) in &cases {
        let errors: Vec<&str> = text
            .lines()
            .filter(|line| {
                line.contains(&format!("\"name\":{name:?}")) && line.contains("\"level\":\"error\"")
            })
            .collect();
        if message.is_empty() {
            assert!(
                errors.is_empty() && text.contains(&format!("\"name\":{name:?}")),
                "{name}: {source}\n{errors:#?}\n{}",
                String::from_utf8_lossy(&output.stderr)
            );
            continue;
        }
        let whole = [
            format!("\"message\":\"evaluation panicked: {message}\""),
            format!("\"message\":\"{message}\""),
        ];
        assert!(
            errors
                .iter()
                .any(|line| whole.iter().any(|whole| line.contains(whole))),
            "{name}: {source}\n{errors:#?}\n{}",
            String::from_utf8_lossy(&output.stderr)
        );
    }

    // Who uses `embassy-time` finds out when the program is linked.
    for (name, _) in &programs {
        let output = cargo()
            .current_dir(&folder)
            .args(["build", "--release", "--example", name, "--target-dir"])
            .arg(root.join("target/avr"))
            .output()
            .expect("cargo runs");
        let text = String::from_utf8_lossy(&output.stderr);
        let is_bound = *name == "time_bound";
        assert_eq!(output.status.success(), is_bound, "{name}: {text}");
        assert!(is_bound || text.contains("_embassy_time_now"), "{text}");
    }
}
