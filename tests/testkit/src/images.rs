//! Firmware images, built from the sources as they are now.

use std::collections::HashMap;
use std::path::PathBuf;
use std::process::Command;
use std::sync::{Mutex, OnceLock, PoisonError};

use multidrop_bus::{Format, Line};

use super::conforms::Board;
use super::plain::wire::Way;
use super::{LINE, Runner};

/// Results of builds, made once in each process.
type Built = Mutex<HashMap<String, PathBuf>>;

fn once(key: String, build: impl FnOnce() -> PathBuf) -> PathBuf {
    static BUILT: OnceLock<Built> = OnceLock::new();
    // Held while building, so that two tests do not build the same image.
    let mut built = BUILT
        .get_or_init(Default::default)
        .lock()
        .unwrap_or_else(PoisonError::into_inner);
    built.entry(key).or_insert_with(build).clone()
}

fn root() -> PathBuf {
    multidrop_bus::repository().expect("the test is run by cargo, in the repository")
}

fn run(command: &mut Command) -> String {
    let output = command
        .output()
        .unwrap_or_else(|error| panic!("{command:?}: {error}"));
    let text = String::from_utf8_lossy(&output.stdout).into_owned();
    assert!(
        output.status.success(),
        "{command:?}\n{text}{}",
        String::from_utf8_lossy(&output.stderr)
    );
    text
}

/// What an xtask command has built: the path on its last line.
fn built(arguments: &[&str]) -> PathBuf {
    let cargo = std::env::var_os("CARGO").unwrap_or_else(|| "cargo".into());
    let text = run(Command::new(cargo)
        .current_dir(root())
        .arg("xtask")
        .args(arguments));
    let path = text
        .lines()
        .last()
        .and_then(|line| line.strip_prefix("image: "))
        .unwrap_or_else(|| panic!("no path in {text}"));
    root().join(path)
}

/// The image of a Nano's application, as `cargo xtask build nano APP OPTIONS` makes it.
pub fn image(app: &str, options: &[&str]) -> PathBuf {
    board_image("nano", app, options)
}

fn board_image(board: &str, app: &str, options: &[&str]) -> PathBuf {
    once(format!("{board} {app} {}", options.join(" ")), || {
        built(&[&["build", board, app], options].concat())
    })
}

/// The `registers` image with `count` items in each table, for `line`.
pub fn registers(count: u8, line: Line) -> PathBuf {
    let count = count.to_string();
    let mut options = Vec::new();
    if count != "16" {
        options.extend(["--count", &count]);
    }
    for_line("nano", "registers", options, line, LINE)
}

/// The `conformance` image of a board for `line`.
pub fn conformance(board: Board, way: Way, line: Line) -> PathBuf {
    let (default, ascii) = match way {
        Way::Rtu => (LINE, None),
        Way::Ascii => {
            let format = Format::E71;
            (Line { format, ..LINE }, Some("--ascii"))
        }
    };
    let (name, qemu) = match board {
        Board::Nano => ("nano", None),
        Board::Stm32(runner) => ("stm32", runner.option()),
    };
    let fixed = ascii.into_iter().chain(qemu).collect();
    for_line(name, "conformance", fixed, line, default)
}

/// The image of `ports`.
pub fn ports(runner: Runner) -> PathBuf {
    board_image("stm32", "ports", runner.option().as_slice())
}

/// With what differs from the line that the application has by itself.
fn for_line(board: &str, app: &str, options: Vec<&str>, line: Line, default: Line) -> PathBuf {
    let mut options = options;
    let (baud, format) = (line.baud.to_string(), line.format.to_string());
    if line.baud != default.baud {
        options.extend(["--baud", &baud]);
    }
    if line.format != default.format {
        options.extend(["--format", &format]);
    }
    board_image(board, app, &options)
}

/// The image of an example of the HAL.
pub fn example(name: &str) -> PathBuf {
    once(format!("example {name}"), || built(&["example", name]))
}

/// The image of an example at this rate.
pub fn example_at(name: &str, baud: u32) -> PathBuf {
    let baud = baud.to_string();
    once(format!("example {name} {baud}"), || {
        built(&["example", name, "--baud", &baud])
    })
}

/// The image of an example of the STM32's board, at this rate.
pub fn stm32_example(runner: Runner, name: &str, baud: u32) -> PathBuf {
    let baud = baud.to_string();
    let mut arguments = vec!["example", name, "--stm32", "--baud", &baud];
    arguments.extend(runner.option());
    once(arguments.join(" "), || built(&arguments))
}

/// The `registers` image of the STM32.
pub fn stm32_registers(runner: Runner) -> PathBuf {
    stm32_registers_at(runner, LINE)
}

/// The image of the application `registers` for `line`.
pub fn stm32_registers_at(runner: Runner, line: Line) -> PathBuf {
    let options = runner.option().into_iter().collect();
    for_line("stm32", "registers", options, line, LINE)
}

/// The `registers` image of the Nano for `line`, with guards.
pub fn guarded(count: u8, line: Line) -> PathBuf {
    let count = count.to_string();
    let mut options = vec!["--guarded"];
    if count != "16" {
        options.extend(["--count", &count]);
    }
    for_line("nano", "registers", options, line, LINE)
}

/// The image of a unit that fails while it answers, at this rate.
pub fn faults(board: Board, line: Line) -> PathBuf {
    let (name, fixed) = match board {
        Board::Nano => ("nano", vec![]),
        Board::Stm32(runner) => ("stm32", runner.option().into_iter().collect()),
    };
    for_line(name, "faults", fixed, line, LINE)
}
