//! What is measured of the STM32: sizes of the images that are flashed, and four ports of one; all else in QEMU, where each instruction takes
//! 8 ns, whatever it does.

mod four_ports;
mod garbage;
mod goals;
mod ram;
mod rows;
mod work;

use std::thread;

use multidrop_bus::Parts;

use crate::figures::{Figures, Set, rounded};
use crate::image::{Image, Images};
use crate::limits::{REQUESTS, answers_all};
use crate::measure::{sizes, turnaround};
use crate::traffic::Desk;
use crate::{Arguments, Trouble, kept};

pub use goals::of as goals;
pub use rows::table;

/// Items in each table of the image `registers` that is run.
const COUNT: u8 = 128;
/// The lines at which turnaround and the rest are measured.
const BAUDS: [u32; 2] = [38_400, 115_200];
/// The bauds at which no request may be lost, in order.
const LOSS_FREE: [u32; 5] = [38_400, 115_200, 500_000, 1_000_000, 2_000_000];
/// Instructions in a second.
const INSTRUCTIONS_HZ: u32 = 125_000_000;
/// Exchanges of each shape from which a range is taken: what varies is less than a microsecond.
const EXCHANGES: usize = 60;
/// Requests without a loss that make the slowest baud loss-free: it takes the longest.
const SLOWEST_REQUESTS: usize = 100;

/// What the long run is called.
const FOUR: &str = "four ports";

/// Measures everything. One thread for each image: they share nothing.
pub fn measure(arguments: &Arguments) -> Result<Figures, Trouble> {
    let mut figures = Figures::new(&arguments.compiler, INSTRUCTIONS_HZ);
    for image in &arguments.flashed {
        let mut set = sizes(image);
        ram::of_ports(image, &mut set)?;
        figures.images.insert(image.app.clone(), set);
    }
    let images = arguments.images();
    let images = &images;
    let long = !(arguments.check || arguments.short);
    let measured = thread::scope(|scope| -> Result<Vec<(String, Set)>, Trouble> {
        let four = scope.spawn(move || {
            let flashed = Images(&arguments.flashed);
            long.then(|| four_ports::of(images, &flashed)).transpose()
        });
        let mut threads = Vec::new();
        for baud in BAUDS {
            let image = images.registers(COUNT, baud)?;
            threads.push((image.name(), scope.spawn(move || line(image))));
        }
        let ports = images.app("ports")?;
        threads.push((ports.name(), scope.spawn(move || managed(ports))));
        let free = scope.spawn(move || loss_free_baud(images));
        let mut sets = Vec::new();
        for (name, thread) in threads {
            sets.push((name, thread.join().expect("no panic")?));
        }
        let free = f64::from(free.join().expect("no panic")?);
        for baud in BAUDS {
            let set = Set::from([("loss_free_baud".to_owned(), free)]);
            sets.push((images.registers(COUNT, baud)?.name(), set));
        }
        let four = four.join().expect("no panic")?;
        sets.extend(four.map(|set| (FOUR.to_owned(), set)));
        Ok(sets)
    })?;
    for (name, set) in measured {
        figures.images.entry(name).or_default().extend(set);
    }
    if !long {
        kept::take_over(&arguments.kept, FOUR, &mut figures)?;
    }
    Ok(figures)
}

/// The parts of an image: what stands in for the chip is counted apart, and the interrupts of these handlers are timed.
fn parts(image: &Image, handlers: &[&str]) -> Result<Parts, Trouble> {
    // What the time is, and the executor's loop, are the same on the chip.
    let common = ["now", "run", "init"];
    Ok(Parts::of(
        &image.path,
        "platform/qemu.rs",
        &common,
        handlers,
    )?)
}

/// One `registers` at its line, on RS4.
fn line(image: &Image) -> Result<Set, Trouble> {
    const CHARACTERS: &str = "UART4";
    const ALARMS: &str = "SysTick";
    let mut set = Set::new();
    let mut desk = Desk::stm32(image, Parts::default())?;
    turnaround(&mut desk, EXCHANGES, &mut set)?;
    let mut desk = Desk::stm32(image, parts(image, &[CHARACTERS, ALARMS])?)?;
    work::of_registers(&mut desk, &mut set)?;
    let machine = desk.bus.machine(desk.node);
    work::interrupts(machine, CHARACTERS, "character", &mut set);
    work::interrupts(machine, ALARMS, "alarm", &mut set);
    Ok(set)
}

/// The managed ports of `ports`.
fn managed(image: &Image) -> Result<Set, Trouble> {
    let mut set = Set::new();
    work::of_managed(image, &mut set)?;
    garbage::of(image, &mut set)?;
    Ok(set)
}

/// The highest loss-free baud, found like that of [`limits::loss_free_baud`](crate::limits::loss_free_baud).
fn loss_free_baud(images: &Images<'_>) -> Result<u32, Trouble> {
    let mut free = 0;
    for baud in LOSS_FREE {
        let image = images.registers(COUNT, baud)?;
        let mut desk = Desk::stm32(image, Parts::default())?;
        let requests = if free == 0 {
            SLOWEST_REQUESTS
        } else {
            REQUESTS
        };
        if !answers_all(&mut desk, requests) {
            break;
        }
        free = baud;
    }
    Ok(free)
}

/// The number of instructions in a number of microseconds.
fn in_instructions(us: f64) -> f64 {
    rounded(us * f64::from(INSTRUCTIONS_HZ) / 1e6)
}
