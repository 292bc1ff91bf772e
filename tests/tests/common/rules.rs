//! What holds on the bus at all times, whatever is asked.

use multidrop_bus::{Bus, Line, Station, Time, WireByte};

/// How long DE may stay up after the last stop bit.
pub const DE_LAG: Time = Time::from_us(10);

/// The port of a machine that is on RS-485, with a DE pin.
const RS4: usize = 3;

/// What [`assert_bus_rules`] is told.
pub struct Rules {
    line: Line,
    de_lag: Time,
}

impl From<Line> for Rules {
    fn from(line: Line) -> Self {
        (line, DE_LAG).into()
    }
}

impl From<(Line, Time)> for Rules {
    fn from((line, de_lag): (Line, Time)) -> Self {
        Rules { line, de_lag }
    }
}

/// Checks the record, which must begin and end in silence:
/// - no two drivers ever disagreed;
/// - a node drives for answers alone: DE up at most one character before the first start bit, no
///   idle time between characters, DE down within 10 us of the last stop bit and never before its
///   end (SER 2.5.1.1 and the half-duplex rules of SER 3.2);
/// - no answer begins before t3.5 after the last character of anyone else, or while one is sent.
///
/// `rules` is the line; or the line and how long DE may stay up instead, for nodes that have more to do in
/// their interrupts.
pub fn assert_bus_rules(bus: &Bus, rules: impl Into<Rules>) {
    let Rules { line, de_lag } = rules.into();
    let record = bus.record();
    assert_eq!(record.conflicts(), [], "\n{record}");
    for (_, node) in bus.nodes() {
        assert_eq!(node.bad_opcodes(), 0, "{} ran wild", node.name());
    }
    let nodes = bus.nodes().map(|(id, _)| Station::Node(id));
    for station in nodes.chain(bus.machines().filter_map(|machine| machine.station(RS4))) {
        let broken = |what: &str| panic!("{station}: {what}\n{record}");
        let mut sent: Vec<_> = record.sent_by(station).collect();
        for (on, off) in driven(bus, station) {
            let rest = sent.split_off(sent.partition_point(|byte| byte.start < off));
            let answer = std::mem::replace(&mut sent, rest);
            let (Some(first), Some(last)) = (answer.first(), answer.last()) else {
                return broken("drove without a character");
            };
            if first.start < on {
                broken("a character before DE");
            }
            if first.start - on > line.character() {
                broken("DE up too early");
            }
            if off < last.end {
                broken("DE down too early");
            }
            if off - last.end > de_lag {
                broken("DE down too late");
            }
            if answer.windows(2).any(|pair| pair[0].end != pair[1].start) {
                broken("idle time between characters");
            }
            if !answer.iter().all(|byte| byte.is_good()) {
                broken("a damaged character");
            }
            let others = |byte: &&WireByte| byte.from != station && byte.start < off;
            let heard = record.bytes().iter().filter(others);
            if heard
                .map(|byte| byte.end + line.t35())
                .any(|end| end > first.start)
            {
                broken("an answer before t3.5");
            }
        }
        if !sent.is_empty() {
            broken("a character without DE");
        }
    }
}

/// When a station's driver was on, from and to.
fn driven(bus: &Bus, station: Station) -> Vec<(Time, Time)> {
    let record = bus.record();
    let edges: Vec<_> = record
        .de_edges()
        .iter()
        .filter(|edge| edge.from == station)
        .collect();
    assert!(
        edges.len().is_multiple_of(2),
        "DE is up at the end\n{record}"
    );
    edges
        .chunks(2)
        .map(|pair| {
            assert!(pair[0].on && !pair[1].on, "\n{record}");
            (pair[0].time, pair[1].time)
        })
        .collect()
}
