//! The answer to a wrong word or value: a message that names it and the accepted ones, exit code 2, and nothing
//! built, written or left behind.

use multidrop_testkit::places;

use std::fs;
use std::path::PathBuf;
use std::process::{Command, Output};

/// A folder of its own for one test, in which the command is run and in which it must leave nothing.
struct Folder(PathBuf);

impl Folder {
    fn new(name: &str) -> Self {
        let path = places::scratch().join(format!("cli-{name}"));
        let _ = fs::remove_dir_all(&path);
        fs::create_dir_all(&path).expect("a folder for the test");
        Self(path)
    }

    fn entries(&self) -> Vec<String> {
        let entries = fs::read_dir(&self.0).expect("the folder of the test");
        entries
            .map(|entry| entry.expect("an entry").file_name())
            .map(|name| name.to_string_lossy().into_owned())
            .collect()
    }
}

impl Drop for Folder {
    fn drop(&mut self) {
        let _ = fs::remove_dir_all(&self.0);
    }
}

fn xtask(folder: &Folder, words: &[&str]) -> Output {
    Command::new(env!("CARGO"))
        .current_dir(&folder.0)
        .args(["run", "--quiet", "--package", "xtask", "--manifest-path"])
        .arg(places::root().join("Cargo.toml"))
        .arg("--")
        .args(words)
        .output()
        .expect("cargo runs")
}

/// Runs a command that has to be refused, and checks that it names every one of `said`.
fn refused(name: &str, words: &[&str], said: &[&str]) {
    let folder = Folder::new(name);
    let output = xtask(&folder, words);
    assert_refusal(&output, said);
    assert_eq!(folder.entries(), [""; 0], "left behind");
}

fn assert_refusal(output: &Output, said: &[&str]) {
    let message = String::from_utf8_lossy(&output.stderr);
    assert_eq!(output.status.code(), Some(2), "{message}");
    for part in said {
        assert!(message.contains(part), "{part:?} is not in: {message}");
    }
    assert!(output.stdout.is_empty(), "something was done: {output:?}");
}

fn assert_no_image(stem: &str) {
    for extension in ["elf", "hex"] {
        let path = places::root().join(format!("target/firmware/{stem}.{extension}"));
        assert!(!path.exists(), "{} was left behind", path.display());
    }
}

#[test]
fn a_wrong_command_word() {
    let commands = ["biuld", "setup", "build", "sim", "demo", "test", "flash"];
    refused("command", &["biuld"], &commands);
}

#[test]
fn a_wrong_board() {
    let boards = ["uno", "nano", "stm32"];
    refused("board", &["build", "uno", "registers"], &boards);
}

#[test]
fn a_wrong_application() {
    let applications = ["blink", "demo-unit", "registers"];
    refused("app", &["build", "nano", "blink"], &applications);
    let later = ["nano has no application ports", "demo-unit"];
    refused("app", &["build", "nano", "ports"], &later);
    assert_no_image("nano-ports");
    let other = ["stm32 has no application relay-panel", "demo-unit"];
    refused("app", &["build", "stm32", "relay-panel"], &other);
    assert_no_image("stm32-relay-panel");
}

#[test]
fn a_wrong_scenario() {
    refused(
        "scenario",
        &["sim", "bus"],
        &["bus", "demo-unit", "registers"],
    );
    let later = ["sensor-nodes is not in this version", "demo-unit"];
    refused("scenario", &["sim", "sensor-nodes"], &later);
}

#[test]
fn a_unit_id_outside_1_to_247() {
    for unit in ["0", "248", "256", "two"] {
        let words = ["build", "nano", "demo-unit", "--unit", unit];
        refused("unit", &words, &["--unit", unit]);
        assert_no_image(&format!("nano-demo-unit-unit{unit}"));
    }
}

#[test]
fn a_count_outside_1_to_128() {
    for count in ["0", "129"] {
        let words = ["build", "nano", "registers", "--count", count];
        refused("count", &words, &["--count", count, "1..=128"]);
        assert_no_image(&format!("nano-registers-count{count}"));
    }
}

#[test]
fn a_baud_that_the_clock_cannot_make() {
    // 16 MHz / 16 is 8.5 % off 921600, and no divider comes nearer.
    let words = ["build", "nano", "registers", "--baud", "921600"];
    refused("baud", &words, &["--baud 921600", "2.5 %", "1000000"]);
    assert_no_image("nano-registers-baud921600");
    let words = ["build", "nano", "registers", "--baud", "300"];
    refused("baud", &words, &["--baud 300", "Timer1", "307"]);
    assert_no_image("nano-registers-baud300");
    for baud in ["0", "299", "1000001"] {
        let words = ["build", "nano", "registers", "--baud", baud];
        refused("baud", &words, &["--baud", baud, "300..=1000000"]);
        assert_no_image(&format!("nano-registers-baud{baud}"));
    }
}

#[test]
fn a_format_that_rtu_cannot_use() {
    let words = ["build", "nano", "registers", "--format", "7E1"];
    refused("format", &words, &["--format 7E1", "8 data bits", "8N1"]);
    assert_no_image("nano-registers-format7E1");
}

#[test]
fn ascii_and_line_options_of_other_images_are_refused() {
    let words = ["build", "nano", "registers", "--ascii"];
    refused("ascii", &words, &["--ascii", "registers", "conformance"]);
    assert_no_image("nano-registers-ascii");
    let words = ["sim", "registers", "--format", "8E1"];
    refused(
        "line",
        &words,
        &["--format", "registers", "nano-conformance"],
    );
}

#[test]
fn a_link_that_exists_and_is_not_a_link() {
    let folder = Folder::new("link");
    fs::write(folder.0.join("bus"), "mine").expect("a file in the way");
    fs::create_dir(folder.0.join("folder")).expect("a folder in the way");
    for link in ["bus", "folder"] {
        let output = xtask(&folder, &["sim", "demo-unit", "--link", link]);
        assert_refusal(&output, &["--link", link, "is not a link"]);
    }
    // The default path is checked as well.
    assert_refusal(&xtask(&folder, &["sim", "registers"]), &["--link ./bus"]);
    let kept = fs::read_to_string(folder.0.join("bus")).expect("still there");
    assert_eq!(kept, "mine");
    assert_eq!(folder.entries().len(), 2, "left behind");
}

#[test]
fn every_command_has_help() {
    let folder = Folder::new("help");
    let commands = ["setup", "build", "sim", "demo", "test", "flash"];
    for command in commands {
        let output = xtask(&folder, &[command, "--help"]);
        let text = String::from_utf8_lossy(&output.stdout);
        assert_eq!(output.status.code(), Some(0), "{command}");
        assert!(
            text.contains(&format!("Usage: cargo xtask {command}")),
            "{text}"
        );
    }
    let output = xtask(&folder, &["--help"]);
    let text = String::from_utf8_lossy(&output.stdout);
    for command in commands {
        assert!(text.contains(command), "{command} is not in {text}");
    }
}
