//! The line of a chip, over the chip that the guide's chapter "A new board" makes up: what tasks see of it, and what they do to the wire.

use std::cell::RefCell;
use std::future::Future;
use std::pin::{Pin, pin};
use std::task::{Context, Poll, Waker};

use multidrop::line::{ChipLine, Line, LineConfig, LineError};
use multidrop::protocol::format::{Framing, LineFormat};
use multidrop::protocol::frame::ReceiveErrors;
use multidrop::protocol::line::Chip;
use multidrop::protocol::port_registers::Duplex;
use multidrop::sniff::Observer;
use multidrop_testkit::line_chip::ChipUnderTest;
use multidrop_testkit::made_up::{CLOCK_HZ, MadeUp, OnDesk};

/// Unit 17, function 07, with its CRC.
const REQUEST: [u8; 4] = [0x11, 0x07, 0x4C, 0x22];

const CONFIG: LineConfig = LineConfig {
    baud: 38_400,
    format: LineFormat::F8N1,
    ..LineConfig::DEFAULT
};

/// Ticks of a character at 38400 baud, and some more.
const CHARACTER: u32 = CLOCK_HZ / 3_840 + 1;

// ANCHOR: line
fn line(desk: &OnDesk, config: Option<LineConfig>) -> ChipLine<MadeUp> {
    let chip = desk.chip_for_a_line();
    let settings = config.map(|config| chip.settings(&config).expect("the chip does this"));
    // SAFETY: the chip on a desk has one buffer, which it uses as the machine says, and there is one line of it.
    unsafe { ChipLine::new(chip, settings.as_ref()) }
}
// ANCHOR_END: line

/// On a desk, in silence.
fn silent(config: LineConfig) -> (OnDesk, ChipLine<MadeUp>) {
    let mut desk = OnDesk::power_up();
    let line = line(&desk, Some(config));
    wait(&mut desk, 50);
    (desk, line)
}

/// The time of so many characters.
fn wait(desk: &mut OnDesk, characters: u32) {
    desk.run_until(desk.now().wrapping_add(characters * CHARACTER));
}

fn hear(desk: &mut OnDesk, bytes: &[u8]) {
    for &byte in bytes {
        wait(desk, 1);
        desk.character(byte, ReceiveErrors::NONE);
    }
}

fn sent(desk: &mut OnDesk) -> Vec<u8> {
    desk.sent().into_iter().map(|(_, byte)| byte).collect()
}

fn poll<F: Future>(future: Pin<&mut F>) -> Poll<F::Output> {
    future.poll(&mut Context::from_waker(Waker::noop()))
}

/// What is ready at once.
fn now<T>(future: impl Future<Output = T>) -> Option<T> {
    match poll(pin!(future)) {
        Poll::Ready(value) => Some(value),
        Poll::Pending => None,
    }
}

#[test]
fn a_frame_is_lent_answered_in_place_and_given_back() {
    let (mut desk, line) = silent(CONFIG);
    let mut receive = pin!(line.receive());
    assert!(poll(receive.as_mut()).is_pending());
    hear(&mut desk, &REQUEST);
    wait(&mut desk, 4);
    let Poll::Ready(Ok(mut frame)) = poll(receive.as_mut()) else {
        panic!("a frame at t1.5");
    };
    assert_eq!((frame.unit(), frame.request_len()), (0x11, 2));
    assert!(now(frame.settle()).is_none(), "provisional");
    frame.adu()[1..3].copy_from_slice(&[0x87, 0x02]);
    let mut answer = frame.release(3);
    assert!(now(answer.sent()).is_none());
    assert!(now(line.receive()).is_none(), "the buffer is lent once");
    wait(&mut desk, 20);
    assert_eq!(now(answer.sent()), Some(true));
    drop(answer);
    assert_eq!(sent(&mut desk), [0x11, 0x87, 0x02, 0xC3, 0xF4]);
    hear(&mut desk, &REQUEST);
    wait(&mut desk, 4);
    assert!(matches!(now(line.receive()), Some(Ok(_))));
}

#[test]
fn a_frame_that_is_damaged_is_told_and_void_ones_are_not_answered() {
    let (mut desk, line) = silent(CONFIG);
    hear(&mut desk, &[0x11, 0x07, 0x4C, 0x23]);
    assert_eq!(now(line.quiet()), None);
    wait(&mut desk, 20);
    assert_eq!(now(line.quiet()), None, "it waits to be fetched");
    let Some(Err(errors)) = now(line.receive()) else {
        panic!("it is told");
    };
    assert_eq!(errors, ReceiveErrors::CHECK);
    assert_eq!(now(line.quiet()), Some(ReceiveErrors::NONE));
    hear(&mut desk, &REQUEST);
    wait(&mut desk, 4);
    let Some(Ok(frame)) = now(line.receive()) else {
        panic!("a frame at t1.5");
    };
    let mut answer = frame.release(2);
    desk.character(0x55, ReceiveErrors::NONE);
    assert_eq!(now(answer.settle()), Some(false));
    assert_eq!(now(answer.sent()), Some(false));
    wait(&mut desk, 20);
    assert_eq!(sent(&mut desk), []);
}

