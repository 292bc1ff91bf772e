//! The buses that can be run, and the images of their nodes.

use crate::error::Error;
use crate::image::{App, Board, Format, Image, Options, word, words};
use clap::{Args, ValueEnum};

/// A bus that can be run.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum Scenario {
    /// Three Nanos with the unit ids 1, 2, 3
    DemoUnit,
    /// One Nano with `registers`
    Registers,
    /// A Nano that is a client and one that is its server; the pseudo terminal only listens
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

    /// The images of the nodes, in the order of their places on the bus; for QEMU if `qemu` and the node is an STM32.
    ///
    /// # Errors
    /// [`Error::usage`] for a scenario that is not in this version, and for options of the line that the scenario
    /// does not have.
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

/// The line of a scenario whose image can be built for several.
#[derive(Args, Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct LineOptions {
    /// Baud rate of nano-conformance, as for build [default: 38400]
    #[arg(long, value_name = "N")]
    pub baud: Option<u32>,
    /// Character format of nano-conformance [default: 8N1, 7E1 for ASCII]
    #[arg(long, value_enum, ignore_case = true)]
    pub format: Option<Format>,
    /// nano-conformance in ASCII
    #[arg(long)]
    pub ascii: bool,
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
}
