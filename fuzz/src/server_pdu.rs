//! Requests to a server, one after the other, compared with a plain reading of the standard.

use multidrop_apps::conformance::Conformance;
use multidrop_protocol::Adu;
use multidrop_protocol::frame::ReceiveErrors;
use multidrop_protocol::server::{Counted, DataModel, Plan, Server};

use crate::input::Input;
use multidrop_testkit::harness::book::Book;
use multidrop_testkit::harness::memory::{self, Memory};
use multidrop_testkit::plain::{Heard, Plain};

/// A byte that chooses the kind of model; then, for each request, its length and its bytes: unit id and PDU.
pub fn server_pdu(data: &[u8]) {
    let mut input = Input(data);
    match input.byte() & 3 {
        0 => ask_all::<false>(input),
        1 => ask_all::<true>(input),
        _ => ask_conformance(input),
    }
}

/// All functions over the conformance map, with counters and event log. A length of 0 or 1 is a damaged frame.
fn ask_conformance(mut input: Input) {
    let mut plain = Plain::new("stm32", env!("CARGO_PKG_VERSION"), 32);
    let server = Server::<Counted<64>>::counted(17);
    let mut model = Conformance::<32>::new("stm32");
    let mut frame: Adu = [0xA5; 256];
    for _ in 0..64 {
        if input.is_over() {
            break;
        }
        let len = input.byte();
        if len < 2 {
            let overrun = len == 1;
            server.damaged(if overrun {
                ReceiveErrors::OVERRUN
            } else {
                ReceiveErrors::CHECK
            });
            assert_eq!(plain.hears(&Heard::Bad { overrun }), None);
            continue;
        }
        let len = len.min(254);
        let request = input.bytes(len.into());
        frame[..request.len()].copy_from_slice(request);
        let request = frame[..len.into()].to_vec();
        let plan = server.prepare(&mut model, &mut frame, len);
        let early = plan.answer_at_once::<Conformance<32>>();
        let released = frame;
        let answer = server.commit(&mut model, &mut frame, len, plan);
        if early > 0 {
            assert_eq!((answer, frame), (early, released), "it may be on its way");
        }
        let expected = plain.hears(&Heard::Good(request.clone()));
        let expected = expected.unwrap_or_default();
        assert_eq!(frame[..answer.into()], expected, "{request:02X?}");
    }
}

fn ask_all<const MAY_FAIL: bool>(mut input: Input) {
    let mut book = Book::new();
    let mut memory = Memory::<MAY_FAIL>::of(&book);
    let server = memory::server();
    // What a request leaves in the buffer must not show in the answer to the next.
    let mut frame: Adu = [0xA5; 256];
    for _ in 0..64 {
        if input.is_over() {
            break;
        }
        let len = input.byte();
        let request = input.bytes(len.into());
        frame[..request.len()].copy_from_slice(request);
        // A length that has no bytes to it is for the server to refuse, or it is about what was there before.
        let request = frame[..len.into()].to_vec();

        let before = memory.clone();
        let plan = server.prepare(&mut memory, &mut frame, len);
        assert!(memory == before, "preparing changed the model");
        let executes = matches!(plan, Plan::Write { .. } | Plan::Call);
        if executes {
            assert_eq!(frame[..len.into()], request, "not as it came in");
        }
        if matches!(plan, Plan::Write { .. }) && !Memory::<MAY_FAIL>::WRITES_MAY_FAIL {
            server.commit(&mut memory, &mut frame, len, plan);
            assert_eq!(frame[..len.into()], request, "an answer is on its way");
            memory = before.clone();
        }
        let answer = server.commit(&mut memory, &mut frame, len, plan);

        assert!(answer == 0 || (2..=254).contains(&answer));
        let answer = &frame[..answer.into()];
        if !executes || answer.get(1).is_some_and(|function| function & 0x80 != 0) {
            assert!(memory == before, "refused or ignored, and changed");
        }
        if !answer.is_empty() {
            assert_eq!(answer[0], request[0]);
            assert_eq!(answer[1] & 0x7F, request[1] & 0x7F);
        }
        if (2..=254).contains(&len) {
            let expected = book.ask(&request);
            assert_eq!(executes, expected.executes, "{request:02X?}");
            assert_eq!(
                answer,
                expected.answer.unwrap_or_default(),
                "{request:02X?}"
            );
        } else {
            assert!(answer.is_empty());
        }
        assert!(memory.is(&book), "{request:02X?}");
    }
}
