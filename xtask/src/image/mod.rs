//! Firmware images: their boards, applications, options and file names.

mod line;

pub use line::DEFAULT_BAUD;
use line::{check_baud, check_rtu_format};

use crate::error::Error;
use clap::ValueEnum;
use std::path::PathBuf;

/// A board that images are built for.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum Board {
    /// Arduino Nano, ATmega328P at 16 MHz
    Nano,
    /// STM32F405, such as the Olimex STM32-H405
    Stm32,
}

impl Board {
    /// The folder of its crate, from the root of the repository.
    pub const fn folder(self) -> &'static str {
        match self {
            Self::Nano => "board-nano",
            Self::Stm32 => "board-stm32",
        }
    }

    /// The folder of cargo's build results for the board, from the root of the repository.
    pub const fn target_dir(self) -> &'static str {
        match self {
            Self::Nano => "target/avr",
            Self::Stm32 => "target/stm32",
        }
    }

    /// The applications of the board.
    pub const fn apps(self) -> &'static [App] {
        match self {
            Self::Nano => &[
                App::DemoUnit,
                App::Registers,
                App::Conformance,
                App::RelayPanel,
                App::RelayBoard,
                App::ClientFunctions,
                App::Faults,
            ],
            Self::Stm32 => &[
                App::DemoUnit,
                App::Registers,
                App::Conformance,
                App::Ports,
                App::Faults,
            ],
        }
    }
}

/// The CPU clock of the Nano in Hz by default, from which baud rates are divided.
const NANO_HZ: u32 = 16_000_000;

/// The clock of the STM32's slower USARTs in Hz, from which baud rates are divided.
const STM32_USART_HZ: u32 = 42_000_000;

/// An application that a board can be built with.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum App {
    /// Remote output module: one register on the LED pins
    DemoUnit,
    /// The yardstick: N of each table
    Registers,
    /// Every function, for conformance tests: unit 17
    Conformance,
    /// Counters and sampled sensors
    #[value(hide = true)]
    SensorNode,
    /// A client that toggles two relays of unit 1 and shows their state
    RelayPanel,
    /// The unit with the relays
    RelayBoard,
    /// A client that calls every function once, for tests
    #[value(hide = true)]
    ClientFunctions,
    /// Four ports at once: master, two slaves, sniffer
    Ports,
    /// A unit that fails while it answers, for tests
    #[value(hide = true)]
    Faults,
}

impl App {
    /// Whether the application can be built for ASCII.
    const fn has_ascii(self) -> bool {
        matches!(self, Self::Conformance | Self::ClientFunctions)
    }
}

/// The words of those in `all` that are not hidden.
pub fn words<T: ValueEnum>(all: impl IntoIterator<Item = T>) -> String {
    let words: Vec<_> = all
        .into_iter()
        .filter_map(|one| one.to_possible_value())
        .filter(|value| !value.is_hide_set())
        .map(|value| value.get_name().to_owned())
        .collect();
    words.join(", ")
}

/// The format of a character. Formats of 7 data bits are for ASCII only.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
#[value(rename_all = "UPPER")]
#[allow(
    missing_docs,
    reason = "data bits, parity, stop bits: the name says it"
)]
pub enum Format {
    #[value(name = "8N1")]
    Bits8None1,
    #[value(name = "8E1")]
    Bits8Even1,
    #[value(name = "8O1")]
    Bits8Odd1,
    #[value(name = "8N2")]
    Bits8None2,
    #[value(name = "7E1")]
    Bits7Even1,
    #[value(name = "7O1")]
    Bits7Odd1,
    #[value(name = "7N2")]
    Bits7None2,
}

/// The boot loader of a Nano.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum Bootloader {
    /// No boot loader: a programmer writes the image
    None,
    /// Optiboot, 512 bytes, 115200 baud
    New,
    /// ATmegaBOOT, 2 KB, 57600 baud: most boards. It does not work with a watchdog, which is left out
    Old,
}

/// The word that a user types for a value.
pub fn word(value: impl ValueEnum) -> String {
    value
        .to_possible_value()
        .expect("no value is skipped")
        .get_name()
        .to_owned()
}

/// The options that replace the application's own settings.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Options {
    /// Unit id, 1..=247.
    pub unit: Option<u8>,
    /// Items in each table, 1..=128.
    pub count: Option<u8>,
    /// The baud rate.
    pub baud: Option<u32>,
    /// The character format.
    pub format: Option<Format>,
    /// CPU clock in Hz, for boards with another crystal.
    pub clock: Option<u32>,
    /// ASCII framing instead of RTU; the format is then 7E1 unless another is given.
    pub ascii: bool,
    /// The yardstick with the guards that every other application has.
    pub guarded: bool,
    /// The boot loader of the Nano that it is for.
    pub bootloader: Option<Bootloader>,
    /// For the STM32 in QEMU instead of the chip.
    pub qemu: bool,
}

/// An image with valid options.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Image {
    board: Board,
    app: App,
    options: Options,
}

