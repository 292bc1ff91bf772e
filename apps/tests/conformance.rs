//! The functions over the conformance map: examples of the standard, byte for byte.

use multidrop::protocol::Adu;
use multidrop::protocol::data::{BytesOut, RegistersOut};
use multidrop::protocol::exception::Exception;
use multidrop::protocol::frame::ReceiveErrors;
use multidrop::protocol::server::{Conformity, Counted, DataModel, FunctionSet, Server};
use multidrop_apps::conformance::Conformance;

struct Unit<M> {
    server: Server<Counted<64>>,
    model: M,
}

impl Unit<Conformance<32>> {
    fn new() -> Self {
        Unit {
            server: Server::counted(17),
            model: Conformance::new("stm32"),
        }
    }
}

impl<M: DataModel> Unit<M> {
    /// A good frame that stands: the answer, nothing if there is none.
    fn ask(&mut self, request: &[u8]) -> Vec<u8> {
        let mut frame: Adu = [0xA5; 256];
        frame[..request.len()].copy_from_slice(request);
        let len = request.len() as u8;
        let plan = self.server.prepare(&mut self.model, &mut frame, len);
        let early = plan.answer_at_once::<M>();
        let before = frame;
        let len = self.server.commit(&mut self.model, &mut frame, len, plan);
        if early > 0 {
            assert_eq!((len, frame), (early, before), "it may be on its way");
        }
        frame[..len.into()].to_vec()
    }

    /// A PDU to unit 17.
    fn pdu(&mut self, pdu: &[u8]) -> Vec<u8> {
        let answer = self.ask(&[&[17], pdu].concat());
        assert_eq!(answer[0], 17);
        answer[1..].to_vec()
    }

    fn counter(&mut self, sub: u8) -> u16 {
        let answer = self.pdu(&[8, 0, sub, 0, 0]);
        assert_eq!(answer[..3], [8, 0, sub]);
        u16::from_be_bytes([answer[3], answer[4]])
    }
}

#[test]
fn mask_write_as_the_standard_has_it() {
    let mut unit = Unit::new();
    // APP 6.16: 0x12 with the masks 0xF2 and 0x25 becomes 0x17.
    unit.pdu(&[6, 0, 4, 0, 0x12]);
    let request = [0x16, 0, 4, 0, 0xF2, 0, 0x25];
    assert_eq!(unit.pdu(&request), request);
    assert_eq!(unit.pdu(&[3, 0, 4, 0, 1]), [3, 2, 0, 0x17]);
    // The rule binds the result: 100 & 0 | 200 is allowed, | 201 is not.
    assert_eq!(unit.pdu(&[0x16, 0, 100, 0, 0, 0, 201]), [0x96, 3], "a rule");
    assert_eq!(
        unit.pdu(&[0x16, 0, 100, 0, 0, 0, 200]),
        [0x16, 0, 100, 0, 0, 0, 200]
    );
    assert_eq!(unit.pdu(&[0x16, 0, 128, 0, 0, 0, 0]), [0x96, 2]);
    assert_eq!(unit.pdu(&[0x16, 0, 120, 0, 0, 0, 0]), [0x96, 7]);
    assert_eq!(unit.pdu(&[0x16, 0, 4, 0, 0, 0]), [0x96, 3], "too short");
}

