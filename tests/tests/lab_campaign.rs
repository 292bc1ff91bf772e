//! Random faults by a seed on a bus with three nodes: other nodes are not affected, none blocks the bus, no write is
//! done in part, and the next good request is answered.

use multidrop_bus::{
    Bus, BusConfig, Campaign, Fault, HostId, HostPort, Nano, NodeId, RxByte, Station, Time,
    received,
};
use multidrop_testkit::frames::{adu, words};
use multidrop_testkit::model::Model;
use multidrop_testkit::traffic::{everything, request};
use multidrop_testkit::{DE_LAG, LINE, image, registers};

/// Faults under each seed.
const FAULTS: usize = 6;
/// What clocks may be off by.
const CLOCK_PPM: u32 = 30_000;

/// Unit 1 has 16 of each; of the demonstration units 2 and 3 it is their one register that is used.
const COUNTS: [u16; 3] = [16, 1, 1];

struct Lab {
    bus: Bus,
    nodes: Vec<NodeId>,
    client: HostId,
    neighbour: HostId,
    models: Vec<Model>,
    /// Of the node with the fastest clock, at least 0.
    fastest_ppm: i32,
}

fn boot(unit: usize) -> Model {
    Model::new(unit as u8 + 1, usize::from(COUNTS[unit]))
}

impl Lab {
    fn new(campaign: &mut Campaign) -> Self {
        let mut bus = Bus::new(BusConfig::default());
        let images = [
            registers(COUNTS[0] as u8, LINE),
            image("demo-unit", &["--unit", "2"]),
            image("demo-unit", &["--unit", "3"]),
        ];
        let mut fastest = 0;
        let mut nodes = Vec::new();
        for (index, elf) in images.into_iter().enumerate() {
            let nano = Nano {
                clock_ppm: campaign.random.clock_ppm(CLOCK_PPM),
                seed: campaign.random.any(),
                ..Nano::new(format!("unit {}", index + 1), elf)
            };
            fastest = nano.clock_ppm.max(fastest);
            nodes.push(bus.add_nano(nano).expect("a valid image"));
        }
        let [client, neighbour] = [(); 2].map(|()| bus.add_host(HostPort::new(LINE)));
        bus.run_for(Time::from_ms(20));
        Lab {
            bus,
            nodes,
            client,
            neighbour,
            models: (0..3).map(boot).collect(),
            fastest_ppm: fastest,
        }
    }

    /// A good request to anyone.
    fn ask(&mut self, request: &[u8]) -> Vec<u8> {
        let answer = self.bus.transact(self.client, request, Time::from_ms(5));
        answer.map_or(Vec::new(), |answer| answer.bytes)
    }

    /// Asks each unit for all it holds, beginning with unit `first`, and takes the one of
    /// `candidates` that it is. Every request must be answered.
    fn settle(&mut self, first: usize, candidates: &[Vec<Model>], what: &str) {
        for unit in (0..3).map(|index| (first + index) % 3) {
            let id = unit as u8 + 1;
            let reads = |model: &Model| {
                let mut reads = everything(model, id, COUNTS[unit]);
                // Their coils are the register seen otherwise.
                reads.retain(|(read, _)| unit == 0 || read[1] == 3);
                reads
            };
            let asked: Vec<_> = reads(&self.models[unit])
                .into_iter()
                .map(|(read, _)| self.ask(&read))
                .collect();
            let fits = |model: &&Model| {
                let expected = reads(model).into_iter().map(|(_, answer)| answer);
                expected.eq(asked.iter().cloned())
            };
            let Some(model) = candidates[unit].iter().find(fits) else {
                panic!("{what}: unit {id} answered {asked:02x?}");
            };
            self.models[unit] = model.clone();
        }
        self.check(&[], what);
    }

