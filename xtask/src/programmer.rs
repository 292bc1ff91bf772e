//! A programmer for the Nano, driven by avrdude: it writes without a boot loader, and reads and writes fuses.

use crate::error::Error;
use crate::{repo, serial};
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

/// Programmers of avrdude that are boot loaders: they can neither erase the chip nor write its fuses.
const BOOT_LOADERS: &[&str] = &["arduino", "wiring", "xbee", "urclock"];

/// An Arduino with the sketch ArduinoISP, and its speed.
const ARDUINO_AS_ISP: &[&str] = &["stk500v1", "arduino_as_isp"];
const ARDUINO_AS_ISP_BAUD: &str = "19200";

/// A programmer that avrdude knows.
pub struct Programmer {
    avrdude: PathBuf,
    name: String,
    port: Option<PathBuf>,
}

impl Programmer {
    /// # Errors
    /// [`Error::usage`] for a name that this avrdude does not have, with the names that it has; for the name of a
    /// boot loader; and for a port that cannot be used.
    pub fn new(avrdude: PathBuf, name: &str, port: Option<&Path>) -> Result<Self, Error> {
        if BOOT_LOADERS.contains(&name) {
            return Err(Error::usage(format!(
                "--programmer {name}: this is for a boot loader; leave --programmer out to use it"
            )));
        }
        let known = known(&avrdude)?;
        if !known.is_empty() && !known.iter().any(|one| one == name) {
            return Err(Error::usage(format!(
                "--programmer {name}: unknown to avrdude, must be one of: {}",
                known.join(", ")
            )));
        }
        // Only a path is checked; other values are names such as usb:BUS:DEVICE.
        if let Some(port) = port.filter(|port| port.components().count() > 1) {
            serial::check(port)?;
        }
        Ok(Self {
            avrdude,
            name: name.to_owned(),
            port: port.map(Path::to_owned),
        })
    }

    fn command(&self) -> Command {
        let mut command = Command::new(&self.avrdude);
        command.args(["-c", &self.name, "-p", "atmega328p"]);
        if let Some(port) = &self.port {
            command.arg("-P").arg(port);
        }
        if ARDUINO_AS_ISP.contains(&self.name.as_str()) {
            command.args(["-b", ARDUINO_AS_ISP_BAUD]);
        }
        command
    }

    /// Runs avrdude with `operations`, in the form of its option -U.
    ///
    /// # Errors
    /// [`Error::failed`] when it fails.
    pub fn write(&self, operations: &[String]) -> Result<(), Error> {
        let mut command = self.command();
        for operation in operations {
            command.args(["-U", operation]);
        }
        println!("> {}", repo::shown(&command));
        repo::run(&mut command)
    }

    /// Runs avrdude with these operations; returns what it printed.
    ///
    /// # Errors
    /// [`Error::failed`] when it fails.
    pub fn read(&self, operations: &[&str]) -> Result<String, Error> {
        let mut command = self.command();
        command.args(["-q", "-q"]);
        for operation in operations {
            command.args(["-U", operation]);
        }
        let output = command
            .stdin(Stdio::null())
            .stderr(Stdio::inherit())
            .output()
            .map_err(|error| Error::io("avrdude", error))?;
        if !output.status.success() {
            return Err(Error::failed(format!(
                "{} ended with {}\nA USB programmer may need a rule for udev, or root; a serial one needs --port",
                repo::shown(&command),
                output.status
            )));
        }
        Ok(String::from_utf8_lossy(&output.stdout).into_owned())
    }
}

/// The names of this avrdude's programmers.
fn known(avrdude: &Path) -> Result<Vec<String>, Error> {
    let output = Command::new(avrdude)
        .args(["-c", "?"])
        .stdin(Stdio::null())
        .output()
        .map_err(|error| Error::io("avrdude", error))?;
    Ok(names(&String::from_utf8_lossy(&output.stderr)))
}

fn names(listed: &str) -> Vec<String> {
    let lines = listed.lines().filter(|line| line.starts_with("  "));
    let names = lines.filter_map(|line| Some(line.split_once(" = ")?.0.trim().to_owned()));
    names
        .filter(|name| !BOOT_LOADERS.contains(&name.as_str()))
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_names_are_those_of_avrdudes_list() {
        let listed = "\nValid programmers are:\n  arduino            = Arduino for bootloader\n  \
                      usbasp             = USBasp, http://www.fischl.de/usbasp/\n  usbtiny            = USBtiny = small\n\n";
        assert_eq!(names(listed), ["usbasp", "usbtiny"]);
    }
}