#[test]
fn read_and_write_write_first_and_all_or_nothing() {
    let mut unit = Unit::new();
    let request = [0x17, 0, 3, 0, 3, 0, 4, 0, 2, 4, 0xAB, 0xCD, 0x12, 0x34];
    assert_eq!(unit.pdu(&request), [0x17, 6, 0, 3, 0xAB, 0xCD, 0x12, 0x34]);
    // What cannot be read is not written either, and its exception comes before that of the values.
    for (request, exception) in [
        ([0x17, 0, 126, 0, 3, 0, 0, 0, 1, 2, 9, 9], 2),
        ([0x17, 0, 126, 0, 3, 0, 120, 0, 1, 2, 9, 9], 2),
        ([0x17, 0xFF, 0xFF, 0, 2, 0, 0, 0, 1, 2, 9, 9], 2),
        ([0x17, 0, 0, 0, 1, 0, 128, 0, 1, 2, 9, 9], 2),
        ([0x17, 0, 0, 0, 1, 0, 120, 0, 1, 2, 9, 9], 7),
        ([0x17, 0, 0, 0, 1, 0, 100, 0, 1, 2, 9, 9], 3),
        ([0x17, 0, 0, 0, 126, 0, 0, 0, 1, 2, 9, 9], 3),
        ([0x17, 0, 0, 0, 0, 0, 0, 0, 1, 2, 9, 9], 3),
        ([0x17, 0, 0, 0, 1, 0, 0, 0, 0, 2, 9, 9], 3),
        ([0x17, 0, 0, 0, 1, 0, 0, 0, 1, 3, 9, 9], 3),
    ] {
        assert_eq!(unit.pdu(&request), [0x97, exception], "{request:?}");
        assert_eq!(unit.pdu(&[3, 0, 0, 0, 1]), [3, 2, 0, 0], "{request:?}");
    }
    // The longest of both.
    let mut longest = vec![0x17, 0, 0, 0, 125, 0, 0, 0, 100, 200];
    longest.extend([7; 200]);
    let answer = unit.pdu(&longest);
    assert_eq!((answer.len(), answer[1], answer[2]), (252, 250, 7));
}

#[test]
fn report_server_id_and_exception_status_return_their_bytes() {
    let mut unit = Unit::new();
    assert_eq!(unit.pdu(&[7]), [7, 0]);
    unit.pdu(&[0x0F, 0, 0, 0, 8, 1, 0x6D]);
    assert_eq!(unit.pdu(&[7]), [7, 0x6D]);
    assert_eq!(unit.pdu(&[7, 0]), [0x87, 3]);
    assert_eq!(unit.pdu(&[0x11]), *b"\x11\x0B\x11\xFFmultidrop");
    assert_eq!(unit.pdu(&[0x11, 0]), [0x91, 3]);
}

#[test]
fn reading_a_queue_does_not_empty_it() {
    let mut unit = Unit::new();
    for _ in 0..2 {
        assert_eq!(
            unit.pdu(&[0x18, 0x04, 0xDE]),
            [0x18, 0, 6, 0, 2, 0x01, 0xB8, 0x12, 0x84]
        );
    }
    assert_eq!(unit.pdu(&[0x18, 0x04, 0xDF]), [0x98, 2]);
    assert_eq!(unit.pdu(&[0x18, 0x04]), [0x98, 3]);
}

/// Queues of as many registers as their pointer says, and objects of the device identification of as many bytes as
/// `sizes` has for them.
struct Sized {
    sizes: [Option<u8>; 256],
}

impl DataModel for Sized {
    const FUNCTIONS: FunctionSet = FunctionSet::ALL;
    const CONFORMITY: Conformity = Conformity::Extended;

    fn fifo_queue(&mut self, pointer: u16, mut out: RegistersOut<'_>) -> Result<u16, Exception> {
        out.fill_from(1..=pointer);
        Ok(pointer)
    }

    fn device_object(&mut self, id: u8, out: &mut BytesOut<'_>) -> bool {
        let Some(size) = self.sizes[usize::from(id)] else {
            return false;
        };
        for _ in 0..size {
            out.push(id);
        }
        true
    }

    fn server_id(&mut self, out: &mut BytesOut<'_>) {
        out.extend(&[0xEE; 300]);
    }
}

fn with_objects(objects: &[(u8, u8)]) -> Unit<Sized> {
    let mut sizes = [None; 256];
    for &(id, size) in objects {
        sizes[usize::from(id)] = Some(size);
    }
    Unit {
        server: Server::counted(17),
        model: Sized { sizes },
    }
}

