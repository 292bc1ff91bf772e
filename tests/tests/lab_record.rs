//! The record as text and as a wave form, read by independent readers: sigrok's UART and Modbus decoders, and a VCD
//! parser.

use multidrop_testkit::places;

use std::fs::File;
use std::path::Path;
use std::process::Command;

use multidrop_bus::{
    Bus, BusConfig, Frame, Framing, HostPort, Level, Nano, Pin, Time, Tx, framed, frames,
};
use multidrop_testkit::frames::{adu, be, block, data, words};
use multidrop_testkit::{LINE, Rig, registers};

/// sigrok takes a sample for every so many nanoseconds here.
const SAMPLE_NS: u64 = 100;

/// One annotation of a decoder: from and to, in samples since time zero, and its text.
type Annotation = (u64, u64, String);

fn sigrok(file: &Path, decoders: &str, annotations: &str) -> Vec<Annotation> {
    let output = Command::new("sigrok-cli")
        .arg("-i")
        .arg(file)
        .args(["-I", &format!("vcd:downsample={SAMPLE_NS}")])
        .args(["-P", decoders, "-A", annotations])
        .arg("--protocol-decoder-samplenum")
        .output()
        .expect("sigrok-cli, from cargo xtask setup");
    assert!(output.status.success(), "{output:?}");
    let text = String::from_utf8_lossy(&output.stdout).into_owned();
    let parse = |line: &str| {
        let (span, rest) = line.split_once(' ')?;
        let (from, to) = span.split_once('-')?;
        let (_, text) = rest.split_once(": ")?;
        Some((from.parse().ok()?, to.parse().ok()?, text.to_owned()))
    };
    let line = |line| parse(line).unwrap_or_else(|| panic!("{line:?}"));
    text.lines().map(line).collect()
}

fn sample(time: Time) -> u64 {
    time.ps() / 1_000 / SAMPLE_NS
}

fn written(bus: &Bus, name: &str) -> std::path::PathBuf {
    let path = places::scratch().join(name);
    bus.write_vcd(File::create(&path).expect("a file for the test"))
        .expect("written");
    path
}

/// What the decoder says of the frame that takes this time.
fn said_of<'a>(annotations: &'a [Annotation], frame: &Frame) -> Vec<&'a str> {
    let (start, end) = (sample(frame.start()), sample(frame.end()) + 1);
    annotations
        .iter()
        .filter(|(from, to, _)| *from >= start && *to <= end)
        .map(|(_, _, text)| text.as_str())
        .collect()
}

#[test]
fn sigrok_decodes_the_bus_as_the_record_does() {
    let mut rig = Rig::registers(16, LINE);
    let mut damaged = words(1, 3, 0, 1);
    damaged[3] ^= 0x40;
    for request in [
        words(1, 3, 0, 16),
        words(1, 6, 3, 0x1234),
        block(1, 0x10, 4, 3, &be(&[0xface, 0x0000, 0x8001])),
        words(1, 3, 2, 6),
        words(1, 5, 9, 0xff00),
        words(1, 1, 0, 16),
        words(1, 2, 0, 16),
        words(1, 4, 1, 7),
        words(1, 3, 15, 2),
        damaged,
        words(2, 3, 0, 1),
    ] {
        let patience = rig.patience();
        rig.bus.transact(rig.host, &request, patience);
    }
    let found = frames(rig.bus.record(), LINE);
    assert_eq!(found.len(), 11 + 9);
    let file = written(&rig.bus, "sigrok.vcd");

    // Bytes off the wire, each where it was: what is marked begins behind the start bit.
    let bytes = sigrok(&file, "uart:rx=wire:baudrate=38400", "uart=rx-data");
    let ours: Vec<_> = found.iter().flat_map(|frame| &frame.characters).collect();
    assert_eq!(bytes.len(), ours.len());
    for ((from, _, text), character) in bytes.iter().zip(ours) {
        assert_eq!(*text, format!("{:02X}", character.value), "{character}");
        let begins = sample(character.start + LINE.bits(1));
        assert!(from.abs_diff(begins) <= 2, "{from}, not {begins}");
    }
    let wrong = sigrok(
        &file,
        "uart:rx=wire:baudrate=38400",
        "uart=rx-warnings:rx-break",
    );
    assert_eq!(wrong, []);

    // Frames off what the stations drive: who speaks tells requests from answers.
    let decoders = "uart:rx=node0_txd:tx=host0_txd:baudrate=38400,modbus";
    let annotations = sigrok(&file, decoders, "modbus");
    for frame in &found {
        let (said, ours) = (said_of(&annotations, frame), frame.meaning());
        let whole = format!("{frame}\n{said:#?}");
        let bytes = frame.bytes();
        let has = |text: &str| said.contains(&text);
        assert!(has(&format!("Slave ID: {}", bytes[0])), "{whole}");
        let (name, function) = match frame.is_exception() {
            false => (said[1].strip_prefix("Function "), bytes[1]),
            true => (said[1].strip_prefix("Error for function "), bytes[1] & 0x7f),
        };
        let name = name.and_then(|text| text.strip_prefix(&format!("{function}: ")));
        let name = name.unwrap_or_else(|| panic!("{whole}")).to_lowercase();
        // Where the CRC is wrong we say nothing about the rest.
        let right = frame.body().is_some();
        assert_eq!(right, ours.to_lowercase().contains(&name), "{whole}");
        assert_eq!(has("CRC correct"), right, "{whole}");
        assert_eq!(ours.ends_with("CRC ok"), right, "{whole}");
        if frame.answer && matches!(function, 3 | 4) && !frame.is_exception() {
            let values = said.iter().filter_map(|text| text.strip_prefix("0x"));
            let values = values.map(|text| format!(" 0x{}", &text[..4].to_uppercase()));
            let values: String = values.collect();
            assert_eq!(values.len(), 7 * usize::from(bytes[2] / 2), "{whole}");
            assert!(ours.contains(&format!(":{values},")), "{whole}");
        }
    }
    std::fs::remove_file(file).expect("it is there");
}

