//! Faults that were found in other servers.

mod common;

use common::{LIMITED, LOCKED, Tables, UNIT, ask, ask_on_line, refused, with_data, words};
use multidrop_protocol::Adu;
use multidrop_protocol::data::{CoilsOut, Registers, RegistersOut};
use multidrop_protocol::exception::Exception;
use multidrop_protocol::rtu;
use multidrop_protocol::server::{ApplicationFunction, DataModel, Function, Plan, Server};

fn adu(request: &[u8]) -> Vec<u8> {
    rtu::encode(request, &mut [0; 256]).unwrap().to_vec()
}

#[test]
fn a_bad_crc_is_never_answered() {
    let mut tables = Tables::new();
    for function in 0..=255 {
        let whole = adu(&words(UNIT, function, 0, 1));
        assert!(ask_on_line(&mut tables, &whole).is_some());
        for bit in 0..whole.len() * 8 {
            let mut bad = whole.clone();
            bad[bit / 8] ^= 1 << (bit % 8);
            assert_eq!(ask_on_line(&mut tables, &bad), None, "{bad:02X?}");
        }
    }
}

#[test]
fn only_the_servers_unit_id_is_answered_and_only_0_is_broadcast() {
    for unit in (0..=255).filter(|unit| *unit != UNIT) {
        let mut tables = Tables::new();
        assert_eq!(ask(&mut tables, &words(unit, 6, 0, 0x1234)), None);
        assert_eq!(tables.holding[0] == 0x1234, unit == 0, "unit {unit}");
        assert_eq!(ask(&mut tables, &words(unit, 3, 0, 1)), None);
        assert_eq!(ask(&mut tables, &words(unit, 0x55, 0, 1)), None);
    }
}

#[test]
fn a_byte_count_that_does_not_fit_writes_nothing() {
    let mut tables = Tables::new();
    let before = tables.clone();
    for request in [
        with_data(UNIT, 0x10, 0, 2, &[9; 6]),
        with_data(UNIT, 0x10, 0, 0, &[]),
        with_data(UNIT, 0x0F, 0, 0, &[]),
        with_data(UNIT, 0x0F, 0, 8, &[0xFF, 0xFF]),
    ] {
        assert_eq!(
            ask(&mut tables, &request),
            refused(&request, Exception::IllegalDataValue)
        );
    }
    for function in [0x0F, 0x10] {
        for present in [0, 1, 2, 247] {
            let mut request = words(UNIT, function, 0, 1);
            request.push(255);
            request.extend(vec![9; present]);
            assert_eq!(
                ask(&mut tables, &request),
                refused(&request, Exception::IllegalDataValue)
            );
        }
    }
    assert!(tables == before);
}

#[test]
fn one_wrong_value_keeps_all_from_being_written() {
    let mut tables = Tables::new();
    let before = tables.clone();
    let registers = with_data(UNIT, 0x10, LIMITED - 1, 3, &[0, 1, 0, 201, 0, 1]);
    assert_eq!(
        ask(&mut tables, &registers),
        refused(&registers, Exception::IllegalDataValue)
    );
    let coils = with_data(UNIT, 0x0F, LOCKED - 1, 3, &[0xFF]);
    assert_eq!(
        ask(&mut tables, &coils),
        refused(&coils, Exception::NegativeAcknowledge)
    );
    let broadcast = with_data(0, 0x10, LIMITED - 1, 3, &[0, 1, 0, 201, 0, 1]);
    assert_eq!(ask(&mut tables, &broadcast), None);
    assert!(tables == before);
}

#[test]
fn a_write_that_fails_is_exception_04() {
    let mut tables = Tables::new();
    tables.broken = true;
    for request in [
        words(UNIT, 5, 0, 0xFF00),
        words(UNIT, 6, 0, 1),
        with_data(UNIT, 0x0F, 0, 1, &[1]),
        with_data(UNIT, 0x10, 0, 1, &[1, 2]),
    ] {
        assert_eq!(
            ask(&mut tables, &request),
            refused(&request, Exception::ServerDeviceFailure)
        );
        let mut broadcast = request;
        broadcast[0] = 0;
        assert_eq!(ask(&mut tables, &broadcast), None);
    }
}

