//! Builds the small assembler programs in `avr/` for the tests of the models.
#![allow(dead_code, missing_docs)]

use std::path::{Path, PathBuf};
use std::process::Command;

use multidrop_bus::{Bus, BusConfig, HostId, HostPort, Line, Nano, NodeId};

/// Assembles `avr/NAME.S` with symbols set, and returns the image.
pub fn assemble(name: &str, symbols: &[(&str, u32)]) -> PathBuf {
    let source = Path::new(env!("CARGO_MANIFEST_DIR")).join("avr");
    let mut variant = name.to_owned();
    for (symbol, value) in symbols {
        variant += &format!("-{symbol}{value}");
    }
    // Tests run at the same time: each call has a file of its own.
    static CALLS: std::sync::atomic::AtomicUsize = std::sync::atomic::AtomicUsize::new(0);
    let call = CALLS.fetch_add(1, std::sync::atomic::Ordering::Relaxed);
    let image = Path::new(env!("CARGO_TARGET_TMPDIR"))
        .join(format!("{variant}-{}-{call}.elf", std::process::id()));
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
    let output = command.output().expect("avr-gcc runs");
    assert!(
        output.status.success(),
        "{}",
        String::from_utf8_lossy(&output.stderr)
    );
    image
}

/// A bus with one Nano that runs `avr/NAME.S`, and a host.
pub fn one(name: &str, symbols: &[(&str, u32)], line: Line) -> (Bus, NodeId, HostId) {
    let mut bus = Bus::new(BusConfig::default());
    let node = bus
        .add_nano(Nano::new(name, assemble(name, symbols)))
        .expect("a valid image");
    let host = bus.add_host(HostPort::new(line));
    (bus, node, host)
}
