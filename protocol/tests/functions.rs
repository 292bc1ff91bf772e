//! Requests beside the tables: status and id, functions of the application, and the defaults of a model.

mod common;

use common::{UNIT, ask_server};
use multidrop_protocol::data::{BytesOut, Coils, CoilsOut, Registers, RegistersOut};
use multidrop_protocol::exception::Exception;
use multidrop_protocol::frame::ReceiveErrors;
use multidrop_protocol::server::{
    ApplicationFunction, Counted, DataModel, Function, FunctionSet, Plan, Server,
};

/// A model without anything.
#[derive(Clone, PartialEq)]
struct Nothing;

impl DataModel for Nothing {
    const FUNCTIONS: FunctionSet = FunctionSet::ALL;
}

/// A model that tells what the test has put there.
#[derive(Clone, PartialEq)]
struct Machine {
    status: u8,
    busy: bool,
    id: Vec<u8>,
    registers: u32,
    called: Vec<Vec<u8>>,
    /// What the function of the application gives.
    gives: Result<usize, Exception>,
}

impl Machine {
    fn new() -> Machine {
        Machine {
            status: 0,
            busy: false,
            id: Vec::new(),
            registers: 0,
            called: Vec::new(),
            gives: Ok(3),
        }
    }
}

/// Keeps what it was asked and leaves an answer behind: two bytes of data, and where it has none another function code, which
/// nobody must see.
fn run(model: &mut Machine, pdu: &mut [u8], len: usize) -> Result<usize, Exception> {
    assert_eq!(pdu.len(), 253);
    model.called.push(pdu[..len].to_vec());
    pdu[1] = 0xBE;
    pdu[2] = 0xEF;
    if !matches!(model.gives, Ok(1..=253)) {
        pdu[0] = 0x11;
    }
    model.gives
}

impl DataModel for Machine {
    const FUNCTIONS: FunctionSet = FunctionSet::ALL.without(0x10).without(200);
    const APPLICATION: &'static [ApplicationFunction<Machine>] = &[
        ApplicationFunction {
            code: 0x41,
            broadcast: false,
            run,
        },
        ApplicationFunction {
            code: 0x42,
            broadcast: true,
            run,
        },
    ];

    fn holding_registers(
        &mut self,
        first: u16,
        mut out: RegistersOut<'_>,
    ) -> Result<(), Exception> {
        if u32::from(first) + out.len() as u32 > self.registers {
            return Err(Exception::IllegalDataAddress);
        }
        out.fill_from(first..=u16::MAX);
        Ok(())
    }

    fn exception_status(&mut self) -> u8 {
        self.status
    }

    fn is_busy(&mut self) -> bool {
        self.busy
    }

    fn server_id(&mut self, out: &mut BytesOut<'_>) {
        out.extend(&self.id);
    }
}

fn pdu<M: DataModel + Clone + PartialEq>(model: &mut M, request: &[u8]) -> Vec<u8> {
    let answer = ask_server(&Server::new(UNIT), model, &[&[UNIT], request].concat());
    answer.map_or_else(Vec::new, |answer| answer[1..].to_vec())
}

fn broadcast<M: DataModel + Clone + PartialEq>(model: &mut M, request: &[u8]) -> Option<Vec<u8>> {
    ask_server(&Server::new(UNIT), model, &[&[0], request].concat())
}

#[test]
fn the_exception_status_is_the_models_byte() {
    let mut model = Machine::new();
    for status in [0, 1, 0x80, 0xA5, 0xFF] {
        model.status = status;
        assert_eq!(pdu(&mut model, &[7]), [7, status]);
    }
    assert_eq!(pdu(&mut model, &[7, 0]), [0x87, 3]);
    assert_eq!(broadcast(&mut model, &[7]), None);
}

#[test]
fn the_server_id_is_what_the_model_tells_up_to_251_bytes() {
    let mut model = Machine::new();
    for len in [0, 1, 2, 250, 251, 252, 300] {
        model.id = (0..len).map(|byte| byte as u8).collect();
        let told = &model.id.clone()[..len.min(251)];
        let expected = [&[0x11, told.len() as u8], told].concat();
        assert_eq!(pdu(&mut model, &[0x11]), expected, "{len} bytes");
    }
    assert_eq!(pdu(&mut model, &[0x11, 0]), [0x91, 3]);
    assert_eq!(broadcast(&mut model, &[0x11]), None);
}