/// Two hosts, and no node.
fn two_hosts() -> (Bus, [multidrop_bus::HostId; 2]) {
    let mut bus = Bus::new(BusConfig::default());
    let hosts = [(); 2].map(|()| bus.add_host(HostPort::new(LINE)));
    bus.run_for(Time::from_ms(1));
    (bus, hosts)
}

fn lines(bus: &Bus) -> Vec<String> {
    let found = frames(bus.record(), LINE);
    found.iter().map(Frame::to_string).collect()
}

#[test]
fn the_text_has_sender_time_and_meaning() {
    let (mut bus, [client, server]) = two_hosts();
    bus.host(client).send(&words(17, 3, 107, 3));
    bus.run_for(Time::from_ms(5));
    bus.host(server)
        .send(&data(17, 3, &be(&[0xae41, 0x5652, 0x4340])));
    bus.run_for(Time::from_ms(10));
    bus.host(client)
        .send(&adu(&[0, 0x0f, 0, 19, 0, 10, 2, 0xcd, 0x01]));
    bus.run_for(Time::from_ms(10));
    assert_eq!(
        lines(&bus),
        [
            "     1000.000 us  host 0  -> 11 03 00 6B 00 03 76 87  \
             unit 17: Read Holding Registers, 3 from 107, CRC ok",
            "     6000.000 us  host 1  <- 11 03 06 AE 41 56 52 43 40 49 AD  \
             unit 17: Read Holding Registers: 0xAE41 0x5652 0x4340, CRC ok; after 2916.666 us",
            "    16000.000 us  host 0  -> 00 0F 00 13 00 0A 02 CD 01 7F 5B  \
             broadcast: Write Multiple Coils from 19 := 1011001110, CRC ok",
        ]
    );
}

/// Frames that a client and a server send in turn, as text without time and sender.
fn told(exchanges: &[(&[u8], &[u8])]) -> Vec<String> {
    let (mut bus, [client, server]) = two_hosts();
    for (request, answer) in exchanges {
        for (host, body) in [(client, request), (server, answer)] {
            bus.host(host).send(&adu(body));
            bus.run_for(Time::from_ms(40));
        }
    }
    let found = frames(bus.record(), LINE);
    let arrow = |frame: &Frame| if frame.answer { "<- " } else { "-> " };
    let told = |frame: &Frame| format!("{}{}", arrow(frame), frame.meaning());
    found.iter().map(told).collect()
}

