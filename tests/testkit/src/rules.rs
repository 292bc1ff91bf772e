//! The rules that hold on the bus at all times.

use multidrop_bus::{Bus, Line, Station, Time, WireByte};

/// How long DE may stay up after the last stop bit.
pub const DE_LAG: Time = Time::from_us(10);

/// The port of a machine that is on RS-485, with a DE pin.
const RS4: usize = 3;

/// What [`assert_bus_rules`] is told.
pub struct Rules {
    line: Line,
    de_lag: Time,
    /// Whether what is sent answers RTU frames.
    answers_rtu: bool,
}

impl From<Line> for Rules {
    /// Servers that speak RTU.
    fn from(line: Line) -> Self {
        Rules {
            line,
            de_lag: DE_LAG,
            answers_rtu: true,
        }
    }
}

impl Rules {
    /// Clients: what they send is no answer.
    pub fn client(line: Line) -> Self {
        Rules {
            answers_rtu: false,
            ..line.into()
        }
    }

    /// DE may stay up for so much longer: for nodes that have more to do in their interrupts.
    pub fn and_de_lag(self, more: Time) -> Self {
        Rules {
            de_lag: self.de_lag + more,
            ..self
        }
    }

    /// Servers that allow gaps inside frames.
    pub fn with_gaps(line: Line) -> Self {
        Rules::client(line)
    }

    /// Servers that speak ASCII, which has up to a second between characters.
    pub fn ascii(line: Line) -> Self {
        Rules::client(line)
    }
}

/// Checks the record, which must begin and end in silence:
/// - no two drivers ever disagreed;
/// - a node drives for answers alone: DE up at most one bit before the first start bit, no
///   idle time between characters, DE down within 10 us of the last stop bit and never before its
///   end (SER 2.5.1.1 and the half-duplex rules of SER 3.2), characters as long as those of the line and of its format;
/// - no answer begins before t3.5 after the last character of anyone else, or while one is sent;
/// - no frame of RTU is answered that has a gap of more than t1.5 and a bit, or a damaged character.
///
/// `rules` is the line, for servers that speak RTU; others have [`Rules`] of their own.
pub fn assert_bus_rules(bus: &Bus, rules: impl Into<Rules>) {
    let Rules {
        line,
        de_lag,
        answers_rtu,
    } = rules.into();
    let record = bus.record();
    let bit = Time::from_us(1_000_000 / u64::from(line.baud) + 1);
    assert!(
        record.conflicts().is_empty(),
        "two drivers disagreed\n{record}"
    );
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
            if first.start - on > bit {
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
            // A clock may be off by 2.5 % and more on the Nano; a bit more or less is a tenth.
            let sent_bits = last.end - first.start;
            let all = line.character() * answer.len() as u64;
            if sent_bits * 20 > all * 21 || sent_bits * 20 < all * 19 {
                broken("characters of another length");
            }
            if !answer.iter().all(|byte| byte.fits(line.format)) {
                broken("characters of another format");
            }
            let others = |byte: &&WireByte| byte.from != station && byte.start < off;
            let heard = record.bytes().iter().filter(others);
            let heard: Vec<_> = heard.collect();
            if answers_rtu {
                match flaw(&heard, line, bit) {
                    Some(Flaw::Gap) => broken("an answer to a frame with a gap"),
                    Some(Flaw::Damaged) => broken("an answer to a damaged frame"),
                    None => {}
                }
            }
            if heard
                .iter()
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

enum Flaw {
    Gap,
    Damaged,
}

/// What is wrong with the last frame of these characters.
fn flaw(heard: &[&WireByte], line: Line, bit: Time) -> Option<Flaw> {
    let pause = |pair: &[&WireByte]| pair[1].start - pair[0].end.min(pair[1].start);
    // What begins a little before t3.5 by one clock begins behind it by another.
    let apart = |pair: &[&WireByte]| pause(pair) * 100 >= line.t35() * 95;
    let first = heard
        .windows(2)
        .rposition(apart)
        .map_or(0, |place| place + 1);
    let frame = &heard[first..];
    // What a receiver can tell of a character; values that were damaged are for the CRC.
    if frame
        .iter()
        .any(|byte| byte.framing_error || byte.parity_error)
    {
        return Some(Flaw::Damaged);
    }
    frame
        .windows(2)
        .any(|pair| pause(pair) > line.t15() + bit)
        .then_some(Flaw::Gap)
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
