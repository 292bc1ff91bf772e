//! The frames that the standard's examples and the project's documents give, byte for byte, against
//! the firmware in the simulator.

use multidrop_testkit::frames::{adu, be, block, data, words};
use multidrop_testkit::{Rig, image};

/// Frames as documents print them, CRC included.
const READ_ONE: [u8; 8] = [0x01, 0x03, 0x00, 0x00, 0x00, 0x01, 0x84, 0x0a];
const READ_THREE: [u8; 8] = [0x11, 0x03, 0x00, 0x6b, 0x00, 0x03, 0x76, 0x87];
const THREE: [u8; 11] = [
    0x11, 0x03, 0x06, 0xae, 0x41, 0x56, 0x52, 0x43, 0x40, 0x49, 0xad,
];
const COIL_ON: [u8; 8] = [0x11, 0x05, 0x00, 0xac, 0xff, 0x00, 0x4e, 0x8b];
const REGISTER: [u8; 8] = [0x11, 0x06, 0x00, 0x01, 0x00, 0x03, 0x9a, 0x9b];
const TEN_COILS: [u8; 11] = [
    0x11, 0x0f, 0x00, 0x13, 0x00, 0x0a, 0x02, 0xcd, 0x01, 0xbf, 0x0b,
];
const TWO_REGISTERS: [u8; 13] = [
    0x11, 0x10, 0x00, 0x01, 0x00, 0x02, 0x04, 0x00, 0x0a, 0x01, 0x02, 0xc6, 0xf0,
];
const REFUSED: [u8; 5] = [0x0a, 0x81, 0x02, 0xb0, 0x53];

/// A frame of unit 17 as unit 1 would get or send it.
fn for_unit_1(frame: &[u8]) -> Vec<u8> {
    let mut body = frame[..frame.len() - 2].to_vec();
    body[0] = 1;
    adu(&body)
}

#[test]
fn printed_frames_have_a_good_crc() {
    let frames: [&[u8]; 8] = [
        &READ_ONE,
        &READ_THREE,
        &THREE,
        &COIL_ON,
        &REGISTER,
        &TEN_COILS,
        &TWO_REGISTERS,
        &REFUSED,
    ];
    for frame in frames {
        assert_eq!(adu(&frame[..frame.len() - 2]), frame, "{frame:02x?}");
    }
    let check = crc::Crc::<u16>::new(&crc::CRC_16_MODBUS).checksum(b"123456789");
    assert_eq!(check, 0x4b37);
}

#[test]
fn unit_1_reads_its_first_register() {
    let nothing = [0x01, 0x03, 0x02, 0x00, 0x00, 0xb8, 0x44];
    Rig::full().expect(&READ_ONE, &nothing);
    Rig::units(&[1]).expect(&READ_ONE, &nothing);
}

#[test]
fn frames_of_unit_17_work_on_unit_1() {
    let mut rig = Rig::full();
    let values = be(&[0xae41, 0x5652, 0x4340]);
    rig.expect(&block(1, 0x10, 0x6b, 3, &values), &words(1, 0x10, 0x6b, 3));
    rig.expect(&for_unit_1(&READ_THREE), &for_unit_1(&THREE));

    rig.expect(&for_unit_1(&REGISTER), &for_unit_1(&REGISTER));
    rig.expect(&words(1, 3, 1, 1), &data(1, 3, &[0x00, 0x03]));

    rig.expect(&for_unit_1(&TEN_COILS), &words(1, 0x0f, 0x13, 10));
    rig.expect(&words(1, 1, 0x13, 10), &data(1, 1, &[0xcd, 0x01]));
    // Its neighbours on both sides are off: 0x12 and 0x1d.
    rig.expect(&words(1, 1, 0x12, 12), &data(1, 1, &[0x9a, 0x03]));

    rig.expect(&for_unit_1(&TWO_REGISTERS), &words(1, 0x10, 1, 2));
    rig.expect(
        &words(1, 3, 0, 4),
        &data(1, 3, &[0, 0, 0x00, 0x0a, 0x01, 0x02, 0, 0]),
    );

    // Coil 172 is not there: the nearest that differs in one bit is.
    let on = words(1, 5, 0x2c, 0xff00);
    rig.expect(&on, &on);
    rig.expect(&words(1, 1, 0x2c, 1), &data(1, 1, &[1]));
}

#[test]
fn unit_17_refuses_what_it_does_not_have() {
    // The demonstration unit has one register: every printed request goes past it.
    let mut rig = Rig::units(&[17]);
    let requests: [&[u8]; 5] = [&READ_THREE, &COIL_ON, &REGISTER, &TEN_COILS, &TWO_REGISTERS];
    for request in requests {
        rig.expect(request, &adu(&[0x11, request[1] | 0x80, 2]));
    }
    rig.expect_silence(&READ_ONE);
    rig.expect(&words(17, 3, 0, 1), &data(17, 3, &[0, 0]));
}

#[test]
fn unit_10_refuses_with_the_printed_exception() {
    // APP 7: a read of coil 1245, of which there are fewer.
    let mut rig = Rig::units(&[10]);
    rig.expect(&words(10, 1, 0x04a1, 1), &REFUSED);
}

#[test]
fn frames_of_unit_17_do_not_affect_unit_1() {
    let mut rig = Rig::full();
    let before = rig.state(128);
    let frames: [&[u8]; 6] = [
        &READ_THREE,
        &THREE,
        &COIL_ON,
        &REGISTER,
        &TEN_COILS,
        &TWO_REGISTERS,
    ];
    for frame in frames {
        rig.expect_silence(frame);
    }
    rig.expect_silence(b":1103006B00037E\r\n");
    assert_eq!(rig.state(128), before);
}

#[test]
fn a_demonstration_unit_shows_its_register_in_all_tables_and_on_its_pins() {
    let image = image("demo-unit", &[]);
    let mut rig = Rig::with(&[&image], multidrop_testkit::LINE);
    let write = words(1, 6, 0, 0x2ad5);
    rig.expect(&write, &write);
    for function in [3, 4] {
        rig.expect(&words(1, function, 0, 1), &data(1, function, &[0x2a, 0xd5]));
    }
    for function in [1, 2] {
        rig.expect(
            &words(1, function, 0, 16),
            &data(1, function, &[0xd5, 0x2a]),
        );
    }
    let node = rig.bus.node(rig.node());
    let (b, direction_b) = node.port_state('B').expect("a port");
    let (d, direction_d) = node.port_state('D').expect("a port");
    assert_eq!(direction_b & 0x3f, 0x3f);
    assert_eq!(b & 0x3f, 0x2a);
    // RXD, TXD and DE are not LED pins.
    assert_eq!(direction_d & 0xf8, 0xf8);
    assert_eq!(d & 0xf8, 0xd0);
}
