//! `sim`: a simulated bus in real time, with a serial port on it for other programs.

use std::io::Write;
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use clap::error::ErrorKind;
use clap::{Parser, ValueEnum};
use multidrop_bus::{
    Bus, BusConfig, BusError, Emulator, Format, HostPort, Line, Live, LiveError, Nano, NodeId, Pin,
    Stm32, Time, WireId,
};
use nix::sys::signal::{SigSet, Signal};
use signal_hook::consts::{SIGHUP, SIGINT, SIGTERM};

/// The time in which the nodes boot: many times what they need, t3.5 included.
const BOOT: Time = Time::from_ms(50);

/// A simulated bus in real time, with a serial port on it.
#[derive(Debug, Parser)]
#[command(name = "sim")]
struct Arguments {
    /// The nodes on the bus
    scenario: Scenario,
    /// The firmware of a node, in the order of the nodes
    #[arg(long = "image", value_name = "PATH")]
    images: Vec<PathBuf>,
    /// The link to the serial port
    #[arg(long, value_name = "PATH", default_value = "./bus")]
    link: PathBuf,
    /// End after this number of seconds
    #[arg(long, value_name = "N")]
    seconds: Option<u64>,
    /// The baud rate of the line
    #[arg(long, value_name = "N", default_value_t = 38_400)]
    baud: u32,
    /// The format of its characters
    #[arg(long, value_name = "FORMAT", default_value = "8N1")]
    format: Format,
    /// Run the STM32 in QEMU, with an image that is built for it, slower than real time
    #[arg(long)]
    qemu: bool,
    /// Send a canned frame when the nodes listen, and show it with its effects
    #[arg(long, value_name = "NAME")]
    inject: Option<Canned>,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
enum Scenario {
    /// Three Nanos with the unit ids 1, 2, 3
    DemoUnit,
    /// One Nano with unit id 1
    Registers,
    /// A Nano that is a client, and its server; each of its two buttons is pressed every two seconds
    RelayPanel,
    /// Every function, unit 17
    NanoConformance,
    /// Every function on an STM32, unit 17, on RS4
    Stm32Conformance,
    /// A Nano that is a client
    ClientFunctions,
    /// An STM32 with four ports, master of three Nanos on RS4; the serial port is on AS1
    Mixed,
}

impl Scenario {
    /// The default image files of the nodes.
    fn images(self) -> &'static [&'static str] {
        match self {
            Scenario::DemoUnit => &[
                "nano-demo-unit-unit1.elf",
                "nano-demo-unit-unit2.elf",
                "nano-demo-unit-unit3.elf",
            ],
            Scenario::Registers => &["nano-registers.elf"],
            Scenario::RelayPanel => &["nano-relay-panel.elf", "nano-relay-board.elf"],
            Scenario::NanoConformance => &["nano-conformance.elf"],
            Scenario::Stm32Conformance => &["stm32-conformance.elf"],
            Scenario::ClientFunctions => &["nano-client-functions.elf"],
            Scenario::Mixed => &[
                "nano-demo-unit-unit1.elf",
                "nano-demo-unit-unit2.elf",
                "nano-demo-unit-unit3.elf",
                "stm32-ports.elf",
            ],
        }
    }
}

/// Frames of which every byte is given, checksum included.
#[derive(Clone, Copy, Debug, ValueEnum)]
enum Canned {
    /// Unit 1: read holding register 0
    ReadHolding,
    /// Unit 1: a write with a wrong checksum
    BadCrc,
    /// Unit 17: read holding registers 107 to 109
    ReadHolding17,
    /// Unit 17: coil 172 on
    CoilOn17,
    /// Unit 17: write holding register 1
    WriteRegister17,
    /// Unit 17: write ten coils from 19
    WriteCoils17,
    /// Unit 17: write holding registers 1 and 2
    WriteRegisters17,
    /// Unit 10's answer: exception 02 to function 01
    Exception10,
}

impl Canned {
    fn frame(self) -> &'static [u8] {
        match self {
            Canned::ReadHolding => &[0x01, 0x03, 0x00, 0x00, 0x00, 0x01, 0x84, 0x0a],
            Canned::BadCrc => &[0x01, 0x03, 0x00, 0x00, 0x00, 0x01, 0x84, 0x0b],
            Canned::ReadHolding17 => &[0x11, 0x03, 0x00, 0x6b, 0x00, 0x03, 0x76, 0x87],
            Canned::CoilOn17 => &[0x11, 0x05, 0x00, 0xac, 0xff, 0x00, 0x4e, 0x8b],
            Canned::WriteRegister17 => &[0x11, 0x06, 0x00, 0x01, 0x00, 0x03, 0x9a, 0x9b],
            Canned::WriteCoils17 => &[
                0x11, 0x0f, 0x00, 0x13, 0x00, 0x0a, 0x02, 0xcd, 0x01, 0xbf, 0x0b,
            ],
            Canned::WriteRegisters17 => &[
                0x11, 0x10, 0x00, 0x01, 0x00, 0x02, 0x04, 0x00, 0x0a, 0x01, 0x02, 0xc6, 0xf0,
            ],
            Canned::Exception10 => &[0x0a, 0x81, 0x02, 0xb0, 0x53],
        }
    }
}