    /// What holds whatever goes wrong: no driver stays on, and none is switched on but for an
    /// answer that begins t3.5 after its request. Those of `restarted` may let go early.
    fn check(&mut self, restarted: &[NodeId], what: &str) {
        let record = self.bus.record();
        for &node in &self.nodes {
            let fail = |why: &str| panic!("{what}: {} {why}\n{record}", self.bus.node(node).name());
            assert_eq!(self.bus.node(node).bad_opcodes(), 0, "{what}");
            let edges = record
                .de_edges()
                .iter()
                .filter(|edge| edge.from == node.into());
            let edges: Vec<_> = edges.collect();
            if edges.len() % 2 == 1 {
                fail("holds the bus");
            }
            for pair in edges.chunks(2) {
                let (on, off) = (pair[0].time, pair[1].time);
                let sent = record.sent_by(Station::Node(node));
                let sent: Vec<_> = sent.filter(|b| b.start >= on && b.start < off).collect();
                let Some(last) = sent.last() else {
                    if !restarted.contains(&node) {
                        fail("drove without a character");
                    }
                    continue;
                };
                if off > last.end + DE_LAG {
                    fail("held the bus after its answer");
                }
                if off < last.end && !restarted.contains(&node) {
                    fail("let go inside of its answer");
                }
                // A node counts by its own clock, from the last start bit on.
                let asked = record.sent_by(Station::Host(self.client));
                let asked = asked.map(|byte| byte.start).filter(|start| *start < on);
                let wait = LINE.character() + LINE.t35();
                let wait = wait * 1_000_000 / (1_000_000 + self.fastest_ppm as u64);
                if asked.max().is_none_or(|start| sent[0].start < start + wait) {
                    fail("answered before t3.5");
                }
            }
        }
        self.bus.clear_record();
    }
}

/// The bytes, if they came without an error and with a right CRC.
fn good(heard: &[RxByte]) -> Option<Vec<u8>> {
    let bytes: Vec<u8> = heard.iter().map(|byte| byte.value).collect();
    let intact = bytes.len() >= 4 && adu(&bytes).ends_with(&[0, 0]);
    (intact && heard.iter().all(RxByte::is_good)).then_some(bytes)
}

/// What a fault may leave behind.
struct Verdict {
    /// What the client may hear with a right CRC.
    answers: Vec<Vec<u8>>,
    /// Whether it must hear one of them.
    must_answer: bool,
    /// What each unit may hold.
    candidates: Vec<Vec<Model>>,
    /// Who was restarted.
    restarted: Vec<NodeId>,
}

fn judge(lab: &Lab, request: &[u8], fault: &Fault) -> Verdict {
    let execute = |frames: &[Vec<u8>]| {
        let mut models = lab.models.clone();
        let mut answers = Vec::new();
        for model in &mut models {
            let each = frames.iter().map(|frame| model.answer(frame));
            answers.extend(each.filter(|answer| !answer.is_empty()));
        }
        (models, answers)
    };
    let (done, mut answers) = execute(&[request.to_vec()]);
    let mut verdict = Verdict {
        answers: Vec::new(),
        must_answer: false,
        candidates: Vec::new(),
        restarted: Vec::new(),
    };
    match fault {
        // What is received is known, and so is all that follows.
        Fault::Damage(_) => {
            let frames = received(&fault.characters(request, LINE), LINE);
            let frames: Vec<_> = frames.into_iter().flatten().collect();
            let (done, answers) = execute(&frames);
            verdict.must_answer = !answers.is_empty();
            verdict.answers = answers;
            verdict.candidates = done.into_iter().map(|model| vec![model]).collect();
            return verdict;
        }
        Fault::Noise { .. } | Fault::StuckLow { .. } => {}
        Fault::Intrusion { bytes, .. } => answers.push(bytes.clone()),
        Fault::Reset { node, .. } | Fault::PowerCut { node, .. } => {
            verdict.restarted.push(*node);
            let unit = lab.nodes.iter().position(|known| known == node);
            let unit = unit.expect("one of ours");
            verdict.must_answer = !answers.is_empty() && usize::from(request[0]) != unit + 1;
            // Others hear the request as it was sent; the one that starts again holds nothing.
            let all = done.into_iter().enumerate();
            verdict.candidates = all
                .map(|(index, model)| vec![if index == unit { boot(unit) } else { model }])
                .collect();
            verdict.answers = answers;
            return verdict;
        }
    }
    // Each unit heard it or did not: all of it or nothing.
    let both = lab.models.iter().cloned().zip(done);
    verdict.candidates = both.map(|(before, after)| vec![before, after]).collect();
    verdict.answers = answers;
    verdict
}

