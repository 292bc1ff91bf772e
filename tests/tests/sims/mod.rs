//! The program `sim` in a test: in a folder of its own, with given images, and with a check of the files that it
//! leaves.
#![allow(dead_code, reason = "each test binary uses a part")]

use std::fs;
use std::io::{BufRead, BufReader, Read};
use std::os::unix::fs::PermissionsExt;
use std::os::unix::process::CommandExt;
use std::path::PathBuf;
use std::process::{Child, ChildStderr, Command, ExitStatus, Stdio};
use std::thread;
use std::time::{Duration, Instant};

use nix::sys::signal::{self, Signal};
use nix::unistd::Pid;
use tempfile::TempDir;

use multidrop_testkit::places;

/// Far longer than anything takes that is waited for here, on a busy machine.
pub const PATIENCE: Duration = Duration::from_secs(60);

/// A running `sim`, or a program that becomes one.
pub struct Sim {
    child: Child,
    /// Where its link is, and what it writes elsewhere.
    pub folder: TempDir,
}

impl Sim {
    /// The command for a scenario with its images; its link and its temporary files are in `folder`.
    pub fn command(folder: &TempDir, scenario: &str, images: &[PathBuf]) -> Command {
        let mut command = Command::new(places::program("sim"));
        command.arg(scenario).args(["--link", "bus"]);
        for image in images {
            command.arg("--image").arg(image);
        }
        if images
            .iter()
            .any(|image| image.to_string_lossy().contains("-qemu"))
        {
            command.arg("--qemu");
        }
        settle(&mut command, folder);
        command
    }

    /// A folder for one.
    pub fn folder() -> TempDir {
        TempDir::new_in(places::scratch()).expect("a folder for the test")
    }

    /// Starts it, as the leader of a process group: what a shell does with a job.
    pub fn start(mut command: Command, folder: TempDir) -> Self {
        let child = command
            .process_group(0)
            .stdin(Stdio::null())
            .stdout(Stdio::piped())
            .stderr(Stdio::piped())
            .spawn()
            .expect("it starts");
        Sim { child, folder }
    }

    /// Starts it, and waits until its nodes listen.
    pub fn ready(scenario: &str, images: &[PathBuf]) -> Self {
        let folder = Self::folder();
        let mut sim = Self::start(Self::command(&folder, scenario, images), folder);
        sim.await_ready();
        sim
    }

    /// Waits for its nodes to listen.
    pub fn await_ready(&mut self) {
        let stdout = self.child.stdout.as_mut().expect("piped");
        let mut said = String::new();
        BufReader::new(stdout).read_line(&mut said).expect("text");
        if said != "ready: bus\n" {
            let status = self.child.wait();
            panic!("{said:?}, {status:?}: {}", self.complaint());
        }
    }

    /// The path of the link.
    pub fn link(&self) -> PathBuf {
        self.folder.path().join("bus")
    }

    /// The id of its process.
    pub fn id(&self) -> Pid {
        Pid::from_raw(self.child.id().cast_signed())
    }

    /// Sends it a signal.
    pub fn send(&self, signal: Signal) {
        signal::kill(self.id(), signal).expect("it runs");
    }

    /// Sends a signal to its whole process group, as a terminal does for Ctrl-C.
    pub fn send_to_group(&self, signal: Signal) {
        signal::killpg(self.id(), signal).expect("it runs");
    }

    /// Waits until it has a handler of its own for `signal`.
    pub fn await_handler(&self, signal: Signal) {
        let bit = 1_u64 << (signal as u32 - 1);
        let caught = || {
            let status = fs::read_to_string(format!("/proc/{}/status", self.child.id()));
            let status = status.expect("it runs");
            let line = status.lines().find_map(|line| line.strip_prefix("SigCgt:"));
            let mask = u64::from_str_radix(line.expect("Linux tells").trim(), 16);
            mask.expect("hexadecimal") & bit != 0
        };
        assert!(await_true(caught), "it does not handle {signal}");
    }

    /// The processes that it has started and that run.
    pub fn children(&self) -> Vec<Pid> {
        children_of(self.id())
    }

    /// Waits for its end.
    pub fn ended(&mut self) -> ExitStatus {
        let mut status = None;
        let ended = await_true(|| {
            status = self.child.try_wait().expect("it is a child of ours");
            status.is_some()
        });
        assert!(ended, "it does not end");
        status.expect("it has ended")
    }

    /// What it says on standard error.
    pub fn stderr(&mut self) -> ChildStderr {
        self.child.stderr.take().expect("piped")
    }

    /// What it has said on standard error until its end.
    pub fn complaint(&mut self) -> String {
        let mut said = String::new();
        let stderr = self.child.stderr.as_mut().expect("piped");
        stderr.read_to_string(&mut said).expect("text");
        said
    }

    /// What is in its folder.
    pub fn left_behind(&self) -> Vec<String> {
        let entries = fs::read_dir(self.folder.path()).expect("a folder");
        let names = entries.map(|entry| entry.expect("an entry").file_name());
        names
            .map(|name| name.to_string_lossy().into_owned())
            .collect()
    }
}

impl Drop for Sim {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

/// Puts what a program writes into `folder`, and takes the programs in its `bin` for those of the system.
pub fn settle(command: &mut Command, folder: &TempDir) {
    let system = std::env::var_os("PATH").unwrap_or_default();
    let bins = [folder.path().join("bin")].into_iter();
    let path = std::env::join_paths(bins.chain(std::env::split_paths(&system)));
    command
        .current_dir(folder.path())
        .env("TMPDIR", folder.path())
        .env("PATH", path.expect("a path"));
}

/// Puts a shell script into the `bin` of `folder`.
pub fn stand_in(folder: &TempDir, name: &str, script: &str) {
    let bin = folder.path().join("bin");
    fs::create_dir_all(&bin).expect("a folder");
    let path = bin.join(name);
    fs::write(&path, format!("#!/bin/sh\n{script}\n")).expect("a script");
    fs::set_permissions(&path, fs::Permissions::from_mode(0o755)).expect("a program");
}

/// The running children of a process.
pub fn children_of(parent: Pid) -> Vec<Pid> {
    let processes = fs::read_dir("/proc").expect("Linux").flatten();
    let ids = processes.filter_map(|entry| entry.file_name().to_str()?.parse::<i32>().ok());
    ids.filter(|&id| parent_of(id) == Some(parent.as_raw()))
        .map(Pid::from_raw)
        .collect()
}

/// Whether a process runs.
pub fn runs(process: Pid) -> bool {
    parent_of(process.as_raw()).is_some()
}

/// The parent of a process that runs; zombies do not.
fn parent_of(id: i32) -> Option<i32> {
    let stat = fs::read_to_string(format!("/proc/{id}/stat")).ok()?;
    // Behind the name, which may hold anything: the state, then the parent.
    let mut fields = stat.rsplit_once(')')?.1.split_whitespace();
    (fields.next()? != "Z").then_some(())?;
    fields.next()?.parse().ok()
}

/// Waits until `done`; false if that takes too long.
pub fn await_true(mut done: impl FnMut() -> bool) -> bool {
    let start = Instant::now();
    while !done() {
        if start.elapsed() > PATIENCE {
            return false;
        }
        thread::sleep(Duration::from_millis(2));
    }
    true
}
