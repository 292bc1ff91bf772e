//! Clients of `sim`, and its messages: terminals that are left locked, links of others, and a machine that is too
//! slow.

use multidrop_testkit::places;
mod sims;

use std::fs::{self, OpenOptions};
use std::io::{BufRead, BufReader, Read, Write};
use std::os::unix::fs::{chown, symlink};
use std::os::unix::process::CommandExt;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};
use std::thread;
use std::time::Duration;

use multidrop_testkit::image;
use nix::sys::signal::Signal;
use nix::unistd::geteuid;
use sims::Sim;
use tempfile::TempDir;

/// An ordinary user: what is done to root's terminals does not stop root.
const NOBODY: u32 = 65_534;

/// Reads holding register 0 of unit 1 through a terminal that it locks, and leaves locked (TIOCEXCL).
const CLIENT: &str = r#"
    for (1..1000) { last if open(F, "+<", $ARGV[0]); select(undef, undef, undef, 0.01) }
    ioctl(F, 0x540C, 0) or die "not locked: $!";
    syswrite(F, pack("H*", "010300000001840a"));
    while (length($answer) < 7) { sysread(F, $answer, 7, length($answer)) or die "gone: $!" }
    print unpack("H*", $answer);
"#;

/// Unit 1: read holding register 0.
const READ: [u8; 8] = [0x01, 0x03, 0x00, 0x00, 0x00, 0x01, 0x84, 0x0a];

fn as_nobody(command: &mut Command) -> &mut Command {
    if geteuid().is_root() {
        command.uid(NOBODY).gid(NOBODY);
    }
    command
}

#[test]
fn a_terminal_that_is_left_locked_ends_nothing() {
    // Where any user gets at it.
    let folder = TempDir::new().expect("a folder for the test");
    let copy = |from: &Path, name: &str| {
        let to = folder.path().join(name);
        fs::copy(from, &to).expect("a copy");
        to
    };
    let program = copy(&places::program("sim"), "sim");
    let image = copy(&image("registers", &[]), "registers.elf");
    if geteuid().is_root() {
        chown(folder.path(), Some(NOBODY), Some(NOBODY)).expect("root may");
    }
    let mut command = Command::new(program);
    command.args(["registers", "--link", "bus", "--image"]);
    sims::settle(command.arg(image), &folder);
    as_nobody(&mut command);
    let mut sim = Sim::start(command, folder);
    sim.await_ready();
    for _ in 0..3 {
        let mut client = Command::new("perl");
        client.args(["-e", CLIENT]).arg(sim.link());
        let output = as_nobody(&mut client).output().expect("perl runs");
        let answer = String::from_utf8_lossy(&output.stdout);
        assert_eq!(answer, "0103020000b844", "{output:?}");
    }
    sim.send(Signal::SIGTERM);
    assert_eq!(sim.ended().code(), Some(0), "{}", sim.complaint());
    assert!(
        fs::symlink_metadata(sim.link()).is_err(),
        "the link is left"
    );
}

/// Runs `sim registers` on a link at `bus` of `folder`, to its end.
fn registers(folder: &TempDir) -> Output {
    let images = [image("registers", &[])];
    let mut command = Sim::command(folder, "registers", &images);
    command.args(["--seconds", "0"]).output().expect("it runs")
}

fn assert_refused(output: &Output, said: &str) {
    let complaint = String::from_utf8_lossy(&output.stderr);
    assert_eq!(output.status.code(), Some(2), "{output:?}");
    assert!(complaint.contains(said), "{complaint}");
    assert!(output.stdout.is_empty(), "{output:?}");
}

#[test]
fn the_link_of_a_running_sim_is_refused() {
    let sim = Sim::ready("registers", &[image("registers", &[])]);
    let target = fs::read_link(sim.link()).expect("a link");
    assert_refused(&registers(&sim.folder), "another sim is running on it");
    // Under another name of its folder, too.
    let mut other = Command::new(places::program("sim"));
    sims::settle(&mut other, &sim.folder);
    let link = sim.folder.path().join("bin/../bus");
    fs::create_dir(sim.folder.path().join("bin")).expect("a folder");
    other
        .args(["registers", "--seconds", "0", "--link"])
        .arg(link);
    other.arg("--image").arg(image("registers", &[]));
    let output = other.output().expect("it runs");
    assert_refused(&output, "another sim is running on it");
    assert_eq!(fs::read_link(sim.link()).expect("a link"), target);
}

