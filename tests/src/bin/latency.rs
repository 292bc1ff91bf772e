//! `latency`: how long a client that others wrote waits for an answer from `sim`, by the clock on the wall, and how long the bus itself takes for it.
//!
//! The first is of the machine on which it is measured, and of what else runs there: it is told and kept nowhere.

use std::io::{BufRead, BufReader};
use std::path::PathBuf;
use std::process::{Child, Command, ExitCode, Stdio};

use clap::Parser;
use multidrop_bus::{
    Bus, BusConfig, BusError, Emulator, HostId, HostPort, Line, Nano, Random, Stm32, Time, WireId,
    with_crc,
};

/// Exchanges of each kind.
const COUNT: usize = 500;

/// What it may be beyond the time of the bus on a host that has nothing else to do, in ms: in the median, and in the slowest of a hundred.
const GOALS: [f64; 2] = [3.0, 10.0];

/// How long a client of `sim` waits for answers
#[derive(Debug, Parser)]
#[command(name = "latency")]
struct Arguments {
    /// Python with pymodbus
    #[arg(long, value_name = "PATH")]
    python: PathBuf,
    /// The client: tests/python/latency.py
    #[arg(long, value_name = "PATH")]
    client: PathBuf,
    /// The program sim
    #[arg(long, value_name = "PATH")]
    sim: PathBuf,
    /// Images: nano registers, stm32 conformance, and those of mixed
    #[arg(long = "image", value_name = "PATH", num_args = 6, required = true)]
    images: Vec<PathBuf>,
}

