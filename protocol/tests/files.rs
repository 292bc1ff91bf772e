//! Record files (FC 14, 15) and the queue (FC 18) against a plain reading of APP 6.14, 6.15 and 6.18.

mod common;

use common::{UNIT, ask_server};
use multidrop_protocol::data::{Registers, RegistersOut};
use multidrop_protocol::exception::Exception;
use multidrop_protocol::server::{DataModel, FunctionSet, Server};
use proptest::prelude::*;

/// File 1 has 10 records, file 300 has all 10000. Queue 5 holds what it is told to.
#[derive(Clone, PartialEq)]
struct Files {
    small: Vec<u16>,
    large: Vec<u16>,
    queue: Vec<u16>,
    broken: bool,
}

const SMALL: u16 = 1;
const LARGE: u16 = 300;
const QUEUE: u16 = 0x0105;
/// No record of the small file takes this value.
const UNWANTED: u16 = 0xDEAD;

impl Files {
    fn new() -> Files {
        Files {
            small: (100..110).collect(),
            large: (0..10_000).collect(),
            queue: Vec::new(),
            broken: false,
        }
    }

    fn file(&self, file: u16) -> Option<&Vec<u16>> {
        match file {
            SMALL => Some(&self.small),
            LARGE => Some(&self.large),
            _ => None,
        }
    }

    fn block(&self, file: u16, record: u16, count: usize) -> Result<&[u16], Exception> {
        assert!(file != 0 && count != 0 && usize::from(record) + count <= 10_000);
        let first = usize::from(record);
        self.file(file)
            .and_then(|records| records.get(first..first + count))
            .ok_or(Exception::IllegalDataAddress)
    }
}

impl DataModel for Files {
    const FUNCTIONS: FunctionSet = FunctionSet::ALL;

    fn file_records(
        &mut self,
        file: u16,
        record: u16,
        mut out: RegistersOut<'_>,
    ) -> Result<(), Exception> {
        out.copy_from(self.block(file, record, out.len())?);
        Ok(())
    }

    fn check_file_records(
        &self,
        file: u16,
        record: u16,
        values: Registers<'_>,
    ) -> Result<(), Exception> {
        self.block(file, record, values.len())?;
        if file == SMALL && values.iter().any(|value| value == UNWANTED) {
            return Err(Exception::IllegalDataValue);
        }
        Ok(())
    }

    fn write_file_records(
        &mut self,
        file: u16,
        record: u16,
        values: Registers<'_>,
    ) -> Result<(), Exception> {
        if self.broken {
            return Err(Exception::ServerDeviceFailure);
        }
        let records = match file {
            SMALL => &mut self.small,
            _ => &mut self.large,
        };
        values.copy_to(&mut records[record.into()..]);
        Ok(())
    }

    fn fifo_queue(&mut self, pointer: u16, mut out: RegistersOut<'_>) -> Result<u16, Exception> {
        assert_eq!(out.len(), 31);
        if pointer != QUEUE {
            return Err(Exception::IllegalDataAddress);
        }
        out.copy_from(&self.queue);
        Ok(self.queue.len() as u16)
    }
}

/// One group of a request.
#[derive(Clone, Debug)]
struct Group {
    reference: u8,
    file: u16,
    record: u16,
    count: u16,
    /// Of a write.
    values: Vec<u16>,
}

impl Group {
    fn read(file: u16, record: u16, count: u16) -> Group {
        Group {
            reference: 6,
            file,
            record,
            count,
            values: Vec::new(),
        }
    }

    fn write(file: u16, record: u16, values: &[u16]) -> Group {
        Group {
            values: values.to_vec(),
            ..Group::read(file, record, values.len() as u16)
        }
    }

    fn last(&self) -> u32 {
        u32::from(self.record) + u32::from(self.count) - 1
    }

    /// Whether the standard has such a place.
    fn may_exist(&self) -> bool {
        self.reference == 6 && self.file != 0 && self.last() <= 9999
    }

    fn exists(&self, files: &Files) -> bool {
        let records = files.file(self.file);
        self.may_exist() && records.is_some_and(|records| self.last() < records.len() as u32)
    }
}

fn words(values: &[u16]) -> Vec<u8> {
    values
        .iter()
        .flat_map(|value| value.to_be_bytes())
        .collect()
}

/// The whole request: byte count and groups behind the function code.
fn request(code: u8, groups: &[Group]) -> Vec<u8> {
    let mut data = Vec::new();
    for group in groups {
        data.push(group.reference);
        data.extend(words(&[group.file, group.record, group.count]));
        data.extend(words(&group.values));
    }
    [vec![UNIT, code, data.len() as u8], data].concat()
}

