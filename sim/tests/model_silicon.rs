//! The STM32 that runs flashed images, tested by small programs: the USART's flags and handshake, resets and the
//! watchdog.

use multidrop_bus::{
    Bus, BusConfig, Cause, Emulator, HostId, HostPort, Line, MachineId, Silicon, Stm32, Time, Tx,
    WireId,
};
use multidrop_testkit::assembler::assemble_arm;

const LINE: Line = Line::n81(38_400);

/// Bits of SR (RM0090 30.6.1), CR1 and CR3.
const PE: u32 = 1 << 0;
const FE: u32 = 1 << 1;
const NF: u32 = 1 << 2;
const ORE: u32 = 1 << 3;
const RXNE: u32 = 1 << 5;
const IDLE: u32 = 0xC0;
const ON: u32 = 0x200C;
const EVEN: u32 = 1 << 12 | 1 << 10;
const RTSE: u32 = 1 << 8;
const CTSE: u32 = 1 << 9;

struct Desk {
    bus: Bus,
    host: HostId,
    machine: MachineId,
}

impl Desk {
    /// The machine with a program, AS1 on a wire with a host.
    fn new(name: &str, symbols: &[(&str, u32)], line: Line) -> Self {
        let mut bus = Bus::new(BusConfig::default());
        let host = bus.add_host(HostPort::new(line));
        let stm32 = Stm32 {
            name: "stm32".to_owned(),
            image: assemble_arm(name, symbols),
            emulator: Emulator::core().expect("set-up has brought it"),
            wires: [Some(WireId::default()), None, None, None],
        };
        let machine = bus.add_stm32(stm32).expect("a valid image");
        Desk { bus, host, machine }
    }

    fn usart(cr1: u32, cr3: u32, sends: u32, waits: u32, line: Line) -> Self {
        let symbols = [
            ("CR1", cr1),
            ("CR3", cr3),
            ("SENDS", sends),
            ("WAITS", waits),
        ];
        let mut desk = Self::new("usart", &symbols, line);
        desk.bus.run_for(Time::from_ms(1));
        desk
    }

    fn silicon(&mut self) -> &mut Silicon {
        let silicon = self.bus.machine_mut(self.machine).silicon();
        silicon.expect("it is not in QEMU")
    }

    fn word(&mut self, address: u32) -> u32 {
        let bytes = self.silicon().memory(address);
        u32::from_le_bytes(bytes.expect("there is memory"))
    }

    /// What the program has kept of each character: SR, DR, SR again, and the level of RTS before DR was read.
    fn heard(&mut self) -> Vec<(u32, u32, u32, bool)> {
        let count = self.word(0x2000_0000);
        let entry = |place: u32| {
            let [sr, dr, again, idr] =
                [0, 4, 8, 12].map(|offset| self.word(0x2000_0010 + 16 * place + offset));
            (sr, dr, again, idr >> 12 & 1 != 0)
        };
        (0..count).map(entry).collect()
    }

    /// When characters of the machine began.
    fn sent(&self) -> Vec<Time> {
        let station = self.bus.machine(self.machine).station(0);
        let sent = self
            .bus
            .record()
            .sent_by(station.expect("it is on the wire"));
        sent.map(|byte| byte.start).collect()
    }
}

#[test]
fn a_character_is_read_once_and_reading_clears_its_flags() {
    let mut desk = Desk::usart(ON, 0, 0, 0, LINE);
    let bad = Tx::byte(0x42).after(Time::from_ms(1)).bad_stop();
    let good = Tx::byte(0x43).after(Time::from_ms(2));
    let host = desk.host;
    desk.bus.host(host).send_each([Tx::byte(0x41), bad, good]);
    desk.bus.run_for(Time::from_ms(10));
    assert_eq!(
        desk.heard(),
        [
            (IDLE | RXNE, 0x41, IDLE, false),
            (IDLE | RXNE | FE, 0x42, IDLE, false),
            (IDLE | RXNE, 0x43, IDLE, false),
        ]
    );
}

