//! `host-bench`: instructions per request, counted by callgrind, beside rmodbus's; requests per second as criterion found them.
//!
//! Instructions are counted, not timed, so they can be kept in the repository and held against what is kept. The time of a
//! request depends on the machine and is shown only.

mod callgrind;
mod kept;

use std::path::{Path, PathBuf};
use std::process::ExitCode;

use clap::{Parser, Subcommand, ValueEnum};
use host_bench::{Answers, Ours, Request, Rmodbus, agree};

/// Instructions and time per request of the server on the host.
#[derive(Debug, Parser)]
#[command(name = "host-bench")]
struct Arguments {
    #[command(subcommand)]
    command: Command,
}

#[derive(Debug, Subcommand)]
enum Command {
    /// Count and show
    Measure(Measure),
    /// Answer one request so many times: what is counted
    #[command(hide = true)]
    Work {
        side: Side,
        request: String,
        times: u32,
    },
}

#[derive(Debug, clap::Args)]
struct Measure {
    /// What this was compiled with
    #[arg(long, value_name = "TEXT")]
    compiler: String,
    /// The file in which the figures are kept
    #[arg(long, value_name = "PATH")]
    kept: PathBuf,
    /// Where criterion has put its results
    #[arg(long, value_name = "FOLDER")]
    criterion: Option<PathBuf>,
    /// Add the figures to this JSON file
    #[arg(long, value_name = "PATH")]
    json: Option<PathBuf>,
    /// Rewrite what is kept
    #[arg(long)]
    record: bool,
    /// Fail where a figure is not the kept one or a goal is missed, and count the checks
    #[arg(long, conflicts_with = "record")]
    check: bool,
}

/// The server that is measured.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum Side {
    /// This project's server
    Ours,
    /// The server of rmodbus
    Rmodbus,
}

impl Side {
    const fn name(self) -> &'static str {
        match self {
            Side::Ours => "ours",
            Side::Rmodbus => "rmodbus",
        }
    }
}

/// Requests per second and core that the host must answer at least.
const GOAL_PER_SECOND: f64 = 1e6;

/// Why there are no figures.
pub type Trouble = Box<dyn std::error::Error>;

fn main() -> ExitCode {
    let done = match Arguments::parse().command {
        Command::Measure(arguments) => measure(&arguments),
        Command::Work {
            side,
            request,
            times,
        } => work(side, &request, times),
    };
    match done {
        Ok(true) => ExitCode::SUCCESS,
        Ok(false) => ExitCode::from(1),
        Err(trouble) => {
            eprintln!("error: {trouble}");
            ExitCode::from(1)
        }
    }
}

fn work(side: Side, request: &str, times: u32) -> Result<bool, Trouble> {
    let request = Request::ALL
        .into_iter()
        .find(|known| known.name() == request)
        .ok_or_else(|| format!("{request} is no request of these"))?;
    let frame = request.frame();
    fn repeat(server: &mut impl Answers, frame: &[u8], times: u32) -> bool {
        (0..times)
            .all(|_| !std::hint::black_box(server.answer(std::hint::black_box(frame))).is_empty())
    }
    Ok(match side {
        Side::Ours => repeat(&mut Ours::new(), &frame, times),
        Side::Rmodbus => repeat(&mut Rmodbus::new(), &frame, times),
    })
}

/// Whether all that was asked for is good.
fn measure(arguments: &Measure) -> Result<bool, Trouble> {
    if !agree() {
        return Err("the two servers do not answer with the same bytes".into());
    }
    let mut figures = kept::Set::new();
    for request in Request::ALL {
        for side in [Side::Ours, Side::Rmodbus] {
            let count = callgrind::instructions_per_request(side, request)?;
            figures.insert(
                format!("{}_{}_instructions", side.name(), request.name()),
                count,
            );
        }
    }
    println!("\nServer on the host, per request            ours   rmodbus");
    for request in Request::ALL {
        let [ours, theirs] = counts(&figures, request);
        println!(
            "  {}, instructions              {ours:>12}{theirs:>10}",
            request.name()
        );
    }
    let mut checks = Vec::new();
    for request in Request::ALL {
        let [ours, theirs] = counts(&figures, request);
        let verdict = if ours < theirs { "ok    " } else { "MISSED" };
        println!(
            "  {verdict}  instructions for {}: under rmodbus's {theirs}, is {ours}",
            request.name()
        );
        checks.push(ours < theirs);
    }
    if let Some(folder) = &arguments.criterion {
        speed(folder)?;
    }
    if let Some(path) = &arguments.json {
        kept::add_to(path, &figures)?;
    }
    if arguments.record {
        kept::record(&arguments.kept, &arguments.compiler, &figures)?;
    }
    if !arguments.check {
        return Ok(true);
    }
    checks.extend(kept::compare(
        &arguments.kept,
        &arguments.compiler,
        &figures,
    )?);
    let failed = checks.iter().filter(|passed| !**passed).count();
    // The words of Rust's own test harness, by which `cargo xtask test` counts.
    println!(
        "\ntest result: {}. {} passed; {failed} failed",
        if failed == 0 { "ok" } else { "FAILED" },
        checks.len() - failed
    );
    Ok(failed == 0)
}

fn counts(figures: &kept::Set, request: Request) -> [u64; 2] {
    [Side::Ours, Side::Rmodbus].map(|side| {
        let name = format!("{}_{}_instructions", side.name(), request.name());
        figures.get(&name).copied().unwrap_or(0)
    })
}

/// Shows what criterion measured on this machine.
fn speed(folder: &Path) -> Result<(), Trouble> {
    for request in Request::ALL {
        for side in [Side::Ours, Side::Rmodbus] {
            let name = format!("{}-{}", side.name(), request.name());
            let path = folder.join("server").join(&name).join("new/estimates.json");
            let text = std::fs::read_to_string(&path)
                .map_err(|error| format!("{}: {error}", path.display()))?;
            let estimates: serde_json::Value = serde_json::from_str(&text)?;
            let ns = estimates["mean"]["point_estimate"].as_f64();
            let ns = ns.ok_or_else(|| format!("{}: no mean", path.display()))?;
            let per_second = 1e9 / ns;
            let goal = match (side, request) {
                (Side::Ours, Request::Read) if per_second >= GOAL_PER_SECOND => {
                    "  ok, at least 1 million"
                }
                (Side::Ours, Request::Read) => "  MISSED: at least 1 million",
                _ => "",
            };
            println!(
                "  {name:<16}{:>10.2} million/s on this machine{goal}",
                per_second / 1e6
            );
        }
    }
    Ok(())
}
