//! The measurements that every image goes through, and the order of all of them.

use std::collections::BTreeMap;
use std::thread;

use multidrop_bus::{Time, Tx, TxPhase, VectorStats};

use crate::Trouble;
use crate::figures::{Figures, Range, Set, rounded, us_between};
use crate::image::{Image, Images};
use crate::traffic::{Desk, Shape, mixed};
use crate::{functions, limits, power};

/// Items in each table of the images that are measured.
pub const COUNTS: [u8; 2] = [16, 128];
/// The lines at which turnaround and the rest are measured.
pub const BAUDS: [u32; 2] = [38_400, 115_200];
/// `registers` with 16 items and all that guards the bus against faults of the firmware.
pub const GUARDED: &str = "registers-guarded";
/// Exchanges from which a range is taken.
const EXCHANGES: usize = 200;
/// The interrupts of the line and their vectors, counted from 0 (DS40002061B, 12.1): USART_RX, USART_UDRE,
/// TIMER1_COMPB.
const INTERRUPTS: [(&str, usize); 3] = [("rx", 18), ("tx", 19), ("silence", 12)];

/// Measures everything. One thread for each image: they share nothing.
pub fn all(images: &Images<'_>, figures: &mut Figures) -> Result<(), Trouble> {
    let unit = images.app("demo-unit")?;
    figures.images.insert(unit.name(), sizes(unit));
    let measured = thread::scope(|scope| -> Result<Vec<(String, Set)>, Trouble> {
        let server = scope.spawn(move || functions::server(images));
        let client = scope.spawn(move || functions::client(images));
        let edges = scope.spawn(move || limits::loss_free_baud_with_edges(images));
        let mut lines = Vec::new();
        let mut limits = Vec::new();
        for count in COUNTS {
            limits.push(scope.spawn(move || limits::loss_free_baud(images, count)));
            for baud in BAUDS {
                let image = images.registers(count, baud)?;
                lines.push((image, scope.spawn(move || one(image))));
            }
        }
        let guarded = images.app(GUARDED)?;
        let with_guards = scope.spawn(move || one(guarded));
        let mut free = BTreeMap::new();
        for (count, thread) in COUNTS.into_iter().zip(limits) {
            free.insert(count, thread.join().expect("no panic")?);
        }
        let edges = f64::from(edges.join().expect("no panic")?);
        let mut sets = Vec::new();
        for (image, thread) in lines {
            let mut set = thread.join().expect("no panic")?;
            set.insert("loss_free_baud".to_owned(), f64::from(free[&image.count]));
            if image.count == COUNTS[0] {
                set.insert("loss_free_with_edges_baud".to_owned(), edges);
            }
            sets.push((image.name(), set));
        }
        let mut set = with_guards.join().expect("no panic")?;
        let bare = images.registers(guarded.count, guarded.baud)?;
        for (name, with, without) in [
            ("guards_flash_bytes", guarded.flash, bare.flash),
            ("guards_ram_bytes", guarded.ram, bare.ram),
        ] {
            set.insert(name.to_owned(), f64::from(with) - f64::from(without));
        }
        sets.push((guarded.name(), set));
        for (app, thread) in [("conformance", server), ("client-functions", client)] {
            let set = thread.join().expect("no panic")?;
            sets.push((images.app(app)?.name(), set));
        }
        Ok(sets)
    })?;
    figures.images.extend(measured);
    Ok(())
}

/// What is known of an image without running it.
pub fn sizes(image: &Image) -> Set {
    Set::from([
        ("flash_bytes".to_owned(), f64::from(image.flash)),
        ("static_ram_bytes".to_owned(), f64::from(image.ram)),
    ])
}

fn one(image: &Image) -> Result<Set, Trouble> {
    let mut set = sizes(image);
    set.insert("stack_peak_bytes".to_owned(), stack_peak(image)?);
    turnaround(&mut Desk::new(image, |_| {})?, EXCHANGES, &mut set)?;
    for (name, phase) in [
        ("baud_tick", TxPhase::BaudTick),
        ("bit_clock", TxPhase::BitClock),
    ] {
        let mut desk = Desk::new(image, |nano| nano.tx_phase = phase)?;
        let mut gaps = Range::default();
        let range = exchanges(&mut desk, Shape::Read(1), EXCHANGES, &mut gaps)?.turnaround;
        range.store(&mut set, &format!("tx_{name}_turnaround_03x1"), "us");
        let jitter = rounded(range.width());
        set.insert(format!("tx_{name}_jitter_03x1_us"), jitter);
    }
    interrupts(image, &mut set)?;
    power::active_cycles(image, &mut set)?;
    power::asleep(image, &mut set)?;
    limits::longest_gap(image, &mut set)?;
    limits::clock_error(image, &mut set)?;
    Ok(set)
}

