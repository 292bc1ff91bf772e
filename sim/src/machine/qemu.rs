//! A QEMU process that runs exactly as far as it is told: the STM32F405 of the machine `olimex-stm32-h405`.
//!
//! See `qemu/barrier.c` for how it is held. Whatever is done to it is done while its CPU stands still.

use std::io::{self, Read, Write};
use std::os::unix::net::{UnixListener, UnixStream};
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::time::{Duration, Instant};

use super::child::{self, Child, PATIENCE};
use super::parts::{Instructions, Parts};
use crate::error::BusError;

/// What the program is called.
const PROGRAM: &str = "qemu-system-arm";

/// A load or store of the firmware to a watched address.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Access {
    /// Instructions executed, this one included.
    pub count: u64,
    /// Where to, or where from.
    pub address: u64,
    /// What was stored; `None` for a load.
    pub stored: Option<u32>,
}

/// The process of QEMU.
pub struct Qemu {
    child: Child,
    barrier: UnixStream,
    qtest: UnixStream,
    serials: Vec<UnixStream>,
    counted: Instructions,
    /// Interrupts that are over: where they began, and how long they were.
    interrupts: Vec<(u64, u64)>,
    /// Why it runs no more.
    failure: Option<String>,
}

/// The status register of a USART, and its flag that a character has come (RM0090 30.6.1).
const SR: u64 = 0x00;
const RXNE: u8 = 1 << 5;

/// Kinds of messages of the plugin.
const STORE: u64 = 1;
const STOPPED: u64 = 2;
const LOAD: u64 = 3;
const INTERRUPT: u64 = 4;

impl Qemu {
    /// Starts `image` with `serials` USARTs on sockets; its CPU stands before the first instruction. `plugin` is the
    /// barrier, compiled; accesses to `watched` addresses are told, and a store to one of `stops` stops it as well. The `parts` are
    /// counted apart.
    pub fn start(
        image: &Path,
        plugin: &Path,
        serials: usize,
        watched: &[(u64, u64)],
        stops: &[u64],
        parts: &Parts,
    ) -> Result<Self, BusError> {
        let failed = |reason: String| BusError::Machine { reason };
        if !image.is_file() {
            return Err(BusError::Read {
                path: image.to_path_buf(),
                source: std::io::ErrorKind::NotFound.into(),
            });
        }
        let folder = tempfile::tempdir().map_err(|error| failed(error.to_string()))?;
        let listen = |name: &str| -> Result<(PathBuf, UnixListener), BusError> {
            let path = folder.path().join(name);
            let listener = UnixListener::bind(&path)
                .and_then(|listener| listener.set_nonblocking(true).map(|()| listener))
                .map_err(|error| failed(error.to_string()))?;
            Ok((path, listener))
        };
        let (barrier_path, barrier) = listen("barrier")?;
        let (qtest_path, qtest) = listen("qtest")?;
        let ports = (0..serials)
            .map(|index| listen(&format!("serial{index}")))
            .collect::<Result<Vec<_>, _>>()?;
        let mut plugin = format!("{},socket={}", plugin.display(), barrier_path.display());
        for (first, last) in watched {
            plugin.push_str(&format!(",watch={first:x}-{last:x}"));
        }
        for address in stops {
            plugin.push_str(&format!(",stop={address:x}"));
        }
        let told = parts.arguments(folder.path());
        plugin.push_str(&told.map_err(|error| failed(error.to_string()))?);
        let mut command = Command::new(PROGRAM);
        command
            .args(["-M", "olimex-stm32-h405", "-kernel"])
            .arg(image)
            .args(["-nodefaults", "-display", "none", "-monitor", "none"])
            // 8 ns an instruction; the clock follows the instructions and nothing else.
            .args(["-accel", "tcg", "-icount", "shift=3,sleep=off"])
            .args(["-plugin", &plugin, "-qtest-log", "none", "-qtest"])
            .arg(format!("unix:{}", qtest_path.display()))
            .stdin(Stdio::null())
            .stdout(Stdio::null());
        for (path, _) in &ports {
            command
                .arg("-serial")
                .arg(format!("unix:{}", path.display()));
        }
        let mut child =
            child::spawn(&mut command).map_err(|error| failed(format!("{PROGRAM}: {error}")))?;
        let mut accept = |listener: &UnixListener| accept(listener, &mut child).map_err(failed);
        let barrier = accept(&barrier)?;
        let qtest = accept(&qtest)?;
        let serials = ports
            .iter()
            .map(|(_, listener)| accept(listener))
            .collect::<Result<Vec<_>, _>>()?;
        // Each wait for the process checks whether it is alive.
        let prepare = || -> io::Result<()> {
            Child::prepare(&barrier)?;
            Child::prepare(&qtest)?;
            serials
                .iter()
                .try_for_each(|serial| serial.set_nonblocking(true))
        };
        prepare().map_err(|error| failed(error.to_string()))?;
        let mut qemu = Qemu {
            child,
            barrier,
            qtest,
            serials,
            counted: Instructions::default(),
            interrupts: Vec::new(),
            failure: None,
        };
        qemu.until_stopped(&mut Vec::new()).map_err(failed)?;
        // The sockets are connected, and their folder goes away here: a process that is killed could not remove it.
        Ok(qemu)
    }

    /// Why it runs no more, if it does not: the process has died, or it hangs and was killed.
    pub fn failure(&self) -> Option<&str> {
        self.failure.as_deref()
    }

