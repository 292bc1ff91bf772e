//! The serial port through which a board is flashed.

use crate::error::Error;
use nix::unistd::{Gid, Group};
use std::fs::{self, OpenOptions};
use std::io::{ErrorKind, IsTerminal};
use std::os::unix::fs::{FileTypeExt, MetadataExt, OpenOptionsExt};
use std::path::{Path, PathBuf};

/// Names of USB serial adapters and Nanos in /dev on Linux and macOS.
const PORT_NAMES: &[&str] = &[
    "ttyUSB",
    "ttyACM",
    "cu.usbserial",
    "cu.usbmodem",
    "cu.wchusbserial",
];

/// The given port, or the only one on this machine.
///
/// # Errors
/// [`Error::usage`] if there is no port, or more than one, or if it is not a serial port, or cannot be opened.
pub fn port(given: Option<&Path>) -> Result<PathBuf, Error> {
    let port = match given {
        Some(port) => port.to_owned(),
        None => choose(all())?,
    };
    check(&port)?;
    Ok(port)
}

/// Opens the port once, since the message of avrdude says less.
///
/// # Errors
/// As [`port`].
pub fn check(port: &Path) -> Result<(), Error> {
    let refused = |why: &str| Err(Error::usage(format!("--port {}: {why}", port.display())));
    let meta = match fs::metadata(port) {
        Err(error) if error.kind() == ErrorKind::NotFound => {
            return refused("there is no such port");
        }
        Err(error) => return refused(&error.to_string()),
        Ok(meta) => meta,
    };
    if !meta.file_type().is_char_device() {
        return refused("it is a file or a folder, not a serial port");
    }
    // This neither waits for a carrier nor makes the port the controlling terminal.
    let flags = nix::libc::O_NONBLOCK | nix::libc::O_NOCTTY;
    let mut options = OpenOptions::new();
    match options
        .read(true)
        .write(true)
        .custom_flags(flags)
        .open(port)
    {
        Ok(file) if file.is_terminal() => Ok(()),
        Ok(_) => refused("it is another kind of device, not a serial port"),
        Err(error) if error.kind() == ErrorKind::PermissionDenied => {
            refused(&not_allowed(meta.gid()))
        }
        Err(error) if error.kind() == ErrorKind::ResourceBusy => {
            refused("another program has it open and locked")
        }
        Err(error) => refused(&error.to_string()),
    }
}

/// How to get access to a port that belongs to a group.
fn not_allowed(group: u32) -> String {
    let found = Group::from_gid(Gid::from_raw(group)).ok().flatten();
    let group = found.map_or_else(|| group.to_string(), |group| group.name);
    format!(
        "permission denied; it belongs to the group {group}: sudo usermod -aG {group} $USER, then log in again"
    )
}

fn choose(mut ports: Vec<PathBuf>) -> Result<PathBuf, Error> {
    ports.sort();
    match &ports[..] {
        [] => Err(Error::usage(
            "no serial port found: connect the board, or name its port with --port TTY",
        )),
        [one] => Ok(one.clone()),
        several => Err(Error::usage(format!(
            "several serial ports found; name that of the board with --port: {}",
            several
                .iter()
                .map(|port| port.display().to_string())
                .collect::<Vec<_>>()
                .join(", ")
        ))),
    }
}

fn all() -> Vec<PathBuf> {
    fs::read_dir("/dev")
        .into_iter()
        .flatten()
        .flatten()
        .filter(|entry| {
            let name = entry.file_name();
            let name = name.to_string_lossy();
            PORT_NAMES.iter().any(|known| name.starts_with(known))
        })
        .map(|entry| entry.path())
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_port_is_chosen_only_where_there_is_no_doubt() {
        let port = |name: &str| PathBuf::from(name);
        assert_eq!(choose(vec![port("a")]).unwrap(), port("a"));
        assert!(choose(vec![]).unwrap_err().message().contains("--port"));
        let doubt = choose(vec![port("b"), port("a")]).unwrap_err();
        assert!(doubt.message().ends_with("a, b"));
    }
}
