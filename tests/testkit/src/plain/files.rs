//! File records (APP 6.14, 6.15): file 4 of the conformance map, where there is one, and file 5 of
//! [`super::Plain::with_extras`], which is read only.

/// One group of a request: the records it is about, and what it writes to them.
struct Group<'a> {
    reference: u8,
    file: u16,
    first: u16,
    count: usize,
    data: &'a [u8],
}

/// The groups behind a byte count that must be in `limits`.
fn groups(
    data: &[u8],
    limits: std::ops::RangeInclusive<u8>,
    with_data: bool,
) -> Result<Vec<Group<'_>>, u8> {
    let (count, mut rest) = data.split_first().ok_or(3)?;
    if !limits.contains(count) || rest.len() != usize::from(*count) {
        return Err(3);
    }
    let mut groups = Vec::new();
    while !rest.is_empty() {
        let (head, behind) = rest.split_first_chunk::<7>().ok_or(3)?;
        let word = |at: usize| u16::from_be_bytes([head[at], head[at + 1]]);
        let count = usize::from(word(5));
        let bytes = if with_data { 2 * count } else { 0 };
        if count == 0 || bytes > behind.len() {
            return Err(3);
        }
        let (data, behind) = behind.split_at(bytes);
        groups.push(Group {
            reference: head[0],
            file: word(1),
            first: word(3),
            count,
            data,
        });
        rest = behind;
    }
    Ok(groups)
}

fn exists(group: &Group<'_>, records: &[u16]) -> bool {
    let end = usize::from(group.first) + group.count;
    group.reference == 6 && group.file == 4 && end <= records.len()
}

/// FC 14, all that follows the function code.
pub fn read(records: &[u16], extras: bool, data: &[u8]) -> Result<Vec<u8>, u8> {
    let groups = groups(data, 0x07..=0xf5, false)?;
    let answered: usize = groups.iter().map(|group| 2 + 2 * group.count).sum();
    if answered > 245 {
        return Err(3);
    }
    let mut answer = vec![answered as u8];
    for group in groups {
        let (first, count) = (usize::from(group.first), group.count);
        let high = extras && group.reference == 6 && group.file == 5;
        let values: Vec<u16> = if exists(&group, records) {
            records[first..first + count].to_vec()
        } else if high && first >= 9_990 && first + count <= 10_000 {
            (first..first + count).map(|record| record as u16).collect()
        } else {
            return Err(2);
        };
        answer.extend([1 + 2 * count as u8, 6]);
        answer.extend(values.iter().flat_map(|value| value.to_be_bytes()));
    }
    Ok(answer)
}

/// FC 15, all that follows the function code: all groups or none.
pub fn write(records: &mut [u16], data: &[u8]) -> Result<Vec<u8>, u8> {
    let groups = groups(data, 0x09..=0xfb, true)?;
    if !groups.iter().all(|group| exists(group, records)) {
        return Err(2);
    }
    for group in groups {
        let first = usize::from(group.first);
        for (record, pair) in records[first..].iter_mut().zip(group.data.chunks(2)) {
            *record = u16::from_be_bytes([pair[0], pair[1]]);
        }
    }
    Ok(data.to_vec())
}
