//! The Nano's image after its boot loaders, which use the reset flags, the watchdog and r2 first (`avr/boot.S`).

use std::path::Path;

use multidrop_bus::{Bus, BusConfig, HostId, HostPort, Nano, NodeId, Time};
use multidrop_testkit::frames::{data, words};
use multidrop_testkit::{LINE, image};

/// The boot sections, of 2 KB and of 512 bytes.
const OLD: (u32, u16) = (0, 0x7800);
const NEW_WITHOUT_R2: (u32, u16) = (1, 0x7E00);
const NEW: (u32, u16) = (2, 0x7E00);

/// Causes, and how to fail, as `multidrop` numbers them.
const POWER: u8 = 1;
const WATCHDOG: u8 = 3;
const FAULT: u8 = 5;
const OTHER: u8 = 6;
const PANIC: u16 = 1;
const HANG: u16 = 4;

const UNIT: u8 = 5;

/// The image `faults` for a boot loader, behind this one.
struct Desk {
    bus: Bus,
    node: NodeId,
    host: HostId,
}

impl Desk {
    fn new(loader: (u32, u16), image: &Path, seed: u64) -> Self {
        let (kind, section) = loader;
        let symbols = [("KIND", kind), ("BOOT", u32::from(section))];
        let loader = multidrop_testkit::assembler::assemble("boot", &symbols);
        let mut bus = Bus::new(BusConfig::default());
        let nano = Nano {
            boot_loader: Some((loader, section)),
            seed,
            ..Nano::new("unit", image)
        };
        let node = bus.add_nano(nano).expect("a valid image");
        let host = bus.add_host(HostPort::new(LINE));
        Desk { bus, node, host }
    }

    fn ask(&mut self, request: &[u8]) -> Vec<u8> {
        let answer = self.bus.transact(self.host, request, Time::from_ms(20));
        answer.map_or(Vec::new(), |answer| answer.bytes)
    }

    /// Nothing if it does not answer; else the cause of its start.
    fn cause(&mut self) -> Option<u8> {
        let answer = self.ask(&words(UNIT, 3, 0, 2));
        let cause = *answer.get(4)?;
        assert_eq!(answer, data(UNIT, 3, &[0, cause, 1, 1]));
        Some(cause)
    }

    fn fail(&mut self, failure: u16) {
        self.ask(&words(UNIT, 4, failure, 16));
    }
}

#[test]
fn optiboot_passes_the_reset_flags_on_and_the_watchdog_works() {
    let image = image("faults", &["--bootloader", "new"]);
    let mut desk = Desk::new(NEW, &image, 1);
    desk.bus.run_for(Time::from_ms(20));
    assert_eq!(desk.cause(), Some(POWER));
    desk.fail(PANIC);
    desk.bus.run_for(Time::from_ms(50));
    assert_eq!(desk.cause(), Some(FAULT));
    desk.fail(HANG);
    desk.bus.run_for(Time::from_ms(2_100));
    assert_eq!(desk.cause(), Some(WATCHDOG));
    // It ends its own wait by the watchdog, and that is what it hands over.
    desk.bus.reset(desk.node);
    desk.bus.run_for(Time::from_ms(900));
    assert_eq!(desk.cause(), None);
    desk.bus.run_for(Time::from_ms(200));
    assert_eq!(desk.cause(), Some(WATCHDOG));
}

#[test]
fn with_an_optiboot_that_passes_nothing_on_the_fault_is_kept() {
    let image = image("faults", &["--bootloader", "new"]);
    for seed in 1..=8 {
        // What is in r2 then is no flags, most times.
        let mut desk = Desk::new(NEW_WITHOUT_R2, &image, seed);
        desk.bus.run_for(Time::from_ms(20));
        assert_eq!(desk.cause(), Some(OTHER), "seed {seed}");
        desk.fail(PANIC);
        desk.bus.run_for(Time::from_ms(50));
        assert_eq!(desk.cause(), Some(FAULT), "seed {seed}");
    }
}

#[test]
fn the_image_for_the_old_boot_loader_has_no_watchdog() {
    let with = image("faults", &["--bootloader", "new"]);
    let without = image("faults", &["--bootloader", "old"]);
    for (image, comes_back) in [(with, false), (without, true)] {
        let mut desk = Desk::new(OLD, &image, 1);
        desk.bus.run_for(Time::from_ms(1_100));
        assert_eq!(desk.cause(), Some(POWER));
        desk.fail(PANIC);
        desk.bus.run_for(Time::from_s(5));
        assert_eq!(desk.cause(), None);
        // Pulling the reset pin helps where no watchdog runs.
        desk.bus.reset(desk.node);
        desk.bus.run_for(Time::from_ms(1_100));
        assert_eq!(desk.cause().is_some(), comes_back);
    }
}