impl Image {
    /// # Errors
    /// [`Error::usage`] for a board or application that is not in this version, an option that the
    /// application does not have, a baud rate that the clock cannot make within 2.5 %, and a
    /// 7-bit format for RTU.
    pub fn new(board: Board, app: App, options: Options) -> Result<Self, Error> {
        let apps = board.apps();
        if !apps.contains(&app) {
            return Err(Error::usage(format!(
                "{} has no application {} in this version; it has: {}",
                word(board),
                word(app),
                words(apps.iter().copied())
            )));
        }
        if options.qemu && board != Board::Stm32 {
            return Err(Error::usage(
                "--qemu: only for stm32; the Nano is simulated with the image that is flashed",
            ));
        }
        if options.clock.is_some() && board != Board::Nano {
            return Err(Error::usage(
                "--clock: only for nano, which is sold with several crystals",
            ));
        }
        if options.unit.is_some() && app != App::DemoUnit {
            return Err(Error::usage(format!(
                "--unit: only for demo-unit; {} has a fixed unit id or none",
                word(app)
            )));
        }
        if options.count.is_some() && app != App::Registers {
            return Err(Error::usage(format!(
                "--count: only for registers; {} has tables of its own",
                word(app)
            )));
        }
        if options.bootloader.is_some() && board != Board::Nano {
            return Err(Error::usage(
                "--bootloader: only for nano; an STM32 has none",
            ));
        }
        if options.guarded && app != App::Registers {
            return Err(Error::usage(format!(
                "--guarded: only for registers; {} has its guards always",
                word(app)
            )));
        }
        if app == App::Ports && (options.baud.is_some() || options.format.is_some()) {
            return Err(Error::usage(
                "--baud, --format: not for ports, whose four lines are set at run time; see its source",
            ));
        }
        if options.ascii && !app.has_ascii() {
            return Err(Error::usage(format!(
                "--ascii: {} is built for RTU only; use {}",
                word(app),
                words(apps.iter().copied().filter(|app| app.has_ascii()))
            )));
        }
        if options.baud.is_some() || options.clock.is_some() {
            check_baud(board, &options)?;
        }
        if let Some(format) = options.format
            && !options.ascii
        {
            check_rtu_format(format, app.has_ascii())?;
        }
        Ok(Self {
            board,
            app,
            options,
        })
    }

    /// The board of the image.
    pub fn board(&self) -> Board {
        self.board
    }

    /// Whether the image is for QEMU only.
    pub fn is_for_qemu(&self) -> bool {
        self.options.qemu
    }

    /// The features of the board's crate, and whether the default features are enabled.
    pub fn features(&self) -> (bool, Vec<&'static str>) {
        let mut features = Vec::new();
        if self.is_for_qemu() {
            features.push("qemu");
        }
        if self.app == App::Registers && !self.options.guarded {
            features.push("bare");
        }
        (!self.is_for_qemu(), features)
    }

    /// The boot loader option, if it was given.
    pub fn bootloader(&self) -> Option<Bootloader> {
        self.options.bootloader
    }

    /// The image for a Nano with this boot loader.
    pub fn with_bootloader(self, bootloader: Bootloader) -> Self {
        let options = Options {
            bootloader: Some(bootloader),
            ..self.options
        };
        Self { options, ..self }
    }

    /// Whether the watchdog is left out because of the boot loader.
    pub fn lacks_watchdog(&self) -> bool {
        let is_bare = self.features().1.contains(&"bare");
        self.options.bootloader == Some(Bootloader::Old) && !is_bare
    }

    /// The CPU clock of the Nano in Hz.
    pub fn nano_hz(&self) -> u32 {
        self.options.clock.unwrap_or(NANO_HZ)
    }

    /// The name of the application's binary.
    pub fn app(&self) -> String {
        word(self.app)
    }

    /// The file name without extension: board, application, then the options that were given, in the order unit,
    /// count, baud, format, clock, ascii, guarded, bootloader, qemu.
    pub fn stem(&self) -> String {
        let mut stem = format!("{}-{}", word(self.board), word(self.app));
        for (name, value) in self.given() {
            stem.push_str(&match name {
                "ascii" | "guarded" | "qemu" => format!("-{name}"),
                _ => format!("-{name}{value}"),
            });
        }
        stem
    }

    /// The path of the ELF file, from the root of the repository.
    pub fn elf(&self) -> PathBuf {
        PathBuf::from(format!("target/firmware/{}.elf", self.stem()))
    }

    /// The environment that passes the options to the firmware's build: all variables, with `None` for an option that
    /// was not given.
    pub fn environment(&self) -> Vec<(String, Option<String>)> {
        let given = self.given();
        [
            "unit",
            "count",
            "baud",
            "format",
            "clock",
            "ascii",
            "bootloader",
        ]
        .into_iter()
        .map(|name| {
            let value = given
                .iter()
                .find(|(known, _)| *known == name)
                .map(|(_, value)| value.clone());
            (format!("MULTIDROP_{}", name.to_uppercase()), value)
        })
        .collect()
    }

    fn given(&self) -> Vec<(&'static str, String)> {
        let Options {
            unit,
            count,
            baud,
            format,
            clock,
            ascii,
            guarded,
            bootloader,
            qemu,
        } = self.options;
        [
            ("unit", unit.map(|n| n.to_string())),
            ("count", count.map(|n| n.to_string())),
            ("baud", baud.map(|n| n.to_string())),
            ("format", format.map(word)),
            ("clock", clock.map(|n| n.to_string())),
            ("ascii", ascii.then(|| "1".to_owned())),
            ("guarded", guarded.then(|| "1".to_owned())),
            ("bootloader", bootloader.map(word)),
            ("qemu", qemu.then(|| "1".to_owned())),
        ]
        .into_iter()
        .filter_map(|(name, value)| Some((name, value?)))
        .collect()
    }
}

#[cfg(test)]
mod tests;
