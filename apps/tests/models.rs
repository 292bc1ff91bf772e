//! The data models of the images, address by address, and the reset causes of a board.

use std::cell::{Cell, RefCell};
use std::future::Future;
use std::pin::pin;
use std::ptr::NonNull;
use std::rc::Rc;
use std::task::{Context, Poll, Waker};

use multidrop::line::{Key, Lend, Line, LineConfig, LineError};
use multidrop::protocol::Adu;
use multidrop::protocol::frame::ReceiveErrors;
use multidrop::protocol::port_registers::Duplex;
use multidrop::protocol::server::{Counted, DataModel, Server};
use multidrop::{PortConfig, ResetCause, ServerPort, Stack};
use multidrop_apps::demo_unit::DemoUnit;
use multidrop_apps::faults::{Asked, Failure, Faults, keep, use_up_stack};
use multidrop_apps::yardstick::yardstick;

/// The PDU answered to this PDU.
fn ask<M: DataModel>(model: &mut M, pdu: &[u8]) -> Vec<u8> {
    let server = Server::new(1);
    let mut adu: Adu = [0xA5; 256];
    adu[0] = 1;
    adu[1..=pdu.len()].copy_from_slice(pdu);
    let len = pdu.len() as u8 + 1;
    let plan = server.prepare(model, &mut adu, len);
    let len = server.commit(model, &mut adu, len, plan);
    adu[1..len.into()].to_vec()
}

fn words(code: u8, words: &[u16]) -> Vec<u8> {
    let mut pdu = vec![code];
    pdu.extend(words.iter().flat_map(|word| word.to_be_bytes()));
    pdu
}

/// `count` bits of `bits` from `first` on, as an answer to this function has them.
fn told_bits(code: u8, count: u16, is_on: impl Fn(u16) -> bool) -> Vec<u8> {
    let bytes = usize::from(count.div_ceil(8));
    let mut pdu = vec![0; 2 + bytes];
    (pdu[0], pdu[1]) = (code, bytes as u8);
    for bit in (0..count).filter(|bit| is_on(*bit)) {
        pdu[2 + usize::from(bit / 8)] |= 1 << (bit % 8);
    }
    pdu
}

const OUTPUTS: [u16; 6] = [0, 0xFFFF, 0x0001, 0x8000, 0xA53C, 0x1234];

/// What was put on the pins.
type Shown = Rc<RefCell<Vec<u16>>>;

fn demo_unit() -> (DemoUnit<impl FnMut(u16)>, Shown) {
    let shown = Shown::default();
    let pins = shown.clone();
    (
        DemoUnit::new(move |outputs| pins.borrow_mut().push(outputs)),
        shown,
    )
}

#[test]
fn the_demonstration_unit_is_one_register_in_four_tables() {
    for outputs in OUTPUTS {
        let (mut unit, shown) = demo_unit();
        let write = words(6, &[0, outputs]);
        assert_eq!(ask(&mut unit, &write), write);
        assert_eq!(*shown.borrow(), [outputs]);
        for code in [3, 4] {
            let [high, low] = outputs.to_be_bytes();
            assert_eq!(ask(&mut unit, &words(code, &[0, 1])), [code, 2, high, low]);
            for (first, count) in [(0, 2), (1, 1), (65_535, 1)] {
                assert_eq!(
                    ask(&mut unit, &words(code, &[first, count])),
                    [code | 0x80, 2]
                );
            }
        }
        for code in [1, 2] {
            for first in 0..16 {
                for count in 1..=16 - first {
                    let expected = told_bits(code, count, |bit| outputs >> (first + bit) & 1 == 1);
                    assert_eq!(ask(&mut unit, &words(code, &[first, count])), expected);
                }
                let beyond = words(code, &[first, 17 - first]);
                assert_eq!(ask(&mut unit, &beyond), [code | 0x80, 2], "{first}");
            }
        }
        assert_eq!(shown.borrow().len(), 1);
    }
}

#[test]
fn a_coil_of_the_demonstration_unit_is_a_bit_and_no_other() {
    for outputs in OUTPUTS {
        for bit in 0..16 {
            for on in [false, true] {
                let (mut unit, shown) = demo_unit();
                ask(&mut unit, &words(6, &[0, outputs]));
                let write = words(5, &[bit, if on { 0xFF00 } else { 0 }]);
                assert_eq!(ask(&mut unit, &write), write);
                let rest = outputs & !(1 << bit);
                let expected = rest | u16::from(on) << bit;
                assert_eq!(*shown.borrow(), [outputs, expected], "{bit}: {on}");
            }
        }
        // Several at once, from each first one.
        for first in 0..16 {
            let count = 16 - first;
            let (mut unit, shown) = demo_unit();
            ask(&mut unit, &words(6, &[0, outputs]));
            let mut write = words(15, &[first, count]);
            let bytes = &0x5A96_u16.to_le_bytes()[..usize::from(count.div_ceil(8))];
            write.push(bytes.len() as u8);
            write.extend(bytes);
            assert_eq!(ask(&mut unit, &write), write[..5]);
            let mask = (0xFFFF_u32 << first) as u16;
            let expected = outputs & !mask | 0x5A96 << first;
            assert_eq!(*shown.borrow(), [outputs, expected], "from {first}");
        }
    }
}