/// Promises that its writes succeed, and breaks the promise.
struct Liar;

impl DataModel for Liar {
    const WRITES_MAY_FAIL: bool = false;

    fn check_registers(&self, _: u16, _: Registers<'_>) -> Result<(), Exception> {
        Ok(())
    }
}

#[test]
fn an_answer_that_is_being_sent_is_not_changed() {
    let server = Server::new(UNIT);
    let mut frame: Adu = [0; 256];
    frame[..6].copy_from_slice(&words(UNIT, 6, 0, 1));
    let plan = server.prepare(&mut Liar, &mut frame, 6);
    assert_eq!(plan, Plan::Write { len: 6 });
    let before = frame;
    assert_eq!(server.commit(&mut Liar, &mut frame, 6, plan), 6);
    assert_eq!(frame, before);
}

#[test]
fn tables_that_a_model_leaves_out_do_not_exist() {
    struct Nothing;
    impl DataModel for Nothing {}
    let server = Server::new(UNIT);
    for request in [
        words(UNIT, 1, 0, 1),
        words(UNIT, 2, 0, 1),
        words(UNIT, 3, 0, 1),
        words(UNIT, 4, 0, 1),
        words(UNIT, 5, 0, 0),
        words(UNIT, 6, 0, 0),
    ] {
        let mut frame: Adu = [0; 256];
        frame[..6].copy_from_slice(&request);
        assert_eq!(
            server.prepare(&mut Nothing, &mut frame, 6),
            Plan::Answer { len: 3 }
        );
        assert_eq!(frame[..3], [UNIT, request[1] | 0x80, 2]);
    }
}

#[test]
fn values_that_a_model_does_not_set_are_zero() {
    struct Lazy;
    impl DataModel for Lazy {
        fn coils(&mut self, _: u16, _: CoilsOut<'_>) -> Result<(), Exception> {
            Ok(())
        }
        fn holding_registers(&mut self, _: u16, _: RegistersOut<'_>) -> Result<(), Exception> {
            Ok(())
        }
    }
    let server = Server::new(UNIT);
    for (function, quantity, bytes) in [(1, 2000, 250), (3, 125, 250), (1, 9, 2), (3, 1, 2)] {
        let mut frame: Adu = [0xFF; 256];
        frame[..6].copy_from_slice(&words(UNIT, function, 0x0102, quantity));
        let len = 3 + bytes;
        assert_eq!(
            server.prepare(&mut Lazy, &mut frame, 6),
            Plan::Answer { len }
        );
        assert_eq!(frame[..3], [UNIT, function, bytes]);
        assert!(frame[3..len.into()].iter().all(|byte| *byte == 0));
        assert!(
            frame[len.into()..]
                .iter()
                .all(|byte| *byte == 0xFF || len < 6)
        );
    }
}

fn reverse<const DEFAULTED: bool>(
    app: &mut App<DEFAULTED>,
    pdu: &mut [u8],
    len: usize,
) -> Result<usize, Exception> {
    assert_eq!(pdu.len(), 253);
    app.0 += 1;
    pdu[1..len].reverse();
    Ok(len)
}

fn refuse<const DEFAULTED: bool>(
    _: &mut App<DEFAULTED>,
    pdu: &mut [u8],
    _: usize,
) -> Result<usize, Exception> {
    pdu[0] = 0;
    Err(Exception::ServerDeviceBusy)
}

fn longest<const DEFAULTED: bool>(
    _: &mut App<DEFAULTED>,
    pdu: &mut [u8],
    _: usize,
) -> Result<usize, Exception> {
    pdu[252] = 0x77;
    Ok(253)
}

