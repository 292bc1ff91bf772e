//! The commands of this repository: `cargo xtask --help` lists them.
//!
//! Built with the stable toolchain and without any C library, so that it runs on a machine that has nothing else:
//! [`setup`] installs the rest. It never links the simulator; `sim` and `demo` are programs that this one builds and
//! then executes in its place.

mod bench;
mod check;
mod cli;
mod demo;
mod error;
mod firmware;
mod flash;
mod front;
mod fuses;
mod fuzz;
mod guide;
mod image;
mod job;
mod layers;
mod layout;
mod machine;
mod mutants;
mod needs;
mod package;
mod programmer;
mod python;
mod repo;
mod scenario;
mod serial;
mod setup;
mod sim;
mod size;
mod tally;
mod toolchain;
mod whole;
mod words;

use cli::Command;
use error::Error;
use std::process::ExitCode;

fn main() -> ExitCode {
    let command = cli::parse();
    match repo::find_root().and_then(|_| run(command)) {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => error.report(),
    }
}

fn run(command: Command) -> Result<(), Error> {
    match command {
        Command::Setup { check: true } => setup::report(),
        Command::Setup { check: false } => setup::install(),
        Command::Build(request) => firmware::build_and_show(&request),
        Command::Example {
            name,
            stm32,
            qemu,
            baud,
        } => firmware::build_example(&name, stm32, qemu, baud),
        Command::Sim(request) => sim::run(&request),
        Command::Demo { hold } => demo::run(hold),
        Command::Test => check::run(),
        Command::Mutants(request) => mutants::run(&request),
        Command::Flash(request) => flash::run(&request),
        Command::Bench { latency: true, .. } => bench::tell_latency(),
        Command::Bench {
            json,
            record,
            short,
            latency: false,
        } => bench::run(json.as_deref(), record, short),
    }
}