#[test]
fn a_model_without_an_answer_has_no_such_address() {
    let refused = |code: u8| vec![code | 0x80, 2];
    for (request, expected) in [
        (vec![1, 0, 0, 0, 1], refused(1)),
        (vec![2, 0, 0, 0, 1], refused(2)),
        (vec![3, 0, 0, 0, 1], refused(3)),
        (vec![4, 0, 0, 0, 1], refused(4)),
        (vec![5, 0, 0, 0xFF, 0], refused(5)),
        (vec![6, 0, 0, 0, 0], refused(6)),
        (vec![7], vec![7, 0]),
        (vec![15, 0, 0, 0, 1, 1, 1], refused(15)),
        (vec![16, 0, 0, 0, 1, 2, 0, 1], refused(16)),
        (vec![0x11], vec![0x11, 0]),
        (vec![0x14, 7, 6, 0, 1, 0, 0, 0, 1], refused(0x14)),
        (vec![0x15, 9, 6, 0, 1, 0, 0, 0, 1, 0, 0], refused(0x15)),
        (vec![0x16, 0, 0, 0, 0, 0, 0], refused(0x16)),
        (vec![0x17, 0, 0, 0, 1, 0, 0, 0, 1, 2, 0, 0], refused(0x17)),
        (vec![0x18, 0, 0], refused(0x18)),
        (vec![0x2B, 0x0E, 4, 0], refused(0x2B)),
        (vec![0x41], vec![0xC1, 1]),
    ] {
        assert_eq!(pdu(&mut Nothing, &request), expected, "{request:02X?}");
    }
}

#[test]
fn a_write_that_a_model_accepts_and_does_not_do_is_exception_04() {
    /// Checks and never writes.
    #[derive(Clone, PartialEq)]
    struct Checks;
    impl DataModel for Checks {
        const FUNCTIONS: FunctionSet = FunctionSet::ALL;
        fn check_coils(&self, _: u16, _: Coils<'_>) -> Result<(), Exception> {
            Ok(())
        }
        fn check_registers(&self, _: u16, _: Registers<'_>) -> Result<(), Exception> {
            Ok(())
        }
        fn check_file_records(&self, _: u16, _: u16, _: Registers<'_>) -> Result<(), Exception> {
            Ok(())
        }
    }
    for request in [
        vec![5, 0, 0, 0xFF, 0],
        vec![6, 0, 0, 0, 0],
        vec![15, 0, 0, 0, 1, 1, 1],
        vec![16, 0, 0, 0, 1, 2, 0, 1],
        vec![0x15, 9, 6, 0, 1, 0, 0, 0, 1, 0, 0],
    ] {
        assert_eq!(pdu(&mut Checks, &request), [request[0] | 0x80, 2]);
    }
}

#[test]
fn the_read_part_of_fc_17_is_checked_whole() {
    /// Takes every write, has so many registers.
    #[derive(Clone, PartialEq)]
    struct Written(u32);
    impl DataModel for Written {
        const FUNCTIONS: FunctionSet = FunctionSet::ALL;
        fn holding_registers(
            &mut self,
            first: u16,
            out: RegistersOut<'_>,
        ) -> Result<(), Exception> {
            assert!((1..=125).contains(&out.len()));
            match u32::from(first) + out.len() as u32 <= self.0 {
                true => Ok(()),
                false => Err(Exception::IllegalDataAddress),
            }
        }
        fn check_registers(&self, _: u16, _: Registers<'_>) -> Result<(), Exception> {
            Ok(())
        }
        fn write_registers(&mut self, _: u16, _: Registers<'_>) -> Result<(), Exception> {
            Ok(())
        }
    }
    for count in 1..=125u8 {
        for missing in [0, 1, 2]
            .into_iter()
            .filter(|missing| *missing <= u32::from(count))
        {
            let mut model = Written(u32::from(count) - missing);
            let request = [0x17, 0, 0, 0, count, 0, 0, 0, 1, 2, 0, 0];
            let answer = pdu(&mut model, &request);
            match missing {
                0 => assert_eq!(
                    answer,
                    [vec![0x17, 2 * count], vec![0; 2 * usize::from(count)]].concat()
                ),
                _ => assert_eq!(answer, [0x97, 2], "{count} read, {missing} missing"),
            }
        }
    }
    // Up to the last address there is.
    let mut model = Written(65_536);
    let last = [0x17, 0xFF, 0xE0, 0, 0x20, 0, 0, 0, 1, 2, 0, 0];
    assert_eq!(pdu(&mut model, &last).len(), 2 + 64);
}

