//! The desk: three nodes on a bus in real time, a client program and a plain serial port to drive
//! them with, and a look at their pins.

use std::fs::OpenOptions;
use std::io::{ErrorKind, Read, Write};
use std::os::unix::fs::OpenOptionsExt;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use multidrop_bus::{
    Bus, BusConfig, Frame, HostPort, Line, Live, LiveError, Nano, NodeId, Time, frames,
};
use nix::fcntl::OFlag;

use crate::{Trouble, show};

/// Nodes on the desk, with the unit ids 1, 2, ...
pub const UNITS: usize = 3;
/// Baud rate and format of all of them.
pub const BAUD: u32 = 38_400;

/// Time given to the nodes to boot: many times what they need.
const BOOT: Time = Time::from_ms(50);
/// Bus time after a client has had its answer, so that the bus is silent and what is on record is
/// whole.
const SETTLE: Time = Time::from_ms(5);
/// Longer than any call of the client takes, its own timeout included, on a busy machine.
const PATIENCE: Duration = Duration::from_secs(20);

/// What the ports do to the LED pins.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Leds {
    pub b: u8,
    pub d: u8,
}

impl Leds {
    /// Pins with an LED: PB6 and PB7 are the crystal's,
    pub const B: u8 = 0b0011_1111;
    /// and PD0 to PD2 are RXD, TXD and DE.
    pub const D: u8 = 0b1111_1000;

    /// What a unit's register has to make of them.
    pub fn of(register: u16) -> Self {
        let [high, low] = register.to_be_bytes();
        Leds {
            b: high & Self::B,
            d: low & Self::D,
        }
    }
}

/// What a client program said.
#[derive(Debug)]
pub struct Said {
    /// Its exit code; `None`: a signal ended it.
    pub code: Option<i32>,
    /// Both of its outputs.
    pub text: String,
}

/// What went over the wire so far.
#[derive(Debug, Default)]
pub struct Tally {
    pub frames: usize,
    pub conflicts: usize,
    /// The longest turnaround beyond t3.5.
    pub slowest: Time,
}

/// Three nodes on a bus, and those who drive them.
pub struct Desk {
    live: Live,
    nodes: [NodeId; UNITS],
    line: Line,
    folder: PathBuf,
    mbpoll: PathBuf,
    stop: Arc<AtomicBool>,
    pub tally: Tally,
}

impl Desk {
    /// Boots the nodes and makes `bus` in `folder` their serial port.
    pub fn new(
        images: &[PathBuf; UNITS],
        folder: &Path,
        mbpoll: &Path,
        stop: Arc<AtomicBool>,
    ) -> Result<Self, Trouble> {
        let line = Line::n81(BAUD);
        let mut bus = Bus::new(BusConfig::default());
        let mut nodes = Vec::new();
        for (index, image) in images.iter().enumerate() {
            let mut nano = Nano::new(format!("unit {}", index + 1), image);
            nano.seed = index as u64 + 1;
            nodes.push(bus.add_nano(nano)?);
        }
        let nodes = <[NodeId; UNITS]>::try_from(nodes).expect("one for each image");
        let client = bus.add_host(HostPort::new(line));
        bus.run_for(BOOT);
        let live = Live::new(bus, client, &folder.join("bus")).map_err(|error| match error {
            LiveError::NotALink(_) => Trouble::BusInTheWay,
            other => other.into(),
        })?;
        Ok(Desk {
            live,
            nodes,
            line,
            folder: folder.to_owned(),
            mbpoll: program(mbpoll)?,
            stop,
            tally: Tally::default(),
        })
    }

    /// Runs the bus until `done`.
    fn run(&mut self, mut done: impl FnMut(&mut Bus) -> bool) -> Result<(), Trouble> {
        let stop = Arc::clone(&self.stop);
        let stopped = || stop.load(Ordering::Relaxed);
        self.live.run(|bus| stopped() || done(bus))?;
        if stopped() {
            return Err(Trouble::Interrupted);
        }
        Ok(())
    }

    fn run_for(&mut self, span: Time) -> Result<(), Trouble> {
        let end = self.live.bus().now() + span;
        self.run(|bus| bus.now() >= end)
    }

    /// Runs mbpoll with `words` while the bus runs.
    ///
    /// It is called in the link's folder, so that what is shown is what is called.
    pub fn mbpoll(&mut self, words: &str) -> Result<Said, Trouble> {
        let words = format!("-m rtu -b {BAUD} -P none -0 -1 {words}");
        show::command(&format!("mbpoll {words}"));
        let mut child = Command::new(&self.mbpoll)
            .current_dir(&self.folder)
            .args(words.split_whitespace())
            .stdin(Stdio::null())
            .stdout(Stdio::piped())
            .stderr(Stdio::piped())
            .spawn()
            .map_err(|source| Trouble::Client {
                program: self.mbpoll.clone(),
                source,
            })?;
        let give_up = Instant::now() + PATIENCE;
        let mut ended = Ok(None);
        let ran = self.run(|_| {
            ended = child.try_wait();
            !matches!(ended, Ok(None)) || Instant::now() >= give_up
        });
        if !matches!(ended, Ok(Some(_))) {
            // It must not outlive the bus it talks to; that it may have ended just now is no matter.
            let _ = child.kill();
        }
        let output = child.wait_with_output()?;
        ran?;
        self.run_for(SETTLE)?;
        let said = [output.stdout, output.stderr].concat();
        Ok(Said {
            code: output.status.code(),
            text: String::from_utf8_lossy(&said).into_owned(),
        })
    }