/// What APP 6.14 answers to these groups.
fn read_answer(files: &Files, groups: &[Group]) -> Vec<u8> {
    let bytes: u32 = groups
        .iter()
        .map(|group| 2 + 2 * u32::from(group.count))
        .sum();
    let request_bytes = 7 * groups.len();
    let counts = groups.iter().all(|group| group.count != 0);
    if !(0x07..=0xF5).contains(&request_bytes) || !counts || bytes > 245 {
        return vec![UNIT, 0x94, 3];
    }
    if !groups.iter().all(|group| group.exists(files)) {
        return vec![UNIT, 0x94, 2];
    }
    let mut answer = vec![UNIT, 0x14, bytes as u8];
    for group in groups {
        let first = usize::from(group.record);
        let records = &files.file(group.file).unwrap()[first..first + usize::from(group.count)];
        answer.extend([1 + 2 * group.count as u8, 6]);
        answer.extend(words(records));
    }
    answer
}

/// What APP 6.15 answers to these groups, and what they change.
fn write_answer(files: &mut Files, groups: &[Group]) -> Vec<u8> {
    let bytes: usize = groups.iter().map(|group| 7 + 2 * group.values.len()).sum();
    let counts = groups
        .iter()
        .all(|group| group.count != 0 && usize::from(group.count) == group.values.len());
    if !(0x09..=0xFB).contains(&bytes) || !counts {
        return vec![UNIT, 0x95, 3];
    }
    if !groups.iter().all(Group::may_exist) {
        return vec![UNIT, 0x95, 2];
    }
    // The rest is the application's, group by group.
    for group in groups {
        if !group.exists(files) {
            return vec![UNIT, 0x95, 2];
        }
        if group.file == SMALL && group.values.contains(&UNWANTED) {
            return vec![UNIT, 0x95, 3];
        }
    }
    for group in groups {
        let first = usize::from(group.record);
        let records = match group.file {
            SMALL => &mut files.small,
            _ => &mut files.large,
        };
        records[first..first + group.values.len()].copy_from_slice(&group.values);
    }
    request(0x15, groups)
}

fn ask(files: &mut Files, request: &[u8]) -> Vec<u8> {
    ask_server(&Server::new(UNIT), files, request).expect("an answer")
}

fn place() -> impl Strategy<Value = (u8, u16, u16)> {
    let reference = prop_oneof![20 => Just(6u8), 1 => Just(5u8), 1 => Just(7u8)];
    let file = prop_oneof![8 => Just(SMALL), 8 => Just(LARGE), 1 => Just(0u16), 1 => Just(2u16)];
    let record = prop_oneof![8 => 0u16..12, 4 => 9_980u16..=10_002, 1 => 65_530u16..=65_535];
    (reference, file, record)
}

fn to_read() -> impl Strategy<Value = Group> {
    let count =
        prop_oneof![12 => 1u16..8, 2 => Just(0u16), 2 => 115u16..=124, 1 => 65_530u16..=65_535];
    (place(), count).prop_map(|((reference, file, record), count)| Group {
        reference,
        file,
        record,
        count,
        values: Vec::new(),
    })
}

fn to_write() -> impl Strategy<Value = Group> {
    let value = prop_oneof![20 => any::<u16>(), 1 => Just(UNWANTED)];
    let values = prop_oneof![
        12 => prop::collection::vec(value.clone(), 1..6),
        1 => prop::collection::vec(value, 0..2)
    ];
    (place(), values).prop_map(|((reference, file, record), values)| Group {
        reference,
        file,
        record,
        count: values.len() as u16,
        values,
    })
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 600, failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn reads_are_those_of_a_plain_reader(groups in prop::collection::vec(to_read(), 1..6)) {
        let mut files = Files::new();
        let expected = read_answer(&files, &groups);
        prop_assert_eq!(ask(&mut files, &request(0x14, &groups)), expected);
    }

    #[test]
    fn writes_are_those_of_a_plain_writer(groups in prop::collection::vec(to_write(), 1..5)) {
        let mut files = Files::new();
        let mut plain = Files::new();
        let expected = write_answer(&mut plain, &groups);
        prop_assert_eq!(ask(&mut files, &request(0x15, &groups)), expected);
        prop_assert!(files == plain);
    }
}

#[test]
fn a_read_has_1_to_35_groups_and_an_answer_of_245_bytes_at_most() {
    let mut files = Files::new();
    for groups in [1, 2, 34, 35] {
        let groups = vec![Group::read(LARGE, 9_999, 1); groups];
        let expected = read_answer(&files, &groups);
        assert_eq!(ask(&mut files, &request(0x14, &groups)), expected);
        assert_eq!(expected[1], 0x14);
    }
    // 121 registers make 244 bytes; with a second group the sum counts.
    for (counts, fits) in [
        (vec![121], true),
        (vec![122], false),
        (vec![60, 59], true),
        (vec![60, 60], true),
        (vec![60, 61], false),
        (vec![1, 1, 117], true),
        (vec![1, 1, 118], false),
    ] {
        let groups: Vec<_> = counts
            .iter()
            .map(|count| Group::read(LARGE, 7, *count))
            .collect();
        let answer = ask(&mut files, &request(0x14, &groups));
        assert_eq!(answer, read_answer(&files, &groups));
        assert_eq!(answer[1] == 0x14, fits, "{counts:?}");
    }
    let none = [UNIT, 0x14, 0];
    assert_eq!(ask(&mut files, &none), [UNIT, 0x94, 3]);
}

