//! The HAL's EEPROM driver in the simulator: the ends of the memory, power cuts, wear, and interrupts at any cycle.

use multidrop_bus::{Bus, BusConfig, Nano, NodeId, Pin, Time};
use multidrop_testkit::example;

/// Bytes of EEPROM.
const SIZE: u16 = 1024;
/// A byte takes 3.4 ms (DS table 8-1), and an order of the example a fifth of a millisecond with all that it copies.
const BYTE: Time = Time::from_us(3_400);
const SLACK: Time = Time::from_us(250);

/// Orders of the example `cells`.
const READ: u8 = 1;
const WRITE: u8 = 2;
const GIVE_UP: u8 = 3;
/// By the blocking traits.
const READ_BLOCKING: u8 = 4;
const WRITE_BLOCKING: u8 = 5;
/// By these, 65536 bytes further on.
const READ_BEYOND: u8 = 6;
const WRITE_BEYOND: u8 = 7;

/// Cycles of the Nano as time.
fn bus_time(cycles: u64) -> Time {
    Time::from_ns(cycles * 1_000 / 16)
}

/// The example `cells`, which does with the EEPROM what it is told to.
struct Cells {
    bus: Bus,
    node: NodeId,
    /// The orders by which it reads and writes.
    orders: (u8, u8),
}

/// Async and blocking.
const BOTH: [(u8, u8); 2] = [(READ, WRITE), (READ_BLOCKING, WRITE_BLOCKING)];

impl Cells {
    fn new() -> Self {
        Self::by((READ, WRITE))
    }

    fn by(orders: (u8, u8)) -> Self {
        let mut bus = Bus::new(BusConfig::default());
        let node = bus
            .add_nano(Nano {
                de: None,
                ..Nano::new("cells", example("cells"))
            })
            .expect("a valid image");
        let mut cells = Cells { bus, node, orders };
        let fill = (0..SIZE).map(|address| address as u8);
        let fill: Vec<_> = fill.collect();
        cells.bus.node_mut(node).eeprom_mut().copy_from_slice(&fill);
        cells.start();
        cells
    }

    fn start(&mut self) {
        self.bus.run_for(Time::from_ms(1));
        assert_eq!(self.bus.node(self.node).bad_opcodes(), 0);
    }

    /// Where a variable of the example is.
    fn at(&self, name: &str) -> u16 {
        let symbol = self.bus.node(self.node).symbol(name);
        symbol.expect("a variable of the example").address
    }

    fn tell(&mut self, order: u8, address: u16, bytes: &[u8]) {
        let parts = [
            ("ADDRESS", &address.to_le_bytes()[..]),
            ("LEN", &[bytes.len() as u8]),
            ("BYTES", bytes),
            ("RESULT", &[0]),
            ("ORDER", &[order]),
        ];
        for (name, value) in parts {
            let at = self.at(name);
            self.bus.node_mut(self.node).write(at, value);
        }
    }

    /// Runs until the order is done; whether the range was taken, and how long it took.
    fn done(&mut self) -> (bool, Time) {
        let (order, result) = (self.at("ORDER"), self.at("RESULT"));
        let (node, begun) = (self.node, self.bus.now());
        // Nothing happens on the bus that it could stop at.
        while self.bus.node(node).read(order) != [0] {
            self.bus.run_for(Time::from_us(10));
            assert!(self.bus.now() - begun < Time::from_ms(200), "it hangs");
        }
        let [result] = self.bus.node(node).read(result);
        (result == 1, self.bus.now() - begun)
    }

    fn write(&mut self, address: u16, bytes: &[u8]) -> (bool, Time) {
        self.tell(self.orders.1, address, bytes);
        self.done()
    }

    /// What it reads, where the range is taken.
    fn read<const N: usize>(&mut self, address: u16) -> Option<[u8; N]> {
        self.tell(self.orders.0, address, &[0xEE; N]);
        let (taken, _) = self.done();
        let at = self.at("BYTES");
        let bytes = self.bus.node(self.node).read(at);
        if !taken {
            assert_eq!(bytes, [0xEE; N], "refused, and read all the same");
        }
        taken.then_some(bytes)
    }

    fn cells(&self) -> Vec<u8> {
        self.bus.node(self.node).eeprom().to_vec()
    }

    /// The addresses of cells that were written, each as often as it was.
    fn worn(&self) -> Vec<usize> {
        let wear = self.bus.node(self.node).eeprom_wear().iter().enumerate();
        wear.flat_map(|(address, times)| std::iter::repeat_n(address, *times as usize))
            .collect()
    }

    /// Tells it to write, and runs to where the first byte begins to be written.
    fn begin(&mut self, address: u16, bytes: &[u8]) {
        let worn = self.worn();
        self.tell(self.orders.1, address, bytes);
        while self.worn() == worn {
            self.bus.run_for(Time::from_us(1));
        }
    }

