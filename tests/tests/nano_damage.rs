//! Damaged frames are dropped: no answer, no change, and the next request is answered. Against the firmware in the
//! simulator.

use multidrop_bus::{Format, Line, Time, Tx};
use multidrop_testkit::frames::{adu, block, data, words};
use multidrop_testkit::rig::ALIVE;
use multidrop_testkit::{LINE, Rig};

const COUNT: u16 = 16;

/// A write that would be seen.
fn write() -> Vec<u8> {
    words(1, 6, 3, 0x1234)
}

/// A node and what is in its tables.
struct Bench {
    rig: Rig,
    before: Vec<u8>,
}

impl Bench {
    fn new(format: Format) -> Self {
        let mut rig = Rig::registers(COUNT as u8, Line { format, ..LINE });
        rig.expect_alive();
        let before = rig.state(COUNT);
        Bench { rig, before }
    }

    /// These characters are not answered and, 1.05 t3.5 later, a good request is.
    #[track_caller]
    fn dropped(&mut self, characters: impl IntoIterator<Item = Tx>, what: &str) {
        let silence = self.rig.line.t35() * 105 / 100;
        self.dropped_before(silence, characters, what);
    }

    /// Checks that these characters are not answered, where a receiver may take an edge for a start bit: what it
    /// receives then ends up to a character later than what was sent.
    #[track_caller]
    fn dropped_out_of_step(&mut self, characters: impl IntoIterator<Item = Tx>, what: &str) {
        let silence = self.rig.line.t35() * 105 / 100 + self.rig.line.character();
        self.dropped_before(silence, characters, what);
    }

    #[track_caller]
    fn dropped_before(
        &mut self,
        silence: Time,
        characters: impl IntoIterator<Item = Tx>,
        what: &str,
    ) {
        let mut characters: Vec<_> = characters.into_iter().collect();
        let next = ALIVE.request().into_iter().map(Tx::byte);
        characters.extend(next.enumerate().map(|(index, character)| match index {
            0 => character.after(silence),
            _ => character,
        }));
        let heard = self.rig.ask_each(characters);
        assert_eq!(heard, ALIVE.answer(), "{what}");
    }

    #[track_caller]
    fn dropped_bytes(&mut self, bytes: &[u8]) {
        self.dropped(
            bytes.iter().map(|byte| Tx::byte(*byte)),
            &format!("{bytes:02x?}"),
        );
    }
}

impl Drop for Bench {
    fn drop(&mut self) {
        if !std::thread::panicking() {
            assert_eq!(self.rig.state(COUNT), self.before, "something changed");
        }
    }
}

/// `write()`, character `at` replaced.
fn with(at: usize, damage: impl Fn(Tx) -> Tx) -> Vec<Tx> {
    let bytes = write().into_iter().enumerate();
    bytes
        .map(|(index, byte)| {
            let character = Tx::byte(byte);
            if index == at {
                damage(character)
            } else {
                character
            }
        })
        .collect()
}

#[test]
fn a_flipped_bit() {
    for format in [Format::N81, Format::E81] {
        let mut bench = Bench::new(format);
        for at in 0..write().len() {
            for bit in 0..8 {
                let what = format!("bit {bit} of byte {at}, {format}");
                bench.dropped(with(at, |character| character.flip_bit(bit)), &what);
            }
        }
    }
}

#[test]
fn two_flipped_bits_that_parity_does_not_see() {
    let mut bench = Bench::new(Format::E81);
    for at in 0..write().len() {
        for bit in 0..7 {
            let twice = |character: Tx| character.flip_bit(bit).flip_bit(bit + 1);
            bench.dropped(with(at, twice), &format!("bit {bit} of byte {at}"));
        }
    }
}

#[test]
fn a_wrong_parity_bit_alone() {
    // The data and the CRC are right: parity is all there is to tell.
    let mut bench = Bench::new(Format::E81);
    for at in 0..write().len() {
        bench.dropped(with(at, Tx::bad_parity), &format!("byte {at}"));
    }
}

