//! What one more port costs in RAM, from the symbols of the image that is flashed.
//!
//! Everything is counted that is there once for each port: the line's state, its buffer of 256 bytes, the port with its
//! registers, and the futures of its two tasks. What the application puts into the port is in it: its registers, and the
//! places of those who ask through it. Routers and their tasks, the scan list and what is printed are the application's.

use addr2line::demangle_auto;
use object::{Object, ObjectSymbol};

use crate::Trouble;
use crate::figures::Set;
use crate::image::Image;

/// Ports of the board, for each of which the line has its state and its buffer.
const PORTS: u64 = 4;
/// Those of all lines.
const LINES: [&str; 2] = ["usart::state::SHARED", "usart::state::ADUS"];

/// The ports of an application whose RAM is told: what they are called in figures, and their symbols.
fn ports(app: &str) -> &'static [(&'static str, [&'static str; 3])] {
    match app {
        "demo-unit" => &[(
            "port",
            ["::SERVER_PORT_CELL", "::receive::POOL", "::serve::POOL"],
        )],
        "ports" => &[
            ("as1", ["::AS1", "::as1_receive::POOL", "::as1_run::POOL"]),
            ("as2", ["::AS2", "::as2_receive::POOL", "::as2_run::POOL"]),
            ("rs2", ["::RS2", "::rs2_receive::POOL", "::rs2_run::POOL"]),
            ("rs4", ["::RS4", "::rs4_receive::POOL", "::rs4_run::POOL"]),
        ],
        _ => &[],
    }
}

/// `ram_NAME_bytes` for each port whose RAM is told.
pub fn of_ports(image: &Image, set: &mut Set) -> Result<(), Trouble> {
    let trouble = |what: String| Trouble::Elf {
        path: image.path.clone(),
        what,
    };
    let bytes = std::fs::read(&image.path).map_err(|error| trouble(error.to_string()))?;
    let elf = object::File::parse(&*bytes).map_err(|error| trouble(error.to_string()))?;
    let named = elf.symbols().filter_map(|symbol| {
        let name = demangle_auto(symbol.name().ok()?.into(), None);
        Some((name.into_owned(), symbol.size()))
    });
    let named: Vec<_> = named.collect();
    // One symbol, and no empty one: a name that has changed must not count as nothing.
    let size = |end: &str| {
        let mut found = named.iter().filter(|(name, _)| name.ends_with(end));
        match (found.next(), found.next()) {
            (Some(&(_, size)), None) if size > 0 => Ok(size),
            (Some(_), Some(_)) => Err(trouble(format!("several symbols end with {end}"))),
            _ => Err(trouble(format!("no symbol ends with {end}"))),
        }
    };
    for (port, symbols) in ports(&image.app) {
        let mut ram = 0;
        for all in LINES {
            ram += size(all)? / PORTS;
        }
        for own in symbols {
            ram += size(own)?;
        }
        set.insert(format!("ram_{port}_bytes"), ram as f64);
    }
    Ok(())
}