#[test]
fn text_tells_of_every_function() {
    let id = [&[17, 0x11, 11, 17, 0xff], &b"multidrop"[..]].concat();
    let object = [&[17, 0x2b, 14, 4, 0x82, 0, 0, 1, 1, 4], &b"nano"[..]].concat();
    let file = [17, 0x15, 9, 6, 0, 4, 0, 7, 0, 1, 6, 0xaf];
    assert_eq!(
        told(&[
            (&[17, 7], &[17, 7, 0x6d]),
            (&[17, 8, 0, 0, 0xa5, 0x37], &[17, 8, 0, 0, 0xa5, 0x37]),
            (&[17, 11], &[17, 11, 0, 0, 1, 8]),
            (&[17, 12], &[17, 12, 8, 0, 0, 1, 8, 1, 0x21, 0x20, 0]),
            (&[17, 17], &id),
            (
                &[17, 0x14, 7, 6, 0, 4, 0, 1, 0, 2],
                &[17, 0x14, 6, 5, 6, 13, 254, 0, 32]
            ),
            (&file, &file),
            (
                &[17, 0x16, 0, 4, 0, 0xf2, 0, 0x25],
                &[17, 0x16, 0, 4, 0, 0xf2, 0, 0x25]
            ),
            (
                &[17, 0x17, 0, 3, 0, 1, 0, 14, 0, 1, 2, 0, 255],
                &[17, 0x17, 2, 0, 254]
            ),
            (
                &[17, 0x18, 4, 0xde],
                &[17, 0x18, 0, 6, 0, 2, 1, 0xb8, 0x12, 0x84]
            ),
            (&[17, 0x2b, 14, 4, 1], &object),
            (&[17, 6, 100, 0, 0, 0], &[17, 0x86, 7]),
        ]),
        [
            "-> unit 17: Read Exception Status, CRC ok",
            "<- unit 17: Read Exception Status: 10110110, CRC ok",
            "-> unit 17: Diagnostics 0: 0xA537, CRC ok",
            "<- unit 17: Diagnostics 0: 0xA537, CRC ok",
            "-> unit 17: Get Comm Event Counter, CRC ok",
            "<- unit 17: Get Comm Event Counter: status 0, 264 events, CRC ok",
            "-> unit 17: Get Comm Event Log, CRC ok",
            "<- unit 17: Get Comm Event Log: status 0, 264 events, 289 messages, log 20 00, CRC ok",
            "-> unit 17: Report Server ID, CRC ok",
            "<- unit 17: Report Server ID: id 17, run indicator FF, \"multidrop\", CRC ok",
            "-> unit 17: Read File Record: 2 of file 4 from 1, CRC ok",
            "<- unit 17: Read File Record, CRC ok",
            "-> unit 17: Write File Record: 1 of file 4 from 7 := 0x06AF, CRC ok",
            "<- unit 17: Write File Record: done, 1 of file 4 from 7 := 0x06AF, CRC ok",
            "-> unit 17: Mask Write Register 4 := value & 0x00F2 | 0x0025 & !0x00F2, CRC ok",
            "<- unit 17: Mask Write Register: done, CRC ok",
            "-> unit 17: Read/Write Multiple Registers, 1 from 3, from 14 := 0x00FF, CRC ok",
            "<- unit 17: Read/Write Multiple Registers: 0x00FE, CRC ok",
            "-> unit 17: Read FIFO Queue at 1246, CRC ok",
            "<- unit 17: Read FIFO Queue, 2 in the queue: 0x01B8 0x1284, CRC ok",
            "-> unit 17: Read Device Identification, code 4 from object 1, CRC ok",
            "<- unit 17: Read Device Identification: 1 \"nano\", CRC ok",
            "-> unit 17: Write Single Register 25600 := 0x0000, CRC ok",
            "<- unit 17: exception 07 negative acknowledge (Write Single Register), CRC ok",
        ]
    );
}

#[test]
fn text_tells_ascii_frames_apart_by_their_characters() {
    let (mut bus, [client, server]) = two_hosts();
    bus.host(client).send(b":1103006B00037E\r\n");
    bus.run_for(Time::from_ms(20));
    bus.host(server).send(b":110306AE4156524340CC\r\n:11\r\n");
    bus.run_for(Time::from_ms(40));
    let found = framed(bus.record(), LINE, Framing::Ascii);
    let told: Vec<_> = found
        .iter()
        .map(|frame| format!("{}  {}", frame.hex(), frame.meaning()))
        .collect();
    assert_eq!(
        told,
        [
            ":1103006B00037E\\r\\n  unit 17: Read Holding Registers, 3 from 107, LRC ok",
            ":110306AE4156524340CC\\r\\n  unit 17: Read Holding Registers: 0xAE41 0x5652 0x4340, LRC ok",
            ":11\\r\\n  LRC wrong: no frame for anybody",
        ]
    );
    assert!(found[1].answer && !found[0].answer);
}

#[test]
fn the_text_marks_errors() {
    let (mut bus, [client, server]) = two_hosts();
    let bytes = words(17, 6, 1, 3);
    let characters = bytes.iter().map(|&byte| Tx::byte(byte)).enumerate();
    let pause = Time::from_us(800);
    bus.host(client)
        .send_each(characters.map(|(index, character)| match index {
            2 => character.after(pause),
            3 => character.flip_bit(1),
            4 => character.after(LINE.t15() - Time::from_us(1)),
            7 => character.bad_stop(),
            _ => character,
        }));
    bus.run_for(Time::from_ms(5));
    // Another begins before t3.5 is over, and the first once more into the middle of that.
    bus.host(server).send(&[0xff, 0xff]);
    bus.run_for(LINE.bits(4));
    bus.host(client).send(&[0x00]);
    bus.run_for(Time::from_ms(5));
    let found = lines(&bus);
    let expected = "     1000.000 us  host 0  -> 11 06 [800.000 us] 00 03! 00 03 9A 9B!  CRC wrong: \
                    no frame for anybody; a pause over t1.5; framing error; other bits than sent";
    assert_eq!(found[0], expected);
    assert!(found[1].contains("before t3.5"), "{}", found[1]);
    assert!(found[2].contains("conflict"), "{}", found[2]);
}

