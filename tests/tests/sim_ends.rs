//! The end of `sim` by any signal: no link, no process and no file is left.

use multidrop_testkit::places;
mod sims;

use std::path::PathBuf;
use std::process::Command;

use multidrop_testkit::conforms::Board;
use multidrop_testkit::plain::wire::Way;
use multidrop_testkit::{LINE, Runner, conformance, image, ports};
use nix::sys::signal::Signal;
use nix::unistd::Pid;
use sims::{Sim, await_true, runs};

/// The scenarios that run QEMU, and one that does not.
fn scenarios() -> [(&'static str, Vec<PathBuf>); 3] {
    let units = ["1", "2", "3"].map(|unit| image("demo-unit", &["--unit", unit]));
    [
        ("demo-unit", units.to_vec()),
        (
            "mixed",
            [units.to_vec(), vec![ports(Runner::Qemu)]].concat(),
        ),
        (
            "stm32-conformance",
            vec![conformance(Board::Stm32(Runner::Qemu), Way::Rtu, LINE)],
        ),
    ]
}

fn assert_none_runs(processes: &[Pid]) {
    let gone = || !processes.iter().any(|&process| runs(process));
    assert!(await_true(gone), "a process was left behind");
}

#[test]
fn ctrl_c_in_a_terminal_ends_it_well() {
    for (name, images) in scenarios() {
        let mut sim = Sim::ready(name, &images);
        let children = sim.children();
        assert_eq!(children.len(), usize::from(name != "demo-unit"));
        sim.send_to_group(Signal::SIGINT);
        let status = sim.ended();
        assert_eq!(status.code(), Some(0), "{name}: {}", sim.complaint());
        assert_eq!(sim.left_behind(), [""; 0], "{name}");
        assert_none_runs(&children);
    }
}

#[test]
fn sigterm_ends_it_well() {
    for (name, images) in scenarios() {
        let mut sim = Sim::ready(name, &images);
        let children = sim.children();
        sim.send(Signal::SIGTERM);
        assert_eq!(sim.ended().code(), Some(0), "{name}: {}", sim.complaint());
        assert_eq!(sim.left_behind(), [""; 0], "{name}");
        assert_none_runs(&children);
    }
}

#[test]
fn kill_leaves_the_link_and_its_record_and_nothing_else() {
    for (name, images) in scenarios() {
        let mut sim = Sim::ready(name, &images);
        let children = sim.children();
        sim.send(Signal::SIGKILL);
        sim.ended();
        assert_none_runs(&children);
        let mut left = sim.left_behind();
        left.retain(|name| !name.starts_with("multidrop-sim-"));
        assert_eq!(left, ["bus"], "{name}");
    }
}

#[test]
fn kill_while_qemu_starts_leaves_no_process() {
    let (name, images) = &scenarios()[2];
    let folder = Sim::folder();
    // One that never comes so far as to notice that nobody is there.
    sims::stand_in(&folder, "qemu-system-arm", "exec sleep 1000");
    let mut sim = Sim::start(Sim::command(&folder, name, images), folder);
    assert!(await_true(|| !sim.children().is_empty()));
    let children = sim.children();
    sim.send(Signal::SIGKILL);
    sim.ended();
    assert_none_runs(&children);
}

#[test]
fn a_signal_before_it_is_ready_ends_it_well() {
    for (name, images) in scenarios() {
        let folder = Sim::folder();
        let mut sim = Sim::start(Sim::command(&folder, name, &images), folder);
        sim.await_handler(Signal::SIGINT);
        // QEMU is a part of the job that the terminal knows, unless it is kept out.
        assert!(name == "demo-unit" || await_true(|| !sim.children().is_empty()));
        sim.send_to_group(Signal::SIGINT);
        assert_eq!(sim.ended().code(), Some(0), "{name}: {}", sim.complaint());
        assert_eq!(sim.left_behind(), [""; 0], "{name}");
        assert_eq!(sim.children(), []);
    }
}

#[test]
fn qemu_that_dies_or_hangs_ends_it_with_a_message() {
    let (name, images) = &scenarios()[2];
    for (signal, said) in [
        (Signal::SIGKILL, "signal: 9 (SIGKILL)"),
        (Signal::SIGSTOP, "does not answer"),
    ] {
        let mut sim = Sim::ready(name, images);
        let children = sim.children();
        for &child in &children {
            nix::sys::signal::kill(child, signal).expect("it runs");
        }
        let status = sim.ended();
        let complaint = sim.complaint();
        assert_eq!(status.code(), Some(1), "{complaint}");
        assert!(complaint.starts_with("error: "), "{complaint}");
        assert!(complaint.contains(said), "{complaint}");
        assert_eq!(sim.left_behind(), [""; 0]);
        assert_none_runs(&children);
    }
}

/// The command `sim registers`, with a stand-in for cargo that never comes to an end; and the processes that have begun then.
fn while_cargo_builds() -> (Sim, Vec<Pid>) {
    // What needs the real one.
    image("registers", &[]);
    let folder = Sim::folder();
    sims::stand_in(&folder, "cargo", "sleep 1000 & echo > $TMPDIR/begun; wait");
    let mut command = Command::new(places::xtask());
    command.args(["sim", "registers", "--link"]);
    command.arg(folder.path().join("bus"));
    sims::settle(&mut command, &folder);
    command.env("CARGO", folder.path().join("bin/cargo"));
    command.env("CARGO_MANIFEST_DIR", places::root());
    let sim = Sim::start(command, folder);
    let begun = sim.folder.path().join("begun");
    assert!(await_true(|| begun.exists()));
    let children = sim.children();
    let grandchildren: Vec<_> = children
        .iter()
        .copied()
        .flat_map(sims::children_of)
        .collect();
    assert!(!grandchildren.is_empty());
    (sim, [children, grandchildren].concat())
}

#[test]
fn a_signal_while_it_is_built_ends_it_well_with_all_that_builds() {
    for signal in [Signal::SIGINT, Signal::SIGTERM, Signal::SIGHUP] {
        let (mut sim, processes) = while_cargo_builds();
        sim.send(signal);
        assert_eq!(sim.ended().code(), Some(0), "{}", sim.complaint());
        assert_none_runs(&processes);
    }
    let (mut sim, processes) = while_cargo_builds();
    sim.send(Signal::SIGKILL);
    sim.ended();
    assert_none_runs(&processes);
}

#[test]
fn a_signal_while_another_command_builds_ends_it_well() {
    image("registers", &[]);
    let lock = std::fs::File::create(places::root().join("target/firmware/lock"));
    let lock = lock.expect("the lock of all builds");
    lock.lock().expect("locked");
    let folder = Sim::folder();
    let mut command = Command::new(places::xtask());
    command.args(["sim", "registers", "--link", "bus"]);
    sims::settle(&mut command, &folder);
    command.env("CARGO_MANIFEST_DIR", places::root());
    let mut sim = Sim::start(command, folder);
    sim.await_handler(Signal::SIGTERM);
    sim.send(Signal::SIGTERM);
    assert_eq!(sim.ended().code(), Some(0), "{}", sim.complaint());
    assert_eq!(sim.left_behind(), [""; 0]);
}
