//! What differs between the boards: what is measured, which goals there are, and where the figures are shown.

use clap::ValueEnum;

use crate::figures::Figures;
use crate::goals::{self, Goal};
use crate::table::{self, Table};
use crate::{Arguments, Trouble, measure, stm32};

/// A board whose firmware is measured.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum Board {
    /// ATmega328P in simavr
    Nano,
    /// STM32F405 in QEMU
    Stm32,
}

impl Board {
    /// Measures all figures of the board.
    pub fn measure(self, arguments: &Arguments) -> Result<Figures, Trouble> {
        match self {
            Board::Nano => {
                let mut figures = Figures::new(&arguments.compiler, 16_000_000);
                measure::all(&arguments.images(), &mut figures)?;
                Ok(figures)
            }
            Board::Stm32 => stm32::measure(arguments),
        }
    }

    /// The table of the board.
    pub fn table(self) -> Table {
        match self {
            Board::Nano => table::nano(),
            Board::Stm32 => stm32::table(),
        }
    }

    /// What its figures have to reach.
    pub fn goals(self, figures: &Figures) -> Vec<Goal> {
        match self {
            Board::Nano => goals::of(figures),
            Board::Stm32 => stm32::goals(figures),
        }
    }

    /// How many bytes of an image's flash may depend on where the repository lies: symbols have a hash of its path, the order of
    /// functions goes by their symbols, and what lies between them for their alignment by the order. The AVR has none.
    pub const fn padding(self) -> f64 {
        match self {
            Board::Nano => 0.0,
            Board::Stm32 => 32.0,
        }
    }

    /// The line before its table in the guide.
    pub const fn begin(self) -> &'static str {
        match self {
            Board::Nano => "<!-- written by: cargo xtask bench --record -->",
            Board::Stm32 => "<!-- STM32, written by: cargo xtask bench --record -->",
        }
    }

    /// What its figures are called in the file that has all; the Nano's begin it.
    pub const fn member(self) -> Option<&'static str> {
        match self {
            Board::Nano => None,
            Board::Stm32 => Some("stm32"),
        }
    }
}
