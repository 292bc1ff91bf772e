//! A bus in real time, with a host of it as a serial port for other programs: a pseudo terminal.
//!
//! # What a client hears, and when
//! As a USB adapter does, this one passes on what it heard when the line has fallen silent (after
//! 3.5 characters and one). Common clients send the next request at once and rely on that: a
//! request within t3.5 of another server's answer would be part of that answer's frame.
//!
//! # Clients
//! When the last client has gone, what the bus says is discarded, what the client left unread is flushed, and the terminal is
//! made raw again for the next one; see `terminal.rs`.

mod link;
mod pace;
mod terminal;

use std::io;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use crate::bus::Bus;
use crate::error::BusError;
use crate::record::HostId;
use crate::time::Time;
use link::Link;
use pace::Pace;
use terminal::Terminal;

pub use pace::Behind;

/// How long the bus is left alone at most; half of what bytes may take from the client to the line.
const TICK: Duration = Duration::from_millis(1);
/// The tick in place of [`TICK`] while a client may wait for an answer: for [`QUICK`] after its last byte.
const QUICK_TICK: Duration = Duration::from_micros(200);
const QUICK: Duration = Duration::from_millis(500);

/// Why a bus could not be put on a pseudo terminal.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum LiveError {
    /// The link's path is taken by something that is not a link.
    #[error("{} exists and is not a link; choose another path", .0.display())]
    NotALink(PathBuf),
    /// The link's path is taken by a link that was not made here.
    #[error("{} is a link to {}, which no sim has made; choose another path, or remove it", path.display(), target.display())]
    ForeignLink {
        /// The link asked for.
        path: PathBuf,
        /// Where the one that is there leads.
        target: PathBuf,
    },
    /// The link's path is that of another bus.
    #[error("{}: another sim is running on it; choose another path", .0.display())]
    Taken(PathBuf),
    /// The link cannot be made.
    #[error("cannot make the link {}: {source}", path.display())]
    Link {
        /// The link asked for.
        path: PathBuf,
        /// What the system said.
        source: io::Error,
    },
    /// The system has no pseudo terminal for us.
    #[error("no pseudo terminal: {0}")]
    Terminal(#[from] io::Error),
    /// The bus itself cannot go on.
    #[error(transparent)]
    Bus(#[from] BusError),
}

impl From<nix::Error> for LiveError {
    fn from(error: nix::Error) -> Self {
        LiveError::Terminal(error.into())
    }
}

/// A bus that runs as fast as the clock on the wall.
pub struct Live {
    bus: Bus,
    host: HostId,
    terminal: Terminal,
    link: Link,
    tell: Box<dyn FnMut(Behind)>,
}

impl Live {
    /// Makes `link` a link to a pseudo terminal on which `host` of `bus` is a serial port.
    ///
    /// # Errors
    /// [`LiveError`]; nothing is left behind.
    pub fn new(bus: Bus, host: HostId, link: &Path) -> Result<Self, LiveError> {
        let terminal = Terminal::open()?;
        let link = Link::make(link, terminal.name())?;
        Ok(Live {
            bus,
            host,
            terminal,
            link,
            tell: Box::new(|_| {}),
        })
    }

    /// Has `tell` called when the bus falls behind real time, at most once in ten seconds unless it gets twice as bad.
    pub fn on_behind(&mut self, tell: impl FnMut(Behind) + 'static) {
        self.tell = Box::new(tell);
    }

    /// The bus that is run.
    pub fn bus(&mut self) -> &mut Bus {
        &mut self.bus
    }

    /// The link that clients open.
    pub fn link(&self) -> &Path {
        self.link.path()
    }

    /// Whether a client has the terminal open.
    pub fn has_client(&self) -> bool {
        self.terminal.has_client()
    }

    /// Runs in real time until `done` says so, asked about once a millisecond at least.
    ///
    /// # Errors
    /// [`LiveError::Terminal`], and [`LiveError::Bus`] when a machine has stopped.
    pub fn run(&mut self, mut done: impl FnMut(&mut Bus) -> bool) -> Result<(), LiveError> {
        let start = Instant::now();
        let mut pace = Pace::default();
        let mut asked: Option<Instant> = None;
        while !done(&mut self.bus) {
            let waits = asked.is_some_and(|asked| asked.elapsed() < QUICK);
            let input = self.terminal.wait(if waits { QUICK_TICK } else { TICK })?;
            if self.terminal.is_new() {
                self.link.lead_to(self.terminal.name())?;
            }
            let (span, behind) = pace.step(start.elapsed());
            if let Some(behind) = behind {
                (self.tell)(behind);
            }
            self.bus.try_run_for(Time::from(span))?;
            if !input.is_empty() {
                asked = Some(Instant::now());
                self.bus.host(self.host).send(&input);
            }
            let heard = self.heard();
            self.terminal.write(&heard)?;
        }
        Ok(())
    }

    /// What was heard, once the line has been silent.
    fn heard(&mut self) -> Vec<u8> {
        let now = self.bus.now();
        let host = self.bus.host(self.host);
        let silence = host.line().t35() + host.line().character();
        let silent = host
            .heard()
            .last()
            .is_some_and(|last| now >= last.end + silence);
        if !silent || host.is_receiving() {
            return Vec::new();
        }
        host.take().iter().map(|byte| byte.value).collect()
    }
}