#[test]
fn parity_is_checked_and_read_with_the_data() {
    let line = Line {
        format: "8E1".parse().expect("a format"),
        ..LINE
    };
    let mut desk = Desk::usart(ON | EVEN, 0, 0, 0, line);
    let host = desk.host;
    desk.bus.host(host).send_each([
        Tx::byte(0x41),
        Tx::byte(0x43).after(Time::from_ms(1)),
        Tx::byte(0x43).after(Time::from_ms(1)).bad_parity(),
    ]);
    desk.bus.run_for(Time::from_ms(10));
    // Two ones are even, three are not.
    assert_eq!(
        desk.heard(),
        [
            (IDLE | RXNE, 0x041, IDLE, false),
            (IDLE | RXNE, 0x143, IDLE, false),
            (IDLE | RXNE | PE, 0x043, IDLE, false),
        ]
    );
}

#[test]
fn samples_that_do_not_agree_are_noise() {
    let mut desk = Desk::usart(ON, 0, 0, 0, LINE);
    let host = desk.host;
    let start = desk.bus.now();
    desk.bus.host(host).send(&[0x00]);
    // High for a tenth of a bit from a twentieth in front of the middle of the fourth bit on.
    let from = start + LINE.bits(4) + LINE.bits(1) / 2 + LINE.bits(1) / 25;
    desk.bus.noise(from, LINE.bits(1) / 10, true);
    desk.bus.run_for(Time::from_ms(2));
    assert_eq!(desk.heard(), [(IDLE | RXNE | NF, 0, IDLE, false)]);
}

#[test]
fn characters_that_nobody_reads_are_lost_and_the_first_one_stays() {
    // It looks away for 1 ms, four characters.
    let mut desk = Desk::usart(ON, 0, 0, 4_000, LINE);
    let host = desk.host;
    desk.bus.host(host).send(&[1, 2, 3, 4, 5]);
    desk.bus.run_for(Time::from_ms(10));
    assert_eq!(
        desk.heard(),
        [
            (IDLE | RXNE, 1, IDLE, false),
            (IDLE | RXNE | ORE, 2, IDLE, false),
            (IDLE | RXNE, 5, IDLE, false),
        ]
    );
    assert_eq!(desk.bus.machine(desk.machine).overruns(0), 2);
}

#[test]
fn rts_is_high_while_a_character_waits() {
    let mut desk = Desk::usart(ON, RTSE, 0, 4_000, LINE);
    assert!(!desk.silicon().pin('A', 12));
    let host = desk.host;
    desk.bus.host(host).send(&[1, 2]);
    // The first is read at once, the second waits.
    desk.bus.run_for(LINE.character() * 2);
    assert!(desk.silicon().pin('A', 12));
    desk.bus.run_for(Time::from_ms(3));
    assert!(!desk.silicon().pin('A', 12));
    let rts: Vec<bool> = desk.heard().iter().map(|(.., rts)| *rts).collect();
    assert_eq!(rts, [true, true]);
}

#[test]
fn cts_holds_the_next_character_and_not_the_one_under_way() {
    let mut desk = Desk::usart(ON, CTSE, 20, 0, LINE);
    desk.silicon().drive('A', 11, Some(true));
    desk.bus.run_for(Time::from_ms(5));
    let before = desk.sent();
    desk.silicon().drive('A', 11, Some(false));
    let released = desk.bus.now();
    desk.bus.run_for(Time::from_ms(5));
    let sent = desk.sent();
    // An idle character went first.
    assert_eq!(before.len(), 3);
    let next = sent[before.len()];
    assert!(
        next >= released && next < released + Time::from_us(2),
        "{next}"
    );
    let ends: Vec<_> = sent.windows(2).skip(before.len()).collect();
    assert!(
        ends.iter()
            .all(|pair| (pair[1] - pair[0]).ps().abs_diff(LINE.character().ps()) < 400_000)
    );
}

#[test]
fn a_transceiver_that_echoes_returns_the_sent_characters() {
    for echo in [false, true] {
        let symbols = [("CR1", ON), ("CR3", 0), ("SENDS", 3), ("WAITS", 0)];
        let mut desk = Desk::new("usart", &symbols, LINE);
        let station = desk.bus.machine(desk.machine).station(0);
        desk.bus.set_echo(station.expect("it is on the wire"), echo);
        desk.bus.run_for(Time::from_ms(5));
        let heard: Vec<_> = desk.heard().iter().map(|(_, dr, ..)| *dr).collect();
        assert_eq!(desk.sent().len(), 3);
        assert_eq!(heard, if echo { vec![3, 2, 1] } else { vec![] });
    }
}