    /// Writes `bytes` to the serial port as they are, and returns what came within `wait` of bus
    /// time.
    pub fn serial(&mut self, bytes: &[u8], wait: Time) -> Result<Vec<u8>, Trouble> {
        let mut port = OpenOptions::new()
            .read(true)
            .write(true)
            .custom_flags((OFlag::O_NOCTTY | OFlag::O_NONBLOCK).bits())
            .open(self.live.link())?;
        port.write_all(bytes)?;
        self.run_for(wait)?;
        let mut answer = Vec::new();
        match port.read_to_end(&mut answer) {
            Err(error) if error.kind() != ErrorKind::WouldBlock => Err(error.into()),
            _ => Ok(answer),
        }
    }

    /// What went over the wire since the last call.
    pub fn take_frames(&mut self) -> Vec<Frame> {
        let bus = self.live.bus();
        take_frames(bus, self.line, &mut self.tally)
    }

    /// How often a node's driver was switched since the last look at the frames.
    pub fn de_edges(&mut self) -> usize {
        self.live.bus().record().de_edges().len()
    }

    /// The line of the client and of every node.
    pub fn line(&self) -> Line {
        self.line
    }

    /// The node with a unit id, 1..=3.
    pub fn node(&self, unit: usize) -> NodeId {
        self.nodes[unit - 1]
    }

    /// The LED pins of a unit as they are in the simulated ports; an error if one is no output, or
    /// if its driver is on.
    pub fn leds(&mut self, unit: usize) -> Result<Leds, Trouble> {
        let node = self.live.bus().node(self.nodes[unit - 1]);
        let state = |port| node.port_state(port).unwrap_or_default();
        let ((b, b_out), (d, d_out)) = (state('B'), state('D'));
        if b_out & Leds::B != Leds::B || d_out & Leds::D != Leds::D {
            return Err(Trouble::Failed(format!(
                "node {unit} has an LED pin that is no output"
            )));
        }
        if d & 1 << 2 != 0 {
            return Err(Trouble::Failed(format!("node {unit} holds the bus")));
        }
        Ok(Leds {
            b: b & Leds::B,
            d: d & Leds::D,
        })
    }

    /// Pulls a unit's bus connector, or puts it back.
    pub fn plug(&mut self, unit: usize, plugged: bool) -> Result<(), Trouble> {
        let node = self.node(unit);
        if plugged {
            self.live.bus().plug(node);
        } else {
            self.live.bus().unplug(node);
        }
        self.run_for(SETTLE)
    }

    /// Keeps the bus up until a signal, and shows what goes over it.
    pub fn hold(&mut self) -> Result<(), Trouble> {
        let (stop, line, nodes) = (Arc::clone(&self.stop), self.line, self.nodes);
        let tally = &mut self.tally;
        let leds = |bus: &mut Bus| {
            nodes.map(|node| {
                let state = |port| bus.node(node).port_state(port).unwrap_or_default().0;
                Leds {
                    b: state('B') & Leds::B,
                    d: state('D') & Leds::D,
                }
            })
        };
        let mut shown = leds(self.live.bus());
        self.live.run(|bus| {
            let stopped = stop.load(Ordering::Relaxed);
            let last = bus.record().bytes().last().map(|byte| byte.end);
            if last.is_some_and(|end| stopped || bus.now() >= end + SETTLE) {
                for frame in take_frames(bus, line, tally) {
                    show::frame(&frame, line);
                }
                let now = leds(bus);
                for (index, (before, now)) in shown.iter().zip(&now).enumerate() {
                    if before != now {
                        show::leds(index + 1, *now);
                    }
                }
                shown = now;
            }
            stopped
        })?;
        Ok(())
    }
}

/// A path, as seen from any folder; a bare name is looked for in `PATH`.
fn program(path: &Path) -> std::io::Result<PathBuf> {
    match path.components().count() {
        1 => Ok(path.to_owned()),
        _ => std::path::absolute(path),
    }
}

fn take_frames(bus: &mut Bus, line: Line, tally: &mut Tally) -> Vec<Frame> {
    let found = frames(bus.record(), line);
    tally.frames += found.len();
    tally.conflicts += bus.record().conflicts().len();
    let answers = found.iter().filter(|frame| frame.answer);
    for time in answers.filter_map(|frame| frame.turnaround) {
        tally.slowest = tally.slowest.max(time.saturating_sub(line.t35()));
    }
    bus.clear_record();
    found
}
