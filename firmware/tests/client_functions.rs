//! Every function of the client: its request, and the result for an answer, an exception and silence.

mod desk;

use std::fmt::Debug;

use desk::{Desk, Heard, TestLine};
use multidrop::protocol::client::{Diagnostic, FileData, FileRange, RequestError};
use multidrop::protocol::exception::Exception;
use multidrop::{Client, ClientConfig, ClientError};

const CONFIG: ClientConfig = ClientConfig::new().timeout_ms(30).turnaround_ms(5);
const DELAY: u64 = 4;

type Port = Client<TestLine, 1>;

/// What `call` comes to where this is heard; `None` if nothing is. It sends `request`, to unit 17.
fn asked<R: 'static, F: Future<Output = Result<R, ClientError>> + 'static>(
    call: impl Fn(Port) -> F,
    request: &[u8],
    heard: Option<&[u8]>,
) -> Result<R, ClientError> {
    let heard: Vec<_> = heard.iter().map(|pdu| [&[17], *pdu].concat()).collect();
    let mut desk = Desk::<1>::new(move |_| {
        let heard = heard.iter().cloned();
        heard.map(|frame| (DELAY, Heard::Frame(frame))).collect()
    });
    let client = desk.port.client(CONFIG);
    let (result, _) = desk.ask(call(client));
    assert_eq!(desk.sent(), [[&[17], request].concat()]);
    result
}

/// A request with `call` gives `expected`, whether the answer stands or not.
fn works<R, F>(call: impl Fn(Port) -> F, request: &[u8], answer: &[u8], expected: R)
where
    R: PartialEq + Debug + 'static,
    F: Future<Output = Result<R, ClientError>> + 'static,
{
    assert_eq!(asked(&call, request, Some(answer)), Ok(expected));
    for (heard, error) in [
        (
            Some(&[request[0] | 0x80, 2][..]),
            ClientError::Exception(Exception::IllegalDataAddress),
        ),
        (
            Some(&[request[0] ^ 0x20, 0][..]),
            ClientError::WrongFunction(request[0] ^ 0x20),
        ),
        (None, ClientError::Timeout),
    ] {
        assert_eq!(asked(&call, request, heard), Err(error), "{request:02X?}");
    }
}

#[test]
fn bits_are_read() {
    let bits = |packed: u32, count: usize| -> Vec<bool> {
        (0..count).map(|bit| packed >> bit & 1 == 1).collect()
    };
    works(
        |client| async move {
            let mut into = vec![false; 19];
            client.read_coils(17, 0x13, &mut into).await?;
            Ok(into)
        },
        &[1, 0, 0x13, 0, 19],
        &[1, 3, 0xCD, 0x6B, 0x05],
        bits(0x05_6BCD, 19),
    );
    works(
        |client| async move {
            let mut into = vec![true; 9];
            client.read_discrete_inputs(17, 0x1C4, &mut into).await?;
            Ok(into)
        },
        &[2, 1, 0xC4, 0, 9],
        &[2, 2, 0xAC, 1],
        bits(0x01AC, 9),
    );
}

#[test]
fn bits_are_read_eight_to_a_byte() {
    works(
        |client| async move {
            let mut into = [0xEE; 4];
            client.read_packed_coils(17, 0x13, 19, &mut into).await?;
            Ok(into)
        },
        &[1, 0, 0x13, 0, 19],
        &[1, 3, 0xCD, 0x6B, 0x05],
        // What is there beyond stays.
        [0xCD, 0x6B, 0x05, 0xEE],
    );
    works(
        |client| async move {
            let mut into = [0xEE; 1];
            let read = client.read_packed_discrete_inputs(17, 2, 8, &mut into);
            read.await.map(|()| into)
        },
        &[2, 0, 2, 0, 8],
        &[2, 1, 0x5A],
        [0x5A],
    );
    // One byte too few: nothing is sent.
    let mut desk = Desk::<1>::new(|_| vec![]);
    let client = desk.port.client(CONFIG);
    for (count, room) in [(1, 0), (9, 1), (17, 2), (2000, 249)] {
        let (refused, ms) = desk.ask(async move {
            let mut into = vec![0; usize::from(room)];
            client.read_packed_coils(17, 2, count, &mut into).await
        });
        let needed = count.div_ceil(8);
        let error = ClientError::Request(RequestError::Room { room, needed });
        assert_eq!((refused, ms), (Err(error), 0));
    }
    assert!(desk.sent().is_empty());
}

