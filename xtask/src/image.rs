//! Firmware images: which there are, what can be compiled into them, and what the file is called.

use crate::error::Error;
use clap::ValueEnum;
use multidrop_protocol::baud::{atmega, stm32};
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

    /// Where cargo puts what it builds for it, from the root of the repository.
    pub const fn target_dir(self) -> &'static str {
        match self {
            Self::Nano => "target/avr",
            Self::Stm32 => "target/stm32",
        }
    }

    /// Applications that it can be built with.
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

/// CPU clock of the Nano in Hz, if not built otherwise: baud rates are divided from it.
const NANO_HZ: u32 = 16_000_000;

/// What the STM32's slower USARTs divide their rates from, in Hz.
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
    /// A client that asks every function once, for tests
    #[value(hide = true)]
    ClientFunctions,
    /// Four ports at once: master, two slaves, sniffer
    Ports,
    /// A unit that fails while it answers, for tests
    #[value(hide = true)]
    Faults,
}

impl App {
    /// Whether it can be built for ASCII.
    const fn has_ascii(self) -> bool {
        matches!(self, Self::Conformance | Self::ClientFunctions)
    }
}

/// The words of those in `all` that users are told of.
pub fn words<T: ValueEnum>(all: impl IntoIterator<Item = T>) -> String {
    let words: Vec<_> = all
        .into_iter()
        .filter_map(|one| one.to_possible_value())
        .filter(|value| !value.is_hide_set())
        .map(|value| value.get_name().to_owned())
        .collect();
    words.join(", ")
}

/// Bits of a character. Those of 7 data bits are for ASCII alone.
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

/// How an image comes into a Nano, and what has started when it does.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum Bootloader {
    /// Without one, through a programmer
    None,
    /// Optiboot, 512 bytes, 115200 baud
    New,
    /// ATmegaBOOT, 2 KB, 57600 baud: most boards; it cannot bear a watchdog, which is left out
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

/// What is compiled into an image in place of the application's own settings.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Options {
    /// Unit id, 1..=247.
    pub unit: Option<u8>,
    /// Items in each table, 1..=128.
    pub count: Option<u8>,
    /// Baud rate.
    pub baud: Option<u32>,
    /// Character format.
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

