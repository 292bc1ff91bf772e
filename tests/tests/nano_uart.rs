//! The HAL's plain UART in the simulator, against the USART of the data sheet: no byte lost, errors where they are, ends to the bit.

use multidrop_bus::{
    Bus, BusConfig, Format, HostId, HostPort, Line, Nano, NodeId, Station, Time, Tx,
};
use multidrop_testkit::example;

/// What the example `uart_modes` does, by its first byte of EEPROM.
const EXCHANGE: u8 = 0;
const EXCHANGE_UNBUFFERED: u8 = 1;
const EXCHANGE_IMPATIENT: u8 = 2;
const LISTEN: u8 = 3;
const LISTEN_UNBUFFERED: u8 = 4;
const SEND: u8 = 5;
const SEND_UNBUFFERED: u8 = 6;
const EXCHANGE_BLOCKING: u8 = 7;

/// `HOLD` of the example.
const GO_ON: u8 = 0;
const READ_NOTHING: u8 = 1;
const INTERRUPTS_OFF: u8 = 2;

/// Buffers of the example.
const RX: usize = 64;
const TX: usize = 32;
/// Bytes of its long message.
const LONG: usize = 1_000;

const FAST: Line = Line::n81(115_200);
const WITH_PARITY: Line = Line {
    format: Format::E81,
    ..FAST
};

/// What came in, as the example logs it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Heard {
    Byte(u8),
    Overrun,
    Framing,
    Parity,
}
use Heard::{Byte, Framing, Overrun, Parity};

struct Rig {
    bus: Bus,
    node: NodeId,
    host: HostId,
    line: Line,
}

impl Rig {
    /// The example in this mode, and a host.
    fn new(mode: u8, line: Line) -> Self {
        let mut bus = Bus::new(BusConfig::default());
        let nano = Nano::new("uart", example("uart_modes"));
        let node = bus.add_nano(nano).expect("a valid image");
        let host = bus.add_host(HostPort::new(line));
        let format = u8::from(line.format == Format::E81);
        let wanted = [&[mode, format][..], &line.baud.to_le_bytes()].concat();
        bus.node_mut(node).eeprom_mut()[..6].copy_from_slice(&wanted);
        // Its start-up code has much RAM to clear.
        bus.run_for(Time::from_ms(5));
        let rig = Rig {
            bus,
            node,
            host,
            line,
        };
        assert_eq!(rig.bus.node(node).bad_opcodes(), 0);
        rig
    }

    fn at(&self, name: &str) -> u16 {
        let symbol = self.bus.node(self.node).symbol(name);
        symbol.expect("a variable of the example").address
    }

    fn hold(&mut self, how: u8) {
        let at = self.at("HOLD");
        self.bus.node_mut(self.node).write(at, &[how]);
        self.bus.run_for(Time::from_us(100));
    }

    fn log(&self) -> Vec<Heard> {
        let [len] = self.bus.node(self.node).read(self.at("LOGGED"));
        let log: [u8; 256] = self.bus.node(self.node).read(self.at("LOG"));
        let entries = log[..usize::from(len)].chunks(2);
        let heard = entries.map(|entry| match entry[0] {
            1 => Byte(entry[1]),
            2 => Overrun,
            3 => Framing,
            4 => Parity,
            other => panic!("{other} is logged"),
        });
        heard.collect()
    }

    /// Sends characters while `how` holds the example, lets go, and gives the log.
    fn heard_late(&mut self, how: u8, characters: impl IntoIterator<Item = Tx>) -> Vec<Heard> {
        self.hold(how);
        let end = self.bus.host(self.host).send_each(characters);
        self.bus.run_to(end + self.line.character());
        self.hold(GO_ON);
        self.bus.run_for(Time::from_ms(5));
        self.log()
    }

    /// Sends a message and takes what comes back.
    fn exchange(&mut self, message: &[u8]) -> Vec<u8> {
        let bytes = [&[message.len() as u8], message].concat();
        let end = self.bus.host(self.host).send(&bytes);
        let back = self.line.character() * (message.len() as u64 + 2);
        self.bus.run_to(end + back + Time::from_ms(8));
        let record = self.bus.record();
        assert_eq!(record.conflicts(), []);
        for byte in record.bytes() {
            assert!(byte.is_good(), "{byte:?}");
        }
        self.bus.clear_record();
        let heard = self.bus.host(self.host).take();
        heard
            .iter()
            .map(|byte| {
                assert!(byte.is_good(), "{byte:?}");
                byte.value
            })
            .collect()
    }

