//! `bench`: builds images as they are flashed, those of the STM32 for QEMU too, and measures them on the simulated bus.

use crate::error::Error;
use crate::firmware::Builder;
use crate::image::{App, Board, Image, Options, word};
use crate::needs::Purpose;
use crate::scenario::{LineOptions, Scenario};
use crate::sim::program;
use crate::toolchain::Toolchain;
use crate::{python, repo, setup, size};
use std::path::{Path, PathBuf};
use std::process::Command;

/// Items in each table.
const COUNTS: [u8; 2] = [16, 128];

/// The two bauds that are measured in full, and all at which requests must not be lost.
const BAUDS: [u32; 6] = [38_400, 57_600, 115_200, 250_000, 500_000, 1_000_000];

/// Items in each table, and the bauds, of the STM32 in QEMU.
const STM32_COUNT: u8 = 128;
const STM32_BAUDS: [u32; 5] = [38_400, 115_200, 500_000, 1_000_000, 2_000_000];

/// The example of the Nano's HAL that waits for edges on port D beside its server.
const EDGES: &str = "port_d";

/// The units that the long run of the STM32's four ports has behind one of them.
const UNITS: [u8; 3] = [1, 2, 3];

/// Where the figures are shown, from the root of the repository.
const GUIDE: &str = "docs/src/figures.md";

/// The file of the kept figures of the server on the host.
const KEPT_HOST: &str = "figures/host.json";

/// Measures and prints the table.
///
/// # Errors
/// [`Error::usage`] before anything is built, when something is missing; else what failed.
pub fn run(json: Option<&Path>, record: bool, short: bool) -> Result<(), Error> {
    if let Some(json) = json {
        check_json(json)?;
    }
    // One of the programs runs in another folder.
    let absolute = |path| std::path::absolute(path).map_err(|error| Error::io("--json", error));
    let json = json.map(absolute).transpose()?;
    setup::require(&[
        Purpose::Firmware,
        Purpose::Avr,
        Purpose::Arm,
        Purpose::Simulator,
        Purpose::Machine,
        Purpose::Core,
        Purpose::Profiler,
    ])?;
    let builder = Builder::new()?;
    let mut nano = measured(&builder, Board::Nano)?;
    let mut stm32 = measured(&builder, Board::Stm32)?;
    let mut speed =
        repo::cargo_in_root(&["bench", "--quiet", "--package", HOST, "--bench", "server"]);
    speed.args(["--", "--noplot", "--quiet"]);
    let criterion = repo::root().join("target/host-criterion");
    speed.env("CRITERION_HOME", &criterion);
    let mut host = on_host();
    host.arg("--criterion").arg(criterion);
    if short {
        stm32.arg("--short");
    }
    // The others add to the file of the first.
    for command in [&mut nano, &mut stm32, &mut host] {
        if let Some(json) = &json {
            command.arg("--json").arg(json);
        }
        if record {
            command.arg("--record");
        }
    }
    repo::run(&mut nano)?;
    repo::run(&mut stm32)?;
    repo::run(&mut speed)?;
    repo::run(&mut host)?;
    repo::run(&mut latency(&builder)?)
}

/// Shows how long a client of `sim` waits, and measures nothing else.
///
/// # Errors
/// As [`run`].
pub fn tell_latency() -> Result<(), Error> {
    setup::require(&[
        Purpose::Firmware,
        Purpose::Avr,
        Purpose::Arm,
        Purpose::Simulator,
        Purpose::Core,
    ])?;
    repo::run(&mut latency(&Builder::new()?)?)
}

/// The command that measures how long a client of `sim` waits: by wall-clock time, so the figure is not kept.
fn latency(builder: &Builder) -> Result<Command, Error> {
    let mut latency = program("multidrop-tests", "latency")?;
    let root = repo::root();
    latency.arg("--python").arg(python::interpreter());
    latency
        .arg("--client")
        .arg(root.join("tests/python/latency.py"));
    latency
        .arg("--sim")
        .arg(program("multidrop-bus", "sim")?.get_program());
    latency.arg("--image");
    for scenario in [
        Scenario::Registers,
        Scenario::Stm32Conformance,
        Scenario::Mixed,
    ] {
        for image in scenario.images(LineOptions::default(), false)? {
            latency.arg(builder.build(&image)?);
        }
    }
    Ok(latency)
}