#[test]
fn a_write_is_251_bytes_of_groups_at_most() {
    for count in [1, 121, 122] {
        let mut files = Files::new();
        let mut plain = Files::new();
        let values: Vec<_> = (0..count).map(|value| value * 3).collect();
        let groups = [Group::write(LARGE, 10_000 - count, &values)];
        let expected = write_answer(&mut plain, &groups);
        assert_eq!(expected[1], 0x15);
        assert_eq!(ask(&mut files, &request(0x15, &groups)), expected);
        assert!(files == plain);
    }
    // Three groups of 9 bytes and one of 224: 251.
    let mut files = Files::new();
    let groups: Vec<_> = [vec![1], vec![2], vec![3], vec![4; 108]]
        .iter()
        .map(|values| Group::write(LARGE, 5, values))
        .collect();
    let longest = request(0x15, &groups[..3]);
    assert_eq!(ask(&mut files, &longest), longest);
    assert_eq!(files.large[5], 3, "the last group for a record wins");
}

#[test]
fn the_byte_count_is_that_of_the_frame() {
    for (code, groups) in [
        (
            0x14,
            vec![Group::read(SMALL, 0, 2), Group::read(SMALL, 3, 1)],
        ),
        (
            0x15,
            vec![
                Group::write(SMALL, 0, &[1, 2]),
                Group::write(SMALL, 3, &[4]),
            ],
        ),
    ] {
        let right = request(code, &groups);
        let refused = [UNIT, code | 0x80, 3];
        for wrong in [-2, -1, 1, 2] {
            let mut files = Files::new();
            let mut frame = right.clone();
            frame[2] = (i16::from(frame[2]) + wrong) as u8;
            assert_eq!(ask(&mut files, &frame), refused, "count {wrong}");
            let mut frame = right.clone();
            frame.resize((right.len() as i16 + wrong) as usize, 6);
            assert_eq!(ask(&mut files, &frame), refused, "length {wrong}");
            // Count and length agree, the groups do not.
            frame[2] = (i16::from(right[2]) + wrong) as u8;
            assert_eq!(ask(&mut files, &frame), refused, "both {wrong}");
            assert!(files == Files::new());
        }
        let mut files = Files::new();
        for len in 2..4 {
            assert_eq!(ask(&mut files, &right[..len]), refused, "{len} bytes");
        }
    }
}

#[test]
fn a_write_that_fails_is_exception_04() {
    let mut files = Files::new();
    files.broken = true;
    let write = request(0x15, &[Group::write(SMALL, 1, &[9])]);
    assert_eq!(ask(&mut files, &write), [UNIT, 0x95, 4]);
}

#[test]
fn files_are_not_for_broadcasts_but_for_writing() {
    let mut files = Files::new();
    let server = Server::new(UNIT);
    for (code, groups) in [
        (0x14, [Group::read(SMALL, 0, 1)]),
        (0x15, [Group::write(SMALL, 0, &[77])]),
        (0x15, [Group::write(2, 0, &[78])]),
    ] {
        let mut frame = request(code, &groups);
        frame[0] = 0;
        assert_eq!(ask_server(&server, &mut files, &frame), None);
    }
    assert_eq!(files.small[0], 77);
}

#[test]
fn a_queue_is_read_up_to_31_registers() {
    let read = [UNIT, 0x18, 1, 5];
    for count in 0..=33u16 {
        let mut files = Files::new();
        files.queue = (0..count).map(|place| 0x0A00 + place).collect();
        let expected = match count {
            0..=31 => {
                let mut answer = vec![UNIT, 0x18];
                answer.extend(words(&[2 + 2 * count, count]));
                answer.extend(words(&files.queue));
                answer
            }
            _ => vec![UNIT, 0x98, 3],
        };
        assert_eq!(ask(&mut files, &read), expected, "{count} queued");
        assert_eq!(files.queue.len(), usize::from(count), "they stay queued");
    }
    let mut files = Files::new();
    assert_eq!(ask(&mut files, &[UNIT, 0x18, 0, 5]), [UNIT, 0x98, 2]);
    assert_eq!(ask(&mut files, &[UNIT, 0x18, 1]), [UNIT, 0x98, 3]);
    assert_eq!(ask(&mut files, &[UNIT, 0x18, 1, 5, 0]), [UNIT, 0x98, 3]);
    let server = Server::new(UNIT);
    assert_eq!(ask_server(&server, &mut files, &[0, 0x18, 1, 5]), None);
}
