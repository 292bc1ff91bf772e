//! A bus in real time, with a host of it as a serial port for other programs: a pseudo terminal.
//!
//! # What a client hears, and when
//! As a USB adapter does, this one passes on what it heard when the line has fallen silent (after
//! 3.5 characters and one). Common clients send the next request at once and rely on that: a
//! request within t3.5 of another server's answer would be part of that answer's frame.
//!
//! # Clients
//! No file descriptor of the terminal's client side is kept open here, so that the system tells
//! when the last client has gone (`POLLHUP`). What the bus says then is discarded, what the client
//! left unread is flushed, and the terminal is made raw again for the next one.

use std::fs::{self, File, OpenOptions};
use std::io::{self, ErrorKind, Read, Write};
use std::os::fd::AsFd;
use std::os::unix::fs::{OpenOptionsExt, symlink};
use std::path::{Path, PathBuf};
use std::thread;
use std::time::{Duration, Instant};

use nix::fcntl::{FcntlArg, OFlag, fcntl};
use nix::poll::{PollFd, PollFlags, PollTimeout, poll};
use nix::pty::{PtyMaster, grantpt, posix_openpt, ptsname_r, unlockpt};
use nix::sys::termios::{self, FlushArg, SetArg};

use crate::bus::Bus;
use crate::error::BusError;
use crate::record::HostId;
use crate::time::Time;

/// How long the bus is left alone at most; half of what bytes may take from the client to the line.
const TICK: Duration = Duration::from_millis(1);
/// The most wall time that is caught up with after the machine was busy elsewhere; what is beyond
/// is left out.
const CATCH_UP: Duration = Duration::from_millis(250);

/// Why a bus could not be put on a pseudo terminal.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum LiveError {
    /// The link's path is taken by something that is not a link.
    #[error("{} exists and is not a link; choose another path", .0.display())]
    NotALink(PathBuf),
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
}

impl Live {
    /// Makes `link` a link to a pseudo terminal on which `host` of `bus` is a serial port.
    ///
    /// # Errors
    /// [`LiveError`]; nothing is left behind.
    pub fn new(bus: Bus, host: HostId, link: &Path) -> Result<Self, LiveError> {
        // First the link's path: it is what a user gets wrong.
        Link::check(link)?;
        let terminal = Terminal::open()?;
        let link = Link::make(link, &terminal.name)?;
        Ok(Live {
            bus,
            host,
            terminal,
            link,
        })
    }

    /// The bus.
    pub fn bus(&mut self) -> &mut Bus {
        &mut self.bus
    }

    /// The link that clients open.
    pub fn link(&self) -> &Path {
        &self.link.path
    }

    /// Whether a client has the terminal open.
    pub fn has_client(&self) -> bool {
        self.terminal.client
    }