#[test]
fn a_queue_of_31_registers_is_read_and_one_of_32_is_refused() {
    let mut unit = with_objects(&[]);
    assert_eq!(unit.pdu(&[0x18, 0, 0]), [0x18, 0, 2, 0, 0]);
    let answer = unit.pdu(&[0x18, 0, 31]);
    assert_eq!(answer[..5], [0x18, 0, 64, 0, 31]);
    assert_eq!((answer.len(), &answer[65..]), (67, &[0, 31][..]));
    assert_eq!(unit.pdu(&[0x18, 0, 32]), [0x98, 3]);
}

#[test]
fn a_server_id_may_fill_the_frame_and_is_cut_there() {
    let answer = with_objects(&[]).pdu(&[0x11]);
    assert_eq!((answer.len(), answer[1]), (253, 251));
}

#[test]
fn device_identification() {
    let mut unit = Unit::new();
    let version = env!("CARGO_PKG_VERSION").as_bytes();
    let text = |text: &[u8]| [&[text.len() as u8], text].concat();
    let basic = [
        [&[0], &text(b"multidrop")[..]].concat(),
        [&[1], &text(b"stm32")[..]].concat(),
        [&[2], &text(version)[..]].concat(),
    ]
    .concat();
    let name = [&[6], &text(b"conformance")[..]].concat();
    let is = |code, count, objects: &[&[u8]]| {
        let head = [0x2B, 0x0E, code, 0x82, 0, 0, count];
        [&head[..], &objects.concat()[..]].concat()
    };
    assert_eq!(unit.pdu(&[0x2B, 0x0E, 1, 0]), is(1, 3, &[&basic]));
    assert_eq!(unit.pdu(&[0x2B, 0x0E, 2, 0]), is(2, 4, &[&basic, &name]));
    assert_eq!(unit.pdu(&[0x2B, 0x0E, 3, 0]), is(3, 4, &[&basic, &name]));
    assert_eq!(unit.pdu(&[0x2B, 0x0E, 2, 6]), is(2, 1, &[&name]));
    assert_eq!(unit.pdu(&[0x2B, 0x0E, 4, 6]), is(4, 1, &[&name]));
    // Absent: a stream starts again, a single one does not exist.
    assert_eq!(unit.pdu(&[0x2B, 0x0E, 1, 0x80]), is(1, 3, &[&basic]));
    assert_eq!(unit.pdu(&[0x2B, 0x0E, 2, 4]), is(2, 4, &[&basic, &name]));
    assert_eq!(unit.pdu(&[0x2B, 0x0E, 4, 3]), [0xAB, 2]);
    assert_eq!(unit.pdu(&[0x2B, 0x0E, 0, 0]), [0xAB, 3]);
    assert_eq!(unit.pdu(&[0x2B, 0x0E, 5, 0]), [0xAB, 3]);
    assert_eq!(unit.pdu(&[0x2B, 0x0E, 1]), [0xAB, 3]);
    assert_eq!(unit.pdu(&[0x2B, 0x0D, 1, 0]), [0xAB, 1]);
    assert_eq!(unit.pdu(&[0x2B]), [0xAB, 3]);
}

#[test]
fn device_identification_continues_after_a_full_answer() {
    // 244 bytes of value fit an answer of their own; then 100 + 2, 100 + 2 and 40 + 2 are 246, which is one too many after
    // the 7 of the head: 253 in all is just enough.
    let mut unit = with_objects(&[
        (0, 244),
        (1, 100),
        (2, 100),
        (3, 40),
        (0x80, 0),
        (0xFF, 244),
    ]);
    let mut told = Vec::new();
    let mut next = 0;
    let mut answers = 0;
    loop {
        let answer = unit.pdu(&[0x2B, 0x0E, 3, next]);
        assert!(answer.len() <= 253);
        assert_eq!(answer[..4], [0x2B, 0x0E, 3, 0x83]);
        let mut rest = &answer[7..];
        for _ in 0..answer[6] {
            let (id, len) = (rest[0], usize::from(rest[1]));
            assert!(rest[2..2 + len].iter().all(|byte| *byte == id));
            told.push((id, len));
            rest = &rest[2 + len..];
        }
        assert!(rest.is_empty());
        answers += 1;
        match answer[4] {
            0xFF => next = answer[5],
            more => {
                assert_eq!((more, answer[5]), (0, 0));
                break;
            }
        }
    }
    let all = [
        (0, 244),
        (1, 100),
        (2, 100),
        (3, 40),
        (0x80, 0),
        (0xFF, 244),
    ];
    assert_eq!(told, all.map(|(id, len): (u8, usize)| (id, len)));
    assert_eq!(answers, 4);
    // One that fits no answer is the device's failure, not a loop without end.
    let mut unit = with_objects(&[(0, 245)]);
    assert_eq!(unit.pdu(&[0x2B, 0x0E, 1, 0]), [0xAB, 4]);
    assert_eq!(unit.pdu(&[0x2B, 0x0E, 4, 0]), [0xAB, 4]);
}

