//! `bench`: sizes and timing of the firmware as it is flashed, measured on the simulated bus.
//!
//! Everything is counted in simulated time from fixed seeds, so that two runs of one image give the
//! same figures to the last digit, on any machine. That is why they can be kept in the repository and
//! compared for equality.

mod board;
mod figures;
mod functions;
mod goals;
mod guide;
mod image;
mod kept;
mod limits;
mod measure;
mod power;
mod stm32;
mod table;
mod traffic;

use std::path::PathBuf;
use std::process::ExitCode;

use clap::Parser;
use multidrop_bus::BusError;

use board::Board;
use image::{Image, Images};

/// Sizes, turnaround, jitter and limits of the firmware, in simulated time.
#[derive(Debug, Parser)]
#[command(name = "bench")]
struct Arguments {
    /// The board to measure
    #[arg(long, value_enum)]
    board: Board,
    /// A firmware image: application, items in each table, baud, flash, static RAM, path
    #[arg(
        long = "image",
        value_name = "APP:COUNT:BAUD:FLASH:RAM:PATH",
        required = true
    )]
    images: Vec<Image>,
    /// An image for the chip, of which the sizes alone are wanted: all the others are run
    #[arg(long = "flashed", value_name = "APP:COUNT:BAUD:FLASH:RAM:PATH")]
    flashed: Vec<Image>,
    /// What the images were compiled and linked with
    #[arg(long, value_name = "TEXT")]
    compiler: String,
    /// Write all figures as JSON to this file too
    #[arg(long, value_name = "PATH")]
    json: Option<PathBuf>,
    /// The file in which the figures are kept
    #[arg(long, value_name = "PATH")]
    kept: PathBuf,
    /// The text in which a part of them is shown
    #[arg(long, value_name = "PATH")]
    guide: PathBuf,
    /// Rewrite figures and tables
    #[arg(long)]
    record: bool,
    /// Take what is kept of what takes longest, as --check does
    #[arg(long)]
    short: bool,
    /// Fail where a figure is not the kept one or a goal is missed, and count the checks
    #[arg(long, conflicts_with = "record")]
    check: bool,
}

impl Arguments {
    /// Those that are run.
    fn images(&self) -> Images<'_> {
        Images(&self.images)
    }
}

/// Why there are no figures.
#[derive(Debug, thiserror::Error)]
enum Trouble {
    #[error("{image}: {what}")]
    Firmware { image: String, what: String },
    #[error("no image {0}")]
    NoImage(String),
    #[error("{}: the lines {} and {} are not there, in this order", .0.display(), .1, guide::END)]
    NoPlace(PathBuf, &'static str),
    #[error("{}: {what}", path.display())]
    Elf { path: PathBuf, what: String },
    #[error("{}: {source}", path.display())]
    File {
        path: PathBuf,
        source: std::io::Error,
    },
    #[error("{}: {source}", path.display())]
    Json {
        path: PathBuf,
        source: serde_json::Error,
    },
    #[error(transparent)]
    Bus(#[from] BusError),
}

fn main() -> ExitCode {
    match run(&Arguments::parse()) {
        Ok(true) => ExitCode::SUCCESS,
        Ok(false) => ExitCode::from(1),
        Err(trouble) => {
            eprintln!("error: {trouble}");
            ExitCode::from(1)
        }
    }
}

/// Whether all that was asked for is good.
fn run(arguments: &Arguments) -> Result<bool, Trouble> {
    let board = arguments.board;
    let figures = board.measure(arguments)?;
    print!("{}", board.table().of(&figures));
    let goals = board.goals(&figures);
    println!("\nGoals");
    for goal in &goals {
        println!("{goal}");
    }
    if let Some(path) = &arguments.json {
        kept::write(path, board.member(), &figures)?;
    }
    if arguments.record {
        let kept = kept::record(&arguments.kept, &figures)?;
        guide::update(&arguments.guide, board, &kept, &figures)?;
    }
    if !arguments.check {
        return Ok(true);
    }
    let promised = goals.iter().filter(|goal| goal.is_promised());
    let mut checks: Vec<bool> = promised.map(|goal| goal.is_met()).collect();
    checks.extend(kept::compare(
        &arguments.kept,
        &figures,
        arguments.board.padding(),
    )?);
    let kept = kept::load(&arguments.kept)?;
    checks.push(guide::check(&arguments.guide, board, &kept)?);
    let failed = checks.iter().filter(|passed| !**passed).count();
    // The words of Rust's own test harness, by which `cargo xtask test` counts.
    println!(
        "\ntest result: {}. {} passed; {failed} failed",
        if failed == 0 { "ok" } else { "FAILED" },
        checks.len() - failed
    );
    Ok(failed == 0)
}
