//! The demonstration: it reaches its end, prints plain text to a pipe, reports a step that fails, and keeps its bus
//! up on request.

use multidrop_testkit::places;

use std::fs;
use std::io::{BufRead, BufReader};
use std::process::{Child, Command, Output, Stdio};

use multidrop_testkit::image;
use tempfile::TempDir;

const ESCAPE: char = '\u{1b}';

/// The program itself, with nodes of these unit ids, in a folder of its own.
fn demo(folder: &TempDir, units: &[u8]) -> Command {
    let mut command = Command::new(places::program("demo"));
    command.current_dir(folder.path());
    plain(&mut command);
    for unit in units {
        let path = image("demo-unit", &["--unit", &unit.to_string()]);
        command.arg("--image").arg(path);
    }
    command
}

/// Without what a user's environment may say about colours.
fn plain(command: &mut Command) {
    for name in ["CLICOLOR_FORCE", "CLICOLOR", "NO_COLOR"] {
        command.env_remove(name);
    }
}

fn folder() -> TempDir {
    TempDir::new_in(places::scratch()).expect("a folder for the test")
}

fn is_empty(folder: &TempDir) -> bool {
    let mut entries = fs::read_dir(folder.path()).expect("the folder of the test");
    entries.next().is_none()
}

fn text(bytes: &[u8]) -> String {
    String::from_utf8_lossy(bytes).into_owned()
}

fn assert_says(output: &Output, parts: &[&str]) {
    let said = text(&output.stdout);
    for part in parts {
        assert!(said.contains(part), "{part:?} is not in:\n{said}");
    }
}

#[test]
fn the_command_tells_every_step_in_plain_text() {
    let mut command = Command::new(env!("CARGO"));
    command.current_dir(places::root()).args(["xtask", "demo"]);
    plain(&mut command);
    let output = command.output().expect("cargo runs");
    let (said, complained) = (text(&output.stdout), text(&output.stderr));
    assert_eq!(output.status.code(), Some(0), "{said}\n{complained}");
    assert!(!said.contains(ESCAPE), "{said:?}");
    assert_says(
        &output,
        &[
            "-> 02 06 00 00 2D A8 95 17",
            "unit 2: Write Single Register 0 := 0x2DA8, CRC ok",
            "node 2  PORTB ..101101  PORTD 10101...",
            "broadcast: Write Multiple Registers from 0 := 0x1550, CRC ok",
            "node 3  PORTB ..010101  PORTD 01010...",
            "unit 1: exception 01 illegal function (Report Server ID), CRC ok",
            "unit 2: exception 02 illegal data address (Read Holding Registers), CRC ok",
            "unit 3: exception 03 illegal data value (Read Holding Registers), CRC ok",
            "Read output (holding) register failed: Connection timed out",
            "= t3.5 + ",
        ],
    );
    let last = said.lines().last().unwrap_or_default();
    assert!(
        last.starts_with("All right: 21 steps, 38 frames, 0 conflicts, longest turnaround t3.5 + "),
        "{last}"
    );
}

#[test]
fn a_step_that_fails_is_named_and_ends_it() {
    let folder = folder();
    let output = demo(&folder, &[1, 3, 2]).output().expect("it runs");
    let complained = text(&output.stderr);
    assert_eq!(output.status.code(), Some(1), "{complained}");
    assert!(
        complained.starts_with("error: step 4 failed (mbpoll writes 0x2DA8"),
        "{complained}"
    );
    assert!(!text(&output.stdout).contains("All right"));
    assert!(is_empty(&folder), "left behind");
}

#[test]
fn two_nodes_with_one_unit_id_are_a_conflict() {
    let folder = folder();
    let output = demo(&folder, &[1, 1, 3]).output().expect("it runs");
    let complained = text(&output.stderr);
    assert_eq!(output.status.code(), Some(1), "{complained}");
    assert!(
        complained.starts_with("error: step 2 failed"),
        "{complained}"
    );
}

#[test]
fn a_terminal_gets_colours() {
    let folder = folder();
    let output = demo(&folder, &[1, 2, 3])
        .env("CLICOLOR_FORCE", "1")
        .output()
        .expect("it runs");
    assert_eq!(output.status.code(), Some(0), "{}", text(&output.stderr));
    assert!(text(&output.stdout).contains(ESCAPE));
}

#[test]
fn wrong_use_is_refused() {
    let output = demo(&folder(), &[1, 2]).output().expect("it runs");
    assert_eq!(output.status.code(), Some(2));
    assert!(text(&output.stderr).contains("--image has to be given 3 times, not 2 times"));

    let folder = folder();
    fs::write(folder.path().join("bus"), "mine").expect("a file in the way");
    let output = demo(&folder, &[1, 2, 3])
        .arg("--hold")
        .output()
        .expect("it runs");
    assert_eq!(output.status.code(), Some(2));
    assert!(text(&output.stderr).contains("./bus exists and is not a link"));
    let kept = fs::read_to_string(folder.path().join("bus")).expect("still there");
    assert_eq!(kept, "mine");

    let output = demo(&folder, &[1, 2, 3])
        .args(["--mbpoll", "./no-such-program"])
        .output()
        .expect("it runs");
    assert_eq!(output.status.code(), Some(2));
    assert!(text(&output.stderr).contains("cannot run"));
}

/// A demonstration that does not outlive its test.
struct Running(Child);

impl Running {
    fn interrupt(&self) {
        // The shell's own, since not every machine has the program.
        let sent = Command::new("sh")
            .args(["-c", &format!("kill -INT {}", self.0.id())])
            .status()
            .expect("a shell runs");
        assert!(sent.success());
    }
}

impl Drop for Running {
    fn drop(&mut self) {
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

#[test]
fn the_bus_stays_up_until_it_is_interrupted() {
    let folder = folder();
    let mut command = demo(&folder, &[1, 2, 3]);
    command.arg("--hold").stdout(Stdio::piped());
    let mut running = Running(command.spawn().expect("it runs"));
    let mut lines = BufReader::new(running.0.stdout.take().expect("its output"))
        .lines()
        .map(|line| line.expect("text"));
    assert!(lines.any(|line| line.contains("The bus stays up: ./bus")));

    let client = Command::new("mbpoll")
        .current_dir(folder.path())
        .args("-m rtu -b 38400 -P none -0 -1 -a 2 -t 4 -r 0 ./bus 0x2DA8".split(' '))
        .output()
        .expect("mbpoll runs");
    assert!(client.status.success(), "{}", text(&client.stderr));

    running.interrupt();
    let shown: Vec<_> = lines.collect();
    assert_eq!(running.0.wait().expect("it ends").code(), Some(0));
    let leds = "    node 2  PORTB ..101101  PORTD 10101...";
    assert!(shown.iter().any(|line| line == leds), "{shown:#?}");
    assert!(is_empty(&folder), "left behind");
}