#[test]
fn a_low_stop_bit_alone() {
    for format in [Format::N81, Format::E81] {
        let mut bench = Bench::new(format);
        for at in 0..write().len() {
            let what = format!("byte {at}, {format}");
            // A pause lets the receiver find the next start bit, so that again nothing else is wrong.
            let mut characters = with(at, Tx::bad_stop);
            if let Some(next) = characters.get_mut(at + 1) {
                *next = next.after(LINE.bits(3));
            }
            bench.dropped(characters, &what);
            bench.dropped_out_of_step(with(at, Tx::bad_stop), &what);
        }
    }
}

#[test]
fn a_byte_lost_or_doubled() {
    // What an overrun at another place leaves of a frame.
    let mut bench = Bench::new(Format::N81);
    for at in 0..write().len() {
        let mut bytes = write();
        bytes.remove(at);
        bench.dropped_bytes(&bytes);
        bytes = write();
        bytes.insert(at, bytes[at] | 1);
        bench.dropped_bytes(&bytes);
    }
}

#[test]
fn a_bad_crc() {
    let mut bench = Bench::new(Format::N81);
    let good = write();
    let crc = u16::from_le_bytes([good[6], good[7]]);
    for wrong in [
        crc ^ 0xffff,
        crc.swap_bytes(),
        crc.wrapping_add(1),
        0,
        0xffff,
    ] {
        bench.dropped_bytes(&[&good[..6], &wrong.to_le_bytes()].concat());
    }
}

#[test]
fn under_four_bytes() {
    let mut bench = Bench::new(Format::N81);
    for byte in 0..=255 {
        bench.dropped_bytes(&[byte]);
    }
    bench.dropped_bytes(&adu(&[]));
    for unit in 0..=255 {
        bench.dropped_bytes(&adu(&[unit]));
    }
    for len in 1..write().len() {
        bench.dropped_bytes(&write()[..len]);
    }
}

#[test]
fn over_256_bytes() {
    let mut bench = Bench::new(Format::N81);
    let longest = block(1, 0x0f, 0, 1968, &[0xff; 246]);
    for len in [257, 258, 259, 264, 300, 511, 512, 513, 520, 1000] {
        // A good CRC over all of it.
        let body = [&write()[..6], &vec![0; len - 8]].concat();
        bench.dropped_bytes(&adu(&body));
        // Good frames at its start and where a buffer that wraps would have them.
        bench.dropped_bytes(&[&write()[..], &vec![0; len - 8]].concat());
        bench.dropped_bytes(&[&vec![0; len - 8], &write()[..]].concat());
        let mut bytes = vec![0x55; len];
        bytes[..255].copy_from_slice(&longest);
        bench.dropped_bytes(&bytes);
        if len >= 264 {
            let mut bytes = vec![0x55; len];
            bytes[256..264].copy_from_slice(&write());
            bench.dropped_bytes(&bytes);
        }
    }
}

#[test]
fn a_request_begun_and_sent_again() {
    let mut bench = Bench::new(Format::N81);
    let request = block(1, 0x10, 0, 3, &[0x5a; 6]);
    for len in 1..request.len() {
        bench.dropped_bytes(&request[..len]);
    }
}

#[test]
fn noise_in_a_frame() {
    let mut bench = Bench::new(Format::N81);
    let bits = LINE.format.bits() * write().len() as u32;
    for bit in 0..bits {
        let from = bench.rig.bus.now() + LINE.bits(u64::from(bit));
        // The wrong level for one bit: what was sent is known, so it is always a change.
        let sent = write()[bit as usize / 10];
        let level = match bit % 10 {
            0 => false,
            9 => true,
            data => sent >> (data - 1) & 1 == 1,
        };
        bench.rig.bus.noise(from, LINE.bits(1), !level);
        let characters = write().into_iter().map(Tx::byte);
        bench.dropped_out_of_step(characters, &format!("bit {bit} of the line"));
    }
}

#[test]
fn a_line_held_low() {
    let mut bench = Bench::new(Format::N81);
    for length in [LINE.character(), Time::from_ms(1), Time::from_ms(20)] {
        for from in [Time::ZERO, Time::from_us(900), Time::from_us(2_500)] {
            let bus = &mut bench.rig.bus;
            bus.noise(bus.now() + from, length, false);
            bus.host(bench.rig.host).send(&write());
            // With noise that short the request ends after it.
            let end = (bus.now() + from + length).max(bus.host(bench.rig.host).busy_until());
            bus.run_to(end + LINE.character() + LINE.t35() * 105 / 100);
            bench.rig.bus.host(bench.rig.host).take();
            bench.rig.expect_alive();
        }
    }
}