#[test]
fn records_are_read_and_written_in_groups() {
    let mut unit = Unit::new();
    let answer = unit.pdu(&[0x14, 14, 6, 0, 4, 0, 1, 0, 2, 6, 0, 4, 0, 31, 0, 1]);
    assert_eq!(answer, [0x14, 10, 5, 6, 0, 1, 0, 2, 3, 6, 0, 31]);
    let write = [
        0x15, 20, 6, 0, 4, 0, 7, 0, 2, 0xAA, 0xBB, 0xCC, 0xDD, 6, 0, 4, 0, 0, 0, 1, 0x11, 0x22,
    ];
    // 11 and 9 bytes of groups.
    assert_eq!(unit.pdu(&write), write);
    assert_eq!(
        unit.pdu(&[0x14, 14, 6, 0, 4, 0, 7, 0, 2, 6, 0, 4, 0, 0, 0, 1]),
        [0x14, 10, 5, 6, 0xAA, 0xBB, 0xCC, 0xDD, 3, 6, 0x11, 0x22]
    );
    let read = |group: [u8; 7]| [&[0x14, 7][..], &group].concat();
    for (group, exception) in [
        ([5, 0, 4, 0, 0, 0, 1], 2),
        ([6, 0, 0, 0, 0, 0, 1], 2),
        ([6, 0, 5, 0, 0, 0, 1], 2),
        ([6, 0, 4, 0, 31, 0, 2], 2),
        ([6, 0, 4, 0x27, 0x10, 0, 1], 2),
        ([6, 0, 4, 0xFF, 0xFF, 0, 2], 2),
        ([6, 0, 4, 0, 0, 0, 0], 3),
        ([6, 0, 4, 0, 0, 0, 122], 3),
        ([6, 0, 4, 0, 0, 0xFF, 0xFF], 3),
    ] {
        assert_eq!(unit.pdu(&read(group)), [0x94, exception], "{group:?}");
    }
    // One bad group and none is written.
    let mut write = vec![
        0x15, 18, 6, 0, 4, 0, 3, 0, 1, 9, 9, 6, 0, 4, 0, 32, 0, 1, 9, 9,
    ];
    assert_eq!(unit.pdu(&write), [0x95, 2]);
    assert_eq!(
        unit.pdu(&read([6, 0, 4, 0, 3, 0, 1])),
        [0x14, 4, 3, 6, 0, 3]
    );
    // Groups that do not add up, and byte counts out of limits.
    write[1] = 19;
    write.push(9);
    assert_eq!(unit.pdu(&write), [0x95, 3]);
    assert_eq!(unit.pdu(&[0x14, 6, 6, 0, 4, 0, 0, 0]), [0x94, 3]);
    assert_eq!(unit.pdu(&[0x14, 8, 6, 0, 4, 0, 0, 0, 1, 0]), [0x94, 3]);
    assert_eq!(unit.pdu(&[0x15, 7, 6, 0, 4, 0, 0, 0, 0]), [0x95, 3]);
    // 35 groups of one register are 245 bytes of request and 140 of answer; one group of 121 answers 244.
    let many = [&[0x14, 245][..], &[6, 0, 4, 0, 5, 0, 1].repeat(35)].concat();
    let answer = unit.pdu(&many);
    assert_eq!((answer.len(), answer[1]), (142, 140));
    assert!(answer[2..].chunks(4).all(|group| group == [3, 6, 0, 5]));
}

