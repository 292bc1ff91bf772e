//! The images that have every function: `conformance`, a server, and `client-functions`, a client.

use multidrop_bus::{Bus, BusConfig, HostPort, Nano, Station, Time, Tx, frames};

use crate::Trouble;
use crate::figures::{Range, Set, us_between};
use crate::image::Images;
use crate::measure::sizes;
use multidrop_testkit::plain::requests::Requests;
use multidrop_testkit::plain::wire::{Flaw, Way};
use multidrop_testkit::random::Random;

/// Requests to the server for each seed of what SRAM held before.
const REQUESTS: usize = 300;
/// In this time the client has asked everything: it waits half a second for each of three answers that do not come.
const ASKED: Time = Time::from_ms(4_000);

/// The deepest stack of the server over random requests of all functions, damaged frames, and late characters.
pub fn server(images: &Images<'_>) -> Result<Set, Trouble> {
    let image = images.app("conformance")?;
    let mut peak = 0;
    for seed in 1..=3 {
        let mut bus = Bus::new(BusConfig::default());
        let node = bus.add_nano(Nano {
            seed,
            ..Nano::new(image.name(), &image.path)
        })?;
        let host = bus.add_host(HostPort::new(image.line()));
        bus.run_for(Time::from_ms(20));
        let mut random = Random::new(seed);
        let mut below = |end: u32| (random.next() % u64::from(end)) as u32;
        let mut traffic = Requests::new(&mut below, &[Flaw::Gap, Flaw::Framing]);
        for _ in 0..REQUESTS {
            let characters = traffic.step().characters(Way::Rtu, b'\n');
            let late = (image.line().t15() + image.line().t35()) / 2;
            let sent = characters.iter().map(|one| match one.flaw {
                Flaw::Gap => Tx::byte(one.value).after(late),
                Flaw::Framing => Tx::byte(one.value).bad_stop(),
                _ => Tx::byte(one.value),
            });
            let end = bus.host(host).send_each(sent);
            bus.run_to(end);
            bus.transact(host, &[], Time::from_ms(20));
            bus.clear_record();
        }
        peak = peak.max(bus.node(node).stack_peak());
    }
    let mut set = sizes(image);
    set.insert("stack_peak_bytes".to_owned(), peak as f64);
    Ok(set)
}

/// From each answer that the client gets to its next request, beyond t3.5: both are Nanos.
pub fn client(images: &Images<'_>) -> Result<Set, Trouble> {
    let image = images.app("client-functions")?;
    let mut bus = Bus::new(BusConfig::default());
    bus.add_nano(Nano::new("server", &images.app("conformance")?.path))?;
    let client = bus.add_nano(Nano::new(image.name(), &image.path))?;
    bus.run_for(ASKED);
    let found = frames(bus.record(), image.line());
    let mut gaps = Range::default();
    let mut count = 0;
    for pair in found.windows(2) {
        let [answer, request] = pair else { continue };
        if answer.answer && !request.answer && request.from == Station::Node(client) {
            let due = answer.end() + image.line().t35();
            gaps.add(us_between(request.start(), due));
            count += 1;
        }
    }
    // Forty and some requests, of which a few are not answered.
    if count < 30 {
        return Err(Trouble::Firmware {
            image: image.name(),
            what: format!("only {count} requests after answers\n{}", bus.record()),
        });
    }
    let mut set = sizes(image);
    gaps.store(&mut set, "request_gap", "us");
    Ok(set)
}
