//! `test`: every check and test of the repository, counted on the last line.

use crate::error::Error;
use crate::firmware::{Builder, collect_files};
use crate::image::{App, Board, Format, Image, Options};
use crate::needs::Purpose;
use crate::repo::SIMULATED;
use crate::scenario::{LineOptions, Scenario};
use crate::tally::{Counts, Tally};
use crate::{bench, front, guide, layers, layout, mutants, package, python, repo, setup, words};
use std::io::{BufRead, BufReader};
use std::process::{Command, Stdio};

/// The stream to which a tool prints its summary.
enum Summary {
    Rust,
    Python,
}

/// Sets up, runs everything, and prints `N passed, N failed` last.
///
/// # Errors
/// Exit code 1 when anything failed.
pub fn run() -> Result<(), Error> {
    let mut tally = Tally::default();
    let purposes = [
        Purpose::Firmware,
        Purpose::Avr,
        Purpose::Arm,
        Purpose::Simulator,
        Purpose::Machine,
        Purpose::Core,
        Purpose::Client,
        Purpose::Profiler,
        Purpose::Checks,
    ];
    match setup::prepare(&purposes) {
        Ok(()) => run_all(&mut tally),
        Err(error) => {
            println!("{}", error.message());
            tally.check("setup", false);
        }
    }
    println!("\n{tally}");
    if tally.is_good() {
        Ok(())
    } else {
        Err(Error::silent(1))
    }
}

fn run_all(tally: &mut Tally) {
    let mut host_format = repo::cargo_in_root(&["fmt", "--all", "--check"]);
    check(tally, "format of the host's crates", &mut host_format);
    check_board_format(tally);

    // As a release build: the simulator's C sources are then compiled once, not twice.
    let lint = ["clippy", "--release", "--workspace", "--all-targets"];
    let mut host_lint = repo::cargo_in_root(&[&lint[..], &["--", "-D", "warnings"]].concat());
    check(tally, "clippy of the host's crates", &mut host_lint);

    headline("how the repository is divided");
    layout::run(tally);
    layers::run(tally);

    headline("README, guide and API documentation");
    guide::run(tally);
    front::run(tally);
    words::run(tally);

    let builder = Builder::new();
    match &builder {
        Ok(builder) => {
            let stm32 = ["--workspace", "--no-default-features", "--features", "qemu"];
            for (name, board, options) in [
                (
                    "clippy of the Nano's crates",
                    Board::Nano,
                    &["--workspace"][..],
                ),
                (
                    "clippy of the STM32's crates",
                    Board::Stm32,
                    &["--workspace"],
                ),
                (
                    "clippy of the STM32's crates for QEMU",
                    Board::Stm32,
                    &stm32,
                ),
                (
                    "clippy of the STM32's crate with defmt",
                    Board::Stm32,
                    &["--features", "defmt"],
                ),
            ] {
                let mut lint = builder.toolchain().cargo_in_board(board);
                lint.args(["clippy", "--release", "--target-dir"])
                    .arg(repo::root().join(board.target_dir()))
                    .args(options)
                    .args(["--", "-D", "warnings"]);
                check(tally, name, &mut lint);
            }
            for image in all_images() {
                headline(&image.stem());
                let built = builder.build(&image);
                if let Err(error) = &built {
                    println!("{}", error.message());
                }
                tally.check(&image.stem(), built.is_ok());
            }
        }
        Err(error) => {
            println!("{}", error.message());
            tally.check("firmware compiler", false);
        }
    }

    let mut units = repo::cargo_in_root(&["test", "--no-fail-fast", "--workspace"]);
    for package in SIMULATED.into_iter().chain([bench::HOST]) {
        units.args(["--exclude", package]);
    }
    run_tests(tally, "tests of the host's crates", units, Summary::Rust);
    package::run(tally, builder.as_ref().ok().map(Builder::toolchain));
    let name = "corpus of the fuzz targets";
    run_tests(tally, name, crate::fuzz::replay(), Summary::Rust);
    for (name, mut command) in crate::fuzz::checks() {
        check(tally, &name, &mut command);
    }
    headline("planted faults that tests on the host must see");
    let seen = mutants::plant_on_host();
    match &seen {
        Ok(count) => println!("{count} caught"),
        Err(error) => println!("{}", error.message()),
    }
    tally.check("planted faults", seen.is_ok());
    println!("{}", mutants::summary());
    let mut bus = repo::cargo_in_root(&["test", "--no-fail-fast", "--release"]);
    for package in SIMULATED {
        bus.args(["--package", package]);
    }
    run_tests(tally, "tests on the simulated bus", bus, Summary::Rust);

    if let Ok(builder) = &builder {
        for (name, board) in [
            ("figures and goals of the Nano", Board::Nano),
            ("figures and goals of the STM32", Board::Stm32),
        ] {
            match bench::check(builder, board) {
                Ok(command) => run_tests(tally, name, command, Summary::Rust),
                Err(error) => {
                    println!("{}", error.message());
                    tally.check(name, false);
                }
            }
        }
    }

    let name = "figures of the server on the host";
    run_tests(tally, name, bench::check_on_host(), Summary::Rust);

    let mut clients = Command::new(python::interpreter());
    clients
        .current_dir(repo::root())
        .env("PYTHONDONTWRITEBYTECODE", "1")
        .env("CARGO", repo::cargo_program())
        .args(["-m", "unittest", "discover", "-v", "-s", "tests/python"]);
    run_tests(tally, "clients in Python", clients, Summary::Python);
}

