//! The scenario `mixed`: a PC on AS1 of the STM32, the Nanos behind RS4.

mod sims;

use std::fs::{File, OpenOptions};
use std::io::{Read, Write};
use std::path::PathBuf;

use multidrop_testkit::frames::{be, data, words};
use sims::Sim;

/// Asks; `len` bytes come back, or the bus ends.
fn ask(terminal: &mut File, request: &[u8], len: usize) -> Vec<u8> {
    terminal.write_all(request).expect("written");
    let mut answer = vec![0; len];
    terminal.read_exact(&mut answer).expect("an answer");
    answer
}

#[test]
fn a_pc_reads_the_collected_values_and_reaches_the_nanos() {
    let mut images: Vec<PathBuf> = ["1", "2", "3"]
        .iter()
        .map(|unit| multidrop_testkit::image("demo-unit", &["--unit", unit]))
        .collect();
    images.push(multidrop_testkit::ports(multidrop_testkit::Runner::Core));
    let folder = Sim::folder();
    let mut command = Sim::command(&folder, "mixed", &images);
    command.args(["--seconds", "60"]);
    let mut sim = Sim::start(command, folder);
    sim.await_ready();

    let mut terminal = OpenOptions::new()
        .read(true)
        .write(true)
        .open(sim.link())
        .expect("the terminal");
    for unit in 1..=3_u8 {
        let value = 0x1100 * u16::from(unit);
        let write = words(unit, 6, 0, value);
        assert_eq!(ask(&mut terminal, &write, write.len()), write);
        let read = ask(&mut terminal, &words(unit, 3, 0, 1), 7);
        assert_eq!(read, data(unit, 3, &be(&[value])));
    }
    // The polls see it within their period.
    let expected = data(10, 4, &be(&[0x1100, 0x2200, 0x3300]));
    let mut told = Vec::new();
    for _ in 0..20 {
        told = ask(&mut terminal, &words(10, 4, 0, 3), expected.len());
        if told == expected {
            break;
        }
    }
    assert_eq!(told, expected);
    let failed = ask(&mut terminal, &words(10, 4, 6, 4), 13);
    assert_eq!(failed, data(10, 4, &be(&[0; 4])));
}