    fn assert_proper(&self) {
        assert_eq!(self.bus.node(self.node).eeprom_misuses(), []);
    }
}

#[test]
fn the_last_address_is_written_and_one_past_it_refused() {
    for orders in BOTH {
        let mut cells = Cells::by(orders);
        let before = cells.cells();
        for (address, bytes) in [
            (SIZE - 1, &[1, 2][..]),
            (SIZE, &[3]),
            (SIZE - 31, &[4; 32]),
            (SIZE + 1, &[]),
            (u16::MAX, &[5]),
            (u16::MAX, &[6, 7]),
            (u16::MAX - 30, &[8; 32]),
        ] {
            assert!(!cells.write(address, bytes).0, "{address} {bytes:?}");
        }
        assert_eq!(cells.read::<2>(SIZE - 1), None);
        assert_eq!(cells.read::<1>(SIZE), None);
        assert_eq!(cells.read::<32>(SIZE - 31), None);
        assert_eq!(cells.read::<2>(u16::MAX), None);
        assert_eq!(cells.read::<0>(SIZE + 1), None);
        assert!(cells.cells() == before);
        assert_eq!(cells.worn(), []);

        assert_eq!(cells.read(SIZE - 1), Some([0xFF]));
        assert_eq!(cells.read(SIZE - 3), Some([0xFD, 0xFE, 0xFF]));
        assert!(cells.read::<32>(SIZE - 32).is_some());
        assert_eq!(cells.read::<0>(SIZE), Some([]));
        assert!(cells.write(SIZE, &[]).0);
        assert!(cells.write(SIZE - 1, &[0x11]).0);
        assert!(cells.write(SIZE - 3, &[0x22, 0x33]).0);
        // 255 and 256 are on either side of the high byte of an address.
        assert!(cells.write(255, &[0x44, 0x55]).0);
        let mut expected = before;
        expected[1021..].copy_from_slice(&[0x22, 0x33, 0x11]);
        expected[255..257].copy_from_slice(&[0x44, 0x55]);
        assert!(cells.cells() == expected);
        assert_eq!(cells.read(255), Some([0x44, 0x55]));
        assert_eq!(cells.worn(), [255, 256, 1021, 1022, 1023]);
        cells.assert_proper();
    }
}

#[test]
fn a_byte_that_is_right_already_is_not_written_and_takes_no_time() {
    for orders in BOTH {
        let mut cells = Cells::by(orders);
        let (taken, span) = cells.write(100, &[100, 101, 102, 103]);
        assert!(taken && span < SLACK, "{span}");
        assert_eq!(cells.worn(), []);
        // One of four differs: one is written.
        let (taken, span) = cells.write(100, &[100, 7, 102, 103]);
        assert!(taken && span >= BYTE && span < BYTE + SLACK, "{span}");
        assert_eq!(cells.worn(), [101]);
        // An erased cell is no exception.
        cells.bus.node_mut(cells.node).eeprom_mut()[200] = 0xFF;
        assert!(cells.write(200, &[0xFF]).0);
        assert_eq!(cells.worn(), [101]);
        // Writing it again and again wears none.
        for _ in 0..10 {
            assert!(cells.write(100, &[100, 7, 102, 103]).0);
        }
        assert_eq!(cells.worn(), [101]);
        cells.assert_proper();
    }
}

#[test]
fn it_is_done_when_the_last_byte_is_safe() {
    for orders in BOTH {
        let mut cells = Cells::by(orders);
        let (taken, span) = cells.write(300, &[1, 2, 3]);
        assert!(
            taken && span >= BYTE * 3 && span < BYTE * 3 + SLACK,
            "{span}"
        );
        // A last byte that is right already does not end it before those in front of it.
        let (taken, span) = cells.write(300, &[4, 2, 3]);
        assert!(taken && span >= BYTE && span < BYTE + SLACK, "{span}");
        cells.bus.power_cut(cells.node);
        assert_eq!(cells.cells()[300..303], [4, 2, 3]);
        cells.assert_proper();
    }
}

#[test]
fn it_sleeps_while_a_byte_is_written_and_is_interrupted_once_for_each() {
    let mut cells = Cells::new();
    cells.bus.node_mut(cells.node).clear_stats();
    let (_, span) = cells.write(300, &[1, 2, 3, 4]);
    let stats = cells.bus.node(cells.node).stats();
    let asleep = bus_time(stats.asleep);
    assert!(asleep > BYTE * 4 - SLACK, "{asleep} of {span}");
    assert_eq!(stats.vectors[22].count, 4);
}

