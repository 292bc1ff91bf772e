//! The words and options of the command line, and the answer to wrong ones.

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
    /// Install the compilers, the simulator's libraries and the test programs; say what was done.
    Setup {
        /// Only report what is there and what is missing; exit 1 if something is.
        #[arg(long)]
        check: bool,
    },
    /// Build a firmware image and print the flash and static RAM it takes.
    ///
    /// The last line is `image: PATH`. The .hex file to flash stands beside it.
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
        /// The program.
        name: String,
        /// Of the STM32's board.
        #[arg(long)]
        stm32: bool,
        /// For QEMU.
        #[arg(long, requires = "stm32")]
        qemu: bool,
        /// Baud rate, for those that take one.
        #[arg(long)]
        baud: Option<u32>,
    },
    /// Plant faults in the code and show which of them no test sees; exit 1 if one of the kept list is not.
    ///
    /// A sample of cargo-mutants over protocol, firmware and apps, or what changed since a revision, tested by the tests of the mutated crate;
    /// and the kept list of tests/planted over everything.
    Mutants(MutantsRequest),
    /// Write an image to a board.
    Flash(FlashRequest),
    /// Measure sizes, turnaround, jitter, interrupts, sleep and limits on the simulated bus.
    ///
    /// The STM32's four ports are loaded for ten minutes of bus time, for which the host takes some three.
    Bench {
        /// Write all figures as JSON to this file too.
        #[arg(long, value_name = "PATH")]
        json: Option<PathBuf>,
        /// Keep these figures: `test` fails where they change.
        #[arg(long)]
        record: bool,
        /// Without the ten minutes: what is kept of them is shown, and stays.
        #[arg(long)]
        short: bool,
        /// Only tell how long a client of `sim` waits for an answer, which takes a minute.
        #[arg(long, conflicts_with_all = ["json", "record", "short"])]
        latency: bool,
    },
}

/// Which image: a board, an application, and the options compiled into it.
#[derive(Args)]
pub struct ImageRequest {
    /// The board.
    #[arg(value_enum)]
    pub board: Board,
    /// The application.
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
    /// Baud rate, 300..=1000000 (stm32: 641..=2000000), within 2.5 % of what the clock makes [default: 38400]
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
    /// registers with the guards that every other application has: watchdog, stack guard, bound on DE
    #[arg(long)]
    guarded: bool,
    /// Boot loader of the nano: build takes new and flash old if nothing is said. With old the watchdog is left out
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

/// Which bus, and how long.
#[derive(Args)]
pub struct SimRequest {
    /// The bus to run.
    #[arg(value_enum)]
    pub scenario: Scenario,
    /// The link to the pseudo terminal that is made, and removed at the end.
    #[arg(long, value_name = "PATH", default_value = "./bus")]
    pub link: PathBuf,
    /// End after this many seconds.
    #[arg(long, value_name = "N")]
    pub seconds: Option<u32>,
    /// Send this canned message onto the bus once the nodes listen; a wrong name lists them.
    #[arg(long, value_name = "NAME")]
    pub inject: Option<String>,
    /// Run an STM32 in QEMU: it is not in real time then.
    #[arg(long)]
    pub qemu: bool,
    #[command(flatten)]
    pub line: LineOptions,
}

/// Which image goes where.
#[derive(Args)]
pub struct FlashRequest {
    #[command(flatten)]
    pub image: ImageRequest,
    /// The serial port of the board, or of the programmer; that of the board is found by itself where there is only one.
    #[arg(long, value_name = "TTY")]
    pub port: Option<PathBuf>,
    /// Write the nano without a boot loader, through a programmer that avrdude knows: usbasp, usbtiny, avrisp2,
    /// stk500v1 (an Arduino as programmer), ...
    #[arg(long, value_name = "NAME")]
    pub programmer: Option<String>,
    /// Set the fuses of the nano first: brown-out level, a reset starts the application, EEPROM kept; shown, and asked for
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

/// clap suggests a similar word; a user is better served by all of them.
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
    fn the_definition_is_sound() {
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
