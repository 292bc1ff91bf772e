//! Thousands of requests with one in a hundred bytes damaged: a receiver by the standard decides which of them may be
//! answered and executed.

use multidrop_bus::{Campaign, Damage, Format, Line, Tx, received};
use multidrop_testkit::frames::{adu, data, words};
use multidrop_testkit::model::Model;
use multidrop_testkit::traffic::{everything, request};
use multidrop_testkit::{LINE, Rig};

const COUNT: u16 = 16;
const REQUESTS: usize = 2_500;

/// What was seen of damaged requests.
#[derive(Debug, Default)]
struct Tally {
    damaged: usize,
    /// Frames that came otherwise than they were sent, and with a right CRC all the same: what
    /// they say is executed, rightly.
    right_crc: usize,
    /// Damaged requests that were answered or executed as they should be: a pause within t1.5, or
    /// the right CRC over wrong data.
    done: usize,
}

fn hold(rig: &mut Rig, model: &Model, what: &str) {
    for (read, answer) in everything(model, 1, COUNT) {
        assert_eq!(rig.ask(&read), answer, "{what}: what the unit holds");
    }
}

fn converse(line: Line, seeds: std::ops::Range<u64>) -> Tally {
    let mut tally = Tally::default();
    let each = REQUESTS as u64 / (seeds.end - seeds.start);
    Campaign::each(seeds, |mut campaign| {
        let mut rig = Rig::registers(COUNT as u8, line);
        let mut model = Model::new(1, usize::from(COUNT));
        let random = &mut campaign.random;
        for index in 0..each {
            let unit = match random.below(20) {
                0 => 0,
                1 => 2,
                _ => 1,
            };
            let sent = request(random, unit, COUNT);
            let mut characters: Vec<Tx> = sent.iter().map(|&byte| Tx::byte(byte)).collect();
            let hits = sent.iter().filter(|_| random.one_in(100)).count();
            for _ in 0..hits {
                Damage::draw(random, line, sent.len()).apply(&mut characters, line);
            }
            let frames = received(&characters, line);
            let whole: Vec<_> = frames.iter().flatten().collect();
            let changed = whole.iter().filter(|frame| ***frame != sent);
            let before = model.clone();
            let expected: Vec<u8> = whole.iter().flat_map(|frame| model.answer(frame)).collect();

            let heard = rig.ask_each(characters);
            let what = format!("request {index}, {sent:02x?} came as {frames:02x?}");
            assert_eq!(heard, expected, "{what}");
            if hits > 0 {
                tally.damaged += 1;
                let right = |frame: &[u8]| adu(frame).ends_with(&[0, 0]);
                tally.right_crc += changed.filter(|frame| right(frame)).count();
                tally.done += usize::from(!heard.is_empty() || model != before);
                hold(&mut rig, &model, &what);
            }
        }
        hold(&mut rig, &model, "at the end");
    });
    println!("{line:?}: {tally:?}");
    tally
}

fn check(line: Line, seeds: std::ops::Range<u64>) {
    let alone = seeds.clone();
    let tally = converse(line, seeds);
    if std::env::var_os("BUS_SEED").is_none() {
        assert_eq!(alone.end - alone.start, 10);
        assert!(tally.damaged > REQUESTS / 15, "{tally:?}");
        assert!(
            tally.done > 0 && tally.done < tally.damaged / 2,
            "{tally:?}"
        );
    }
}

#[test]
fn at_38400_8n1() {
    check(LINE, 0..10);
}

#[test]
fn at_115200_8e1() {
    let line = Line {
        baud: 115_200,
        format: Format::E81,
    };
    check(line, 100..110);
}

/// What a CRC cannot see: the damage turns one good frame into another, which is then what was
/// asked for. Counted as `right_crc` above.
#[test]
fn a_damaged_frame_with_a_matching_crc_is_executed_as_received() {
    let mut rig = Rig::registers(COUNT as u8, LINE);
    let (sent, arrives) = (words(1, 6, 3, 0x1234), words(1, 6, 3, 0x1235));
    let mut characters: Vec<Tx> = sent.iter().map(|&byte| Tx::byte(byte)).collect();
    for (at, (sent, arrives)) in sent.iter().zip(&arrives).enumerate() {
        let mask = sent ^ arrives;
        Damage::Flipped { at, mask }.apply(&mut characters, LINE);
    }
    assert_eq!(received(&characters, LINE), [Some(arrives.clone())]);
    assert_eq!(rig.ask_each(characters), arrives);
    rig.expect(&words(1, 3, 3, 1), &data(1, 3, &[0x12, 0x35]));
}