#[test]
fn new_settings_wait_until_what_is_sent_is_out() {
    let (mut desk, line) = silent(CONFIG);
    {
        let mut transmit = pin!(line.transmit(&[0x11, 0x07]));
        assert!(poll(transmit.as_mut()).is_pending());
        wait(&mut desk, 1);
        let slower = LineConfig {
            baud: 9_600,
            ..CONFIG
        };
        let mut configure = pin!(line.configure(slower));
        assert!(poll(configure.as_mut()).is_pending());
        wait(&mut desk, 2);
        assert!(poll(configure.as_mut()).is_pending());
        wait(&mut desk, 4);
        assert_eq!(poll(configure.as_mut()), Poll::Ready(Ok(())));
        assert_eq!(sent(&mut desk), REQUEST);
    }
    let seven = LineConfig {
        format: LineFormat::F7E1,
        ..CONFIG
    };
    let refused = Err(LineError::Format(LineFormat::F7E1));
    assert_eq!(line.check(&seven), refused);
    assert_eq!(now(line.configure(seven)), Some(refused));
    assert_eq!(line.check(&CONFIG), Ok(()));
    // At 9600 baud t1.5 is six of these characters and not three.
    wait(&mut desk, 80);
    hear(&mut desk, &REQUEST);
    wait(&mut desk, 4);
    assert!(now(line.receive()).is_none());
    wait(&mut desk, 4);
    assert!(matches!(now(line.receive()), Some(Ok(_))));
}

#[test]
fn a_line_without_settings_is_off_until_it_is_configured() {
    let mut desk = OnDesk::power_up();
    let line = line(&desk, None);
    wait(&mut desk, 50);
    hear(&mut desk, &REQUEST);
    wait(&mut desk, 50);
    assert!(now(line.receive()).is_none());
    assert_eq!(now(line.configure(CONFIG)), Some(Ok(())));
    wait(&mut desk, 50);
    hear(&mut desk, &REQUEST);
    wait(&mut desk, 4);
    assert!(matches!(now(line.receive()), Some(Ok(_))));
}

#[test]
fn what_hangs_is_cut_and_told_so() {
    let (mut desk, line) = silent(CONFIG);
    let Some(mut frame) = now(line.lend()) else {
        panic!("the wire is silent");
    };
    frame.adu()[..2].copy_from_slice(&REQUEST[..2]);
    let mut request = frame.release(2);
    desk.stop_transmitter();
    wait(&mut desk, 10);
    assert_eq!(now(request.sent()), Some(false));
    assert!(line.was_cut());
    let changes = desk.de_changes();
    assert!(matches!(changes[..], [(_, true), (_, false)]));
}

#[test]
fn the_delimiter_of_ascii_frames_can_be_another() {
    let ascii = LineConfig {
        framing: Framing::Ascii,
        format: LineFormat::F7E1,
        ..CONFIG
    };
    let (mut desk, line) = silent(ascii);
    line.set_delimiter(b'!');
    hear(&mut desk, b":1107E8\r!");
    assert!(matches!(now(line.receive()), Some(Ok(frame)) if frame.request_len() == 2));
}

#[test]
fn an_observer_is_shown_what_the_line_shows() {
    #[derive(Default)]
    struct Eyes(RefCell<Vec<Result<Vec<u8>, ReceiveErrors>>>);

    impl Observer for Eyes {
        fn hear(&self, seen: Result<&[u8], ReceiveErrors>) {
            self.0.borrow_mut().push(seen.map(<[u8]>::to_vec));
        }
    }

    let (_desk, line) = silent(CONFIG);
    line.show(Ok(&[1]));
    let eyes: &'static Eyes = Box::leak(Box::default());
    let line = line.observed_by(eyes);
    line.show(Ok(&REQUEST));
    line.show(Err(ReceiveErrors::GAP));
    let seen = eyes.0.take();
    assert_eq!(seen, [Ok(REQUEST.to_vec()), Err(ReceiveErrors::GAP)]);
    assert!(line.may_be(Duplex::Half) && !line.may_be(Duplex::Full));
    const { assert!(<ChipLine<MadeUp> as Line>::HAS_NEIGHBOURS) };
}