fn run(mut campaign: Campaign, kinds: &mut [usize; 6]) {
    let mut lab = Lab::new(&mut campaign);
    for unit in 0..3 {
        let write = words(unit as u8 + 1, 6, 0, campaign.random.any() as u16);
        let expected = lab.models[unit].answer(&write);
        assert_eq!(lab.ask(&write), expected, "before any fault");
    }
    lab.check(&[], "before any fault");
    for index in 0..FAULTS {
        let random = &mut campaign.random;
        let value = random.any() as u16;
        let request = match random.below(8) {
            0..=3 => request(random, 1, COUNTS[0]),
            4 => words(2, 6, 0, value),
            5 => words(3, 6, 0, value),
            6 => words(random.pick(&[2, 3, 9]), 3, 0, 1),
            _ => words(0, 6, 0, value),
        };
        let nodes = lab.nodes.clone();
        let fault = campaign.draw(LINE, &request, &nodes);
        kinds[match fault {
            Fault::Damage(_) => 0,
            Fault::Noise { .. } => 1,
            Fault::StuckLow { .. } => 2,
            Fault::Intrusion { .. } => 3,
            Fault::Reset { .. } => 4,
            Fault::PowerCut { .. } => 5,
        }] += 1;
        let what = format!("fault {index}, {fault:02x?} with {request:02x?}");
        let verdict = judge(&lab, &request, &fault);

        let heard = fault.strike(&mut lab.bus, lab.client, lab.neighbour, &request);
        if let Some(bytes) = good(&heard) {
            // Noise behind an answer may read as a further 00, over which the CRC is right all the
            // same: its residue is zero. Its length tells a client.
            let whole = bytes.split_last().filter(|(last, _)| **last == 0);
            let whole = whole.map_or(&[][..], |(_, whole)| whole);
            let is = |answer: &Vec<u8>| *answer == bytes || answer == whole;
            let right = verdict.answers.iter().any(is);
            assert!(right, "{what}: heard {bytes:02x?}\n{}", lab.bus.record());
        } else {
            assert!(!verdict.must_answer, "{what}\n{}", lab.bus.record());
        }
        // Those who are not asked do nothing at all.
        let record = lab.bus.record();
        for (unit, &node) in lab.nodes.iter().enumerate() {
            let silent = !record
                .de_edges()
                .iter()
                .any(|edge| edge.from == node.into());
            let asked = usize::from(request[0]) == unit + 1;
            assert!(asked || silent, "{what}\n{record}");
        }
        assert!(lab.bus.wire_level(), "{what}: the bus is held");
        lab.check(&verdict.restarted, &what);
        let first = campaign.random.index(3);
        lab.settle(first, &verdict.candidates, &what);
    }
}

fn seeds(seeds: std::ops::Range<u64>) {
    let mut kinds = [0; 6];
    Campaign::each(seeds, |campaign| run(campaign, &mut kinds));
    println!("damage, noise, stuck low, intrusion, reset, power cut: {kinds:?}");
    if std::env::var_os("BUS_SEED").is_none() {
        assert!(kinds.iter().all(|count| *count > 20), "{kinds:?}");
    }
}

#[test]
fn one_half_of_the_seeds() {
    seeds(0..150);
}

#[test]
fn the_other_half_of_the_seeds() {
    seeds(150..300);
}