    /// Runs in real time until `done` says so, asked about once a millisecond.
    ///
    /// # Errors
    /// [`LiveError::Terminal`], and [`LiveError::Bus`] when a machine has stopped.
    pub fn run(&mut self, mut done: impl FnMut(&mut Bus) -> bool) -> Result<(), LiveError> {
        let mut last = Instant::now();
        while !done(&mut self.bus) {
            let input = self.terminal.wait(TICK)?;
            let elapsed = last.elapsed().min(CATCH_UP);
            last = Instant::now();
            self.bus.try_run_for(Time::from(elapsed))?;
            if !input.is_empty() {
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

/// Our end of a pseudo terminal.
struct Terminal {
    master: PtyMaster,
    name: String,
    client: bool,
}

impl Terminal {
    fn open() -> Result<Self, LiveError> {
        let master = posix_openpt(OFlag::O_RDWR | OFlag::O_NOCTTY | OFlag::O_CLOEXEC)?;
        grantpt(&master)?;
        unlockpt(&master)?;
        fcntl(&master, FcntlArg::F_SETFL(OFlag::O_NONBLOCK))?;
        let name = ptsname_r(&master)?;
        let terminal = Terminal {
            master,
            name,
            client: false,
        };
        terminal.clean()?;
        Ok(terminal)
    }

    /// Raw, so that nothing echoes, and nothing left to read.
    fn clean(&self) -> Result<(), LiveError> {
        let client: File = OpenOptions::new()
            .read(true)
            .write(true)
            .custom_flags((OFlag::O_NOCTTY | OFlag::O_NONBLOCK).bits())
            .open(&self.name)?;
        let mut settings = termios::tcgetattr(&client)?;
        termios::cfmakeraw(&mut settings);
        termios::tcsetattr(&client, SetArg::TCSANOW, &settings)?;
        termios::tcflush(&client, FlushArg::TCIFLUSH)?;
        Ok(())
    }

    /// What clients have written, waiting for it for at most `tick`.
    fn wait(&mut self, tick: Duration) -> Result<Vec<u8>, LiveError> {
        if !self.client {
            // Without a client poll returns at once.
            thread::sleep(tick);
        }
        let timeout = PollTimeout::try_from(tick).unwrap_or(PollTimeout::ZERO);
        let mut fds = [PollFd::new(self.master.as_fd(), PollFlags::POLLIN)];
        match poll(&mut fds, timeout) {
            // A signal: the caller looks at what it meant.
            Err(nix::Error::EINTR) => return Ok(Vec::new()),
            result => result?,
        };
        let events = fds[0].revents().unwrap_or(PollFlags::empty());
        let mut input = Vec::new();
        if events.contains(PollFlags::POLLIN) {
            let mut buffer = [0; 4096];
            match self.master.read(&mut buffer) {
                Ok(count) => input.extend_from_slice(&buffer[..count]),
                // EIO: the client has gone in between.
                Err(error) if error.raw_os_error() == Some(nix::Error::EIO as i32) => {}
                Err(error) if error.kind() == ErrorKind::WouldBlock => {}
                Err(error) if error.kind() == ErrorKind::Interrupted => {}
                Err(error) => return Err(error.into()),
            }
        }
        let client = !events.contains(PollFlags::POLLHUP);
        if self.client && !client {
            self.clean()?;
        }
        self.client = client;
        Ok(input)
    }

    /// Bytes for the client, if there is one. One that does not read loses them.
    fn write(&mut self, bytes: &[u8]) -> Result<(), LiveError> {
        if !self.client || bytes.is_empty() {
            return Ok(());
        }
        match self.master.write(bytes) {
            Err(error) if error.raw_os_error() == Some(nix::Error::EIO as i32) => Ok(()),
            Err(error) if error.kind() == ErrorKind::WouldBlock => Ok(()),
            Err(error) if error.kind() == ErrorKind::Interrupted => Ok(()),
            result => Ok(result.map(|_| ())?),
        }
    }
}

/// The link to the terminal; gone when dropped.
struct Link {
    path: PathBuf,
    target: PathBuf,
}

impl Link {
    fn check(path: &Path) -> Result<(), LiveError> {
        match fs::symlink_metadata(path) {
            Ok(meta) if !meta.is_symlink() => Err(LiveError::NotALink(path.to_owned())),
            _ => Ok(()),
        }
    }

    fn make(path: &Path, target: &str) -> Result<Self, LiveError> {
        Self::check(path)?;
        let failed = |source| LiveError::Link {
            path: path.to_owned(),
            source,
        };
        // Left over from a bus that was killed.
        match fs::remove_file(path) {
            Err(error) if error.kind() != ErrorKind::NotFound => return Err(failed(error)),
            _ => {}
        }
        symlink(target, path).map_err(failed)?;
        Ok(Link {
            path: path.to_owned(),
            target: target.into(),
        })
    }
}

impl Drop for Link {
    fn drop(&mut self) {
        // Another bus may have taken the path over.
        if fs::read_link(&self.path).is_ok_and(|target| target == self.target) {
            let _ = fs::remove_file(&self.path);
        }
    }
}
