//! The messages for users: build errors, requests and values that are refused.

use multidrop_protocol::client::RequestError;
use multidrop_protocol::format::Framing;
use multidrop_protocol::frame::{EncodeError, ReceiveErrors};
use multidrop_protocol::message::Message;
use multidrop_protocol::port_registers::{Reason, Refused, Register};
use multidrop_protocol::registers::{ScanList, SparseBank};
use std::panic::catch_unwind;

/// What a panic says.
fn panics(run: impl FnOnce() + std::panic::UnwindSafe) -> String {
    let said = catch_unwind(run).expect_err("it has to stop the build");
    match said.downcast::<String>() {
        Ok(text) => *text,
        Err(said) => said.downcast::<&str>().expect("a text").to_string(),
    }
}

#[test]
fn a_message_stops_the_build_with_its_text() {
    let said = panics(|| Message::new().text("place ").number(10).text("!").fail());
    assert_eq!(said, "place 10!");
    assert_eq!(
        panics(|| _ = SparseBank::new([3, 5, 5])),
        "sparse bank: address 2 is 5, must be above the one before, which is 5"
    );
    assert_eq!(
        panics(|| _ = SparseBank::new([3, 2])),
        "sparse bank: address 1 is 2, must be above the one before, which is 3"
    );
    assert_eq!(
        panics(|| _ = ScanList::new([1, 2], [247, 248])),
        "scan list: place 1: slave id is 248, must be 0..=247"
    );
    assert_eq!(
        panics(|| _ = ScanList::from_rows([1, 2], [0; 2], [1, 1], [1, 2])),
        "scan list: place 1: register offset is 2, must be 0..=1"
    );
    assert!(panics(|| _ = ScanList::new([], [])).starts_with("scan list: the number of items"));
    // Two bytes of the last sign do not fit.
    let mut message = Message::new();
    for _ in 0..159 {
        message = message.text("a");
    }
    let cut = message.text("\u{e9}");
    assert_eq!(cut.as_str(), "message cut inside a character");
}

#[test]
fn the_errors_of_a_frame_are_displayed_by_name() {
    for (errors, text) in [
        (ReceiveErrors::NONE, "no error"),
        (ReceiveErrors::GAP, "gap"),
        (
            ReceiveErrors::CHECK | ReceiveErrors::GAP,
            "gap, CRC or LRC error",
        ),
        (
            ReceiveErrors::all(),
            "gap, parity error, framing error, overrun, wrong length, CRC or LRC error, invalid character",
        ),
    ] {
        assert_eq!(errors.to_string(), text);
        assert_eq!(format!("{errors:?}"), format!("ReceiveErrors({text})"));
    }
    assert_eq!(
        EncodeError::Length.to_string(),
        "unit id and PDU must be 2..=254 bytes"
    );
    assert_eq!(
        EncodeError::Room.to_string(),
        "the output is too small for the frame"
    );
}

#[test]
fn an_invalid_request_has_a_message() {
    for (error, text) in [
        (
            RequestError::Unit { unit: 248 },
            "unit is 248, must be 0..=247",
        ),
        (
            RequestError::Broadcast { function: 3 },
            "unit is 0, must be 1..=247: function 3 reads, and a broadcast has no answer",
        ),
        (
            RequestError::Count { count: 0, max: 125 },
            "count is 0, must be 1..=125",
        ),
        (
            RequestError::End {
                first: 65_535,
                count: 2,
            },
            "first is 65535, must be 0..=65534 for a count of 2",
        ),
        (
            RequestError::Function { function: 128 },
            "function is 128, must be 1..=127",
        ),
        (
            RequestError::Data { len: 254, max: 253 },
            "data is 254 bytes, must be at most 253",
        ),
        (
            RequestError::Packed { len: 1, needed: 2 },
            "packed coils are 1 bytes, must be 2",
        ),
        (
            RequestError::File { file: 0 },
            "file is 0, must be 1..=65535",
        ),
        (
            RequestError::Record {
                record: 9_999,
                count: 2,
            },
            "record is 9999 with 2 records, must end at 9999 or before",
        ),
        (RequestError::Code { code: 5 }, "code is 5, must be 1..=4"),
        (
            RequestError::Room { room: 3, needed: 4 },
            "room is 3, must be at least 4",
        ),
    ] {
        assert_eq!(error.to_string(), text);
    }
}