/// What a VCD parser finds: time in ns and value of each change of a signal.
fn changes(file: &Path, path: [&str; 2]) -> Vec<(u64, vcd::Value)> {
    let file = std::io::BufReader::new(File::open(file).expect("the file"));
    let mut parser = vcd::Parser::new(file);
    let header = parser.parse_header().expect("a header");
    assert_eq!(header.timescale, Some((1, vcd::TimescaleUnit::NS)));
    let id = header.find_var(&path).expect("the signal").code;
    let (mut now, mut found) = (0, Vec::new());
    for command in parser {
        match command.expect("a command") {
            vcd::Command::Timestamp(time) => now = time,
            vcd::Command::ChangeScalar(signal, value) if signal == id => found.push((now, value)),
            _ => {}
        }
    }
    found
}

#[test]
fn the_wave_form_holds_every_edge() {
    let mut bus = Bus::new(BusConfig::default());
    let node = Nano {
        watch: vec![Pin::D1],
        ..Nano::new("unit 1", registers(16, LINE))
    };
    bus.add_nano(node).expect("a valid image");
    let [client, other] = [(); 2].map(|()| bus.add_host(HostPort::new(LINE)));
    bus.run_for(Time::from_ms(20));
    bus.clear_record();
    let begin = bus.now();
    // A neighbour talks into the answer.
    bus.host(client).send(&words(1, 3, 0, 4));
    bus.run_for(Time::from_ms(5));
    bus.host(other).send(&[0x55]);
    bus.run_for(Time::from_ms(20));
    let file = written(&bus, "edges.vcd");
    let record = bus.record();

    let ns = |time: Time| time.ps() / 1_000;
    let first = ns(begin) - 1_000;
    let mut expected = vec![(first, vcd::Value::V1)];
    let edges = record.wire_edges().iter();
    expected.extend(edges.map(|edge| (ns(edge.time), edge.level.into())));
    assert!(expected.len() > 50);
    assert_eq!(changes(&file, ["bus", "wire"]), expected);

    let edges = record.de_edges().iter();
    let mut expected = vec![(first, vcd::Value::V0)];
    expected.extend(edges.map(|edge| (ns(edge.time), edge.on.into())));
    assert_eq!(expected.len(), 3);
    assert_eq!(changes(&file, ["node0_unit_1", "node0_de"]), expected);

    let conflicts = record.conflicts().iter();
    let ends = |conflict: &multidrop_bus::Conflict| ns(conflict.end.expect("it ended"));
    let mut expected = vec![(first, vcd::Value::V0)];
    expected.extend(conflicts.flat_map(|conflict| {
        let begins = ns(conflict.time);
        [(begins, vcd::Value::V1), (ends(conflict), vcd::Value::V0)]
    }));
    assert!(expected.len() > 1);
    assert_eq!(changes(&file, ["bus", "conflict"]), expected);

    // What the node drives goes on unchanged below the conflict: all bits of its answer.
    let driven = changes(&file, ["node0_unit_1", "node0_txd"]);
    let from =
        |edge: &&multidrop_bus::DataEdge| edge.from == multidrop_bus::Station::Node(node_id(&bus));
    assert_eq!(
        driven.len(),
        1 + record.data_edges().iter().filter(from).count()
    );
    let bits = |byte: u8| (0..8).map(move |bit| byte >> bit & 1 == 1);
    let answer = data(1, 3, &[0; 8]);
    let levels = answer
        .iter()
        .flat_map(|&byte| [false].into_iter().chain(bits(byte)).chain([true]));
    let mut edges: Vec<bool> = levels.collect();
    edges.dedup();
    let seen: Vec<bool> = driven[1..]
        .iter()
        .map(|(_, value)| *value == vcd::Value::V1)
        .collect();
    assert_eq!(seen, edges);
    assert_eq!(bus.node(node_id(&bus)).output(Pin::D1), Level::Floating);
    assert_eq!(
        changes(&file, ["node0_unit_1", "node0_PD1"]),
        [(first, vcd::Value::Z)]
    );
    std::fs::remove_file(file).expect("it is there");
}

fn node_id(bus: &Bus) -> multidrop_bus::NodeId {
    let (id, _) = bus.nodes().next().expect("a node");
    id
}
