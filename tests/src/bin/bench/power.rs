//! What the node does with its time: cycles awake per exchange, share of time asleep.

use multidrop_bus::Time;

use crate::Trouble;
use crate::figures::{Range, Set, rounded};
use crate::image::Image;
use crate::traffic::{Desk, Shape};

/// Cycles awake for one exchange, from before the request's first start bit to after the last silence.
pub fn active_cycles(image: &Image, set: &mut Set) -> Result<(), Trouble> {
    let mut desk = Desk::new(image, |_| {})?;
    for shape in [Shape::Read(1), Shape::Read(16)] {
        let mut cycles = Range::default();
        for _ in 0..50 {
            desk.idle();
            let request = shape.request(desk.count, &mut desk.random);
            desk.bus.node_mut(desk.node).clear_stats();
            desk.expect(&request)?;
            desk.bus.run_for(Time::from_ms(5));
            cycles.add(desk.bus.node(desk.node).stats().awake as f64);
        }
        cycles.store(set, &format!("active_{}", shape.name()), "cycles");
    }
    Ok(())
}

/// The share of one second asleep, with nothing on the bus and with FC 03x1 every 100 ms.
pub fn asleep(image: &Image, set: &mut Set) -> Result<(), Trouble> {
    let mut desk = Desk::new(image, |_| {})?;
    desk.bus.node_mut(desk.node).clear_stats();
    desk.bus.run_for(Time::from_s(1));
    set.insert("asleep_idle_percent".to_owned(), share(&desk));

    desk.bus.node_mut(desk.node).clear_stats();
    for _ in 0..10 {
        let next = desk.bus.now() + Time::from_ms(100);
        let request = Shape::Read(1).request(desk.count, &mut desk.random);
        desk.expect(&request)?;
        desk.bus.run_to(next);
    }
    set.insert("asleep_polled_percent".to_owned(), share(&desk));
    Ok(())
}

fn share(desk: &Desk) -> f64 {
    let stats = desk.bus.node(desk.node).stats();
    let all = stats.asleep + stats.awake;
    rounded(100.0 * stats.asleep as f64 / all as f64)
}
