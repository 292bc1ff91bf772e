//! `sim`: builds the images of a scenario, then becomes the simulated bus.

use crate::cli::{LineOptions, SimRequest};
use crate::error::Error;
use crate::firmware::{Builder, purpose_of};
use crate::image::{App, Board, DEFAULT_BAUD, Format, Image, Options, word, words};
use crate::needs::Purpose;
use crate::{job, repo, setup};
use clap::ValueEnum;
use std::path::{Path, PathBuf};
use std::process::Command;

/// A bus that can be run.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum Scenario {
    /// Three Nanos with the unit ids 1, 2, 3
    DemoUnit,
    /// One Nano
    Registers,
    /// A Nano that is a client and one that is its server; the pseudo terminal listens in
    RelayPanel,
    /// Every function on a Nano, unit 17
    NanoConformance,
    /// A Nano that is a client; the pseudo terminal is for a server
    #[value(hide = true)]
    ClientFunctions,
    /// Every function on an STM32, unit 17, on RS4
    Stm32Conformance,
    /// The sensor-node protocol
    #[value(hide = true)]
    SensorNodes,
    /// An STM32 with four ports, master of three Nanos on RS4; the pseudo terminal is on AS1
    Mixed,
}

impl Scenario {
    /// Those that can be run.
    const BUILT: [Self; 7] = [
        Self::DemoUnit,
        Self::Registers,
        Self::NanoConformance,
        Self::Stm32Conformance,
        Self::RelayPanel,
        Self::ClientFunctions,
        Self::Mixed,
    ];

    /// The images of the nodes, in the order of their places on the bus; those of an STM32 for QEMU if `qemu`.
    ///
    /// # Errors
    /// [`Error::usage`] for a scenario that is not in this version, and for options of the line that it does not
    /// have.
    pub fn images(self, line: LineOptions, qemu: bool) -> Result<Vec<Image>, Error> {
        if !Self::BUILT.contains(&self) {
            return Err(Error::usage(format!(
                "the scenario {} is not in this version; the scenarios are: {}",
                word(self),
                words(Self::BUILT)
            )));
        }
        let lined = matches!(
            self,
            Self::NanoConformance | Self::Stm32Conformance | Self::ClientFunctions
        );
        if !lined && line != LineOptions::default() {
            return Err(Error::usage(format!(
                "--baud, --format, --ascii: the line of {} is 38400 8N1, RTU; only nano-conformance and \
                 stm32-conformance take these options",
                word(self)
            )));
        }
        let has_stm32 = matches!(self, Self::Stm32Conformance | Self::Mixed);
        if qemu && !has_stm32 {
            return Err(Error::usage(format!(
                "--qemu: {} has no STM32; stm32-conformance and mixed have one",
                word(self)
            )));
        }
        let options = Options {
            baud: line.baud,
            format: line.format,
            ascii: line.ascii,
            ..Options::default()
        };
        let nano = |app, options| Image::new(Board::Nano, app, options);
        match self {
            Self::DemoUnit => [1, 2, 3]
                .into_iter()
                .map(|unit| {
                    let unit = Some(unit);
                    nano(App::DemoUnit, Options { unit, ..options })
                })
                .collect(),
            Self::Mixed => {
                let mut images = Self::DemoUnit.images(line, false)?;
                images.push(Image::new(
                    Board::Stm32,
                    App::Ports,
                    Options { qemu, ..options },
                )?);
                Ok(images)
            }
            Self::RelayPanel => [App::RelayPanel, App::RelayBoard]
                .into_iter()
                .map(|app| nano(app, options))
                .collect(),
            Self::NanoConformance => Ok(vec![nano(App::Conformance, options)?]),
            Self::Stm32Conformance => {
                let options = Options { qemu, ..options };
                Ok(vec![Image::new(Board::Stm32, App::Conformance, options)?])
            }
            Self::ClientFunctions => Ok(vec![nano(App::ClientFunctions, options)?]),
            _ => Ok(vec![nano(App::Registers, options)?]),
        }
    }
}

/// Builds what is needed and becomes the simulated bus; comes back only if that fails, or if a signal ends it before. Being
/// replaced, not waited for, the bus gets every later signal itself and its exit code is ours.
///
/// # Errors
/// [`Error::usage`] before anything is built, for a scenario, link or machine that will not do.
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
        .ok_or_else(|| Error::failed(format!("cargo does not say where {name} is")))?;
    let mut command = Command::new(path);
    // As `cargo run` does: it finds its repository by that.
    command.env("CARGO_MANIFEST_DIR", repo::root());
    Ok(command)
}

/// A link is only made in place of one that a simulated bus has left: whatever else stands there is the user's. Only the bus
/// knows its links; this says early what cannot be one of them.
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
            return refused("it is a link which no sim made");
        }
        _ => {}
    }
    // The folder of a bare name is the current one, which is given as an empty path.
    match link.parent() {
        Some(folder) if !Path::new(".").join(folder).is_dir() => refused("its folder is not there"),
        None => refused("it names no file"),
        _ => Ok(()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_scenario_has_its_images_or_says_that_it_is_not_there_yet() {
        let stems = |scenario: Scenario| -> Vec<_> {
            let images = scenario
                .images(LineOptions::default(), false)
                .expect("in this version");
            images.iter().map(Image::stem).collect()
        };
        assert_eq!(
            stems(Scenario::DemoUnit),
            [
                "nano-demo-unit-unit1",
                "nano-demo-unit-unit2",
                "nano-demo-unit-unit3"
            ]
        );
        assert_eq!(stems(Scenario::Registers), ["nano-registers"]);
        assert_eq!(
            stems(Scenario::RelayPanel),
            ["nano-relay-panel", "nano-relay-board"]
        );
        assert_eq!(
            stems(Scenario::Mixed),
            [
                "nano-demo-unit-unit1",
                "nano-demo-unit-unit2",
                "nano-demo-unit-unit3",
                "stm32-ports"
            ]
        );
        let error = Scenario::SensorNodes.images(LineOptions::default(), false);
        let error = error.expect_err("not there yet");
        assert_eq!(error.code(), 2);
        let said = "sensor-nodes is not in this version";
        assert!(error.message().contains(said));
    }

    #[test]
    fn only_a_scenario_with_variants_takes_a_line() {
        let line = LineOptions {
            baud: Some(19_200),
            format: None,
            ascii: true,
        };
        let images = Scenario::NanoConformance
            .images(line, false)
            .expect("it has variants");
        assert_eq!(images[0].stem(), "nano-conformance-baud19200-ascii");
        let error = Scenario::Registers
            .images(line, false)
            .expect_err("it has none");
        assert_eq!(error.code(), 2);
        let said = "the line of registers is 38400 8N1, RTU; only nano-conformance and";
        assert!(error.message().contains(said), "{}", error.message());
    }

    #[test]
    fn a_file_in_the_place_of_the_link_is_refused() {
        let error = check_link(repo::root()).expect_err("a folder");
        assert_eq!(error.code(), 2);
        assert!(error.message().contains("is not a link"));
        let error = check_link(Path::new("no/such/link")).expect_err("no folder");
        assert!(error.message().contains("its folder is not there"));
        for free in ["free", "./free", "/free", "../free"] {
            assert!(check_link(Path::new(free)).is_ok(), "{free}");
        }
    }
}