#[test]
fn power_that_goes_right_behind_a_write_costs_the_byte_under_way_and_no_other() {
    for orders in BOTH {
        let (old, new) = ([40, 41, 42, 43], [0xA0, 0xA1, 0xA2, 0xA3]);
        for us in (100..4 * 3_400).step_by(400) {
            let mut cells = Cells::by(orders);
            let mut expected = cells.cells();
            cells.begin(40, &new);
            cells.bus.run_for(Time::from_us(us));
            // A byte begins some microseconds after the end of the one before.
            let under_way = us as usize / 3_430;
            cells.bus.power_cut(cells.node);
            for (place, address) in (40..44).enumerate() {
                expected[address] = match place {
                    _ if place < under_way => new[place],
                    _ if place == under_way => 0xFF,
                    _ => old[place],
                };
            }
            assert!(cells.cells() == expected, "after {us} us");

            // What it starts with: the cells are read as they are, and written to what they should be.
            cells.bus.run_for(Time::from_ms(5));
            cells.bus.power_up(cells.node);
            cells.start();
            let read: Option<[u8; 4]> = cells.read(40);
            assert_eq!(
                read.map(|bytes| bytes.to_vec()),
                Some(expected[40..44].to_vec())
            );
            assert!(cells.cells() == expected, "something is written by itself");
            assert!(cells.write(40, &new).0);
            assert_eq!(cells.cells()[40..44], new);
            // Those that were in place were not written again.
            let mut worn: Vec<_> = (40..44).collect();
            worn.insert(under_way, 40 + under_way);
            assert_eq!(cells.worn(), worn, "after {us} us");
            cells.assert_proper();
        }
    }
}

#[test]
fn a_reset_in_a_write_lets_the_byte_come_to_its_end_and_the_next_start_waits_for_it() {
    let mut cells = Cells::new();
    cells.begin(40, &[0xA0, 0xA1]);
    cells.bus.run_for(Time::from_us(1_000));
    cells.bus.reset(cells.node);
    cells.start();
    assert_eq!(cells.cells()[40..42], [40, 41]);
    // Its first read waits for the byte of the life before.
    cells.tell(READ, 40, &[0, 0]);
    let (taken, span) = cells.done();
    assert!(
        taken && span >= Time::from_us(1_400) && span < Time::from_us(1_400) + SLACK,
        "{span}"
    );
    let at = cells.at("BYTES");
    assert_eq!(cells.bus.node(cells.node).read(at), [0xA0, 41]);
    cells.assert_proper();
}

#[test]
fn a_write_that_is_given_up_completes_the_byte_under_way_and_the_next_order_waits_for_it() {
    for (order, bytes) in [(READ, [0, 0]), (WRITE, [0xB0, 0xB1])] {
        let mut cells = Cells::new();
        cells.tell(GIVE_UP, 40, &[0xA0, 0xA1]);
        let (_, span) = cells.done();
        assert!(span < SLACK, "{span}");
        assert_eq!(cells.cells()[40..42], [40, 41]);
        cells.tell(order, 40, &bytes);
        let (taken, span) = cells.done();
        assert!(taken && span >= BYTE - SLACK * 2, "{span}");
        if order == READ {
            let at = cells.at("BYTES");
            assert_eq!(cells.bus.node(cells.node).read(at), [0xA0, 41]);
            assert_eq!(cells.worn(), [40]);
        } else {
            assert_eq!(cells.cells()[40..42], bytes);
            assert_eq!(cells.worn(), [40, 40, 41]);
        }
        cells.assert_proper();
    }
}

#[test]
fn an_interrupt_at_any_cycle_of_a_write_keeps_no_byte_from_being_written() {
    let begins = {
        let mut cells = Cells::new();
        cells.begin(40, &[0xA0]);
        cells.bus.node(cells.node).cycle()
    };
    for cycle in begins - 50..begins + 30 {
        let mut cells = Cells::new();
        cells.tell(WRITE, 40, &[0xA0]);
        let node = cells.bus.node_mut(cells.node);
        node.set_input_at(Pin::D2, true, cycle);
        assert!(cells.done().0);
        let node = cells.bus.node(cells.node);
        assert_eq!(node.stats().vectors[1].count, 1, "no interrupt came");
        assert_eq!(cells.cells()[40], 0xA0, "an interrupt in cycle {cycle}");
        cells.assert_proper();
    }
}

#[test]
fn an_address_that_does_not_fit_16_bits_is_refused() {
    let mut cells = Cells::by((READ_BEYOND, WRITE_BEYOND));
    let before = cells.cells();
    assert_eq!(cells.read::<1>(0), None);
    assert_eq!(cells.read::<0>(0), None);
    assert!(!cells.write(0, &[0x11]).0);
    assert!(cells.cells() == before);
    cells.assert_proper();
}

#[test]
fn a_blocking_write_needs_no_interrupt() {
    let mut cells = Cells::by((READ_BLOCKING, WRITE_BLOCKING));
    cells.bus.node_mut(cells.node).clear_stats();
    assert!(cells.write(300, &[1, 2, 3, 4]).0);
    let stats = cells.bus.node(cells.node).stats();
    assert_eq!(stats.vectors[22].count, 0);
    assert_eq!(stats.asleep, 0);
}