#[test]
fn diagnostics_answer_and_count() {
    let mut unit = Unit::new();
    for data in [&[][..], &[1], &[1, 2, 3], &[0xA5; 249]] {
        let request = [&[8, 0, 0][..], data].concat();
        assert_eq!(unit.pdu(&request), request);
    }
    for (request, exception) in [
        (&[8][..], 3),
        (&[8, 0], 3),
        (&[8, 0, 5, 0, 0], 1),
        (&[8, 0, 0x13, 0, 0], 1),
        (&[8, 1, 0, 0, 0], 1),
        (&[8, 0, 5], 1),
        (&[8, 0, 1, 0, 1], 3),
        (&[8, 0, 3, 0x3B, 1], 3),
        (&[8, 0, 0x0B, 0, 1], 3),
        (&[8, 0, 0x0B], 3),
        (&[8, 0, 0x0B, 0, 0, 0], 3),
    ] {
        assert_eq!(unit.pdu(request), [0x88, exception], "{request:?}");
    }
    assert_eq!(unit.counter(0x0D), 11);
    assert_eq!(unit.pdu(&[8, 0, 0x0A, 0, 0]), [8, 0, 0x0A, 0, 0]);
    assert_eq!((unit.counter(0x0B), unit.counter(0x0E)), (1, 2));
    unit.server.diagnostics().set_diagnostic_register(0x1234);
    assert_eq!(unit.counter(0x02), 0x1234);
    // Other units, broadcasts, damaged frames.
    assert!(unit.ask(&[16, 3, 0, 0, 0, 1]).is_empty());
    assert!(unit.ask(&[0, 6, 0, 1, 0, 9]).is_empty());
    assert!(unit.ask(&[0, 3, 0, 1, 0, 9]).is_empty());
    assert!(unit.ask(&[0, 6, 0, 200, 0, 9]).is_empty());
    unit.server.damaged(ReceiveErrors::CHECK);
    unit.server
        .damaged(ReceiveErrors::CHECK | ReceiveErrors::OVERRUN);
    assert_eq!(unit.counter(0x0B), 8);
    assert_eq!(unit.counter(0x0C), 2);
    assert_eq!(unit.counter(0x0D), 1);
    assert_eq!(unit.counter(0x0E), 10);
    assert_eq!(unit.counter(0x0F), 3);
    assert_eq!(unit.counter(0x12), 1);
    unit.pdu(&[8, 0, 0x14, 0, 0]);
    assert_eq!((unit.counter(0x12), unit.counter(0x0C)), (0, 2));
    unit.pdu(&[6, 0, 120, 0, 0]);
    assert_eq!((unit.counter(0x10), unit.counter(0x0D)), (1, 2));
    assert_eq!(unit.server.delimiter(), b'\n');
    unit.pdu(&[8, 0, 3, b';', 0]);
    assert_eq!(unit.server.delimiter(), b';');
}

