//! What a request looks like on the line, and whether it may be sent.

use super::{Ask, SUBS, words};
use multidrop_protocol::client::FileRange;

impl Ask {
    /// The frame to `unit`, without its check; `None` if it may not be sent.
    pub fn frame(&self, unit: u8) -> Option<Vec<u8>> {
        let block = |first: u16, count: usize, limit: usize| {
            (1..=limit).contains(&count) && usize::from(first) + count <= 65536
        };
        let mut frame = vec![unit];
        let mut reads = false;
        match self {
            Ask::Bits {
                inputs,
                first,
                count,
            } => {
                reads = true;
                frame.push(if *inputs { 2 } else { 1 });
                words(&mut frame, &[*first, *count]);
                if !block(*first, (*count).into(), 2000) {
                    return None;
                }
            }
            Ask::Registers {
                inputs,
                first,
                count,
            } => {
                reads = true;
                frame.push(if *inputs { 4 } else { 3 });
                words(&mut frame, &[*first, *count]);
                if !block(*first, (*count).into(), 125) {
                    return None;
                }
            }
            Ask::Coil { address, on } => {
                frame.push(5);
                words(&mut frame, &[*address, if *on { 0xFF00 } else { 0 }]);
            }
            Ask::Register { address, value } => {
                frame.push(6);
                words(&mut frame, &[*address, *value]);
            }
            Ask::Status => {
                reads = true;
                frame.push(7);
            }
            Ask::Query { data } => {
                reads = true;
                frame.extend([8, 0, 0]);
                frame.extend(data);
            }
            Ask::Diagnostic { place, character } => {
                let (sub, mut data, value) = SUBS[usize::from(place % 15)];
                if sub == 3 {
                    data = u16::from(*character) * 256;
                }
                reads = value;
                frame.push(8);
                words(&mut frame, &[sub, data]);
            }
            Ask::Counter => {
                reads = true;
                frame.push(0x0B);
            }
            Ask::Log => {
                reads = true;
                frame.push(0x0C);
            }
            Ask::Coils { first, values } => {
                if !block(*first, values.len(), 1968) {
                    return None;
                }
                frame.push(0x0F);
                words(&mut frame, &[*first, values.len() as u16]);
                let mut packed = vec![0; values.len().div_ceil(8)];
                for (place, on) in values.iter().enumerate() {
                    if *on {
                        packed[place / 8] |= 1 << (place % 8);
                    }
                }
                frame.push(packed.len() as u8);
                frame.extend(packed);
            }
            Ask::Packed {
                first,
                count,
                bytes,
            } => {
                let count = usize::from(*count);
                if !block(*first, count, 1968) || bytes.len() != count.div_ceil(8) {
                    return None;
                }
                frame.push(0x0F);
                words(&mut frame, &[*first, count as u16]);
                frame.push(bytes.len() as u8);
                let begin = frame.len();
                frame.extend(bytes);
                for place in count..8 * bytes.len() {
                    frame[begin + place / 8] &= !(1 << (place % 8));
                }
            }
            Ask::Write { first, values } => {
                if !block(*first, values.len(), 123) {
                    return None;
                }
                frame.push(0x10);
                words(&mut frame, &[*first, values.len() as u16]);
                frame.push(2 * values.len() as u8);
                words(&mut frame, values);
            }
            Ask::Id => {
                reads = true;
                frame.push(0x11);
            }
            Ask::ReadFile { groups } => {
                reads = true;
                let asked: usize = groups.len() * 7;
                let answer: usize = groups
                    .iter()
                    .map(|group| 2 + 2 * usize::from(group.count))
                    .sum();
                let right = |group: &FileRange| {
                    group.file != 0
                        && group.count != 0
                        && u32::from(group.record) + u32::from(group.count) <= 10_000
                };
                if !(7..=0xF5).contains(&asked) || answer > 0xF5 || !groups.iter().all(right) {
                    return None;
                }
                frame.extend([0x14, asked as u8]);
                for group in groups {
                    frame.push(6);
                    words(&mut frame, &[group.file, group.record, group.count]);
                }
            }
            Ask::WriteFile { groups } => {
                let len: usize = groups.iter().map(|group| 7 + 2 * group.2.len()).sum();
                let right = |(file, record, values): &(u16, u16, Vec<u16>)| {
                    *file != 0
                        && !values.is_empty()
                        && usize::from(*record) + values.len() <= 10_000
                };
                if !(9..=0xFB).contains(&len) || !groups.iter().all(right) {
                    return None;
                }
                frame.extend([0x15, len as u8]);
                for (file, record, values) in groups {
                    frame.push(6);
                    words(&mut frame, &[*file, *record, values.len() as u16]);
                    words(&mut frame, values);
                }
            }
            Ask::Mask { address, and, or } => {
                frame.push(0x16);
                words(&mut frame, &[*address, *and, *or]);
            }
            Ask::Both {
                first,
                count,
                write_first,
                values,
            } => {
                reads = true;
                if !block(*first, (*count).into(), 125) || !block(*write_first, values.len(), 121) {
                    return None;
                }
                frame.push(0x17);
                words(
                    &mut frame,
                    &[*first, *count, *write_first, values.len() as u16],
                );
                frame.push(2 * values.len() as u8);
                words(&mut frame, values);
            }
            Ask::Fifo { pointer } => {
                reads = true;
                frame.push(0x18);
                words(&mut frame, &[*pointer]);
            }
            Ask::Device { code, object } => {
                reads = true;
                if !(1..=4).contains(code) {
                    return None;
                }
                frame.extend([0x2B, 0x0E, *code, *object]);
            }
            Ask::Raw { function, data } => {
                if !(1..=127).contains(function) {
                    return None;
                }
                frame.push(*function);
                frame.extend(data);
            }
        }
        (unit <= 247 && !(reads && unit == 0) && frame.len() <= 254).then_some(frame)
    }
}