    /// The number of instructions executed.
    pub fn count(&self) -> u64 {
        self.counted.all
    }

    /// The number of instructions executed, in parts.
    pub fn counted(&self) -> Instructions {
        self.counted
    }

    /// Interrupts that are over: where they began, and how many instructions they took.
    pub fn interrupts(&self) -> &[(u64, u64)] {
        &self.interrupts
    }

    /// Runs to the first block of instructions that begins at `count` or later, or to the one behind a store that
    /// stops it, whichever comes first. Gives what was accessed, in order. After a [`failure`](Self::failure) it does nothing more,
    /// and has done so as far as it was told to.
    pub fn run_to(&mut self, count: u64) -> Vec<Access> {
        let mut accesses = Vec::new();
        if count > self.counted.all && self.failure.is_none() {
            let told = self.barrier.write_all(&count.to_ne_bytes());
            let ran = told
                .map_err(|error| self.child.gone(error))
                .and_then(|()| self.until_stopped(&mut accesses));
            self.note(ran);
        }
        if self.failure.is_some() {
            self.counted.all = self.counted.all.max(count);
        }
        accesses
    }

    fn until_stopped(&mut self, accesses: &mut Vec<Access>) -> Result<(), String> {
        loop {
            let mut words = [[0; 8]; 4];
            self.child.fill(&self.barrier, words.as_flattened_mut())?;
            let [kind, count, address, value] = words.map(u64::from_ne_bytes);
            match kind {
                STOPPED => {
                    self.counted = Instructions {
                        all: count,
                        idle: address,
                        marked: value,
                    };
                    if accesses.iter().any(|access| access.stored.is_some()) {
                        self.drain();
                    }
                    return Ok(());
                }
                STORE | LOAD => accesses.push(Access {
                    count,
                    address,
                    stored: (kind == STORE).then_some(value as u32),
                }),
                INTERRUPT => self.interrupts.push((address, value)),
                _ => unreachable!("the barrier has four kinds of messages"),
            }
        }
    }

    /// What the USARTs send comes out of their sockets too. It is known already, but they must be emptied, and the
    /// machine would wait for ever.
    fn drain(&mut self) {
        let mut some = [0; 64];
        for serial in &mut self.serials {
            while serial.read(&mut some).is_ok_and(|len| len > 0) {}
        }
    }

    /// One command of QEMU's test protocol; when the answer is there, the machine has done all that was asked before.
    /// Nothing is answered after a [`failure`](Self::failure).
    fn command(&mut self, command: &str) -> Option<String> {
        if self.failure.is_some() {
            return None;
        }
        let answer = self.answer(command);
        self.note(answer)
    }

    fn answer(&mut self, command: &str) -> Result<String, String> {
        let told = self.qtest.write_all(format!("{command}\n").as_bytes());
        told.map_err(|error| self.child.gone(error))?;
        let mut answer = Vec::new();
        let mut some = [0; 64];
        while answer.last() != Some(&b'\n') {
            let len = self.child.read(&self.qtest, &mut some)?;
            answer.extend(&some[..len]);
        }
        Ok(String::from_utf8_lossy(&answer).trim_end().to_owned())
    }

    /// Reads a register of a device.
    fn read(&mut self, address: u64) -> Option<u32> {
        let answer = self.command(&format!("readl {address:#x}"))?;
        let value = answer.strip_prefix("OK 0x");
        let value = value.and_then(|digits| u64::from_str_radix(digits, 16).ok());
        Some(value.unwrap_or_else(|| panic!("readl was answered {answer}")) as u32)
    }

    /// Keeps the reason of a failure, and ends what is left of the process.
    fn note<T>(&mut self, result: Result<T, String>) -> Option<T> {
        result
            .map_err(|reason| {
                self.failure = Some(reason);
                self.child.kill();
            })
            .ok()
    }

    /// Sets a register of a device.
    pub fn write(&mut self, address: u64, value: u32) {
        self.command(&format!("writel {address:#x} {value:#x}"));
    }

    /// Lets a pin fall, as the external interrupt controller sees it.
    pub fn falling_edge(&mut self, line: u8) {
        self.command(&format!(
            "set_irq_in /machine/soc/exti unnamed-gpio-in {line} 0"
        ));
    }

    /// Puts a character into the USART at this address, which must have room for it: the one before was read.
    pub fn deliver(&mut self, serial: usize, usart: u64, byte: u8) {
        if self.failure.is_some() {
            return;
        }
        let told = self.serials[serial].write_all(&[byte]);
        let told = told.map_err(|error| self.child.gone(error));
        self.note(told);
        let start = Instant::now();
        // The main loop takes it from the socket whenever it comes to it; the machine's own time stands still meanwhile.
        while self
            .read(usart + SR)
            .is_some_and(|sr| sr & u32::from(RXNE) == 0)
        {
            if start.elapsed() > PATIENCE {
                self.note::<()>(Err("a USART takes nothing".to_owned()));
            }
        }
    }
}

fn accept(listener: &UnixListener, child: &mut Child) -> Result<UnixStream, String> {
    let start = Instant::now();
    loop {
        match listener.accept() {
            Ok((stream, _)) => {
                let blocking = stream.set_nonblocking(false);
                return blocking.map(|()| stream).map_err(|e| e.to_string());
            }
            Err(error) if error.kind() == std::io::ErrorKind::WouldBlock => {}
            Err(error) => return Err(error.to_string()),
        }
        child.check(start)?;
        std::thread::sleep(Duration::from_millis(2));
    }
}