#[test]
fn a_function_of_the_application_has_the_request_and_gives_the_answer() {
    let mut model = Machine::new();
    model.gives = Ok(3);
    assert_eq!(pdu(&mut model, &[0x41, 1, 2, 3, 4]), [0x41, 0xBE, 0xEF]);
    assert_eq!(model.called, [vec![0x41, 1, 2, 3, 4]]);
    model.gives = Ok(253);
    let answer = pdu(&mut model, &[0x42]);
    assert_eq!((answer.len(), answer[0]), (253, 0x42));
    assert_eq!(model.called[1], [0x42]);
    // Nothing to say.
    model.gives = Ok(0);
    assert_eq!(pdu(&mut model, &[0x41]), []);
    // What fits no frame, and what it refuses: the function keeps its code.
    model.gives = Ok(254);
    assert_eq!(pdu(&mut model, &[0x41]), [0xC1, 4]);
    model.gives = Err(Exception::ServerDeviceBusy);
    assert_eq!(pdu(&mut model, &[0x41]), [0xC1, 6]);
    // Codes that nobody may have.
    for code in [0, 0x40, 0x43, 0x80, 0xC1, 0xFF] {
        assert_eq!(pdu(&mut model, &[code]), [code | 0x80, 1]);
    }
    assert_eq!(model.called.len(), 5);
}

#[test]
fn a_function_is_broadcast_where_its_row_says_so() {
    let mut model = Machine::new();
    assert_eq!(broadcast(&mut model, &[0x41]), None);
    assert!(model.called.is_empty());
    assert_eq!(broadcast(&mut model, &[0x42, 9]), None);
    assert_eq!(model.called, [vec![0x42, 9]]);
    model.gives = Err(Exception::IllegalDataValue);
    assert_eq!(broadcast(&mut model, &[0x42, 9]), None);
    assert_eq!(broadcast(&mut model, &[0x43]), None);
    assert_eq!(model.called.len(), 2);
}

#[test]
fn the_default_function_gets_codes_without_a_row() {
    #[derive(Clone, PartialEq)]
    struct Other(Vec<Vec<u8>>);
    fn other(model: &mut Other, pdu: &mut [u8], len: usize) -> Result<usize, Exception> {
        model.0.push(pdu[..len].to_vec());
        pdu[1] = 0x77;
        Ok(2)
    }
    impl DataModel for Other {
        const DEFAULT: Option<Function<Other>> = Some(other);
    }
    let mut model = Other(Vec::new());
    for code in [0x07, 0x41, 0x7F] {
        assert_eq!(pdu(&mut model, &[code, 5]), [code, 0x77]);
    }
    assert_eq!(model.0.len(), 3);
    assert_eq!(broadcast(&mut model, &[0x41]), None);
    for code in [0, 0x80, 0xFF] {
        assert_eq!(pdu(&mut model, &[code]), [code | 0x80, 1]);
    }
    assert_eq!(model.0.len(), 3);
}

#[test]
fn functions_are_chosen_one_by_one() {
    let codes = |set: FunctionSet| (0..=255).filter(|code| set.has(*code)).collect::<Vec<u8>>();
    assert_eq!(codes(FunctionSet::EIGHT), [1, 2, 3, 4, 5, 6, 15, 16]);
    assert_eq!(
        codes(FunctionSet::WITHOUT_FILES),
        [1, 2, 3, 4, 5, 6, 7, 15, 16, 17, 22, 23, 24, 43]
    );
    assert_eq!(
        codes(FunctionSet::ALL),
        [1, 2, 3, 4, 5, 6, 7, 15, 16, 17, 20, 21, 22, 23, 24, 43]
    );
    let without = FunctionSet::EIGHT.without(5).without(5).without(40);
    assert_eq!(codes(without), [1, 2, 3, 4, 6, 15, 16]);
    for code in [63, 64, 128, 255] {
        assert_eq!(FunctionSet::EIGHT.without(code), FunctionSet::EIGHT);
    }
    assert_eq!(
        codes(without.with(5).with(43)),
        [1, 2, 3, 4, 5, 6, 15, 16, 43]
    );
    for code in 0..=255 {
        let chosen = std::panic::catch_unwind(|| FunctionSet::EIGHT.with(code)).is_ok();
        let choice = matches!(code, 1..=7 | 15..=17 | 20..=24 | 43);
        assert_eq!(chosen, choice, "{code:02X}");
    }
    let mut model = Machine::new();
    model.registers = 4;
    let write = [16, 0, 0, 0, 1, 2, 0, 1];
    assert_eq!(pdu(&mut model, &write), [0x90, 1]);
}

#[test]
fn an_answer_that_may_be_sent_at_once_has_its_length() {
    struct Sure;
    impl DataModel for Sure {
        const WRITES_MAY_FAIL: bool = false;
    }
    let plans = [
        (Plan::Ignore, 0, 0),
        (Plan::Silent { refused: None }, 0, 0),
        (Plan::Answer { len: 9 }, 9, 9),
        (Plan::Diagnose { len: 6 }, 6, 6),
        (Plan::Write { len: 6 }, 0, 6),
        (Plan::Write { len: 0 }, 0, 0),
        (Plan::Call, 0, 0),
    ];
    for (plan, where_writes_fail, where_not) in plans {
        assert_eq!(plan.answer_at_once::<Machine>(), where_writes_fail);
        assert_eq!(plan.answer_at_once::<Sure>(), where_not);
    }
}

