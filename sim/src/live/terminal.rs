//! The pseudo terminal that a client opens.
//!
//! No file descriptor of its client side is kept open here, so that the system tells when the last client has gone (`POLLHUP`).
//! It is then cleaned for the next one. A client may have locked it (`TIOCEXCL`), and such a lock outlives the client as long
//! as our side is open: only root could open it again, even to unlock it. A new one then takes its place.

use std::fs::{File, OpenOptions};
use std::io::{ErrorKind, Read, Write};
use std::os::fd::AsFd;
use std::os::unix::fs::OpenOptionsExt;
use std::thread;
use std::time::Duration;

use nix::fcntl::{FcntlArg, OFlag, fcntl};
use nix::poll::{PollFd, PollFlags, ppoll};
use nix::pty::{PtyMaster, grantpt, posix_openpt, ptsname_r, unlockpt};
use nix::sys::termios::{self, FlushArg, SetArg};

use super::LiveError;

/// Our end of a pseudo terminal.
pub(super) struct Terminal {
    master: PtyMaster,
    name: String,
    client: bool,
    is_new: bool,
}

impl Terminal {
    /// A new one, without a client.
    pub fn open() -> Result<Self, LiveError> {
        let master = posix_openpt(OFlag::O_RDWR | OFlag::O_NOCTTY | OFlag::O_CLOEXEC)?;
        grantpt(&master)?;
        unlockpt(&master)?;
        fcntl(&master, FcntlArg::F_SETFL(OFlag::O_NONBLOCK))?;
        let name = ptsname_r(&master)?;
        let terminal = Terminal {
            master,
            name,
            client: false,
            is_new: false,
        };
        terminal.clean()?;
        Ok(terminal)
    }

    /// What clients open.
    pub fn name(&self) -> &str {
        &self.name
    }

    /// Whether a client has it open.
    pub fn has_client(&self) -> bool {
        self.client
    }

    /// Whether it has another name since the last call.
    pub fn is_new(&mut self) -> bool {
        std::mem::take(&mut self.is_new)
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
    pub fn wait(&mut self, tick: Duration) -> Result<Vec<u8>, LiveError> {
        if !self.client {
            // Without a client poll returns at once.
            thread::sleep(tick);
        }
        let mut fds = [PollFd::new(self.master.as_fd(), PollFlags::POLLIN)];
        match ppoll(&mut fds, Some(tick.into()), None) {
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
            match self.clean() {
                Err(LiveError::Terminal(error)) if error.kind() == ErrorKind::ResourceBusy => {
                    *self = Self::open()?;
                    self.is_new = true;
                    return Ok(input);
                }
                cleaned => cleaned?,
            }
        }
        self.client = client;
        Ok(input)
    }

    /// Bytes for the client, if there is one. One that does not read loses them.
    pub fn write(&mut self, bytes: &[u8]) -> Result<(), LiveError> {
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