/// The package that measures the server on the host.
pub const HOST: &str = "multidrop-host-bench";

/// The command that counts the instructions of the server on the host.
fn on_host() -> Command {
    let arguments = ["run", "--quiet", "--release", "--package", HOST];
    let mut host = repo::cargo_in_root(&arguments);
    let compiler = repo::output_of(Command::new("rustc").arg("--version"));
    let compiler = compiler.unwrap_or_else(|| "an unknown compiler".to_owned());
    host.args(["--", "measure", "--compiler"]);
    host.arg(format!("{compiler}, {}", std::env::consts::ARCH));
    host.arg("--kept").arg(repo::root().join(KEPT_HOST));
    host
}

/// Checks the figures of the server on the host, as [`check`] does those of the boards.
pub fn check_on_host() -> Command {
    let mut host = on_host();
    host.arg("--check");
    host
}

/// Checks the path before the measurements.
fn check_json(path: &Path) -> Result<(), Error> {
    let refused = |why| {
        Err(Error::usage(format!(
            "--json {}: {why}; choose another path",
            path.display()
        )))
    };
    // The folder of a bare name is the current one, which is given as an empty path.
    match path.parent() {
        _ if path.is_dir() => refused("it is a folder"),
        Some(folder) if !Path::new(".").join(folder).is_dir() => {
            refused("its folder does not exist")
        }
        _ => Ok(()),
    }
}

/// The command that measures, fails where a figure is not the kept one or a goal is missed, and ends with
/// the counts of these checks as Rust's test harness prints them.
///
/// # Errors
/// When an image cannot be built.
pub fn check(builder: &Builder, board: Board) -> Result<Command, Error> {
    let mut bench = measured(builder, board)?;
    bench.arg("--check");
    Ok(bench)
}

fn measured(builder: &Builder, board: Board) -> Result<Command, Error> {
    let mut bench = program("multidrop-tests", "bench")?;
    let (images, flashed) = match board {
        Board::Nano => (images()?, Vec::new()),
        Board::Stm32 => (machine_images()?, flashed_images()?),
    };
    bench.arg("--board").arg(word(board));
    bench.arg("--compiler");
    bench.arg(compiler(builder.toolchain(), board));
    let kept = format!("figures/{}.json", word(board));
    bench.arg("--kept").arg(near(&kept));
    bench.arg("--guide").arg(near(GUIDE));
    for (option, images) in [("--image", images), ("--flashed", flashed)] {
        for (name, image) in images {
            let elf = builder.build(&image)?;
            let size::Size { flash, ram } = size::of(&elf)?;
            bench.arg(option);
            bench.arg(format!("{name}:{flash}:{ram}:{}", elf.display()));
        }
    }
    if board == Board::Nano {
        for baud in BAUDS {
            let elf = builder.example(board, false, EDGES, Some(baud))?;
            let elf = repo::root().join(elf);
            let size::Size { flash, ram } = size::of(&elf)?;
            bench.arg("--image");
            bench.arg(format!("{EDGES}:16:{baud}:{flash}:{ram}:{}", elf.display()));
        }
    }
    Ok(bench)
}

/// A file of the repository as the caller would name it, because it is printed.
fn near(path: &str) -> PathBuf {
    match std::env::current_dir() {
        Ok(folder) if folder == repo::root() => PathBuf::from(path),
        _ => repo::root().join(path),
    }
}

/// The images of the STM32 that are flashed.
fn flashed_images() -> Result<Vec<(String, Image)>, Error> {
    let apps = Board::Stm32.apps().iter();
    apps.map(|&app| {
        let image = Image::new(Board::Stm32, app, Options::default())?;
        Ok((format!("{}:16:38400", image.app()), image))
    })
    .collect()
}

/// The images that QEMU runs, and those of the Nanos beside it.
fn machine_images() -> Result<Vec<(String, Image)>, Error> {
    let qemu = Options {
        qemu: true,
        ..Options::default()
    };
    let ports = Image::new(Board::Stm32, App::Ports, qemu)?;
    let mut images = vec![("ports:16:38400".to_owned(), ports)];
    for baud in STM32_BAUDS {
        let options = Options {
            count: Some(STM32_COUNT),
            baud: (baud != 38_400).then_some(baud),
            ..qemu
        };
        let image = Image::new(Board::Stm32, App::Registers, options)?;
        images.push((format!("registers:{STM32_COUNT}:{baud}"), image));
    }
    for unit in UNITS {
        let options = Options {
            unit: Some(unit),
            ..Options::default()
        };
        let image = Image::new(Board::Nano, App::DemoUnit, options)?;
        images.push((format!("unit{unit}:1:38400"), image));
    }
    Ok(images)
}