#[test]
fn a_click_in_the_silence_after_a_request_is_not_talked_over() {
    // Shorter than half a bit it is no start bit: the request stands, its answer may be later.
    let mut bench = Bench::new(Format::N81);
    for us in (20..1_750).step_by(37) {
        let rig = &mut bench.rig;
        let end = rig.bus.host(rig.host).send(&ALIVE.request());
        rig.bus
            .noise(end + Time::from_us(us), Time::from_us(6), false);
        let heard = rig.ask_each([]);
        assert_eq!(heard, ALIVE.answer(), "after {us} us");
        // And long enough to be a character it makes the frame bad, unless it begins in the last 1/24 of t3.5: then the frame
        // stands, and is not answered since somebody talks.
        let end = rig.bus.host(rig.host).send(&write());
        rig.bus.noise(end + Time::from_us(us), LINE.bits(4), false);
        // The host hears the noise as well.
        rig.ask_each([]);
        assert_eq!(rig.answered, 0, "after {us} us");
        let stands = LINE.t35() * 23 / 24 < Time::from_us(us);
        let value = if stands { [0x12, 0x34] } else { [0, 0] };
        rig.expect(&words(1, 3, 3, 1), &data(1, 3, &value));
        rig.expect(&words(1, 6, 3, 0), &words(1, 6, 3, 0));
    }
}

/// An edge that is no character may hold an answer back for the time of one, and no longer. A click has two, and the line may look
/// between them.
#[test]
fn a_click_of_1_us_suppresses_no_answer() {
    for baud in [9_600, 38_400, 115_200] {
        let line = Line::n81(baud);
        let mut rig = Rig::registers(COUNT as u8, line);
        let before = (1..60).chain((60..line.t35().ps() / 1_000_000 + 10).step_by(53));
        for us in before {
            let end = rig.bus.host(rig.host).send(&ALIVE.request());
            rig.bus.run_to(end);
            let at = end + line.t35() + Time::from_us(9) - Time::from_us(us);
            rig.bus.noise(at, Time::from_us(1), false);
            let answer = rig.exchange(&[]);
            let answer = answer.unwrap_or_else(|| panic!("none: {us} us, {baud} baud"));
            assert_eq!(answer.bytes, ALIVE.answer(), "{us} us, {baud} baud");
            let after = answer.received[0].start - end;
            let latest = line.t35() + line.character() * 2 + Time::from_us(20);
            assert!(after <= latest, "{after}, {us} us, {baud} baud");
        }
    }
}

#[test]
fn the_wrong_baud_or_format() {
    let mut bench = Bench::new(Format::N81);
    let strange = [
        Line::n81(9_600),
        Line::n81(19_200),
        Line::n81(76_800),
        Line::n81(115_200),
        Line {
            format: Format::O81,
            ..LINE
        },
    ];
    for line in strange {
        let rig = &mut bench.rig;
        rig.bus.host(rig.host).set_line(line);
        for request in [write(), block(1, 0x10, 0, 16, &[0x5a; 32])] {
            assert_eq!(rig.ask(&request), [], "{line:?}");
        }
        rig.bus.host(rig.host).set_line(LINE);
        rig.expect_alive();
    }
}

#[test]
fn a_client_that_sends_during_the_answer() {
    let mut bench = Bench::new(Format::N81);
    for at in 0..40 {
        let rig = &mut bench.rig;
        let end = rig.bus.host(rig.host).send(&words(1, 3, 0, 16));
        rig.bus.run_to(end + LINE.t35() + LINE.bits(at * 9));
        let end = rig.bus.host(rig.host).send(&ALIVE.request());
        // Longer than the answer that it destroys.
        rig.bus.run_to(end + LINE.character() * 40);
        rig.bus.host(rig.host).take();
        rig.bus.clear_record();
        rig.expect_alive();
    }
}
