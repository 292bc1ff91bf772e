//! A process that does not outlive the one that started it, however that one ends.

use std::io::{self, ErrorKind, Read};
use std::os::unix::net::UnixStream;
use std::os::unix::process::CommandExt;
use std::process::{Command, ExitStatus};
use std::time::{Duration, Instant};

/// Starts `command` in a process group of its own, so that Ctrl-C in a terminal reaches only us, who end it in good order;
/// where the system can do it (Linux), it is killed when the thread that started it ends, even by SIGKILL.
pub(super) fn spawn(command: &mut Command) -> io::Result<Child> {
    command.process_group(0);
    #[cfg(target_os = "linux")]
    {
        use nix::sys::{prctl, signal::Signal};
        use nix::unistd::{getpid, getppid};

        let parent = getpid();
        let bind = move || {
            prctl::set_pdeathsig(Signal::SIGKILL)?;
            // It may have ended before that.
            if getppid() != parent {
                return Err(ErrorKind::NotFound.into());
            }
            Ok(())
        };
        // SAFETY: between fork and exec only async-signal-safe calls are allowed. These are two system calls, and nothing is
        // allocated: the error is a number, and so is what is captured.
        unsafe { command.pre_exec(bind) };
    }
    let process = command.spawn()?;
    let name = command.get_program().to_string_lossy().into_owned();
    Ok(Child { process, name })
}

/// How long to wait for it to say something: far more than it needs.
pub(super) const PATIENCE: Duration = Duration::from_secs(20);

/// How long to wait before a look at whether it runs at all.
const LOOK: Duration = Duration::from_millis(100);

/// The process; dropped, it is no more.
pub(super) struct Child {
    process: std::process::Child,
    name: String,
}

impl Child {
    /// Prepares a socket for [`Child::read`].
    pub fn prepare(stream: &UnixStream) -> io::Result<()> {
        stream.set_read_timeout(Some(LOOK))?;
        stream.set_write_timeout(Some(PATIENCE))
    }

    /// Reads what comes from its socket, at least one byte; an error if it ends, or says nothing for [`PATIENCE`].
    pub fn read(&mut self, mut stream: &UnixStream, bytes: &mut [u8]) -> Result<usize, String> {
        let start = Instant::now();
        loop {
            match stream.read(bytes) {
                Ok(0) => return Err(self.gone(ErrorKind::UnexpectedEof.into())),
                Ok(len) => return Ok(len),
                Err(error) if error.kind() == ErrorKind::Interrupted => {}
                Err(error) if error.kind() == ErrorKind::WouldBlock => {
                    self.check(start)?;
                }
                Err(error) => return Err(self.gone(error)),
            }
        }
    }

    /// Reads as many bytes as `bytes` has room for, as [`Child::read`].
    pub fn fill(&mut self, stream: &UnixStream, mut bytes: &mut [u8]) -> Result<(), String> {
        while !bytes.is_empty() {
            let len = self.read(stream, bytes)?;
            bytes = &mut bytes[len..];
        }
        Ok(())
    }

    /// An error if it has ended, or has said nothing since `start` for too long.
    pub fn check(&mut self, start: Instant) -> Result<(), String> {
        match self.status() {
            Some(status) => Err(self.ended(status)),
            None if start.elapsed() > PATIENCE => Err(format!("{} does not answer", self.name)),
            None => Ok(()),
        }
    }

    /// Why a socket of it has failed: when it dies, that is seen a moment before its end.
    pub fn gone(&mut self, error: io::Error) -> String {
        let start = Instant::now();
        while start.elapsed() < LOOK {
            if let Some(status) = self.status() {
                return self.ended(status);
            }
            std::thread::sleep(Duration::from_millis(1));
        }
        format!("{}: {error}", self.name)
    }

    /// Ends the process.
    pub fn kill(&mut self) {
        let _ = self.process.kill();
    }

    fn status(&mut self) -> Option<ExitStatus> {
        self.process.try_wait().ok().flatten()
    }

    fn ended(&self, status: ExitStatus) -> String {
        format!("{} ended with {status}", self.name)
    }
}

impl Drop for Child {
    fn drop(&mut self) {
        self.kill();
        let _ = self.process.wait();
    }
}
