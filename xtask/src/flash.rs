//! `flash`: writes an image to a Nano through its boot loader or a programmer, or to an STM32 through a debug probe.

use crate::cli::FlashRequest;
use crate::error::Error;
use crate::firmware::{Builder, WITHOUT_WATCHDOG};
use crate::fuses::Bod;
use crate::image::{Board, Bootloader, Image};
use crate::needs::Purpose;
use crate::programmer::Programmer;
use crate::{fuses, repo, serial, setup};
use std::path::{Path, PathBuf};
use std::process::Command;

/// Builds the image and has avrdude or probe-rs write it.
///
/// # Errors
/// [`Error::usage`] before anything is built if the image does not exist, an option is not for this board, or a
/// program or the port is missing; else the error of the program.
pub fn run(request: &FlashRequest) -> Result<(), Error> {
    let wanted = &request.image;
    let image = Image::new(wanted.board, wanted.app, (&wanted.options).into())?;
    if wanted.board == Board::Stm32 {
        return flash_stm32(request, &image);
    }
    if request.fuses && request.programmer.is_none() {
        return Err(Error::usage(
            "--fuses: a boot loader cannot write fuses; connect a programmer, and name it with --programmer",
        ));
    }
    let avrdude = repo::in_path("avrdude").ok_or_else(|| {
        Error::usage(
            "avrdude is not installed: Debian, Ubuntu, Fedora, Arch: package avrdude; \
             macOS: brew install avrdude",
        )
    })?;
    match &request.programmer {
        Some(name) => through_programmer(request, &image, avrdude, name),
        None => through_boot_loader(request, &image, avrdude),
    }
}

fn through_programmer(
    request: &FlashRequest,
    image: &Image,
    avrdude: PathBuf,
    name: &str,
) -> Result<(), Error> {
    if !matches!(image.bootloader(), None | Some(Bootloader::None)) {
        return Err(Error::usage(
            "--bootloader: a programmer erases the boot loader; with --programmer only none is accepted",
        ));
    }
    let image = image.with_bootloader(Bootloader::None);
    let level = || {
        request
            .bod
            .map_or_else(|| Bod::of_clock(image.nano_hz()), Ok)
    };
    let bod = request.fuses.then(level).transpose()?;
    let programmer = Programmer::new(avrdude, name, request.port.as_deref())?;
    setup::require(&[Purpose::Firmware, Purpose::Avr])?;
    let hex = Builder::new()?.build(&image)?.with_extension("hex");
    if let Some(bod) = bod {
        // First, since the fuse that keeps the EEPROM must be set when the chip is erased.
        fuses::set(&programmer, bod, request.yes)?;
    }
    programmer.write(&[format!("flash:w:{}:i", hex.display())])
}

fn through_boot_loader(
    request: &FlashRequest,
    image: &Image,
    avrdude: PathBuf,
) -> Result<(), Error> {
    let bootloader = image.bootloader().unwrap_or(Bootloader::Old);
    let (baud, other) = speed(bootloader)?;
    let port = serial::port(request.port.as_deref())?;
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

/// The name of the chip in probe-rs.
const CHIP: &str = "STM32F405RG";

fn flash_stm32(request: &FlashRequest, image: &Image) -> Result<(), Error> {
    if image.is_for_qemu() {
        return Err(Error::usage("--qemu: that image does not run on the chip"));
    }
    let given = [
        ("--port", request.port.is_some()),
        ("--programmer", request.programmer.is_some()),
        ("--fuses", request.fuses),
        ("--bod", request.bod.is_some()),
        ("--yes", request.yes),
    ];
    if let Some((name, _)) = given.iter().find(|(_, is_given)| *is_given) {
        return Err(Error::usage(format!(
            "{name}: the STM32 is flashed through a debug probe, which probe-rs finds; flash stm32 takes the options of its \
             images alone: --unit, --count, --baud, --format, --ascii, --guarded"
        )));
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

/// The baud rate of a boot loader, and the name of the other boot loader.
fn speed(bootloader: Bootloader) -> Result<(&'static str, &'static str), Error> {
    match bootloader {
        Bootloader::Old => Ok(("57600", "new")),
        Bootloader::New => Ok(("115200", "old")),
        Bootloader::None => Err(Error::usage(
            "--bootloader none: this needs a programmer; name it with --programmer",
        )),
    }
}

/// With `-D`, since the boot loader erases page by page and cannot erase the chip.
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
}