#[derive(Debug, thiserror::Error)]
enum SimError {
    #[error("{scenario} has {wanted} nodes, but --image was given {given} times")]
    Images {
        scenario: String,
        wanted: usize,
        given: usize,
    },
    #[error(transparent)]
    Bus(#[from] BusError),
    #[error(transparent)]
    Live(#[from] LiveError),
    #[error("cannot watch for signals: {0}")]
    Signals(std::io::Error),
}

impl SimError {
    /// 2 for wrong use, 1 if the work failed.
    fn exit_code(&self) -> u8 {
        match self {
            SimError::Bus(BusError::Stopped { .. })
            | SimError::Live(LiveError::Bus(_) | LiveError::Terminal(_))
            | SimError::Signals(_) => 1,
            _ => 2,
        }
    }
}

fn main() -> ExitCode {
    let arguments = match Arguments::try_parse() {
        Ok(arguments) => arguments,
        Err(error) => {
            let _ = error.print();
            let asked = matches!(
                error.kind(),
                ErrorKind::DisplayHelp | ErrorKind::DisplayVersion
            );
            return ExitCode::from(if asked { 0 } else { 2 });
        }
    };
    match run(&arguments) {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("error: {error}");
            ExitCode::from(error.exit_code())
        }
    }
}

fn run(arguments: &Arguments) -> Result<(), SimError> {
    // First, so that no signal comes too early.
    let stop = Arc::new(AtomicBool::new(false));
    for signal in [SIGINT, SIGTERM, SIGHUP] {
        signal_hook::flag::register(signal, Arc::clone(&stop)).map_err(SimError::Signals)?;
    }
    // The program that this one has replaced may have blocked them.
    let ours = SigSet::from_iter([Signal::SIGINT, Signal::SIGTERM, Signal::SIGHUP]);
    ours.thread_unblock()
        .map_err(|error| SimError::Signals(error.into()))?;
    let line = Line {
        baud: arguments.baud,
        format: arguments.format,
    };
    let mut bus = Bus::new(BusConfig::default());
    // The wire of the client; RS4 is on that of the Nanos.
    let mut wire = WireId::default();
    for (index, image) in images(arguments)?.into_iter().enumerate() {
        let wires = match (arguments.scenario, index) {
            (Scenario::Stm32Conformance, _) => Some([None; 3]),
            (Scenario::Mixed, 3) => {
                wire = bus.add_wire();
                Some([Some(wire), Some(bus.add_wire()), Some(bus.add_wire())])
            }
            _ => None,
        };
        if let Some([as1, as2, rs2]) = wires {
            bus.add_stm32(Stm32 {
                name: "stm32".to_owned(),
                image,
                emulator: if arguments.qemu {
                    Emulator::qemu()?
                } else {
                    Emulator::core()?
                },
                wires: [as1, as2, rs2, Some(WireId::default())],
            })?;
            continue;
        }
        let mut nano = Nano::new(format!("unit {}", index + 1), image);
        nano.seed = index as u64 + 1;
        bus.add_nano(nano)?;
    }
    let panel = bus.nodes().next().map(|(id, _)| id);
    let client = bus.add_host_on(wire, HostPort::new(line));
    let injector = bus.add_host_on(wire, HostPort::new(line));
    bus.try_run_for(BOOT)?;
    if stop.load(Ordering::Relaxed) {
        return Ok(());
    }

    let mut live = Live::new(bus, client, &arguments.link)?;
    live.on_behind(|behind| eprintln!("warning: {behind}"));
    say(&format!("ready: {}\n", live.link().display()));
    let mut waiting = arguments.inject;
    if let Some(canned) = waiting {
        live.bus().host(injector).send(canned.frame());
    }
    // A time beyond the range is never.
    let end = arguments
        .seconds
        .and_then(|seconds| Instant::now().checked_add(Duration::from_secs(seconds)));
    let shown_at = live.bus().now() + Time::from_ms(100);
    live.run(|bus| {
        if waiting.is_some() && bus.now() >= shown_at {
            waiting = None;
            say(&bus.record().to_string());
        }
        if waiting.is_none() {
            // It may run for days, so no memory may accumulate.
            bus.clear_record();
        }
        bus.host(injector).take();
        if let (Scenario::RelayPanel, Some(panel)) = (arguments.scenario, panel) {
            press(bus, panel);
        }
        stop.load(Ordering::Relaxed) || end.is_some_and(|end| Instant::now() >= end)
    })?;
    Ok(())
}

/// Holds a button of relay-panel, which pulls its pin low, for a tenth of the two seconds that each has.
fn press(bus: &mut Bus, panel: NodeId) {
    const TURN_MS: u64 = 2_000;
    let ms = bus.now().ps() / 1_000_000_000;
    for (button, pin) in (0..).zip([Pin::new('D', 3), Pin::new('D', 4)]) {
        let Some(pin) = pin else { continue };
        let turn = ms / TURN_MS % 2 == button;
        let held = turn && ms % TURN_MS < TURN_MS / 10;
        bus.node_mut(panel).set_input(pin, held.then_some(false));
    }
}

/// Writes to standard output at once; the reader may be gone.
fn say(text: &str) {
    let mut out = std::io::stdout();
    let _ = out.write_all(text.as_bytes()).and_then(|()| out.flush());
}

fn images(arguments: &Arguments) -> Result<Vec<PathBuf>, SimError> {
    let names = arguments.scenario.images();
    if arguments.images.is_empty() {
        let folder = Path::new("target/firmware");
        let named = names.iter().map(|name| match name.strip_prefix("stm32-") {
            Some(app) if arguments.qemu => {
                folder.join(format!("stm32-{}", app.replace(".elf", "-qemu.elf")))
            }
            _ => folder.join(name),
        });
        return Ok(named.collect());
    }
    if arguments.images.len() != names.len() {
        return Err(SimError::Images {
            scenario: format!("{:?}", arguments.scenario),
            wanted: names.len(),
            given: arguments.images.len(),
        });
    }
    Ok(arguments.images.clone())
}