#[test]
fn events_are_counted_and_logged() {
    let mut unit = Unit::new();
    assert_eq!(unit.pdu(&[0x0B]), [0x0B, 0, 0, 0, 0]);
    unit.pdu(&[3, 0, 0, 0, 1]);
    unit.pdu(&[3, 0, 0, 0, 0]);
    unit.ask(&[0, 6, 0, 1, 0, 9]);
    unit.ask(&[18, 6, 0, 1, 0, 9]);
    unit.server.damaged(ReceiveErrors::OVERRUN);
    assert_eq!(unit.pdu(&[0x0B]), [0x0B, 0, 0, 0, 2]);
    assert_eq!(
        unit.pdu(&[0x0C]),
        [
            0x0C, 18, 0, 0, 0, 2, 0, 7, 0x80, 0x40, 0x80, 0x92, 0x40, 0xC0, 0x41, 0x80, 0x40, 0x80,
            0x40, 0x80
        ]
    );
    // 64 at the most, the own one included.
    for _ in 0..40 {
        unit.pdu(&[6, 0, 120, 0, 0]);
    }
    let answer = unit.pdu(&[0x0C]);
    assert_eq!((answer.len(), answer[1]), (72, 70));
    assert_eq!(answer[8..12], [0x80, 0x48, 0x80, 0x48]);
    assert_eq!(unit.pdu(&[0x0C, 0]), [0x8C, 3]);
    // A restart keeps the log or clears it.
    unit.pdu(&[8, 0, 1, 0, 0]);
    assert_eq!(unit.pdu(&[0x0C])[8..11], [0x80, 0x00, 0x40]);
    unit.pdu(&[8, 0, 1, 0xFF, 0]);
    assert_eq!(unit.pdu(&[0x0C]), [0x0C, 8, 0, 0, 0, 0, 0, 1, 0x80, 0x00]);
}

#[test]
fn a_server_that_listens_only() {
    let mut unit = Unit::new();
    unit.pdu(&[8, 0, 1, 0xFF, 0]);
    assert!(unit.ask(&[17, 8, 0, 4, 0, 0]).is_empty());
    for request in [
        &[17, 3, 0, 0, 0, 1][..],
        &[17, 6, 0, 0, 0, 1],
        &[0, 6, 0, 0, 0, 1],
        &[17, 0x41, 1],
        &[17, 8, 0, 1, 0, 1],
        &[17, 8, 0, 1, 0],
        &[17, 0x63],
    ] {
        assert!(unit.ask(request).is_empty(), "{request:?}");
    }
    // The restart is not answered; the log has been kept.
    assert!(unit.ask(&[17, 8, 0, 1, 0, 0]).is_empty());
    assert_eq!(unit.pdu(&[3, 0, 0, 0, 1]), [3, 2, 0, 0], "not written");
    let log = unit.pdu(&[0x0C]);
    let mut expected = vec![0x80, 0x40, 0x80, 0x00, 0x60, 0xA0];
    for request in 0..7 {
        expected.extend([0x60, if request == 4 { 0xE0 } else { 0xA0 }]);
    }
    expected.extend([0x60, 0x04, 0x80, 0x00]);
    assert_eq!(log[8..], expected);
    // A broadcast does both as well.
    unit.ask(&[0, 8, 0, 4, 0, 0]);
    assert!(unit.ask(&[17, 7]).is_empty());
    unit.ask(&[0, 8, 0, 1, 0, 0]);
    assert_eq!(unit.pdu(&[7]), [7, 0]);
}

#[test]
fn a_board_without_files_refuses_their_functions() {
    let mut unit = Unit {
        server: Server::counted(17),
        model: Conformance::<0>::new("nano"),
    };
    assert_eq!(unit.pdu(&[0x14, 7, 6, 0, 4, 0, 0, 0, 1]), [0x94, 1]);
    assert_eq!(unit.pdu(&[0x15, 9, 6, 0, 4, 0, 0, 0, 1, 0, 0]), [0x95, 1]);
    assert_eq!(unit.pdu(&[0x41, 1, 2, 3]), [0x41, 3, 2, 1]);
    for code in [0, 9, 10, 0x0D, 0x12, 0x13, 0x19, 0x40, 0x7F, 0x80, 0xFF] {
        assert_eq!(unit.pdu(&[code, 0, 0, 0, 1]), [code | 0x80, 1]);
    }
}

#[test]
fn a_server_without_counters_refuses_diagnostics_and_events() {
    let server = Server::new(17);
    let mut model = Conformance::<0>::new("nano");
    for code in [8, 0x0B, 0x0C] {
        let mut frame: Adu = [0; 256];
        frame[..2].copy_from_slice(&[17, code]);
        let plan = server.prepare(&mut model, &mut frame, 2);
        assert_eq!(server.commit(&mut model, &mut frame, 2, plan), 3);
        assert_eq!(frame[..3], [17, code | 0x80, 1]);
    }
}