#[test]
fn a_write_to_a_missing_item_of_the_demonstration_unit_changes_nothing() {
    let (mut unit, shown) = demo_unit();
    for write in [
        words(5, &[16, 0xFF00]),
        words(6, &[1, 0xFFFF]),
        [words(15, &[15, 2]), vec![1, 3]].concat(),
        [words(16, &[0, 2]), vec![4, 1, 2, 3, 4]].concat(),
        [words(16, &[1, 1]), vec![2, 1, 2]].concat(),
    ] {
        assert_eq!(ask(&mut unit, &write), [write[0] | 0x80, 2], "{write:02X?}");
    }
    assert!(shown.borrow().is_empty());
    assert_eq!(ask(&mut unit, &words(3, &[0, 1])), [3, 2, 0, 0]);
}

#[test]
fn the_yardstick_has_count_items_in_each_table() {
    let unit = &mut yardstick::<12, 2>();
    for code in 1..=4 {
        for first in 0..14 {
            for count in 1..=14 {
                let told = ask(unit, &words(code, &[first, count]));
                let expected = match code {
                    _ if first + count > 12 => vec![code | 0x80, 2],
                    1 => told_bits(1, count, |_| false),
                    2 => told_bits(2, count, |bit| (first + bit) % 3 == 0),
                    _ => {
                        let values = (first..first + count)
                            .map(|address| if code == 4 { 0x1000 + address } else { 0 });
                        let mut pdu = vec![code, 2 * count as u8];
                        pdu.extend(values.flat_map(u16::to_be_bytes));
                        pdu
                    }
                };
                assert_eq!(told, expected, "{code}: {count} from {first}");
            }
        }
    }
    for write in [
        words(6, &[11, 0x1234]),
        words(5, &[11, 0xFF00]),
        words(6, &[0, 0x5678]),
    ] {
        assert_eq!(ask(unit, &write), write);
    }
    for write in [words(6, &[12, 1]), words(5, &[12, 0xFF00])] {
        assert_eq!(ask(unit, &write), [write[0] | 0x80, 2]);
    }
    assert_eq!(ask(unit, &words(3, &[11, 1])), [3, 2, 0x12, 0x34]);
    assert_eq!(ask(unit, &words(3, &[0, 1])), [3, 2, 0x56, 0x78]);
    assert_eq!(ask(unit, &words(1, &[0, 12])), [1, 2, 0, 8]);
    let another = &mut yardstick::<12, 2>();
    assert_eq!(ask(another, &words(4, &[11, 1])), [4, 2, 0x10, 0x0B]);
}

fn asked(asked: &Asked) -> Option<Failure> {
    asked.try_take()
}

/// The board's stack, as it is told here.
fn stack() -> Stack {
    Stack {
        size: 0x1_0001,
        used: 0x0203,
    }
}

#[test]
fn a_failing_unit_reports_its_reset_cause_and_stack() {
    let told: &'static Asked = Box::leak(Box::default());
    let mut unit = Faults::new(told, ResetCause::Fault, stack);
    let expected = |address: u16| match address {
        0 => 5,
        2 => 0x0203,
        // More than a register holds.
        3 => 0xFFFF,
        _ => 0x0100 + address,
    };
    for first in 0..16 {
        for count in 1..=17 - first {
            let mut pdu = vec![3, 2 * count as u8];
            pdu.extend((first..first + count).flat_map(|address| expected(address).to_be_bytes()));
            if first + count > 16 {
                pdu = vec![0x83, 2];
            }
            assert_eq!(ask(&mut unit, &words(3, &[first, count])), pdu);
        }
    }
    assert_eq!(ask(&mut unit, &words(3, &[16, 1])), [0x83, 2]);
    assert_eq!(asked(told), None);
}

#[test]
fn a_unit_fails_only_as_requested() {
    let told: &'static Asked = Box::leak(Box::default());
    let mut unit = Faults::new(told, ResetCause::Power, stack);
    let failures = [
        Failure::Panic,
        Failure::PanicInInterrupt,
        Failure::UnhandledInterrupt,
        Failure::Hang,
        Failure::HangWithInterruptsOff,
        Failure::LostReady,
        Failure::LostSent,
        Failure::Keep,
        Failure::OverflowStack,
    ];
    for (number, failure) in (1..).zip(failures) {
        for count in [1, 2, 15, 16] {
            let mut pdu = vec![4, 2 * count as u8];
            pdu.resize(2 + 2 * usize::from(count), 0);
            assert_eq!(ask(&mut unit, &words(4, &[number, count])), pdu);
            assert_eq!(asked(told), Some(failure));
        }
        for count in [17, 125] {
            assert_eq!(ask(&mut unit, &words(4, &[number, count])), [0x84, 2]);
            assert_eq!(asked(told), None, "{count}");
        }
    }
    for number in [0, 10, 11, 255, 256, 257, 65_535] {
        assert_eq!(ask(&mut unit, &words(4, &[number, 1])), [0x84, 2]);
        assert_eq!(asked(told), None, "{number}");
    }
}