/// What a series of exchanges of one shape showed, in microseconds.
#[derive(Default)]
struct Series {
    /// The time beyond t3.5.
    turnaround: Range,
    de_lead: Range,
    de_lag: Range,
}

fn exchanges<N>(
    desk: &mut Desk<N>,
    shape: Shape,
    count: usize,
    gaps: &mut Range,
) -> Result<Series, Trouble> {
    let mut series = Series::default();
    let silence = desk.line().t35();
    for _ in 0..count {
        desk.idle();
        let request = shape.request(desk.count, &mut desk.random);
        let seen = desk.expect(&request)?;
        let turnaround = us_between(seen.start, seen.request_end + silence);
        series.turnaround.add(turnaround);
        series.de_lead.add(us_between(seen.start, seen.de_up));
        series.de_lag.add(us_between(seen.de_down, seen.end));
        gaps.add(seen.longest_gap.us());
    }
    Ok(series)
}

/// Turnaround and jitter for each shape, over a number of exchanges; DE and the gaps inside answers over all of them.
pub fn turnaround<N>(desk: &mut Desk<N>, count: usize, set: &mut Set) -> Result<(), Trouble> {
    let mut all = Series::default();
    let mut gaps = Range::default();
    for shape in Shape::measured(desk.count) {
        let series = exchanges(desk, shape, count, &mut gaps)?;
        let name = shape.name();
        series
            .turnaround
            .store(set, &format!("turnaround_{name}"), "us");
        let jitter = rounded(series.turnaround.width());
        set.insert(format!("jitter_{name}_us"), jitter);
        all.de_lead.include(series.de_lead);
        all.de_lag.include(series.de_lag);
    }
    all.de_lead.store(set, "de_lead", "us");
    all.de_lag.store(set, "de_lag", "us");
    gaps.store(set, "answer_gap", "us");
    set.remove("answer_gap_min_us");
    Ok(())
}

/// The deepest stack over boot, requests of all kinds, and characters that come too late or damaged.
/// The largest of some seeds of what SRAM held before: a byte that is overwritten with what was there is not
/// seen.
fn stack_peak(image: &Image) -> Result<f64, Trouble> {
    let mut peak = 0;
    for seed in 1..=3 {
        let mut desk = Desk::new(image, |nano| nano.seed = seed)?;
        for _ in 0..EXCHANGES {
            desk.idle();
            let request = mixed(desk.count, &mut desk.random);
            desk.expect(&request)?;
            // Characters that come too late, while the answer is being worked out: interrupts at depth.
            let characters = request.iter().map(|&byte| Tx::byte(byte));
            let mut pause = desk.line().t15() + desk.chance(Time::from_us(200));
            let mut late = Vec::new();
            for _ in 0..4 {
                let character = Tx::byte(0x55).after(pause);
                let is_damaged = desk.random.one_in(2);
                late.push(if is_damaged {
                    character.bad_stop()
                } else {
                    character
                });
                pause = desk.chance(Time::from_us(600));
            }
            desk.bus.host(desk.host).send_each(characters.chain(late));
            desk.bus.run_for(Time::from_ms(100));
        }
        peak = peak.max(desk.bus.node(desk.node).stack_peak());
    }
    Ok(peak as f64)
}

/// Cycles of the line's interrupts, response and `reti` included, over mixed requests and their answers.
fn interrupts(image: &Image, set: &mut Set) -> Result<(), Trouble> {
    let mut desk = Desk::new(image, |_| {})?;
    let node = desk.node;
    let mut seen = INTERRUPTS.map(|_| Vec::new());
    for _ in 0..30 {
        desk.idle();
        let request = mixed(desk.count, &mut desk.random);
        desk.bus.host(desk.host).send(&request);
        desk.bus.node_mut(node).clear_stats();
        let mut before = INTERRUPTS.map(|_| VectorStats::default());
        desk.bus.run_until(
            |bus| {
                let stats = bus.node(node).stats();
                for (index, (_, vector)) in INTERRUPTS.iter().enumerate() {
                    let (was, now) = (before[index], stats.vectors[*vector]);
                    // Two executions between two looks count as two of their mean.
                    for _ in was.count..now.count {
                        seen[index].push((now.total - was.total) / (now.count - was.count));
                    }
                    before[index] = now;
                }
                false
            },
            Time::from_ms(200),
        );
    }
    for ((name, _), mut cycles) in INTERRUPTS.into_iter().zip(seen) {
        cycles.sort_unstable();
        let figures = [
            ("min", cycles.first()),
            ("median", cycles.get(cycles.len() / 2)),
            ("max", cycles.last()),
        ];
        for (which, value) in figures {
            if let Some(&value) = value {
                set.insert(format!("{name}_interrupt_{which}_cycles"), value as f64);
            }
        }
    }
    Ok(())
}
