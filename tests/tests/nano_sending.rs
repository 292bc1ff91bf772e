//! A Nano during a transmission: its own echo, and settings for the next frame.

use multidrop_bus::{Bus, Format, Line, Nano, Pin, Time, Tx};
use multidrop_testkit::conforms::Board;
use multidrop_testkit::frames::{adu, block, data, words};
use multidrop_testkit::plain::wire::Way;
use multidrop_testkit::{LINE, Rig, conformance, example};

/// The unit id of `conformance`.
const UNIT: u8 = 17;

/// Index of USART_RX among the vectors.
const CHARACTER: usize = 18;

const LINES: [Line; 3] = [
    LINE,
    Line::n81(115_200),
    Line {
        baud: 9_600,
        format: Format::E81,
    },
];

fn hears_itself(line: Line, echo: bool) -> Rig {
    let image = conformance(Board::Nano, Way::Rtu, line);
    let nano = Nano {
        echo,
        ..Nano::new("conformance", image)
    };
    Rig::nano(nano, line)
}

#[test]
fn a_node_with_an_echo_answers_like_one_without() {
    for line in LINES {
        let baud = line.baud;
        let exchanges = [
            (words(UNIT, 3, 0, 1), data(UNIT, 3, &[0, 0])),
            (
                words(UNIT, 4, 0, 125),
                data(
                    UNIT,
                    4,
                    &(0..125).flat_map(|at| [0x10, at]).collect::<Vec<_>>(),
                ),
            ),
            (block(UNIT, 16, 0, 4, &[0x55; 8]), words(UNIT, 16, 0, 4)),
        ];
        let told = [false, true].map(|echo| {
            let mut rig = hears_itself(line, echo);
            let node = rig.node();
            let mut turnarounds = Vec::new();
            for (request, answer) in &exchanges {
                rig.bus.node_mut(node).clear_stats();
                let heard = rig.exchange(request).expect("an answer");
                assert_eq!(&heard.bytes, answer);
                turnarounds.push(heard.turnaround());
                rig.pause(Time::from_ms(5));
                let interrupts = rig.bus.node(node).stats().vectors[CHARACTER].count;
                assert_eq!(interrupts, request.len() as u64, "{baud} baud, {echo}");
            }
            // Messages, errors, exceptions, messages of this server, without an answer, two kinds of busy, overruns.
            for (sub, count) in (0x0B..).zip([4, 0, 0, 7, 0, 0, 0, 0]) {
                let asked = adu(&[UNIT, 8, 0, sub, 0, 0]);
                rig.expect(&asked, &adu(&[UNIT, 8, 0, sub, 0, count]));
            }
            turnarounds
        });
        let [quiet, echoed] = told;
        for (quiet, echoed) in quiet.iter().zip(&echoed) {
            assert!(*echoed < *quiet + line.bits(1), "{echoed}, not {quiet}");
        }
    }
}

#[test]
fn a_request_t3_5_after_an_echoed_answer_is_answered() {
    for line in LINES {
        let baud = line.baud;
        let mut rig = hears_itself(line, true);
        let (request, answer) = (words(UNIT, 4, 2, 1), data(UNIT, 4, &[0x10, 0x02]));
        for _ in 0..4 {
            let (host, count) = (rig.host, answer.len());
            rig.bus.host(host).take();
            rig.bus.host(host).send(&request);
            let answered = |bus: &mut Bus| bus.host(host).heard().len() == count;
            assert!(rig.bus.run_until(answered, Time::from_s(1)));
            // Heard in the middle of the last stop bit; sent to its end.
            rig.bus.run_for(line.bits(1));
            let last = rig.bus.record().bytes().last().expect("an answer").end;
            rig.bus.run_to(last + line.t35());
            let heard = rig.ask_each(request.iter().copied().map(Tx::byte));
            assert_eq!(heard, answer, "{baud} baud");
        }
    }
}

/// Between what the example `changes` goes to and fro.
const SETTINGS: [Line; 2] = [
    LINE,
    Line {
        baud: 9_600,
        format: Format::E81,
    },
];

#[test]
fn settings_changed_during_a_transmission_apply_to_the_next_frame() {
    let mut rig = Rig::nano(Nano::new("changes", example("changes")), SETTINGS[0]);
    let node = rig.node();
    rig.bus.node_mut(node).set_input(Pin::D3, Some(true));
    rig.pause(Time::from_ms(5));
    let frame = adu(&[7, 1, 2, 3]);
    let mut now = 0;
    // Eighths of a character, from the first start bit of the answer to its end.
    for eighth in 0..8 * frame.len() as u64 {
        rig.line = SETTINGS[now];
        rig.bus.host(rig.host).set_line(rig.line);
        let end = rig.bus.host(rig.host).send(&frame);
        let fall = end + rig.line.t35() + Time::from_us(30) + rig.line.character() * eighth / 8;
        let node = rig.bus.node_mut(node);
        for (level, time) in [(false, fall), (true, fall + Time::from_ms(1))] {
            let cycle = node.clock().tick_at_or_after(time);
            node.set_input_at(Pin::D3, level, cycle);
        }
        let heard = rig.ask_each([]);
        assert_eq!(heard, frame, "{eighth} eighths at {} baud", rig.line.baud);
        now = 1 - now;
        rig.bus.run_for(SETTINGS[1].t35() * 2);
    }
}
