//! `flash`: writes an image to a Nano through its boot loader, or to an STM32 through a debug probe.

use crate::cli::FlashRequest;
use crate::error::Error;
use crate::firmware::{Builder, WITHOUT_WATCHDOG};
use crate::image::{Board, Bootloader, Image};
use crate::needs::Purpose;
use crate::{repo, setup};
use std::path::{Path, PathBuf};
use std::process::Command;

/// What USB serial adapters and Nanos are called in /dev on Linux and macOS.
const PORT_NAMES: &[&str] = &[
    "ttyUSB",
    "ttyACM",
    "cu.usbserial",
    "cu.usbmodem",
    "cu.wchusbserial",
];

/// Builds the image and has avrdude write it.
///
/// # Errors
/// [`Error::usage`] before anything is built when the image cannot be had, or avrdude or the port
/// is missing; else what avrdude said.
pub fn run(request: &FlashRequest) -> Result<(), Error> {
    let wanted = &request.image;
    let image = Image::new(wanted.board, wanted.app, (&wanted.options).into())?;
    if wanted.board == Board::Stm32 {
        return flash_stm32(request, &image);
    }
    let avrdude = repo::in_path("avrdude").ok_or_else(|| {
        Error::usage(
            "avrdude is not installed: Debian, Ubuntu, Fedora, Arch: package avrdude; \
             macOS: brew install avrdude",
        )
    })?;
    let port = match &request.port {
        Some(port) => given(port)?,
        None => choose(serial_ports())?,
    };
    let bootloader = image.bootloader().unwrap_or(Bootloader::Old);
    let (baud, other) = speed(bootloader)?;
    let image = image.with_bootloader(bootloader);
    setup::require(&[Purpose::Firmware, Purpose::Avr])?;
    let hex = Builder::new()?.build(&image)?.with_extension("hex");
    if image.lacks_watchdog() {
        println!("{WITHOUT_WATCHDOG}");
    }
    let mut avrdude = Command::new(avrdude);
    avrdude.args(arguments(baud, &port, &hex));
    println!("> {}", repo::shown(&avrdude));
    repo::run(&mut avrdude).map_err(|error| {
        Error::failed(format!(
            "{}\nIf the board does not answer, try --bootloader {other}",
            error.message()
        ))
    })
}

/// What probe-rs calls the chip.
const CHIP: &str = "STM32F405RG";

fn flash_stm32(request: &FlashRequest, image: &Image) -> Result<(), Error> {
    if image.is_for_qemu() {
        return Err(Error::usage("--qemu: that image does not run on the chip"));
    }
    if request.port.is_some() {
        return Err(Error::usage(
            "--port: the STM32 is flashed through a debug probe, which probe-rs finds",
        ));
    }
    let probe_rs = repo::in_path("probe-rs").ok_or_else(|| {
        Error::usage(
            "probe-rs is not installed: cargo install probe-rs-tools --locked, or see probe.rs",
        )
    })?;
    setup::require(&[Purpose::Firmware, Purpose::Arm])?;
    let elf = Builder::new()?.build(image)?;
    let mut command = Command::new(probe_rs);
    command.args(["download", "--chip", CHIP]).arg(&elf);
    println!("> {}", repo::shown(&command));
    repo::run(&mut command)?;
    let mut reset = Command::new("probe-rs");
    reset.args(["reset", "--chip", CHIP]);
    repo::run(&mut reset)
}

fn given(port: &Path) -> Result<PathBuf, Error> {
    if port.exists() {
        Ok(port.to_owned())
    } else {
        Err(Error::usage(format!(
            "--port {}: there is no such port",
            port.display()
        )))
    }
}

fn choose(mut ports: Vec<PathBuf>) -> Result<PathBuf, Error> {
    ports.sort();
    match &ports[..] {
        [] => Err(Error::usage(
            "no serial port of a board is found: plug the board in, or name it with --port TTY",
        )),
        [one] => Ok(one.clone()),
        several => Err(Error::usage(format!(
            "several serial ports are found; name the board's with --port: {}",
            several
                .iter()
                .map(|port| port.display().to_string())
                .collect::<Vec<_>>()
                .join(", ")
        ))),
    }
}

fn serial_ports() -> Vec<PathBuf> {
    std::fs::read_dir("/dev")
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

/// The baud rate of a boot loader, and the other one there is.
fn speed(bootloader: Bootloader) -> Result<(&'static str, &'static str), Error> {
    match bootloader {
        Bootloader::Old => Ok(("57600", "new")),
        Bootloader::New => Ok(("115200", "old")),
        Bootloader::None => Err(Error::usage(
            "--bootloader none: flash writes through a boot loader; build the image and write its .hex with a programmer",
        )),
    }
}

/// `-D`: the boot loader erases page by page and cannot erase the chip.
fn arguments(baud: &str, port: &Path, hex: &Path) -> Vec<String> {
    let port = port.display().to_string();
    let write = format!("flash:w:{}:i", hex.display());
    [
        "-c",
        "arduino",
        "-p",
        "atmega328p",
        "-b",
        baud,
        "-D",
        "-P",
        &port,
        "-U",
        &write,
    ]
    .map(str::to_owned)
    .to_vec()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_boot_loader_sets_the_speed() {
        let line = |bootloader| {
            let (baud, _) = speed(bootloader).unwrap();
            arguments(baud, Path::new("/dev/ttyUSB0"), Path::new("a.hex")).join(" ")
        };
        assert_eq!(
            line(Bootloader::Old),
            "-c arduino -p atmega328p -b 57600 -D -P /dev/ttyUSB0 -U flash:w:a.hex:i"
        );
        assert!(line(Bootloader::New).contains("-b 115200 "));
        assert_eq!(speed(Bootloader::None).unwrap_err().code(), 2);
    }

    #[test]
    fn the_port_is_chosen_only_where_there_is_no_doubt() {
        let port = |name: &str| PathBuf::from(name);
        assert_eq!(choose(vec![port("a")]).unwrap(), port("a"));
        assert!(choose(vec![]).unwrap_err().message().contains("--port"));
        let doubt = choose(vec![port("b"), port("a")]).unwrap_err();
        assert!(doubt.message().ends_with("a, b"));
        assert_eq!(given(Path::new("no/such/port")).unwrap_err().code(), 2);
    }
}