fn too_long<const DEFAULTED: bool>(
    _: &mut App<DEFAULTED>,
    _: &mut [u8],
    _: usize,
) -> Result<usize, Exception> {
    Ok(254)
}

fn silent<const DEFAULTED: bool>(
    _: &mut App<DEFAULTED>,
    _: &mut [u8],
    _: usize,
) -> Result<usize, Exception> {
    Ok(0)
}

/// Functions of the application, with one that takes all others or without.
#[derive(Clone, PartialEq)]
struct App<const DEFAULTED: bool>(u16);

impl<const DEFAULTED: bool> DataModel for App<DEFAULTED> {
    const APPLICATION: &'static [ApplicationFunction<Self>] = &[
        ApplicationFunction {
            code: 0x41,
            broadcast: false,
            run: reverse,
        },
        ApplicationFunction {
            code: 0x42,
            broadcast: true,
            run: reverse,
        },
        ApplicationFunction {
            code: 0x43,
            broadcast: true,
            run: refuse,
        },
        ApplicationFunction {
            code: 0x44,
            broadcast: false,
            run: longest,
        },
        ApplicationFunction {
            code: 0x45,
            broadcast: false,
            run: too_long,
        },
        ApplicationFunction {
            code: 0x46,
            broadcast: false,
            run: silent,
        },
    ];
    const DEFAULT: Option<Function<Self>> = if DEFAULTED { Some(reverse) } else { None };
}

fn ask_app<const DEFAULTED: bool>(request: &[u8]) -> (Option<Vec<u8>>, u16) {
    let mut app = App::<DEFAULTED>(0);
    let answer = common::ask_server(&Server::new(UNIT), &mut app, request);
    (answer, app.0)
}

#[test]
fn functions_of_the_application() {
    assert_eq!(
        ask_app::<false>(&[UNIT, 0x41, 1, 2, 3]),
        (Some(vec![UNIT, 0x41, 3, 2, 1]), 1)
    );
    assert_eq!(ask_app::<false>(&[UNIT, 0x41]), (Some(vec![UNIT, 0x41]), 1));
    assert_eq!(ask_app::<false>(&[0, 0x41, 1, 2, 3]), (None, 0));
    assert_eq!(ask_app::<false>(&[0, 0x42, 1, 2, 3]), (None, 1));
    assert_eq!(
        ask_app::<false>(&[UNIT, 0x43]),
        (Some(vec![UNIT, 0xC3, 6]), 0)
    );
    assert_eq!(ask_app::<false>(&[0, 0x43]), (None, 0));
    let longest = ask_app::<false>(&[UNIT, 0x44]).0.unwrap();
    assert_eq!((longest.len(), longest[253]), (254, 0x77));
    assert_eq!(
        ask_app::<false>(&[UNIT, 0x45]),
        (Some(vec![UNIT, 0xC5, 4]), 0)
    );
    assert_eq!(ask_app::<false>(&[UNIT, 0x46]), (None, 0));
    assert_eq!(
        ask_app::<false>(&[UNIT, 0x47]),
        (Some(vec![UNIT, 0xC7, 1]), 0)
    );
    assert_eq!(ask_app::<false>(&[3, 0x41]), (None, 0));
}

#[test]
fn the_default_can_be_replaced() {
    assert_eq!(
        ask_app::<true>(&[UNIT, 0x60, 1, 2]),
        (Some(vec![UNIT, 0x60, 2, 1]), 1)
    );
    assert_eq!(ask_app::<true>(&[0, 0x60, 1, 2]), (None, 0));
    assert_eq!(
        ask_app::<true>(&[UNIT, 0x43]),
        (Some(vec![UNIT, 0xC3, 6]), 0)
    );
    for reserved in [0x00, 0x80, 0x83, 0xFF] {
        let refusal = Some(vec![UNIT, reserved | 0x80, 1]);
        assert_eq!(ask_app::<true>(&[UNIT, reserved, 1, 2]), (refusal, 0));
    }
}