#[derive(Debug, thiserror::Error)]
enum Trouble {
    #[error(transparent)]
    Bus(#[from] BusError),
    #[error("{what}: {source}")]
    Io {
        what: String,
        source: std::io::Error,
    },
    #[error("{what}: {said}")]
    Failed { what: &'static str, said: String },
}

/// What is asked: who answers, in which scenario.
struct Case<'a> {
    name: &'static str,
    scenario: &'static str,
    images: &'a [PathBuf],
    unit: u8,
    function: u8,
}

fn main() -> ExitCode {
    match run(&Arguments::parse()) {
        Ok(()) => ExitCode::SUCCESS,
        Err(trouble) => {
            eprintln!("error: {trouble}");
            ExitCode::from(1)
        }
    }
}

fn run(arguments: &Arguments) -> Result<(), Trouble> {
    let images = &arguments.images;
    let case = |name, scenario, images, unit, function| Case {
        name,
        scenario,
        images,
        unit,
        function,
    };
    let cases = [
        case("registers, a Nano", "registers", &images[..1], 1, 3),
        case(
            "stm32-conformance",
            "stm32-conformance",
            &images[1..2],
            17,
            3,
        ),
        case("mixed, AS1 itself", "mixed", &images[2..], 10, 4),
        case("mixed, unit 2 behind RS4", "mixed", &images[2..], 2, 3),
    ];
    println!(
        "\nWhat a client of `sim` waits for the answer to 03x1, pymodbus at 38400 baud, {COUNT} times, in ms; of this machine as it is now\n"
    );
    println!("| | bus, median | client, median | goal | bus, p99 | client, p99 | goal |");
    println!("|---|--:|--:|--:|--:|--:|--:|");
    for case in cases {
        let bus = on_the_bus(&case)?;
        let client = by_the_clock(arguments, &case)?;
        let [bus, client] =
            [bus, client].map(|spans| [50, 99].map(|part| percentile(&spans, part)));
        print!("| {}", case.name);
        for place in 0..2 {
            let most = bus[place] + GOALS[place];
            let word = if client[place] <= most {
                "met"
            } else {
                "missed"
            };
            print!(
                " | {:.1} | {:.1} | <= {most:.1} {word}",
                bus[place], client[place]
            );
        }
        println!(" |");
    }
    Ok(())
}

/// The span that `part` of a hundred spans do not exceed.
fn percentile(spans: &[f64], part: usize) -> f64 {
    let mut sorted = spans.to_vec();
    sorted.sort_by(f64::total_cmp);
    let place = (sorted.len() * part).div_ceil(100).max(1) - 1;
    sorted.get(place).copied().unwrap_or(f64::NAN)
}

/// From the first bit of the request until a serial adapter hands on the answer, when the line has been silent, in simulated time.
fn on_the_bus(case: &Case<'_>) -> Result<Vec<f64>, Trouble> {
    let line = Line::n81(38_400);
    let (mut bus, host) = put_together(case, line)?;
    let request = with_crc(&[case.unit, case.function, 0, 0, 0, 1]);
    let mut random = Random::new(1);
    let mut spans = Vec::new();
    for _ in 0..COUNT {
        bus.run_for(Time::from_us(random.below(20_000)));
        bus.clear_record();
        let start = bus.now();
        let answer = bus.transact(host, &request, Time::from_ms(500));
        let answer = answer.ok_or_else(|| Trouble::Failed {
            what: case.name,
            said: "no answer on the simulated bus".to_owned(),
        })?;
        let handed_on = answer.end + line.t35() + line.character();
        spans.push((handed_on - start).us() / 1e3);
    }
    Ok(spans)
}

/// The bus of a scenario, as `sim` has it, booted; and the host that is the client's.
fn put_together(case: &Case<'_>, line: Line) -> Result<(Bus, HostId), Trouble> {
    let mut bus = Bus::new(BusConfig::default());
    let rs4 = WireId::default();
    let mut wire = rs4;
    for (index, image) in case.images.iter().enumerate() {
        let wires = match (case.scenario, index) {
            ("stm32-conformance", _) => [None, None, None, Some(rs4)],
            ("mixed", 3) => {
                let ports = [0; 3].map(|_| bus.add_wire());
                wire = ports[0];
                [Some(ports[0]), Some(ports[1]), Some(ports[2]), Some(rs4)]
            }
            _ => {
                bus.add_nano(Nano::new("unit", image))?;
                continue;
            }
        };
        bus.add_stm32(Stm32 {
            name: "stm32".to_owned(),
            image: image.clone(),
            emulator: Emulator::core()?,
            wires,
        })?;
    }
    let host = bus.add_host_on(wire, HostPort::new(line));
    bus.run_for(Time::from_ms(50));
    Ok((bus, host))
}

/// `sim`, ended with this.
struct Sim(Child);

impl Drop for Sim {
    fn drop(&mut self) {
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

/// The latencies of a case, measured by the clock of the client.
fn by_the_clock(arguments: &Arguments, case: &Case<'_>) -> Result<Vec<f64>, Trouble> {
    let io = |what: String| move |source| Trouble::Io { what, source };
    let failed = |said: String| Trouble::Failed {
        what: case.name,
        said,
    };
    let folder = tempfile::tempdir().map_err(io("a temporary folder".to_owned()))?;
    let link = folder.path().join("bus");
    let mut sim = Command::new(&arguments.sim);
    sim.arg(case.scenario).arg("--link").arg(&link);
    for image in case.images {
        sim.arg("--image").arg(image);
    }
    let started = sim.stdout(Stdio::piped()).spawn();
    let mut sim = Sim(started.map_err(io(arguments.sim.display().to_string()))?);
    let mut ready = String::new();
    if let Some(stdout) = sim.0.stdout.take() {
        let read = BufReader::new(stdout).read_line(&mut ready);
        read.map_err(io("sim".to_owned()))?;
    }
    if !ready.starts_with("ready: ") {
        return Err(failed(format!("sim says {ready:?}")));
    }
    let output = Command::new(&arguments.python)
        .arg(&arguments.client)
        .arg(&link)
        .args([case.unit.to_string(), case.function.to_string()])
        .arg(COUNT.to_string())
        .output()
        .map_err(io(arguments.python.display().to_string()))?;
    if !output.status.success() {
        let said = String::from_utf8_lossy(&output.stderr);
        return Err(failed(said.trim_end().to_owned()));
    }
    serde_json::from_slice(&output.stdout).map_err(|error| failed(error.to_string()))
}