#[test]
fn the_link_of_a_sim_that_was_killed_is_replaced() {
    let mut sim = Sim::ready("registers", &[image("registers", &[])]);
    sim.send(Signal::SIGKILL);
    sim.ended();
    assert!(fs::symlink_metadata(sim.link()).is_ok());
    let output = registers(&sim.folder);
    assert_eq!(output.status.code(), Some(0), "{output:?}");
    assert_eq!(sim.left_behind(), [""; 0]);
}

#[test]
fn a_link_that_no_sim_made_is_refused_and_kept() {
    // A terminal that is there, one that is not, a file, a folder, nothing.
    let other = Sim::ready("registers", &[image("registers", &[])]);
    let terminal = fs::read_link(other.link()).expect("a link");
    let targets = ["/dev/pts/4000", "/dev/null", "/", "nowhere"].map(PathBuf::from);
    for target in targets.into_iter().chain([terminal]) {
        let folder = Sim::folder();
        let link = folder.path().join("bus");
        symlink(&target, &link).expect("a link");
        assert_refused(&registers(&folder), "which no sim has made");
        assert_eq!(fs::read_link(&link).expect("kept"), target);
        // The command says so too, before anything is built.
        let mut xtask = Command::new(places::xtask());
        sims::settle(&mut xtask, &folder);
        xtask.env("CARGO_MANIFEST_DIR", places::root());
        let words = ["sim", "registers", "--link", "bus", "--seconds", "0"];
        let output = xtask.args(words).output().expect("it runs");
        assert_refused(&output, "which no sim has made");
        assert_eq!(fs::read_link(&link).expect("kept"), target);
    }
}

#[test]
fn a_link_that_cannot_be_recorded_is_named() {
    let folder = Sim::folder();
    let mut command = Sim::command(&folder, "registers", &[image("registers", &[])]);
    let output = command.env("TMPDIR", "/no/such/folder").output();
    assert_refused(&output.expect("it runs"), "/no/such/folder/multidrop-sim-");
    assert!(fs::symlink_metadata(folder.path().join("bus")).is_err());
}

#[test]
fn a_link_that_was_changed_meanwhile_is_kept() {
    let mut sim = Sim::ready("registers", &[image("registers", &[])]);
    fs::remove_file(sim.link()).expect("a link");
    symlink("mine", sim.link()).expect("a link");
    sim.send(Signal::SIGTERM);
    assert_eq!(sim.ended().code(), Some(0), "{}", sim.complaint());
    let kept = fs::read_link(sim.link()).expect("kept");
    assert_eq!(kept, Path::new("mine"));
}

#[test]
fn the_simulator_reports_how_far_it_is_behind() {
    let folder = Sim::folder();
    let mut command = Sim::command(&folder, "registers", &[image("registers", &[])]);
    command.args(["--seconds", "20"]);
    let mut sim = Sim::start(command, folder);
    sim.await_ready();
    let mut said = BufReader::new(sim.stderr()).lines();
    // It runs once it answers.
    let mut client = OpenOptions::new().read(true).write(true).open(sim.link());
    let client = client.as_mut().expect("the terminal");
    client.write_all(&READ).expect("written");
    client.read_exact(&mut [0; 7]).expect("an answer");
    sim.send(Signal::SIGSTOP);
    thread::sleep(Duration::from_millis(700));
    sim.send(Signal::SIGCONT);
    let behind = |line: &str| -> Option<u64> {
        let (ms, _) = line.split_once(" ms behind real time")?;
        ms.rsplit(' ').next()?.parse().ok()
    };
    let mut lines = Vec::new();
    let found = said.find(|line| {
        let line = line.as_ref().expect("text");
        lines.push(line.clone());
        behind(line).is_some_and(|ms| ms >= 700)
    });
    let line = found.unwrap_or_else(|| panic!("it only says {lines:?}"));
    let line = line.expect("text");
    assert!(line.starts_with("warning: "), "{line}");
    assert!(line.contains("clients may see timeouts"), "{line}");
}