#[test]
fn a_unit_id_is_1_to_247() {
    let server = Server::new(1);
    for unit in 0..=255 {
        let before = server.unit();
        let valid = (1..=247).contains(&unit);
        assert_eq!(server.set_unit(unit), valid);
        assert_eq!(server.unit(), if valid { unit } else { before });
    }
    for unit in [0, 248, 255] {
        assert!(std::panic::catch_unwind(|| Server::new(unit)).is_err());
    }
    server.set_unit(9);
    for unit in 0..=255 {
        assert_eq!(server.is_concerned(unit), unit == 0 || unit == 9);
        assert!(Server::<Counted<1>>::counted(9).is_concerned(unit));
    }
}

#[test]
fn a_server_that_does_not_count_has_no_diagnostics() {
    let mut model = Machine::new();
    for code in [8, 0x0B, 0x0C] {
        assert_eq!(pdu(&mut model, &[code, 0, 0, 0, 0]), [code | 0x80, 1]);
    }
    let server = Server::new(UNIT);
    server.damaged(ReceiveErrors::OVERRUN);
    server.cut_off();
    assert_eq!(server.delimiter(), 0x0A);
}

#[test]
fn no_read_is_answered_when_it_is_broadcast() {
    /// Has everything that can be read.
    #[derive(Clone, PartialEq)]
    struct All;
    impl DataModel for All {
        const FUNCTIONS: FunctionSet = FunctionSet::ALL;
        fn coils(&mut self, _: u16, _: CoilsOut<'_>) -> Result<(), Exception> {
            Ok(())
        }
        fn discrete_inputs(&mut self, _: u16, _: CoilsOut<'_>) -> Result<(), Exception> {
            Ok(())
        }
        fn holding_registers(&mut self, _: u16, _: RegistersOut<'_>) -> Result<(), Exception> {
            Ok(())
        }
        fn input_registers(&mut self, _: u16, _: RegistersOut<'_>) -> Result<(), Exception> {
            Ok(())
        }
        fn file_records(&mut self, _: u16, _: u16, _: RegistersOut<'_>) -> Result<(), Exception> {
            Ok(())
        }
        fn fifo_queue(&mut self, _: u16, _: RegistersOut<'_>) -> Result<u16, Exception> {
            Ok(1)
        }
        fn device_object(&mut self, id: u8, out: &mut BytesOut<'_>) -> bool {
            out.extend(b"text");
            id < 3
        }
    }
    for request in [
        vec![1, 0, 0, 0, 1],
        vec![2, 0, 0, 0, 1],
        vec![3, 0, 0, 0, 1],
        vec![4, 0, 0, 0, 1],
        vec![7],
        vec![0x11],
        vec![0x14, 7, 6, 0, 1, 0, 0, 0, 1],
        vec![0x18, 0, 0],
        vec![0x2B, 0x0E, 4, 0],
    ] {
        assert_eq!(pdu(&mut All, &request)[0], request[0], "it is there");
        assert_eq!(broadcast(&mut All, &request), None, "{request:02X?}");
    }
}

#[test]
fn only_an_exception_counts_as_one() {
    // The answer to FC 07 is as long as an exception, and its byte may be the code of one.
    let server = Server::<Counted<8>>::counted(UNIT);
    let mut model = Machine::new();
    let exceptions = |model: &mut Machine| {
        ask_server(&server, model, &[UNIT, 8, 0, 0x0D, 0, 0]).expect("an answer")[5]
    };
    for status in [1, 2, 7] {
        model.status = status;
        let answer = ask_server(&server, &mut model, &[UNIT, 7]);
        assert_eq!(answer, Some(vec![UNIT, 7, status]));
        assert_eq!(exceptions(&mut model), 0);
    }
    assert!(ask_server(&server, &mut model, &[UNIT, 3, 0, 0, 0, 1]).is_some());
    assert_eq!(exceptions(&mut model), 1);
}

#[test]
fn frames_that_are_no_request_are_ignored() {
    let mut model = Machine::new();
    let server = Server::new(UNIT);
    let mut frame = [UNIT; 256];
    for len in [0, 1, 255] {
        assert_eq!(server.prepare(&mut model, &mut frame, len), Plan::Ignore);
    }
    for len in [2, 254] {
        frame = [UNIT; 256];
        assert_ne!(server.prepare(&mut model, &mut frame, len), Plan::Ignore);
    }
    frame[0] = UNIT + 1;
    assert_eq!(server.prepare(&mut model, &mut frame, 2), Plan::Ignore);
}
