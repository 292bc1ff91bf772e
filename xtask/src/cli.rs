//! The commands and options of the command line, and the answer to wrong ones.

use crate::fuses::Bod;
use crate::image::{App, Board, Bootloader, Format, Options};
use crate::mutants::MutantsRequest;
use crate::scenario::{LineOptions, Scenario};
use clap::error::{ContextKind, ContextValue, ErrorKind};
use clap::{Args, CommandFactory, Parser, Subcommand};
use std::path::PathBuf;

/// Builds, simulates, shows, tests and flashes multidrop.
#[derive(Parser)]
#[command(name = "cargo xtask", bin_name = "cargo xtask", version)]
struct Cli {
    #[command(subcommand)]
    command: Command,
}

/// One command with its options.
#[derive(Subcommand)]
pub enum Command {
    /// Install the compilers, the simulator's libraries and the test programs; print what was done.
    Setup {
        /// Only list what is installed and what is missing; exit 1 if anything is missing.
        #[arg(long)]
        check: bool,
    },
    /// Build a firmware image and print its flash and static RAM.
    ///
    /// The last line is `image: PATH`. The .hex file to flash is in the same folder.
    Build(ImageRequest),
    /// Run a simulated bus in real time on a pseudo terminal.
    ///
    /// Prints `ready: PATH` when the nodes listen. Ctrl-C, SIGTERM or --seconds ends it.
    Sim(SimRequest),
    /// Show the demonstration unit: three Nanos on one simulated bus, driven by mbpoll.
    Demo {
        /// Keep the bus up afterwards, for clients of your own.
        #[arg(long)]
        hold: bool,
    },
    /// Run every check and test; the last line is `N passed, N failed`.
    Test,
    /// Build a program that only tests run, or an example of the Nano's HAL; the last line is `image: PATH`.
    #[command(hide = true)]
    Example {
        /// The name of the program.
        name: String,
        /// For the STM32's board.
        #[arg(long)]
        stm32: bool,
        /// For an STM32 in QEMU.
        #[arg(long, requires = "stm32")]
        qemu: bool,
        /// Baud rate, for those that take one.
        #[arg(long)]
        baud: Option<u32>,
    },
    /// Plant faults in the code and list those that no test detects; exit 1 if one of the kept list is not detected.
    ///
    /// A sample of cargo-mutants over protocol, firmware and apps, or what changed since a revision, tested by the tests of the
    /// mutated crate; and the kept list of tests/planted over everything.
    Mutants(MutantsRequest),
    /// Write an image to a board.
    Flash(FlashRequest),
    /// Measure sizes, turnaround, jitter, interrupts, sleep and limits on the simulated bus.
    ///
    /// The STM32's four ports are loaded for ten minutes of bus time, which takes the host about three minutes.
    Bench {
        /// Write all figures as JSON to this file too.
        #[arg(long, value_name = "PATH")]
        json: Option<PathBuf>,
        /// Record these figures: `test` fails if they change.
        #[arg(long)]
        record: bool,
        /// Leave the ten minutes out: their recorded figures are shown and kept.
        #[arg(long)]
        short: bool,
        /// Only show how long a client of `sim` waits for an answer, which takes a minute.
        #[arg(long, conflicts_with_all = ["json", "record", "short"])]
        latency: bool,
    },
}

/// The image to build: a board, an application, and the options compiled into it.
#[derive(Args)]
pub struct ImageRequest {
    /// The board of the image.
    #[arg(value_enum)]
    pub board: Board,
    /// The application of the image.
    #[arg(value_enum)]
    pub app: App,
    #[command(flatten)]
    pub options: ImageOptions,
}

/// The options that are compiled into an image.
#[derive(Args)]
pub struct ImageOptions {
    /// Unit id of demo-unit, 1..=247 [default: 1]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u8).range(1..=247))]
    unit: Option<u8>,
    /// Items in each table of registers, 1..=128 [default: 16]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u8).range(1..=128))]
    count: Option<u8>,
    /// Baud rate, 300..=1000000 (stm32: 641..=2000000); the clock must make it within 2.5 % [default: 38400]
    #[arg(long, value_name = "N")]
    baud: Option<u32>,
    /// Character format: data bits, parity, stop bits; those of 7 bits with --ascii [default: 8N1]
    #[arg(long, value_enum, ignore_case = true)]
    format: Option<Format>,
    /// CPU clock in Hz of a nano with another crystal, 8000000..=20000000 [default: 16000000]
    #[arg(long, value_name = "HZ", value_parser = clap::value_parser!(u32).range(8_000_000..=20_000_000))]
    clock: Option<u32>,
    /// ASCII instead of RTU, for conformance; 7E1 if no format is given
    #[arg(long)]
    ascii: bool,
    /// Build registers with the guards that all other applications have: watchdog, stack guard, bound on DE
    #[arg(long)]
    guarded: bool,
    /// Boot loader of the nano [default: new for build, old for flash]. With old the watchdog is left out
    #[arg(long, value_enum)]
    bootloader: Option<Bootloader>,
    /// For the stm32 in QEMU, as the simulated bus runs it
    #[arg(long)]
    qemu: bool,
}

