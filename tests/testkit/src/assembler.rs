//! Builds the small assembler programs in `avr/` and `arm/` of this crate, for the tests of the models.

use std::path::PathBuf;
use std::process::Command;

use crate::places;
use multidrop_bus::{Bus, BusConfig, HostId, HostPort, Level, Line, Nano, NodeId, Pin};

/// Assembles `avr/NAME.S` with symbols set, and returns the image.
pub fn assemble(name: &str, symbols: &[(&str, u32)]) -> PathBuf {
    let source = places::programs().join("avr");
    let mut variant = name.to_owned();
    for (symbol, value) in symbols {
        variant += &format!("-{symbol}{value}");
    }
    // Tests run at the same time: each call has a file of its own.
    static CALLS: std::sync::atomic::AtomicUsize = std::sync::atomic::AtomicUsize::new(0);
    let call = CALLS.fetch_add(1, std::sync::atomic::Ordering::Relaxed);
    let image = places::scratch().join(format!("{variant}-{}-{call}.elf", std::process::id()));
    let mut command = Command::new("avr-gcc");
    command.args([
        "-mmcu=atmega328p",
        "-nostartfiles",
        "-Wl,-e,0",
        "-x",
        "assembler",
    ]);
    command.arg(format!("-Wa,-I{}", source.display()));
    for (symbol, value) in symbols {
        command.arg(format!("-Wa,--defsym,{symbol}={value}"));
    }
    command
        .arg(source.join(format!("{name}.S")))
        .arg("-o")
        .arg(&image);
    if let Some((_, start)) = symbols.iter().find(|(symbol, _)| *symbol == "BOOT") {
        command.arg(format!("-Wl,--section-start=.text={start:#x}"));
    }
    let output = command.output().expect("avr-gcc runs");
    assert!(
        output.status.success(),
        "{}",
        String::from_utf8_lossy(&output.stderr)
    );
    image
}

/// Assembles `arm/NAME.S` with symbols set, for the STM32, and returns the image.
pub fn assemble_arm(name: &str, symbols: &[(&str, u32)]) -> PathBuf {
    let folder = places::programs().join("arm");
    let scratch = places::scratch();
    static CALLS: std::sync::atomic::AtomicUsize = std::sync::atomic::AtomicUsize::new(0);
    let call = CALLS.fetch_add(1, std::sync::atomic::Ordering::Relaxed);
    let stem = scratch.join(format!("{name}-{}-{call}", std::process::id()));
    let (object, image) = (stem.with_extension("o"), stem.with_extension("elf"));
    let run = |command: &mut Command| {
        let output = command
            .output()
            .unwrap_or_else(|error| panic!("{command:?}: {error}"));
        assert!(
            output.status.success(),
            "{}",
            String::from_utf8_lossy(&output.stderr)
        );
    };
    let source = folder.join(format!("{name}.S"));
    let symbols = symbols.iter();
    let symbols =
        symbols.flat_map(|(symbol, value)| ["--defsym".to_owned(), format!("{symbol}={value}")]);
    run(Command::new("arm-none-eabi-as")
        .arg("-g")
        .args(symbols)
        .arg("-I")
        .arg(&folder)
        .arg(source)
        .arg("-o")
        .arg(&object));
    run(Command::new("arm-none-eabi-ld")
        .args([
            "-Ttext",
            "0x08000100",
            "--section-start=.vectors=0x08000000",
            "-e",
            "0x08000100",
        ])
        .arg(&object)
        .arg("-o")
        .arg(&image));
    image
}

/// PB0 to PB2, on which the programs show what they see.
pub fn shown() -> Vec<Pin> {
    (0..3).filter_map(|bit| Pin::new('B', bit)).collect()
}

/// A Nano that runs `avr/NAME.S`.
pub fn nano(name: &str, symbols: &[(&str, u32)]) -> Nano {
    let mut nano = Nano::new(name, assemble(name, symbols));
    nano.watch = shown();
    nano
}

/// A bus with one Nano, and a host.
pub fn bus_with(nano: Nano, line: Line) -> (Bus, NodeId, HostId) {
    let mut bus = Bus::new(BusConfig::default());
    let node = bus.add_nano(nano).expect("a valid image");
    let host = bus.add_host(HostPort::new(line));
    (bus, node, host)
}

/// A bus with one Nano that runs `avr/NAME.S`, and a host.
pub fn one(name: &str, symbols: &[(&str, u32)], line: Line) -> (Bus, NodeId, HostId) {
    bus_with(nano(name, symbols), line)
}

/// The cycles at which PB`bit` went high or low.
pub fn edges(bus: &Bus, node: NodeId, bit: u8, level: Level) -> Vec<u64> {
    let clock = bus.node(node).clock();
    let pin = Pin::new('B', bit);
    bus.record()
        .pin_edges()
        .iter()
        .filter(|edge| edge.node == node && Some(edge.pin) == pin && edge.level == level)
        .map(|edge| clock.tick_at_or_after(edge.time))
        .collect()
}

/// The cycle at which PB`bit` first went high.
pub fn rise(bus: &Bus, node: NodeId, bit: u8) -> u64 {
    edges(bus, node, bit, Level::High)[0]
}