/// One image that can be built: checked, so that the build cannot be asked for nonsense.
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
                "--qemu: only stm32 is simulated in QEMU; the Nano's image is the one that is flashed",
            ));
        }
        if options.clock.is_some() && board != Board::Nano {
            return Err(Error::usage(
                "--clock: only the Nano is sold with several crystals; only nano takes a clock",
            ));
        }
        if options.unit.is_some() && app != App::DemoUnit {
            return Err(Error::usage(format!(
                "--unit: {} has a fixed unit id or none; only demo-unit takes a unit id",
                word(app)
            )));
        }
        if options.count.is_some() && app != App::Registers {
            return Err(Error::usage(format!(
                "--count: {} has tables of its own; only registers takes a count",
                word(app)
            )));
        }
        if options.bootloader.is_some() && board != Board::Nano {
            return Err(Error::usage(
                "--bootloader: an STM32 is flashed without one; only nano has a boot loader",
            ));
        }
        if options.guarded && app != App::Registers {
            return Err(Error::usage(format!(
                "--guarded: {} has its guards; only registers is built without",
                word(app)
            )));
        }
        if app == App::Ports && (options.baud.is_some() || options.format.is_some()) {
            return Err(Error::usage(
                "--baud, --format: ports has four lines, which are set at run time; see its source",
            ));
        }
        if options.ascii && !app.has_ascii() {
            return Err(Error::usage(format!(
                "--ascii: {} speaks RTU; {} takes --ascii",
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

    /// What it runs on.
    pub fn board(&self) -> Board {
        self.board
    }

    /// Whether it runs in QEMU and nowhere else.
    pub fn is_for_qemu(&self) -> bool {
        self.options.qemu
    }

    /// Features of the board's crate that it is built with, and whether the default ones are too.
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

    /// The boot loader that it is for, if that was said.
    pub fn bootloader(&self) -> Option<Bootloader> {
        self.options.bootloader
    }

    /// The same image for a Nano with this boot loader.
    pub fn with_bootloader(self, bootloader: Bootloader) -> Self {
        let options = Options {
            bootloader: Some(bootloader),
            ..self.options
        };
        Self { options, ..self }
    }

    /// Whether a watchdog would be in it but for the boot loader.
    pub fn lacks_watchdog(&self) -> bool {
        let is_bare = self.features().1.contains(&"bare");
        self.options.bootloader == Some(Bootloader::Old) && !is_bare
    }

    /// The CPU clock of a Nano that it is for, in Hz.
    pub fn nano_hz(&self) -> u32 {
        self.options.clock.unwrap_or(NANO_HZ)
    }

    /// The name of the application's binary.
    pub fn app(&self) -> String {
        word(self.app)
    }

    /// File name without extension: board, application, then the options that were given, in the
    /// order unit, count, baud, format, clock, ascii, guarded, bootloader, qemu.
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

    /// Where the ELF file stands, from the root of the repository.
    pub fn elf(&self) -> PathBuf {
        PathBuf::from(format!("target/firmware/{}.elf", self.stem()))
    }

    /// The environment that hands the options to the firmware's build: every variable there is,
    /// with nothing for an option that was not given.
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

/// The slowest rate that a clock makes and a timer counts on some board, and the fastest at which the Nano's receive interrupt
/// follows. Whether the Nano's timer counts a rate below 600 the build says.
const BAUD_MIN: u32 = 300;
const NANO_BAUD_MAX: u32 = 1_000_000;

/// What the applications are built for if nothing else is asked for.
pub const DEFAULT_BAUD: u32 = 38_400;

fn check_baud(board: Board, options: &Options) -> Result<(), Error> {
    let baud = options.baud.unwrap_or(DEFAULT_BAUD);
    let (clock_hz, max) = match board {
        Board::Nano => (options.clock.unwrap_or(NANO_HZ), NANO_BAUD_MAX),
        Board::Stm32 => (STM32_USART_HZ, stm32::MAX_BAUD),
    };
    if !(BAUD_MIN..=max).contains(&baud) {
        return Err(Error::usage(format!(
            "--baud {baud}: must be {BAUD_MIN}..={max}"
        )));
    }
    let nearest = match board {
        Board::Nano => atmega::divisor(clock_hz, baud)
            .err()
            .map(|error| error.nearest),
        Board::Stm32 => stm32::divisor(clock_hz, baud)
            .err()
            .map(|error| error.nearest),
    };
    if board == Board::Nano {
        let bits = match options.format {
            Some(Format::Bits8Even1 | Format::Bits8Odd1 | Format::Bits8None2) => 11,
            _ => 10,
        };
        let slowest = atmega::slowest(clock_hz, bits, options.ascii);
        if baud < slowest {
            return Err(Error::usage(format!(
                "--baud {baud}: Timer1 counts no character that long at {clock_hz} Hz; the slowest rate is {slowest}"
            )));
        }
    }
    match nearest {
        None => Ok(()),
        Some(nearest) => Err(Error::usage(format!(
            "--baud {baud}: a clock of {clock_hz} Hz cannot make it within 2.5 %; the nearest rate \
             it makes is {nearest}"
        ))),
    }
}

fn check_rtu_format(format: Format, has_ascii: bool) -> Result<(), Error> {
    match format {
        Format::Bits8None1 | Format::Bits8Even1 | Format::Bits8Odd1 | Format::Bits8None2 => Ok(()),
        Format::Bits7Even1 | Format::Bits7Odd1 | Format::Bits7None2 => Err(Error::usage(format!(
            "--format {}: RTU sends bytes and needs 8 data bits, 7 are for ASCII{}. The formats for \
             RTU are: 8N1, 8E1, 8O1, 8N2",
            word(format),
            if has_ascii { ", --ascii" } else { "" }
        ))),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn nano(app: App, options: Options) -> Result<Image, Error> {
        Image::new(Board::Nano, app, options)
    }

    fn refusal(result: Result<Image, Error>) -> String {
        let error = result.expect_err("accepted");
        assert_eq!(error.code(), 2);
        error.message().to_owned()
    }

    #[test]
    fn names_hold_the_options_given_in_a_fixed_order() {
        let plain = nano(App::DemoUnit, Options::default()).unwrap();
        assert_eq!(
            plain.elf().to_str(),
            Some("target/firmware/nano-demo-unit.elf")
        );
        let full = Options {
            count: Some(128),
            baud: Some(115_200),
            format: Some(Format::Bits8Even1),
            ..Options::default()
        };
        assert_eq!(
            nano(App::Registers, full).unwrap().stem(),
            "nano-registers-count128-baud115200-format8E1"
        );
        let second = Options {
            unit: Some(2),
            ..Options::default()
        };
        assert_eq!(
            nano(App::DemoUnit, second).unwrap().stem(),
            "nano-demo-unit-unit2"
        );
    }

    #[test]
    fn options_not_given_are_withheld_from_the_build() {
        let baud = Options {
            baud: Some(9_600),
            ..Options::default()
        };
        let environment = nano(App::Registers, baud).unwrap().environment();
        assert_eq!(
            environment,
            [
                ("MULTIDROP_UNIT".to_owned(), None),
                ("MULTIDROP_COUNT".to_owned(), None),
                ("MULTIDROP_BAUD".to_owned(), Some("9600".to_owned())),
                ("MULTIDROP_FORMAT".to_owned(), None),
                ("MULTIDROP_CLOCK".to_owned(), None),
                ("MULTIDROP_ASCII".to_owned(), None),
                ("MULTIDROP_BOOTLOADER".to_owned(), None),
            ]
        );
    }

    #[test]
    fn guards_are_an_option_of_the_yardstick_and_the_boot_loader_one_of_the_nano() {
        let guarded = Options {
            guarded: true,
            ..Options::default()
        };
        let plain = nano(App::Registers, Options::default()).unwrap();
        assert_eq!(plain.features(), (true, vec!["bare"]));
        let image = nano(App::Registers, guarded).unwrap();
        assert_eq!(image.stem(), "nano-registers-guarded");
        assert_eq!(image.features(), (true, vec![]));
        assert!(refusal(nano(App::DemoUnit, guarded)).contains("--guarded"));

        let old = nano(App::DemoUnit, Options::default())
            .unwrap()
            .with_bootloader(Bootloader::Old);
        assert_eq!(old.stem(), "nano-demo-unit-bootloaderold");
        let handed = ("MULTIDROP_BOOTLOADER".to_owned(), Some("old".to_owned()));
        assert!(old.environment().contains(&handed) && old.lacks_watchdog());
        assert!(!old.with_bootloader(Bootloader::New).lacks_watchdog());
        // Nothing is left out of an image that has none.
        assert!(!plain.with_bootloader(Bootloader::Old).lacks_watchdog());
        let stm32 = Options {
            bootloader: Some(Bootloader::New),
            ..Options::default()
        };
        let text = refusal(Image::new(Board::Stm32, App::DemoUnit, stm32));
        assert!(text.contains("--bootloader"), "{text}");
    }

    #[test]
    fn a_baud_off_by_more_than_the_limit_names_the_nearest() {
        let with = |baud| {
            nano(
                App::Registers,
                Options {
                    baud: Some(baud),
                    ..Options::default()
                },
            )
        };
        assert!(with(115_200).is_ok(), "2.1 % off and in use everywhere");
        let text = refusal(with(921_600));
        assert!(
            text.contains("--baud 921600") && text.ends_with("1000000"),
            "{text}"
        );
        for outside in [0, 299, 1_000_001, 2_000_000] {
            let text = refusal(with(outside));
            assert!(text.contains("300..=1000000"), "{text}");
        }
        let text = refusal(with(300));
        assert!(
            text.contains("--baud 300") && text.ends_with("307"),
            "{text}"
        );
        assert!(with(600).is_ok() && with(1_000_000).is_ok());
    }

    #[test]
    fn the_baud_is_checked_against_the_clock_asked_for() {
        let with = |clock, baud| {
            let options = Options {
                baud,
                clock: Some(clock),
                ..Options::default()
            };
            nano(App::Registers, options)
        };
        let exact = with(11_059_200, Some(921_600));
        assert!(refusal(exact).contains("11059200 Hz"), "1/12 of the clock");
        let image = with(11_059_200, Some(115_200)).unwrap();
        assert_eq!(image.stem(), "nano-registers-baud115200-clock11059200");
        // 8 MHz / 16 / 4 is 8.5 % off 115200, and 8 MHz / 8 / 9 is 3.5 % off.
        assert!(refusal(with(8_000_000, Some(115_200))).contains("111111"));
        assert!(with(8_000_000, None).is_ok());
    }

    #[test]
    fn formats_of_seven_bits_are_for_ascii() {
        let with = |format| {
            nano(
                App::Registers,
                Options {
                    format: Some(format),
                    ..Options::default()
                },
            )
        };
        assert!(with(Format::Bits8None2).is_ok());
        assert!(refusal(with(Format::Bits7Even1)).contains("7E1"));
        let ascii = Options {
            baud: Some(19_200),
            format: Some(Format::Bits7Even1),
            ascii: true,
            ..Options::default()
        };
        let image = nano(App::Conformance, ascii).unwrap();
        assert_eq!(image.stem(), "nano-conformance-baud19200-format7E1-ascii");
        assert!(
            image
                .environment()
                .contains(&("MULTIDROP_ASCII".to_owned(), Some("1".to_owned())))
        );
        let text = refusal(nano(App::Registers, ascii));
        assert_eq!(
            text,
            "--ascii: registers speaks RTU; conformance takes --ascii"
        );
        let rtu = Options {
            ascii: false,
            ..ascii
        };
        assert!(refusal(nano(App::Conformance, rtu)).contains("--ascii"));
    }

    #[test]
    fn what_is_not_there_yet_is_said_to_be_so() {
        let panel = refusal(Image::new(
            Board::Stm32,
            App::RelayPanel,
            Options::default(),
        ));
        assert!(panel.contains("stm32 has no application relay-panel in this version"));
        let node = refusal(nano(App::SensorNode, Options::default()));
        assert!(node.contains("nano has no application sensor-node in this version"));
    }

    #[test]
    fn an_option_of_another_application_is_refused() {
        let unit = Options {
            unit: Some(2),
            ..Options::default()
        };
        assert!(refusal(nano(App::Registers, unit)).starts_with("--unit"));
        let count = Options {
            count: Some(2),
            ..Options::default()
        };
        assert!(refusal(nano(App::DemoUnit, count)).starts_with("--count"));
    }
}