#[test]
fn registers_are_read() {
    works(
        |client| async move {
            let mut into = [0xEEEE; 2];
            client.read_holding_registers(17, 0x16B, &mut into).await?;
            Ok(into)
        },
        &[3, 1, 0x6B, 0, 2],
        &[3, 4, 2, 0x2B, 0xFF, 0xFE],
        [0x022B, 0xFFFE],
    );
    works(
        |client| async move {
            let mut into = [0xEEEE];
            client.read_input_registers(17, 8, &mut into).await?;
            Ok(into)
        },
        &[4, 0, 8, 0, 1],
        &[4, 2, 0x12, 0x34],
        [0x1234],
    );
    works(
        |client| async move {
            let mut into = [0xEEEE; 2];
            let asked = client.read_write_registers(17, 3, &mut into, 14, &[0xFF, 0x1234]);
            asked.await.map(|()| into)
        },
        &[0x17, 0, 3, 0, 2, 0, 14, 0, 2, 4, 0, 0xFF, 0x12, 0x34],
        &[0x17, 4, 0, 0xFE, 10, 0xCD],
        [0xFE, 0x0ACD],
    );
}

#[test]
fn bits_are_written() {
    for (on, high) in [(true, 0xFF), (false, 0)] {
        let pdu = [5, 0, 0xAC, high, 0];
        works(
            move |client| async move { client.write_coil(17, 0xAC, on).await },
            &pdu,
            &pdu,
            (),
        );
    }
    works(
        |client| async move {
            let values = [
                true, false, true, true, false, false, true, true, true, false,
            ];
            client.write_coils(17, 0x13, &values).await
        },
        &[15, 0, 0x13, 0, 10, 2, 0xCD, 1],
        &[15, 0, 0x13, 0, 10],
        (),
    );
    works(
        |client| async move { client.write_packed_coils(17, 0x13, 10, &[0xCD, 1]).await },
        &[15, 0, 0x13, 0, 10, 2, 0xCD, 1],
        &[15, 0, 0x13, 0, 10],
        (),
    );
}

#[test]
fn registers_are_written() {
    let pdu = [6, 0, 1, 0x12, 0x34];
    works(
        |client| async move { client.write_register(17, 1, 0x1234).await },
        &pdu,
        &pdu,
        (),
    );
    works(
        |client| async move { client.write_registers(17, 1, &[10, 0x0102]).await },
        &[16, 0, 1, 0, 2, 4, 0, 10, 1, 2],
        &[16, 0, 1, 0, 2],
        (),
    );
    let pdu = [0x16, 0, 4, 0, 0xF2, 0, 0x25];
    works(
        |client| async move { client.mask_write_register(17, 4, 0xF2, 0x25).await },
        &pdu,
        &pdu,
        (),
    );
}

#[test]
fn the_state_of_a_server_is_read() {
    works(
        |client| async move { client.read_exception_status(17).await },
        &[7],
        &[7, 0x6D],
        0x6D,
    );
    works(
        |client| async move {
            let counter = client.event_counter(17).await?;
            Ok((counter.busy, counter.events))
        },
        &[0x0B],
        &[0x0B, 0xFF, 0xFF, 1, 8],
        (true, 0x0108),
    );
    works(
        |client| async move {
            let log = |log: multidrop::protocol::client::EventLog<'_>| {
                (log.busy, log.events, log.messages, log.log.to_vec())
            };
            client.event_log(17, log).await
        },
        &[0x0C],
        &[0x0C, 8, 0, 0, 1, 8, 1, 0x21, 0x20, 0],
        (false, 0x0108, 0x0121, vec![0x20, 0]),
    );
    works(
        |client| async move { client.report_server_id(17, |id| id.bytes().to_vec()).await },
        &[0x11],
        &[0x11, 3, 0x11, 0xFF, 7],
        vec![0x11, 0xFF, 7],
    );
}