#[test]
fn a_refused_value_has_a_message() {
    let text = |register, value, reason| {
        Refused {
            register,
            value,
            reason,
        }
        .to_string()
    };
    for (register, value, reason, expected) in [
        (
            Register::Timeout,
            0,
            Reason::Range(1, 9),
            "TIMEOUT is 0, must be 1..=9",
        ),
        (
            Register::Regs(9),
            0,
            Reason::Index(0),
            "REGS.9 does not exist, there is none",
        ),
        (
            Register::Regs(9),
            0,
            Reason::Index(8),
            "REGS.9 does not exist, must be REGS.0..=7",
        ),
        (Register::Status, 0, Reason::ReadOnly, "STATUS is read only"),
        (
            Register::Start,
            1,
            Reason::Running,
            "START is 1, must wait: a transaction is under way",
        ),
        (
            Register::Mode,
            4,
            Reason::NotYet,
            "MODE is 4, which is not in this version, must be 0 (master), 1 (slave), 2 (off) or 3 (sniffer)",
        ),
        (
            Register::Base,
            65_535,
            Reason::Base(2),
            "BASE is 65535, must be 0..=65534: there are 2 items behind it",
        ),
        (
            Register::RegCnt,
            2,
            Reason::Count(6, 1),
            "REGCNT is 2, must be 1 with FUNC 6",
        ),
        (
            Register::RegCnt,
            126,
            Reason::Count(3, 125),
            "REGCNT is 126, must be 1..=125 with FUNC 3",
        ),
        (
            Register::RegOff,
            3,
            Reason::Beyond(2, 4),
            "REGOFF is 3, must be 0..=2 for 2 items: the array has 4",
        ),
        (
            Register::RegOff,
            3,
            Reason::Beyond(5, 4),
            "REGOFF is 3, which with 5 items is too much: the array has 4",
        ),
        (
            Register::RegOff,
            9,
            Reason::Address(65_530, 2),
            "REGOFF is 9, must be 0..=4 with BASE 65530 and 2 items",
        ),
        (
            Register::Func,
            1,
            Reason::NoCoils,
            "FUNC is 1, must be 3, 4, 6, 16 or 23: the port has no coils",
        ),
        (
            Register::Mode,
            1,
            Reason::SlaveZero,
            "MODE is 1, but SLAVEID is 0, must be 1..=247 first",
        ),
        (
            Register::SlaveId,
            0,
            Reason::SlaveZero,
            "SLAVEID is 0, must be 1..=247 for a slave",
        ),
        (
            Register::Framing,
            0,
            Reason::SevenBits,
            "FRAMING is 0, but FORMAT has 7 data bits, must have 8 for RTU",
        ),
        (
            Register::Format,
            4,
            Reason::SevenBits,
            "FORMAT is 4, must be 8N1 (0), 8E1 (1), 8O1 (2) or 8N2 (3) for RTU",
        ),
        (
            Register::Mode,
            0,
            Reason::Text,
            "MODE is 0, but FRAMING is 2 (text), must be 0 (RTU) or 1 (ASCII) first",
        ),
        (
            Register::Framing,
            2,
            Reason::Text,
            "FRAMING is 2, must be 0 (RTU) or 1 (ASCII) for a master or a slave",
        ),
        (
            Register::Baud,
            1,
            Reason::Baud(600),
            "BAUD is 1, the clock does not make it within 2.5 %, nearest is 600",
        ),
        (
            Register::Format,
            6,
            Reason::Chip,
            "FORMAT is 6, the chip does not have it",
        ),
        (
            Register::Framing,
            0,
            Reason::Framing(Framing::Rtu),
            "FRAMING is 0, the line was built without RTU",
        ),
        (
            Register::Framing,
            1,
            Reason::Framing(Framing::Ascii),
            "FRAMING is 1, the line was built without ASCII",
        ),
        (
            Register::Framing,
            2,
            Reason::Framing(Framing::Text),
            "FRAMING is 2, the line was built without text",
        ),
        (
            Register::Mode,
            3,
            Reason::NoSniffer,
            "MODE is 3, the line was built without a sniffer",
        ),
        (
            Register::Baud,
            300,
            Reason::Silence,
            "BAUD is 300, the line was built without silences of that length",
        ),
        (
            Register::Duplex,
            0,
            Reason::Wiring,
            "DUPLEX is 0, must be 1: the port is wired so",
        ),
        (
            Register::Duplex,
            1,
            Reason::Wiring,
            "DUPLEX is 1, must be 0: the port is wired so",
        ),
        (
            Register::Start,
            1,
            Reason::NotMaster,
            "START is 1, must be 0 (master) for START",
        ),
    ] {
        assert_eq!(text(register, value, reason), expected);
    }
    for (register, choices) in [
        (Register::Framing, "0 (RTU), 1 (ASCII) or 2 (text)"),
        (Register::Coils(0), "0 (off) or 1 (on)"),
        (Register::DisableFlg(0), "0 (enabled) or 1 (disabled)"),
        (
            Register::Format,
            "8N1 (0), 8E1 (1), 8O1 (2), 8N2 (3), 7E1 (4), 7O1 (5) or 7N2 (6)",
        ),
        (Register::Duplex, "0 (half) or 1 (full)"),
        (Register::Flow, "0 (none) or 1 (RTS/CTS)"),
        (
            Register::InterCharacter,
            "0 (strict), 1 (off) or 2..=50 (ms that end a frame)",
        ),
        (Register::Start, "1"),
        (
            Register::Func,
            "1, 2, 3, 4, 5, 6, 15, 16 or 23; other functions are methods of the client",
        ),
    ] {
        let said = text(register, 99, Reason::Value);
        assert_eq!(said, format!("{register} is 99, must be {choices}"));
    }
}