impl From<&ImageOptions> for Options {
    fn from(given: &ImageOptions) -> Self {
        Self {
            unit: given.unit,
            count: given.count,
            baud: given.baud,
            format: given.format,
            clock: given.clock,
            ascii: given.ascii,
            guarded: given.guarded,
            bootloader: given.bootloader,
            qemu: given.qemu,
        }
    }
}

/// The bus to run, and how long.
#[derive(Args)]
pub struct SimRequest {
    /// The bus to run.
    #[arg(value_enum)]
    pub scenario: Scenario,
    /// The link to the pseudo terminal; it is removed at the end.
    #[arg(long, value_name = "PATH", default_value = "./bus")]
    pub link: PathBuf,
    /// End after this many seconds.
    #[arg(long, value_name = "N")]
    pub seconds: Option<u32>,
    /// Send this canned message onto the bus once the nodes listen; a wrong name lists them.
    #[arg(long, value_name = "NAME")]
    pub inject: Option<String>,
    /// Run an STM32 in QEMU, slower than real time.
    #[arg(long)]
    pub qemu: bool,
    #[command(flatten)]
    pub line: LineOptions,
}

/// The image to write, and the place to write it to.
#[derive(Args)]
pub struct FlashRequest {
    #[command(flatten)]
    pub image: ImageRequest,
    /// The serial port of the board, or of the programmer; not needed if the board has the only one.
    #[arg(long, value_name = "TTY")]
    pub port: Option<PathBuf>,
    /// Write the nano without a boot loader, through a programmer that avrdude knows: usbasp, usbtiny, avrisp2,
    /// stk500v1 (an Arduino as programmer), ...
    #[arg(long, value_name = "NAME")]
    pub programmer: Option<String>,
    /// Set the fuses of the nano first: brown-out level, reset to the application, EEPROM kept. Shows them and asks
    #[arg(long)]
    pub fuses: bool,
    /// The brown-out level in V [default: 4.3 at 16 MHz and more, 2.7 at 8 MHz]
    #[arg(long, value_enum, value_name = "LEVEL", requires = "fuses")]
    pub bod: Option<Bod>,
    /// Set the fuses without asking
    #[arg(long, requires = "fuses")]
    pub yes: bool,
}

/// Reads the command line; on a wrong word prints what is right and ends with exit code 2.
pub fn parse() -> Command {
    match Cli::try_parse() {
        Ok(cli) => cli.command,
        Err(error) if error.kind() == ErrorKind::InvalidSubcommand => {
            eprintln!("{}", unknown_command(&error));
            std::process::exit(2)
        }
        Err(error) => error.exit(),
    }
}

/// clap suggests a similar word; the list of all words is more helpful.
fn unknown_command(error: &clap::Error) -> String {
    let word = match error.get(ContextKind::InvalidSubcommand) {
        Some(ContextValue::String(word)) => word.as_str(),
        _ => "",
    };
    let command = Cli::command();
    let known: Vec<_> = command
        .get_subcommands()
        .filter(|sub| !sub.is_hide_set())
        .map(clap::Command::get_name)
        .collect();
    format!(
        "error: there is no command '{word}'; the commands are: {}",
        known.join(", ")
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_command_line_is_consistent() {
        Cli::command().debug_assert();
    }

    fn refusal(words: &[&str]) -> clap::Error {
        match Cli::try_parse_from([&["cargo xtask"], words].concat()) {
            Ok(_) => panic!("{words:?} was accepted"),
            Err(error) => error,
        }
    }

    #[test]
    fn a_wrong_command_is_answered_with_all_commands() {
        let text = unknown_command(&refusal(&["biuld"]));
        assert_eq!(
            text,
            "error: there is no command 'biuld'; the commands are: setup, build, sim, demo, test, mutants, flash, bench"
        );
    }

    #[test]
    fn wrong_values_end_with_code_2_and_name_field_value_and_range() {
        for (words, said) in [
            (
                &["build", "nano", "demo-unit", "--unit", "0"][..],
                ["'0'", "--unit", "1..=247"],
            ),
            (
                &["build", "nano", "demo-unit", "--unit", "248"],
                ["'248'", "--unit", "1..=247"],
            ),
            (
                &["build", "nano", "registers", "--count", "129"],
                ["'129'", "--count", "1..=128"],
            ),
            (
                &["build", "nano", "registers", "--clock", "1000000"],
                ["'1000000'", "--clock", "8000000..=20000000"],
            ),
            (
                &["build", "nano", "blink"],
                ["'blink'", "demo-unit", "registers"],
            ),
            (&["build", "uno", "registers"], ["'uno'", "BOARD", "nano"]),
            (&["sim", "bus"], ["'bus'", "demo-unit", "registers"]),
        ] {
            let error = refusal(words);
            let text = error.to_string();
            assert_eq!(error.exit_code(), 2, "{words:?}");
            for part in said {
                assert!(text.contains(part), "{words:?}: {part} not in {text}");
            }
        }
    }
}