    /// Sends messages of all lengths up to 200, `total` bytes at least, and wants all of them back.
    fn exchange_all(&mut self, total: usize) {
        let mut sent = 0;
        for number in 0.. {
            let len = 1 + number * 37 % 200;
            let message: Vec<u8> = (0..len).map(|place| (place * 7 + number) as u8).collect();
            assert_eq!(self.exchange(&message), message, "after {sent} bytes");
            sent += len;
            if sent >= total {
                break;
            }
        }
        assert_eq!(self.log(), []);
    }
}

fn bytes(values: impl IntoIterator<Item = u8>) -> Vec<Tx> {
    values.into_iter().map(Tx::byte).collect()
}

#[test]
fn ten_kilobytes_come_back_at_each_rate() {
    for baud in [9_600, 38_400, 115_200] {
        Rig::new(EXCHANGE, Line::n81(baud)).exchange_all(10_000);
    }
    Rig::new(EXCHANGE, WITH_PARITY).exchange_all(2_000);
}

#[test]
fn a_uart_without_buffers_and_blocking_traits_lose_nothing() {
    for mode in [EXCHANGE_UNBUFFERED, EXCHANGE_BLOCKING] {
        Rig::new(mode, FAST).exchange_all(3_000);
        Rig::new(mode, Line::n81(9_600)).exchange_all(300);
    }
}

#[test]
fn reads_and_writes_that_are_dropped_take_and_lose_nothing() {
    Rig::new(EXCHANGE_IMPATIENT, FAST).exchange_all(5_000);
}

#[test]
fn it_sleeps_while_nothing_comes_and_is_interrupted_once_for_each_character() {
    let mut rig = Rig::new(EXCHANGE, FAST);
    rig.bus.node_mut(rig.node).clear_stats();
    rig.bus.run_for(Time::from_ms(100));
    let stats = rig.bus.node(rig.node).stats();
    assert_eq!(stats.awake, 0, "awake while nothing comes");
    let message = [0x55; 100];
    assert_eq!(rig.exchange(&message), message);
    let stats = rig.bus.node(rig.node).stats();
    assert_eq!(stats.vectors[18].count, 101);
    // And once more when the buffer is empty, where it was not filled again by then.
    assert!((100..=104).contains(&stats.vectors[19].count));
    assert_eq!(stats.vectors[20].count, 1);
}

#[test]
fn a_reader_that_sleeps_finds_what_the_buffer_holds_and_then_the_overrun() {
    let mut rig = Rig::new(LISTEN, FAST);
    let heard = rig.heard_late(READ_NOTHING, bytes(0..100));
    let mut expected: Vec<Heard> = (0..RX as u8).map(Byte).collect();
    expected.push(Overrun);
    assert_eq!(heard, expected);
    // As many as there is room for are no overrun, and come behind what was.
    let heard = rig.heard_late(READ_NOTHING, bytes(100..120));
    expected.extend((100..120).map(Byte));
    assert_eq!(heard, expected);
}

#[test]
fn a_full_buffer_is_no_overrun() {
    let mut rig = Rig::new(LISTEN, FAST);
    // Not from the beginning of the buffer: it goes round its end.
    rig.heard_late(READ_NOTHING, bytes(200..220));
    let heard = rig.heard_late(READ_NOTHING, bytes(0..RX as u8));
    let expected: Vec<Heard> = (200..220).chain(0..RX as u8).map(Byte).collect();
    assert_eq!(heard, expected);
}

#[test]
fn three_characters_wait_in_the_chip_and_what_is_lost_is_told_where_it_is() {
    for (mode, how) in [
        (LISTEN, INTERRUPTS_OFF),
        (LISTEN_UNBUFFERED, INTERRUPTS_OFF),
        (LISTEN_UNBUFFERED, READ_NOTHING),
    ] {
        // Two in the FIFO and one in the shift register (DS 20.7).
        let three = Rig::new(mode, FAST).heard_late(how, bytes(1..=3));
        assert_eq!(three, [Byte(1), Byte(2), Byte(3)], "{mode}");
        // DOR comes with the character behind the gap (DS 20.7.4).
        let five = Rig::new(mode, FAST).heard_late(how, bytes(1..=5));
        assert_eq!(five, [Byte(1), Byte(2), Overrun, Byte(5)], "{mode}");
    }
}

