//! The examples of the standard: requests and their answers.

use crate::UNIT;
use multidrop_protocol::client::FileRange;
use multidrop_testkit::reference_client::Ask;

/// Request, its bytes behind the unit id, the answer's: APP 6.1 to 6.21, or made up where the standard has none.
pub fn examples() -> Vec<(Ask, Vec<u8>, Vec<u8>)> {
    let hex = |text: &str| -> Vec<u8> {
        let bytes = text.split_whitespace();
        bytes
            .map(|byte| u8::from_str_radix(byte, 16).expect("hex"))
            .collect()
    };
    let diagnostic = |place| Ask::Diagnostic {
        place,
        character: b'\r',
    };
    let range = |file, record, count| FileRange {
        file,
        record,
        count,
    };
    [
        (
            Ask::Bits {
                inputs: false,
                first: 19,
                count: 19,
            },
            "01 00 13 00 13",
            "01 03 CD 6B 05",
        ),
        (
            Ask::Bits {
                inputs: true,
                first: 196,
                count: 22,
            },
            "02 00 C4 00 16",
            "02 03 AC DB 35",
        ),
        (
            Ask::Registers {
                inputs: false,
                first: 107,
                count: 3,
            },
            "03 00 6B 00 03",
            "03 06 02 2B 00 00 00 64",
        ),
        (
            Ask::Registers {
                inputs: true,
                first: 8,
                count: 1,
            },
            "04 00 08 00 01",
            "04 02 00 0A",
        ),
        (
            Ask::Coil {
                address: 172,
                on: true,
            },
            "05 00 AC FF 00",
            "05 00 AC FF 00",
        ),
        (
            Ask::Coil {
                address: 172,
                on: false,
            },
            "05 00 AC 00 00",
            "05 00 AC 00 00",
        ),
        (
            Ask::Register {
                address: 1,
                value: 3,
            },
            "06 00 01 00 03",
            "06 00 01 00 03",
        ),
        (Ask::Status, "07", "07 6D"),
        (
            Ask::Query {
                data: vec![0xA5, 0x37],
            },
            "08 00 00 A5 37",
            "08 00 00 A5 37",
        ),
        (diagnostic(0), "08 00 01 00 00", "08 00 01 00 00"),
        (diagnostic(1), "08 00 01 FF 00", "08 00 01 FF 00"),
        (diagnostic(2), "08 00 02 00 00", "08 00 02 12 34"),
        (diagnostic(3), "08 00 03 0D 00", "08 00 03 0D 00"),
        (diagnostic(5), "08 00 0A 00 00", "08 00 0A 00 00"),
        (diagnostic(6), "08 00 0B 00 00", "08 00 0B 00 07"),
        (diagnostic(14), "08 00 14 00 00", "08 00 14 00 00"),
        (Ask::Counter, "0B", "0B FF FF 01 08"),
        (Ask::Log, "0C", "0C 08 00 00 01 08 01 21 20 00"),
        (
            Ask::Packed {
                first: 19,
                count: 10,
                bytes: vec![0xCD, 0xFD],
            },
            "0F 00 13 00 0A 02 CD 01",
            "0F 00 13 00 0A",
        ),
        (
            Ask::Coils {
                first: 19,
                values: [1, 0, 1, 1, 0, 0, 1, 1, 1, 0].map(|bit| bit == 1).to_vec(),
            },
            "0F 00 13 00 0A 02 CD 01",
            "0F 00 13 00 0A",
        ),
        (
            Ask::Write {
                first: 1,
                values: vec![10, 0x0102],
            },
            "10 00 01 00 02 04 00 0A 01 02",
            "10 00 01 00 02",
        ),
        (Ask::Id, "11", "11 05 11 FF 61 62 63"),
        (
            Ask::ReadFile {
                groups: vec![range(4, 1, 2), range(3, 9, 2)],
            },
            "14 0E 06 00 04 00 01 00 02 06 00 03 00 09 00 02",
            "14 0C 05 06 0D FE 00 20 05 06 33 CD 00 40",
        ),
        (
            Ask::WriteFile {
                groups: vec![(4, 7, vec![0x06AF, 0x04BE, 0x100D])],
            },
            "15 0D 06 00 04 00 07 00 03 06 AF 04 BE 10 0D",
            "15 0D 06 00 04 00 07 00 03 06 AF 04 BE 10 0D",
        ),
        (
            Ask::Mask {
                address: 4,
                and: 0xF2,
                or: 0x25,
            },
            "16 00 04 00 F2 00 25",
            "16 00 04 00 F2 00 25",
        ),
        (
            Ask::Both {
                first: 3,
                count: 6,
                write_first: 14,
                values: vec![0xFF; 3],
            },
            "17 00 03 00 06 00 0E 00 03 06 00 FF 00 FF 00 FF",
            "17 0C 00 FE 0A CD 00 01 00 03 00 0D 00 FF",
        ),
        (
            Ask::Fifo { pointer: 0x04DE },
            "18 04 DE",
            "18 00 06 00 02 01 B8 12 84",
        ),
        (
            Ask::Device { code: 1, object: 0 },
            "2B 0E 01 00",
            "2B 0E 01 01 00 00 03 00 02 41 42 01 01 43 02 03 56 32 2E",
        ),
        (
            Ask::Device { code: 4, object: 2 },
            "2B 0E 04 02",
            "2B 0E 04 83 00 00 01 02 03 56 32 2E",
        ),
    ]
    .into_iter()
    .map(|(ask, request, answer)| {
        let with_unit = |pdu| [vec![UNIT], hex(pdu)].concat();
        (ask, with_unit(request), with_unit(answer))
    })
    .collect()
}