#[test]
fn diagnostics_are_read() {
    works(
        |client| async move { client.diagnose(17, Diagnostic::BusMessages).await },
        &[8, 0, 0x0B, 0, 0],
        &[8, 0, 0x0B, 0x12, 0x34],
        0x1234,
    );
    works(
        |client| async move { client.diagnose(17, Diagnostic::Delimiter(b';')).await },
        &[8, 0, 3, b';', 0],
        &[8, 0, 3, b';', 0],
        0x3B00,
    );
    for data in [&[][..], &[7], &[1, 2, 3]] {
        let pdu = [&[8, 0, 0], data].concat();
        works(
            move |client| async move { client.return_query_data(17, data).await },
            &pdu,
            &pdu,
            (),
        );
    }
    // Not answered, and not waited for.
    let listen = |client: Port| async move { client.diagnose(17, Diagnostic::ListenOnly).await };
    assert_eq!(asked(listen, &[8, 0, 4, 0, 0], None), Ok(0));
}

#[test]
fn records_are_read_and_written() {
    works(
        |client| async move {
            let groups = [
                FileRange {
                    file: 4,
                    record: 1,
                    count: 2,
                },
                FileRange {
                    file: 3,
                    record: 9,
                    count: 1,
                },
            ];
            let read = client.read_files(17, &groups, |records| {
                records
                    .map(|group| group.iter().collect::<Vec<_>>())
                    .collect::<Vec<_>>()
            });
            read.await
        },
        &[0x14, 14, 6, 0, 4, 0, 1, 0, 2, 6, 0, 3, 0, 9, 0, 1],
        &[0x14, 10, 5, 6, 0x0D, 0xFE, 0, 0x20, 3, 6, 0x33, 0xCD],
        vec![vec![0x0DFE, 0x20], vec![0x33CD]],
    );
    let pdu = [0x15, 11, 6, 0, 4, 0, 7, 0, 2, 6, 0xAF, 4, 0xBE];
    works(
        |client| async move {
            let group = FileData {
                file: 4,
                record: 7,
                values: &[0x06AF, 0x04BE],
            };
            client.write_files(17, &[group]).await
        },
        &pdu,
        &pdu,
        (),
    );
}

#[test]
fn a_queue_and_an_identification_are_read() {
    works(
        |client| async move {
            let read = client.read_fifo(17, 0x04DE, |queue| queue.iter().collect::<Vec<_>>());
            read.await
        },
        &[0x18, 4, 0xDE],
        &[0x18, 0, 6, 0, 2, 1, 0xB8, 0x12, 0x84],
        vec![0x01B8, 0x1284],
    );
    works(
        |client| async move {
            let read = client.read_identification(17, 4, 1, |told| {
                let objects = told.objects;
                let objects: Vec<_> = objects.map(|(id, value)| (id, value.to_vec())).collect();
                (told.conformity, told.next, objects)
            });
            read.await
        },
        &[0x2B, 0x0E, 4, 1],
        &[0x2B, 0x0E, 4, 0x82, 0, 0, 1, 1, 2, b'A', b'B'],
        (0x82, None, vec![(1, b"AB".to_vec())]),
    );
}

#[test]
fn any_other_function_is_called() {
    works(
        |client| async move { client.call(17, 0x41, &[1, 2, 3], <[u8]>::to_vec).await },
        &[0x41, 1, 2, 3],
        &[0x41, 3, 2],
        Some(vec![3, 2]),
    );
    // A broadcast has no answer.
    let mut desk = Desk::<1>::new(|_| vec![]);
    let client = desk.port.client(CONFIG);
    let told = desk.ask(async move { client.call(0, 0x41, &[1], <[u8]>::to_vec).await });
    assert_eq!(told.0, Ok(None));
    assert_eq!(desk.sent(), [[0, 0x41, 1]]);
}

#[test]
fn a_count_over_the_limit_is_reported_in_the_error() {
    let mut desk = Desk::<1>::new(|_| vec![]);
    let client = desk.port.client(CONFIG);
    for (len, told) in [
        (0, 0),
        (126, 126),
        (65_535, 65_535),
        (65_536, 65_535),
        (65_537, 65_535),
    ] {
        let (refused, ms) = desk.ask(async move {
            let mut into = vec![0; len];
            client.read_holding_registers(17, 0, &mut into).await
        });
        let error = RequestError::Count {
            count: told,
            max: 125,
        };
        assert_eq!((refused, ms), (Err(ClientError::Request(error)), 0));
    }
    assert!(desk.sent().is_empty());
}