/// Five characters: the second with wrong parity, the fourth without a stop bit.
fn damaged() -> Vec<Tx> {
    let gap = Time::from_us(300);
    vec![
        Tx::byte(1),
        Tx::byte(2).bad_parity(),
        Tx::byte(3),
        Tx::byte(4).bad_stop(),
        Tx::byte(5).after(gap),
    ]
}

#[test]
fn damaged_characters_are_told_where_they_are_and_not_given_out() {
    for mode in [LISTEN, LISTEN_UNBUFFERED] {
        let mut rig = Rig::new(mode, WITH_PARITY);
        let end = rig.bus.host(rig.host).send_each(damaged());
        rig.bus.run_to(end + Time::from_ms(1));
        let expected = [Byte(1), Parity, Byte(3), Framing, Byte(5)];
        assert_eq!(rig.log(), expected, "{mode}");
    }
}

#[test]
fn errors_that_come_before_the_first_is_told_are_told_with_it() {
    let mut rig = Rig::new(LISTEN, WITH_PARITY);
    let heard = rig.heard_late(READ_NOTHING, damaged());
    // The one that says most, where the first was.
    assert_eq!(heard, [Byte(1), Framing, Byte(3), Byte(5)]);
}

/// Lets the example send its long message, and looks at it on the wire; how many bytes had room at once.
fn assert_long(rig: &mut Rig) -> usize {
    let all = rig.line.character() * (LONG as u64 + 60);
    rig.bus.run_for(all + Time::from_ms(4));
    let Some(&Byte(room)) = rig.log().first() else {
        panic!("nothing is logged")
    };
    let record = rig.bus.record();
    let of_node = Station::Node(rig.node);
    let sent: Vec<_> = record.sent_by(of_node).collect();
    let expected = (0..room).chain((0..LONG).map(|place| (place % 251) as u8));
    let values: Vec<u8> = sent.iter().map(|byte| byte.sent as u8).collect();
    assert_eq!(values, expected.collect::<Vec<_>>());
    let last = sent.last().expect("bytes");
    for byte in &sent {
        assert!(!byte.lost && byte.truncated.is_none(), "{byte:?}");
    }
    // The driver goes off behind the last stop bit, and soon.
    let off = record.de_edges().iter().rfind(|edge| !edge.on);
    let off = off.expect("the driver goes off").time;
    assert!(off >= last.end, "{off} is before {}", last.end);
    assert!(off - last.end < Time::from_us(60), "{}", off - last.end);
    usize::from(room)
}

#[test]
fn a_long_message_goes_out_without_a_gap_and_is_flushed_to_its_last_stop_bit() {
    for (mode, least) in [(SEND, TX), (SEND_UNBUFFERED, 2)] {
        for baud in [9_600, 115_200] {
            let mut rig = Rig::new(mode, Line::n81(baud));
            let room = assert_long(&mut rig);
            // Two go on into the chip, and at the higher rate more leave it meanwhile.
            assert!(room >= least, "{mode}: {room}");
            if baud == 9_600 {
                assert!(room <= least + 2, "{mode}: {room}");
            }
            let sent: Vec<_> = rig.bus.record().bytes().iter().collect();
            for pair in sent.windows(2) {
                assert_eq!(pair[1].start, pair[0].end, "{mode} at {baud}");
            }
        }
    }
}

#[test]
fn a_flush_is_not_ended_by_the_end_of_a_character_that_interrupts_held_off_made_the_last() {
    let mut rig = Rig::new(SEND, FAST);
    rig.bus.run_for(Time::from_ms(20));
    rig.hold(INTERRUPTS_OFF);
    rig.bus.run_for(Time::from_us(400));
    rig.hold(GO_ON);
    assert_long(&mut rig);
    let sent: Vec<_> = rig.bus.record().bytes().iter().collect();
    let gaps = sent.windows(2).filter(|pair| pair[1].start != pair[0].end);
    assert_eq!(gaps.count(), 1, "the transmitter stood still once");
}