/// Each image with application, count and baud, for the options of `bench`.
fn images() -> Result<Vec<(String, Image)>, Error> {
    let demo = Image::new(Board::Nano, App::DemoUnit, Options::default())?;
    let mut images = vec![("demo-unit:1:38400".to_owned(), demo)];
    for (name, app) in [
        ("conformance:128:38400", App::Conformance),
        ("client-functions:1:38400", App::ClientFunctions),
    ] {
        let image = Image::new(Board::Nano, app, Options::default())?;
        images.push((name.to_owned(), image));
    }
    let guarded = Options {
        guarded: true,
        ..Options::default()
    };
    let image = Image::new(Board::Nano, App::Registers, guarded)?;
    images.push(("registers-guarded:16:38400".to_owned(), image));
    for count in COUNTS {
        for baud in BAUDS {
            // The application's own settings are not given as options, so that these are the images that others build
            // too.
            let options = Options {
                count: (count != 16).then_some(count),
                baud: (baud != 38_400).then_some(baud),
                ..Options::default()
            };
            let image = Image::new(Board::Nano, App::Registers, options)?;
            images.push((format!("registers:{count}:{baud}"), image));
        }
    }
    Ok(images)
}

/// What decides over the machine code: compiler and code generator, and the C compiler whose library holds
/// the arithmetic, or the QEMU that tells when an interrupt is taken. Not where they come from, and of LLVM's version not the last part: rustup's build of the release
/// holds 22.1.2, Debian's 22.1.8, and their images measure the same in every figure.
fn compiler(toolchain: &Toolchain, board: Board) -> String {
    let version = toolchain.version();
    let field = |name: &str| {
        version
            .lines()
            .find_map(|line| line.strip_prefix(name))
            .unwrap_or("unknown")
    };
    let llvm: Vec<&str> = field("LLVM version: ").split('.').take(2).collect();
    let gcc = || repo::output_of(Command::new("avr-gcc").arg("-dumpversion"));
    let beside = match board {
        Board::Nano => format!("avr-gcc {}", gcc().as_deref().unwrap_or("unknown")),
        Board::Stm32 => format!("QEMU {}", qemu().as_deref().unwrap_or("unknown")),
    };
    format!(
        "rustc {} ({:.9}), LLVM {}, {beside}",
        field("release: "),
        field("commit-hash: "),
        llvm.join("."),
    )
}

/// The version of QEMU, without the last part.
fn qemu() -> Option<String> {
    let told = repo::output_of(Command::new("qemu-system-arm").arg("--version"))?;
    let version = told.split_whitespace().nth(3)?;
    let parts: Vec<_> = version.split('.').take(2).collect();
    Some(parts.join("."))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_json_file_that_cannot_be_is_refused_before_anything_is_measured() {
        let here = repo::root();
        for (path, why) in [
            (here.to_owned(), "it is a folder"),
            (here.join("no/such/file.json"), "its folder does not exist"),
        ] {
            let error = check_json(&path).expect_err("refused");
            assert_eq!(error.code(), 2);
            assert!(error.message().contains(why), "{}", error.message());
        }
        for good in [Path::new("figures.json"), &here.join("figures.json")] {
            assert!(check_json(good).is_ok(), "{}", good.display());
        }
    }

    #[test]
    fn every_image_that_is_measured_can_be_built_and_is_one_of_its_kind() {
        let images = images().expect("valid images");
        // Three applications, the yardstick with its guards, and the yardsticks.
        assert_eq!(images.len(), 4 + COUNTS.len() * BAUDS.len());
        let stems: std::collections::BTreeSet<_> =
            images.iter().map(|(_, image)| image.stem()).collect();
        assert_eq!(stems.len(), images.len());
        let stm32 = [
            machine_images().expect("valid"),
            flashed_images().expect("valid"),
        ]
        .concat();
        let stems: std::collections::BTreeSet<_> =
            stm32.iter().map(|(_, image)| image.stem()).collect();
        assert_eq!(stems.len(), stm32.len());
    }
}
