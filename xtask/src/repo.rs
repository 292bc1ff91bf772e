//! Paths in this repository, and calls of its cargo.

use crate::error::Error;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::sync::OnceLock;

/// Files that only the root of a checkout has.
const MARKS: &[&str] = &["xtask/Cargo.toml", "protocol/Cargo.toml"];

/// The packages whose tests run as release builds: the simulated bus is too slow without optimisation. All others are
/// tested as debug builds, with overflow checks.
pub const SIMULATED: [&str; 2] = ["multidrop-bus", "multidrop-tests"];

/// The root of the repository in which the command is called, not of the one in which it was built. A checkout that
/// was copied with its target folder has a command that was built in another one.
///
/// # Panics
/// Outside of a checkout, which [`find_root`] reports before.
pub fn root() -> &'static Path {
    static ROOT: OnceLock<PathBuf> = OnceLock::new();
    ROOT.get_or_init(|| find_root().expect("called in a checkout"))
}

/// Looks for the root from the current folder upwards; then at the package of the cargo that runs the command, for
/// `cargo run --manifest-path`.
///
/// # Errors
/// [`Error::usage`] outside of a checkout.
pub fn find_root() -> Result<PathBuf, Error> {
    let current =
        std::env::current_dir().map_err(|error| Error::io("the current folder", error))?;
    let package = std::env::var_os("CARGO_MANIFEST_DIR").map(PathBuf::from);
    let mut starts = [Some(&current), package.as_ref()].into_iter().flatten();
    let root = starts.find_map(|start| {
        let mut above = start.ancestors();
        above.find(|folder| MARKS.iter().all(|mark| folder.join(mark).is_file()))
    });
    root.map(Path::to_path_buf).ok_or_else(|| {
        Error::usage(format!(
            "{} is not in a checkout of multidrop",
            current.display()
        ))
    })
}

/// The host's cargo: the one that called this program, else the first in PATH.
pub fn cargo() -> Command {
    Command::new(cargo_program())
}

/// The path of that cargo.
pub fn cargo_program() -> PathBuf {
    std::env::var_os("CARGO").map_or_else(|| PathBuf::from("cargo"), PathBuf::from)
}

/// The host's cargo with `arguments`, to be run in the root of the repository.
pub fn cargo_in_root(arguments: &[&str]) -> Command {
    let mut command = cargo();
    command.current_dir(root()).args(arguments);
    command
}

/// Runs `command` to its end, with this program's terminal.
pub fn run(command: &mut Command) -> Result<(), Error> {
    let program = command.get_program().to_string_lossy().into_owned();
    let status = command
        .status()
        .map_err(|error| Error::io(&program, error))?;
    if status.success() {
        Ok(())
    } else {
        Err(Error::failed(format!(
            "{} ended with {status}",
            shown(command)
        )))
    }
}

/// The output of a command, or `None` if the program is missing or fails.
pub fn output_of(command: &mut Command) -> Option<String> {
    let output = command.stdin(std::process::Stdio::null()).output().ok()?;
    output
        .status
        .success()
        .then(|| String::from_utf8_lossy(&output.stdout).trim().to_owned())
}

/// A command as typed in a shell.
pub fn shown(command: &Command) -> String {
    let program = Path::new(command.get_program());
    let mut text = program
        .file_name()
        .unwrap_or(command.get_program())
        .to_string_lossy()
        .into_owned();
    for argument in command.get_args() {
        text.push(' ');
        text.push_str(&argument.to_string_lossy());
    }
    text
}

/// The first program with this name in PATH.
pub fn in_path(name: &str) -> Option<PathBuf> {
    std::env::split_paths(&std::env::var_os("PATH")?)
        .map(|folder| folder.join(name))
        .find(|candidate| is_program(candidate))
}

fn is_program(path: &Path) -> bool {
    use std::os::unix::fs::PermissionsExt;
    path.metadata()
        .is_ok_and(|meta| meta.is_file() && meta.permissions().mode() & 0o111 != 0)
}
