//! `sim`: builds the images of a scenario, then executes the simulated bus in its place.

use crate::cli::SimRequest;
use crate::error::Error;
use crate::firmware::{Builder, purpose_of};
use crate::image::{Board, DEFAULT_BAUD, Format, Image, word};
use crate::needs::Purpose;
use crate::scenario::LineOptions;
use crate::{job, repo, setup};
use std::path::{Path, PathBuf};
use std::process::Command;

/// Builds what is needed and executes the simulated bus in its place; returns only if that fails, or if a signal ends
/// it before. As this program is replaced, the bus gets every later signal itself, and its exit code is that of the
/// command.
///
/// # Errors
/// [`Error::usage`] before anything is built, for a scenario, link or machine that cannot be used.
pub fn run(request: &SimRequest) -> Result<(), Error> {
    job::watch()?;
    match start(request) {
        Err(_) if job::is_stopped() => Ok(()),
        result => result,
    }
}

fn start(request: &SimRequest) -> Result<(), Error> {
    let images = request.scenario.images(request.line, request.qemu)?;
    check_link(&request.link)?;
    let mut purposes = vec![Purpose::Firmware, Purpose::Simulator];
    for image in &images {
        purposes.push(purpose_of(image.board()));
        if image.board() == Board::Stm32 {
            purposes.push(if request.qemu {
                Purpose::Machine
            } else {
                Purpose::Core
            });
        }
    }
    setup::require(&purposes)?;
    let paths = build_images(&images)?;

    let mut bus = program("multidrop-bus", "sim")?;
    bus.arg(word(request.scenario));
    for path in paths {
        bus.arg("--image").arg(path);
    }
    bus.arg("--link").arg(&request.link);
    let LineOptions {
        baud,
        format,
        ascii,
    } = request.line;
    let default = if ascii {
        Format::Bits7Even1
    } else {
        Format::Bits8None1
    };
    bus.arg("--baud")
        .arg(baud.unwrap_or(DEFAULT_BAUD).to_string());
    bus.arg("--format").arg(word(format.unwrap_or(default)));
    if request.qemu {
        bus.arg("--qemu");
    }
    if let Some(seconds) = request.seconds {
        bus.arg("--seconds").arg(seconds.to_string());
    }
    if let Some(name) = &request.inject {
        bus.arg("--inject").arg(name);
    }
    Err(job::become_program(&bus))
}

/// Builds all of `images`.
///
/// # Errors
/// As [`Builder::build`].
pub fn build_images(images: &[Image]) -> Result<Vec<PathBuf>, Error> {
    let builder = Builder::new()?;
    images.iter().map(|image| builder.build(image)).collect()
}

/// The program `name` of `package`, built.
///
/// # Errors
/// As [`job::run`].
pub fn program(package: &str, name: &str) -> Result<Command, Error> {
    let mut cargo = repo::cargo_in_root(&["build", "--quiet", "--release"]);
    cargo.args(["--package", package, "--bin", name]);
    cargo.args(["--message-format", "json-render-diagnostics"]);
    let printed = job::output_of(&mut cargo)?;
    let path = job::executable(&printed)
        .ok_or_else(|| Error::failed(format!("cargo did not print the path of {name}")))?;
    let mut command = Command::new(path);
    // As `cargo run` does: it finds its repository by that.
    command.env("CARGO_MANIFEST_DIR", repo::root());
    Ok(command)
}

/// Refuses a path that cannot be a link of a simulated bus. Only a link that a bus has left is replaced; everything
/// else is the user's. The bus itself knows its links; this check is earlier.
fn check_link(link: &Path) -> Result<(), Error> {
    let refused = |why| {
        Err(Error::usage(format!(
            "--link {}: {why}; choose another path",
            link.display()
        )))
    };
    match link.symlink_metadata() {
        Ok(meta) if !meta.is_symlink() => return refused("it exists and is not a link"),
        Ok(_) if !link.read_link().is_ok_and(|to| to.starts_with("/dev")) => {
            return refused("it is a link which no sim has made");
        }
        _ => {}
    }
    // The folder of a bare name is the current one, which is given as an empty path.
    match link.parent() {
        Some(folder) if !Path::new(".").join(folder).is_dir() => {
            refused("its folder does not exist")
        }
        None => refused("it names no file"),
        _ => Ok(()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_file_in_the_place_of_the_link_is_refused() {
        let error = check_link(repo::root()).expect_err("a folder");
        assert_eq!(error.code(), 2);
        assert!(error.message().contains("is not a link"));
        let error = check_link(Path::new("no/such/link")).expect_err("no folder");
        assert!(error.message().contains("its folder does not exist"));
        for free in ["free", "./free", "/free", "../free"] {
            assert!(check_link(Path::new(free)).is_ok(), "{free}");
        }
    }
}