/// All images that a test or scenario uses.
fn all_images() -> Vec<Image> {
    let registers = |options: Options| Image::new(Board::Nano, App::Registers, options);
    let variants = [
        Options {
            count: Some(128),
            ..Options::default()
        },
        Options {
            baud: Some(115_200),
            ..Options::default()
        },
        Options {
            format: Some(Format::Bits8Even1),
            ..Options::default()
        },
    ];
    let mut images = Vec::new();
    images.extend(Image::new(Board::Nano, App::DemoUnit, Options::default()));
    let ascii = LineOptions {
        ascii: true,
        ..LineOptions::default()
    };
    for (scenario, line) in [
        (Scenario::DemoUnit, LineOptions::default()),
        (Scenario::Registers, LineOptions::default()),
        (Scenario::RelayPanel, LineOptions::default()),
        (Scenario::NanoConformance, LineOptions::default()),
        (Scenario::NanoConformance, ascii),
        (Scenario::Stm32Conformance, LineOptions::default()),
        (Scenario::Mixed, LineOptions::default()),
        (Scenario::ClientFunctions, LineOptions::default()),
        (Scenario::ClientFunctions, ascii),
    ] {
        images.extend(scenario.images(line, false).expect("in this version"));
    }
    images.extend(variants.map(|options| registers(options).expect("a valid image")));
    for qemu in [false, true] {
        let options = Options {
            qemu,
            ..Options::default()
        };
        let stm32 = Board::Stm32.apps().iter();
        images.extend(stm32.map(|&app| {
            Image::new(Board::Stm32, app, options).expect("an application of the board")
        }));
    }
    images
}

/// rustfmt itself, on every file: the board's cargo wants a compiler that may bring no rustfmt.
fn check_board_format(tally: &mut Tally) {
    let mut files = Vec::new();
    let boards = [Board::Nano, Board::Stm32].map(Board::folder);
    let listed = boards
        .iter()
        .chain(&["tests/nano", "tests/stm32"])
        .try_for_each(|folder| collect_files(&repo::root().join(folder), &mut files));
    files.retain(|file| file.extension().is_some_and(|extension| extension == "rs"));
    let mut rustfmt = Command::new("rustfmt");
    rustfmt
        .current_dir(repo::root())
        .args(["--edition", "2024", "--check"])
        .args(&files);
    if listed.is_ok() && !files.is_empty() {
        check(tally, "format of the board's crates", &mut rustfmt);
    } else {
        tally.check("format of the board's crates", false);
    }
}

fn headline(name: &str) {
    println!("\n== {name}");
}

fn check(tally: &mut Tally, name: &str, command: &mut Command) {
    headline(name);
    let outcome = repo::run(command);
    if let Err(error) = &outcome {
        println!("{}", error.message());
    }
    tally.check(name, outcome.is_ok());
}

/// Runs a tool, shows its output at once, and counts by its summary.
fn run_tests(tally: &mut Tally, name: &str, mut command: Command, summary: Summary) {
    headline(name);
    match summary {
        Summary::Rust => command.stdout(Stdio::piped()),
        Summary::Python => command.stderr(Stdio::piped()),
    };
    let mut child = match command.spawn() {
        Ok(child) => child,
        Err(error) => {
            println!("{}: {error}", repo::shown(&command));
            return tally.check(name, false);
        }
    };
    let mut counts = Counts::default();
    match summary {
        Summary::Rust => echo(child.stdout.take(), |line| counts.take_rust(line)),
        Summary::Python => echo(child.stderr.take(), |line| counts.take_python(line)),
    }
    let succeeded = child.wait().is_ok_and(|status| status.success());
    tally.tool(name, succeeded, counts);
}

fn echo(stream: Option<impl std::io::Read>, mut take: impl FnMut(&str)) {
    let Some(stream) = stream else { return };
    let mut reader = BufReader::new(stream);
    let mut line = Vec::new();
    // Bytes, not text: a test may print anything, and must not end the count.
    while reader
        .read_until(b'\n', &mut line)
        .is_ok_and(|read| read > 0)
    {
        let text = String::from_utf8_lossy(&line);
        print!("{text}");
        take(text.trim_end());
        line.clear();
    }
}
