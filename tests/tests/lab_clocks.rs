//! Nodes whose crystals are off lose no frame. `bench` measures the limit.

use multidrop_bus::{Bus, BusConfig, Campaign, HostPort, Line, Nano, Time};
use multidrop_testkit::model::Model;
use multidrop_testkit::registers;
use multidrop_testkit::traffic::{everything, request};

const COUNT: u16 = 128;
/// Longest time from the end of a request to an answer.
const PATIENCE: Time = Time::from_ms(5);

fn converse(baud: u32, ppm: i32) {
    let line = Line::n81(baud);
    let mut bus = Bus::new(BusConfig::default());
    let nano = Nano {
        clock_ppm: ppm,
        ..Nano::new("unit 1", registers(COUNT as u8, line))
    };
    bus.add_nano(nano).expect("a valid image");
    let host = bus.add_host(HostPort::new(line));
    bus.run_for(Time::from_ms(20));
    let mut model = Model::new(1, usize::from(COUNT));
    let mut campaign = Campaign::new(u64::from(baud) + 1);
    let requests: Vec<_> = (0..300)
        .map(|_| request(&mut campaign.random, 1, COUNT))
        .collect();
    let asked = requests.into_iter().map(|request| {
        let answer = model.answer(&request);
        (request, answer)
    });
    let mut asked: Vec<_> = asked.collect();
    asked.extend(everything(&model, 1, COUNT));
    let long = asked.iter().filter(|(_, answer)| answer.len() > 200);
    assert!(long.count() > 5);
    for (index, (request, expected)) in asked.iter().enumerate() {
        let answer = bus.transact(host, request, PATIENCE);
        let what = format!("{index}: {request:02x?} at {ppm} ppm");
        let answer = answer.unwrap_or_else(|| panic!("{what} was not answered"));
        assert_eq!(answer.bytes, *expected, "{what}");
        assert!(answer.is_clean(), "{what}: {answer:02x?}");
        bus.clear_record();
    }
}

#[test]
fn two_percent_slow_at_38400() {
    converse(38_400, -20_000);
}

#[test]
fn two_percent_fast_at_38400() {
    converse(38_400, 20_000);
}

#[test]
fn one_percent_slow_at_115200() {
    converse(115_200, -10_000);
}

#[test]
fn one_percent_fast_at_115200() {
    converse(115_200, 10_000);
}