#[test]
fn the_stack_is_used_up_until_the_callback_ends_it() {
    let calls = Cell::new(0_u32);
    for depth in [1, 2, 3, 300] {
        calls.set(0);
        let is_over = || {
            calls.set(calls.get() + 1);
            calls.get() == depth
        };
        // Each call keeps a frame of its own, and none is left out on the way back.
        let expected = 0xAA_u8.wrapping_mul((depth - 1) as u8);
        assert_eq!(use_up_stack(&is_over), expected);
        assert_eq!(calls.get(), depth);
    }
}

/// A line of which there is the buffer alone.
struct Buffer {
    is_lent: &'static Cell<bool>,
    may_be_lent: &'static Cell<bool>,
}

// SAFETY: nothing is lent but the right to it.
unsafe impl Lend for Buffer {
    fn poll_received(&self, _: &mut Context<'_>, _: Key) -> Poll<Result<u8, ReceiveErrors>> {
        unreachable!("it is not asked to")
    }

    fn poll_lent(&self, _: &mut Context<'_>, _: Key) -> Poll<()> {
        if !self.may_be_lent.get() {
            return Poll::Pending;
        }
        assert!(!self.is_lent.replace(true), "lent twice");
        Poll::Ready(())
    }

    fn buffer(&self, _: Key) -> NonNull<Adu> {
        unreachable!("nobody looks at it")
    }

    fn release(&self, _: u8, _: Key) {
        unreachable!("nothing is sent")
    }

    fn poll_settled(&self, _: &mut Context<'_>, _: Key) -> Poll<bool> {
        unreachable!("nothing is heard")
    }

    fn poll_sent(&self, _: &mut Context<'_>, _: Key) -> Poll<bool> {
        unreachable!("nothing is sent")
    }

    fn give_back(&self, _: Key) {
        assert!(self.is_lent.replace(false), "given back twice");
    }
}

impl Line for Buffer {
    async fn quiet(&self) -> ReceiveErrors {
        unreachable!("it is not asked to")
    }
    fn check(&self, _: &LineConfig) -> Result<(), LineError> {
        unreachable!("it is not asked to")
    }
    async fn configure(&self, _: LineConfig) -> Result<(), LineError> {
        unreachable!("it is not asked to")
    }
    fn set_delimiter(&self, _: u8) {}
}

#[test]
fn a_buffer_that_is_kept_is_kept_until_the_task_ends() {
    const PORT: PortConfig = PortConfig::new("RS4");
    let is_lent: &'static Cell<bool> = Box::leak(Box::default());
    let may_be_lent: &'static Cell<bool> = Box::leak(Box::default());
    let line = Buffer {
        is_lent,
        may_be_lent,
    };
    let port: &'static ServerPort<Buffer> = Box::leak(Box::new(ServerPort::new(line, &PORT)));
    let mut context = Context::from_waker(Waker::noop());
    {
        let mut kept = pin!(keep(port));
        assert!(kept.as_mut().poll(&mut context).is_pending());
        assert!(!is_lent.get());
        may_be_lent.set(true);
        for _ in 0..3 {
            assert!(kept.as_mut().poll(&mut context).is_pending());
            assert!(is_lent.get());
        }
    }
    assert!(!is_lent.get());
}

#[test]
fn the_default_line_is_half_duplex_and_cuts_nothing_off() {
    let line = Buffer {
        is_lent: Box::leak(Box::default()),
        may_be_lent: Box::leak(Box::default()),
    };
    assert!(line.may_be(Duplex::Half));
    assert!(!line.may_be(Duplex::Full));
    assert!(!line.was_cut());
    line.show(Ok(&[1, 2, 3]));
    line.show(Err(ReceiveErrors::CHECK));
    const { assert!(!Buffer::HAS_NEIGHBOURS) };
}

#[test]
fn each_reset_cause_has_its_number_and_its_name() {
    let causes = [
        (ResetCause::Power, "power"),
        (ResetCause::BrownOut, "brown-out"),
        (ResetCause::Watchdog, "watchdog"),
        (ResetCause::Pin, "pin"),
        (ResetCause::Fault, "fault"),
        (ResetCause::Other, "other"),
    ];
    for (number, (cause, name)) in (1..).zip(causes) {
        assert_eq!(cause as u8, number);
        assert_eq!(ResetCause::from_number(number), cause);
        assert_eq!(cause.name(), name);
        let server = Server::with(1, Counted::<8>::new());
        cause.report(server.diagnostics());
        let mut adu: Adu = [0; 256];
        adu[..6].copy_from_slice(&[1, 8, 0, 2, 0, 0]);
        let (mut unit, _) = demo_unit();
        let plan = server.prepare(&mut unit, &mut adu, 6);
        let len = server.commit(&mut unit, &mut adu, 6, plan);
        assert_eq!(adu[..len.into()], [1, 8, 0, 2, 0, number]);
    }
    for number in [0, 7, 8, 255] {
        assert_eq!(ResetCause::from_number(number), ResetCause::Other);
    }
}
