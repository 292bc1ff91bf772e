//! `demo`: the demonstration unit, told step by step. Three Nanos on one simulated bus answer
//! `mbpoll`, a Modbus client that this project did not write; every step is checked.

mod desk;
mod show;
mod story;

use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::sync::Arc;
use std::sync::atomic::AtomicBool;

use clap::Parser;
use multidrop_bus::{BusError, LiveError};
use nix::sys::signal::{SigSet, Signal};
use signal_hook::consts::{SIGHUP, SIGINT, SIGTERM};

use desk::{Desk, UNITS};

/// The demonstration unit on a simulated bus, told step by step.
#[derive(Debug, Parser)]
#[command(name = "demo")]
struct Arguments {
    /// The firmware of a node: given three times, for the units 1, 2 and 3
    #[arg(long = "image", value_name = "PATH", required = true)]
    images: Vec<PathBuf>,
    /// Keep the bus up afterwards, as ./bus, until Ctrl-C
    #[arg(long)]
    hold: bool,
    /// The program to drive the nodes with
    #[arg(long, value_name = "PATH", default_value = "mbpoll")]
    mbpoll: PathBuf,
}

/// Why the demonstration did not come to its end.
#[derive(Debug, thiserror::Error)]
enum Trouble {
    /// What was seen is not what has to be.
    #[error("{0}")]
    Failed(String),
    #[error("interrupted")]
    Interrupted,
    #[error("--image has to be given {UNITS} times, not {0} times")]
    Images(usize),
    #[error("./bus exists and is not a link; call the demonstration in another folder")]
    BusInTheWay,
    #[error("cannot run {}: {source}", program.display())]
    Client {
        program: PathBuf,
        source: std::io::Error,
    },
    #[error(transparent)]
    Bus(#[from] BusError),
    #[error(transparent)]
    Live(#[from] LiveError),
    #[error(transparent)]
    System(#[from] std::io::Error),
}

impl Trouble {
    fn exit_code(&self) -> u8 {
        match self {
            Trouble::Failed(_) => 1,
            // As a shell has it: 128 and the number of SIGINT.
            Trouble::Interrupted => 130,
            _ => 2,
        }
    }
}

fn main() -> ExitCode {
    let arguments = Arguments::parse();
    match run(&arguments) {
        Ok(()) => ExitCode::SUCCESS,
        Err(trouble) => {
            show::trouble(&trouble.to_string());
            ExitCode::from(trouble.exit_code())
        }
    }
}

fn run(arguments: &Arguments) -> Result<(), Trouble> {
    let images = <&[PathBuf; UNITS]>::try_from(arguments.images.as_slice())
        .map_err(|_| Trouble::Images(arguments.images.len()))?;
    // Before anything is made that has to be cleared away.
    let stop = Arc::new(AtomicBool::new(false));
    for signal in [SIGINT, SIGTERM, SIGHUP] {
        signal_hook::flag::register(signal, Arc::clone(&stop))?;
    }
    // The program that this one has replaced may have blocked them.
    let ours = SigSet::from_iter([Signal::SIGINT, Signal::SIGTERM, Signal::SIGHUP]);
    ours.thread_unblock().map_err(std::io::Error::from)?;
    let scratch = tempfile::tempdir()?;
    let folder = if arguments.hold {
        Path::new(".")
    } else {
        scratch.path()
    };
    let mut desk = Desk::new(images, folder, &arguments.mbpoll, stop)?;
    story::tell(&mut desk)?;
    if arguments.hold {
        story::invite();
        desk.hold()?;
    }
    Ok(())
}
