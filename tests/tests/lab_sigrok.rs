//! A long record of all functions, read by sigrok's Modbus decoder: its findings must be those of the record.

use multidrop_testkit::places;

use std::collections::BTreeMap;
use std::fs::File;
use std::path::Path;
use std::process::Command;

use multidrop_bus::{Frame, Line, Time, Tx, frames};
use multidrop_testkit::conforms::Board;
use multidrop_testkit::plain::requests::Requests;
use multidrop_testkit::plain::wire::{Flaw, Way};
use multidrop_testkit::random::Random;
use multidrop_testkit::{Rig, conformance};

/// Frames take less time, and sigrok less samples.
const LINE: Line = Line::n81(115_200);

/// sigrok takes a sample for every so many nanoseconds: nine in a bit.
const SAMPLE_NS: u64 = 960;

/// What sigrok says, by the sample at which it begins.
fn decoded(file: &Path) -> BTreeMap<u64, Vec<String>> {
    let decoders = "uart:rx=node0_txd:tx=host0_txd:baudrate=115200,modbus:framegap=60";
    let output = Command::new("sigrok-cli")
        .arg("-i")
        .arg(file)
        .args(["-I", &format!("vcd:downsample={SAMPLE_NS}")])
        .args([
            "-P",
            decoders,
            "-A",
            "modbus",
            "--protocol-decoder-samplenum",
        ])
        .output()
        .expect("sigrok-cli, from cargo xtask setup");
    assert!(output.status.success(), "{output:?}");
    let mut all = BTreeMap::<u64, Vec<String>>::new();
    for line in String::from_utf8_lossy(&output.stdout).lines() {
        let parse = || {
            let (span, rest) = line.split_once(' ')?;
            let (from, _) = span.split_once('-')?;
            let (_, text) = rest.split_once(": ")?;
            Some((from.parse().ok()?, text.to_owned()))
        };
        let (from, text) = parse().unwrap_or_else(|| panic!("{line:?}"));
        all.entry(from).or_default().push(text);
    }
    all
}

/// What it says of the frame that takes this time.
fn said_of<'a>(all: &'a BTreeMap<u64, Vec<String>>, frame: &Frame) -> Vec<&'a str> {
    let sample = |time: Time| time.ps() / 1_000 / SAMPLE_NS;
    let span = sample(frame.start())..=sample(frame.end());
    let found = all.range(span).flat_map(|(_, texts)| texts);
    found.map(String::as_str).collect()
}

/// Bytes of unit id and PDU, if the decoder knows the function and what it says of itself is the length it has: requests and
/// answers that it reads to the end, which is where it looks for the CRC.
fn is_known(frame: &Frame, content: &[u8]) -> bool {
    let [unit, function, ..] = *content else {
        return false;
    };
    let counted = |at: usize| content.get(at).map(|count| at + 1 + usize::from(*count));
    let len = match (function, frame.answer) {
        (0x80.., true) => Some(3),
        (1..=4, false) | (5 | 6 | 8, _) | (0x0b | 0x0f | 0x10, true) => Some(6),
        (1..=4 | 0x0c | 0x11 | 0x17, true) => counted(2),
        (7 | 0x0b | 0x0c | 0x11, false) => Some(2),
        (7, true) => Some(3),
        (0x0f | 0x10, false) => counted(6).filter(|_| quantity_fits(content)),
        (0x16, _) => Some(8),
        (0x17, false) => counted(10),
        _ => None,
    };
    // It knows no broadcast but as what it is, and takes no answer from unit 0.
    unit <= 247 && len == Some(content.len())
}

/// It has no name for a quantity over the standard's.
fn quantity_fits(content: &[u8]) -> bool {
    let quantity = u16::from_be_bytes([content[4], content[5]]);
    let (limit, bytes) = match content[1] {
        0x0f => (1968, quantity.div_ceil(8)),
        _ => (123, quantity.saturating_mul(2)),
    };
    (1..=limit).contains(&quantity) && u16::from(content[6]) == bytes
}

#[test]
fn sigrok_finds_the_fields_and_crc_of_the_record() {
    let mut rig = Rig::with(&[&conformance(Board::Nano, Way::Rtu, LINE)], LINE);
    rig.slack = Time::from_ms(15);
    let mut random = Random::new(7);
    let mut below = |end: u32| (random.next() % u64::from(end)) as u32;
    let mut traffic = Requests::new(&mut below, &[Flaw::None]);
    for _ in 0..400 {
        let characters = traffic.step().characters(Way::Rtu, b'\n');
        let patience = rig.patience();
        let host = rig.bus.host(rig.host);
        host.take();
        let end = host.send_each(characters.iter().map(|one| Tx::byte(one.value)));
        rig.bus.run_to(end);
        rig.bus.transact(rig.host, &[], patience);
    }
    let found = frames(rig.bus.record(), LINE);
    let path = places::scratch().join("sigrok-all.vcd");
    let file = File::create(&path).expect("a file for the test");
    rig.bus.write_vcd(file).expect("written");
    let all = decoded(&path);

    let (mut right, mut wrong) = (0, 0);
    for frame in &found {
        let bytes = frame.bytes();
        let content = &bytes[..bytes.len().saturating_sub(2)];
        if !is_known(frame, content) {
            continue;
        }
        let (said, ours) = (said_of(&all, frame), frame.meaning());
        let whole = format!("{frame}\n{said:#?}");
        let has = |text: &str| said.contains(&text);
        assert_eq!(has("CRC correct"), ours.ends_with("CRC ok"), "{whole}");
        if frame.body().is_none() {
            // We say nothing of the rest.
            wrong += 1;
            continue;
        }
        right += 1;
        let unit = match content[0] {
            0 => "Broadcast message".to_owned(),
            unit => format!("Slave ID: {unit}"),
        };
        let us = match content[0] {
            0 => "broadcast: ".to_owned(),
            unit => format!("unit {unit}: "),
        };
        assert!(has(&unit) && ours.starts_with(&us), "{whole}");
        let function = match frame.is_exception() {
            true => format!("Error for function {}: ", content[1] & 0x7f),
            false => format!("Function {}: ", content[1]),
        };
        let name = said.iter().find_map(|text| text.strip_prefix(&function));
        let name = name.unwrap_or_else(|| panic!("{whole}"));
        // Its own words for these.
        let name = name
            .replace("Slave ID", "Server ID")
            .replace("Com ", "Comm ")
            .replace("Read Device Identification/", "")
            .replace("Unknown function", "");
        assert!(ours.contains(&name), "{name}: {whole}");
        for text in said
            .iter()
            .filter(|text| text.to_lowercase().contains("address 0x"))
        {
            let (_, address) = text.split_once("0x").unwrap_or_default();
            let (address, _) = address.split_once(' ').unwrap_or_default();
            let address = u32::from_str_radix(address, 16).expect("a number");
            let is_told = ours
                .split(|c: char| !c.is_ascii_alphanumeric())
                .any(|word| word == address.to_string());
            // Of an echo we say that it was done, and nothing of what is wrong with FC 05.
            let echo = frame.answer && matches!(content[1], 5 | 6 | 0x16);
            let told_nothing = echo || has("Invalid Coil Value");
            assert!(is_told || told_nothing, "{address}: {whole}");
        }
    }
    println!("{right} right, {wrong} wrong, of {}", found.len());
    assert!(right >= 300 && wrong >= 5, "{right} right, {wrong} wrong");
    std::fs::remove_file(path).expect("it is there");
}