/// `reset.S` with what it is to do first, after half a second.
fn resets(first: u32, watchdog: [u32; 3], lsi: u32) -> Desk {
    let [prescaler, reload, feeds] = watchdog;
    let symbols = [
        ("FIRST", first),
        ("PRESCALER", prescaler),
        ("RELOAD", reload),
        ("FEEDS", feeds),
    ];
    let mut desk = Desk::new("reset", &symbols, LINE);
    desk.silicon().set_lsi(lsi);
    desk
}

/// CFSR of a store that is forbidden, and of what could not be kept of what the fault interrupts (ARMv7-M B3.2.15).
const FORBIDDEN: u32 = 0x82;
const NOT_KEPT: u32 = 0x10;

#[test]
fn a_stack_that_grows_into_a_guard_is_a_fault() {
    let mut desk = resets(6, [0; 3], 32_000);
    desk.bus.run_for(Time::from_ms(10));
    let kept = [0, 4, 0x14].map(|offset| desk.word(0x2000_0000 + offset));
    assert_eq!(kept, [2, FORBIDDEN | NOT_KEPT, BY_SOFTWARE]);
    // What is below the guard is as it was.
    assert_eq!(desk.word(0x2000_F000 - 4), 0);
    // After the reset there is none.
    assert!(!desk.silicon().is_locked_up());
}

/// CSR's flags: power and brown-out, the pin's, which every reset sets, software, watchdog (RM0090 7.3.20).
const POWER: u32 = 0x0E00_0000;
const BY_PIN: u32 = 0x0400_0000;
const BY_SOFTWARE: u32 = 0x1400_0000;
const BY_WATCHDOG: u32 = 0x2400_0000;

#[test]
fn a_fault_reaches_its_handler_and_a_reset_keeps_ram() {
    // UNDEFINSTR; PRECISERR and BFARVALID.
    for (first, cfsr) in [(1, 0x1_0000), (2, 0x8200)] {
        let mut desk = resets(first, [0; 3], 32_000);
        desk.bus.run_for(Time::from_ms(1));
        let kept = [0, 4, 0x10, 0x14].map(|offset| desk.word(0x2000_0000 + offset));
        assert_eq!(kept, [2, cfsr, POWER, BY_SOFTWARE]);
    }
}

#[test]
fn the_watchdog_resets_the_chip_when_it_is_not_fed() {
    // 100 periods of 32 of LSI: 100 ms at 32 kHz, 68 at 47, 188 at 17.
    for (lsi, due_ms) in [(32_000, 100), (47_000, 68), (17_000, 188)] {
        let mut desk = resets(3, [3, 99, 0], lsi);
        desk.bus.run_for(Time::from_ms(due_ms - 1));
        assert_eq!(desk.word(0x2000_0000), 1, "{lsi}");
        desk.bus.run_for(Time::from_ms(2));
        assert_eq!(desk.word(0x2000_0000), 2, "{lsi}");
        assert_eq!(desk.word(0x2000_0014), BY_WATCHDOG);
        // It is off afterwards.
        desk.bus.run_for(Time::from_ms(500));
        assert_eq!(desk.word(0x2000_0000), 2, "{lsi}");
    }
    // Fed each 10 ms for 300 ms.
    let mut desk = resets(4, [3, 99, 30], 32_000);
    desk.bus.run_for(Time::from_ms(390));
    assert_eq!(desk.word(0x2000_0000), 1);
    desk.bus.run_for(Time::from_ms(20));
    assert_eq!(desk.word(0x2000_0000), 2);
}

#[test]
fn external_resets_report_their_cause() {
    let mut desk = resets(0, [0; 3], 32_000);
    desk.bus.run_for(Time::from_ms(1));
    desk.bus.reset_stm32(desk.machine, Cause::Pin);
    desk.bus.run_for(Time::from_ms(1));
    let kept = [0, 0x10, 0x14].map(|offset| desk.word(0x2000_0000 + offset));
    assert_eq!(kept, [2, POWER, BY_PIN]);
    desk.bus.reset_stm32(desk.machine, Cause::Power);
    desk.bus.run_for(Time::from_ms(1));
    let kept = [0, 0x10, 0x14].map(|offset| desk.word(0x2000_0000 + offset));
    assert_eq!(kept, [1, POWER, 0]);
}

#[test]
#[should_panic(
    expected = "0x40012000 is read, which is not modelled; the instruction is at 0x080001"
)]
fn an_access_that_is_not_modelled_fails_the_test_by_name() {
    let mut desk = resets(5, [0; 3], 32_000);
    desk.bus.run_for(Time::from_ms(1));
}
