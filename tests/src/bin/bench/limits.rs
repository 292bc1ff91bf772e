//! Where it begins to fail: baud rate, clock error, gaps inside a frame.

use multidrop_bus::{Pin, Time, Tx};

use crate::Trouble;
use crate::figures::{Set, rounded};
use crate::image::{Image, Images};
use crate::traffic::{Desk, Shape, mixed};

/// The bauds that are tried, in order.
pub const BAUDS: [u32; 6] = [38_400, 57_600, 115_200, 250_000, 500_000, 1_000_000];
/// Requests without a loss that make a baud loss-free.
pub const REQUESTS: usize = 400;

/// Requests at each clock error.
const CLOCK_REQUESTS: usize = 100;
/// How finely clock errors are told apart, first and then.
const CLOCK_STEPS_PPM: [i32; 2] = [5_000, 1_000];
/// Where the search ends: a UART samples a neighbouring bit long before.
const CLOCK_END_PPM: i32 = 100_000;

/// Rounds of the search for the longest gap, at each place inside the frame.
const GAP_ROUNDS: usize = 4;

/// The highest baud up to which no request of 400 is lost, each sent as soon as the bus is free.
/// 0 where even the first is not.
pub fn loss_free_baud(images: &Images<'_>, count: u8) -> Result<u32, Trouble> {
    let mut free = 0;
    for baud in BAUDS {
        let mut desk = Desk::new(images.registers(count, baud)?, |_| {})?;
        if !answers_all(&mut desk, REQUESTS) {
            break;
        }
        free = baud;
    }
    Ok(free)
}

/// The highest loss-free baud of a node on which tasks wait for edges on port D, with one edge at any time of each
/// exchange.
pub fn loss_free_baud_with_edges(images: &Images<'_>) -> Result<u32, Trouble> {
    let mut free = 0;
    for baud in BAUDS {
        let mut desk = Desk::new(images.edges(baud)?, |nano| nano.de = Pin::new('C', 0))?;
        let mut level = true;
        let all = (0..REQUESTS).all(|_| {
            level = !level;
            let within = Time::from_ms(3).ps() * 16 / 1_000_000;
            let offset = u64::from(desk.random.below(within as u16));
            let node = desk.bus.node_mut(desk.node);
            node.set_input_at(Pin::D4, level, node.cycle() + offset);
            let request = mixed(desk.count, &mut desk.random);
            desk.ask(&request).is_some()
        });
        if !all {
            break;
        }
        free = baud;
    }
    Ok(free)
}

/// Whether that many mixed requests are answered, each right to the last bit.
pub fn answers_all<N>(desk: &mut Desk<N>, requests: usize) -> bool {
    (0..requests).all(|_| {
        let request = mixed(desk.count, &mut desk.random);
        desk.ask(&request).is_some()
    })
}

/// How far the node's clock may be off before requests are lost, to either side: the smallest error, in steps of
/// 1000 ppm, at which one of 100 is. The host's clock is right.
pub fn clock_error(image: &Image, set: &mut Set) -> Result<(), Trouble> {
    for (name, sign) in [("fast", 1), ("slow", -1)] {
        let mut good = 0;
        for step in CLOCK_STEPS_PPM {
            while good < CLOCK_END_PPM {
                let mut desk = Desk::new(image, |nano| nano.clock_ppm = sign * (good + step))?;
                if !answers_all(&mut desk, CLOCK_REQUESTS) {
                    break;
                }
                good += step;
            }
        }
        let first_bad = good + CLOCK_STEPS_PPM[1];
        set.insert(format!("clock_{name}_loss_from_ppm"), f64::from(first_bad));
    }
    Ok(())
}

/// The longest gap inside a frame that was still accepted, and the shortest that was not, over every place in
/// the frame and many phases of the node's timer.
pub fn longest_gap(image: &Image, set: &mut Set) -> Result<(), Trouble> {
    let mut desk = Desk::new(image, |_| {})?;
    let t15 = desk.line().t15();
    // Finer than a cycle is of no use.
    let resolution = Time::from_ps(62_500);
    let (mut accepted, mut dropped) = (Time::ZERO, Time::NEVER);
    let length = Shape::Read(1).request(image.count, &mut desk.random).len();
    for _ in 0..GAP_ROUNDS {
        for place in 1..length {
            let (mut low, mut high) = (t15 / 2, t15 * 2);
            while high - low > resolution {
                let gap = (low + high) / 2;
                desk.idle();
                let request = Shape::Read(1).request(image.count, &mut desk.random);
                let characters = request.iter().enumerate().map(|(at, &byte)| {
                    let pause = if at == place { gap } else { Time::ZERO };
                    Tx::byte(byte).after(pause)
                });
                if desk.ask_each(characters, &request).is_some() {
                    accepted = accepted.max(gap);
                    low = gap;
                } else {
                    dropped = dropped.min(gap);
                    high = gap;
                }
            }
        }
    }
    let as_t15 = |gap: Time| rounded(gap.us() / t15.us());
    set.insert("gap_accepted_max_us".to_owned(), rounded(accepted.us()));
    set.insert("gap_accepted_max_t15".to_owned(), as_t15(accepted));
    set.insert("gap_dropped_min_us".to_owned(), rounded(dropped.us()));
    set.insert("gap_dropped_min_t15".to_owned(), as_t15(dropped));
    Ok(())
}
