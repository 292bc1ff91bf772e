//! File records: functions 14, 15.

use super::{AnswerError, Draft, Request, RequestError, counted, length};
use crate::data::Registers;
use crate::function::{self, REFERENCE_TYPE as REFERENCE};

/// Bytes before the data of a group: reference type, file, record, length.
const GROUP: usize = 7;

/// A group of file records to be read.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct FileRange {
    /// The file number, from 1.
    pub file: u16,
    /// The number of the first record, 0..=9999.
    pub record: u16,
    /// The number of records, from 1.
    pub count: u16,
}

/// A group of file records to be written.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct FileData<'a> {
    /// The file number, from 1.
    pub file: u16,
    /// The number of the first record, 0..=9999.
    pub record: u16,
    /// The new values of the records, at least one.
    pub values: &'a [u16],
}

/// Read File Record (APP 6.14): one or more groups.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ReadFiles<'a> {
    /// The groups to read: as many as fit in the request, and their records in the answer.
    pub groups: &'a [FileRange],
}

impl ReadFiles<'_> {
    /// The values in the answer, group by group in the order of the request.
    ///
    /// # Errors
    ///
    /// [`AnswerError`] if the groups of the answer do not fit those of the request.
    pub fn answer<'a>(&self, frame: &'a [u8]) -> Result<FileRecords<'a>, AnswerError> {
        let all = counted(frame)?;
        let mut rest = all;
        for group in self.groups {
            let bytes = 1 + 2 * usize::from(group.count);
            let [len, reference, ..] = rest else {
                return Err(length(frame));
            };
            if usize::from(*len) != bytes || *reference != REFERENCE {
                return Err(AnswerError::Content);
            }
            rest = rest.get(1 + bytes..).ok_or(length(frame))?;
        }
        if !rest.is_empty() {
            return Err(length(frame));
        }
        Ok(FileRecords { bytes: all })
    }
}

impl Request for ReadFiles<'_> {
    fn encode(&self, draft: &mut Draft<'_>) -> Result<(), RequestError> {
        draft.read(function::READ_FILE_RECORD)?;
        fits(GROUP * self.groups.len())?;
        let mut answer = 0;
        for group in self.groups {
            check_group(group.file, group.record, group.count.into())?;
            answer += 2 + 2 * usize::from(group.count);
        }
        fits(answer)?;
        draft.byte((GROUP * self.groups.len()) as u8);
        for group in self.groups {
            put_group(draft, group.file, group.record, group.count);
        }
        Ok(())
    }

    fn check(&self, frame: &[u8]) -> Result<(), AnswerError> {
        self.answer(frame).map(|_| ())
    }
}

/// The groups of an answer to [`ReadFiles`].
#[derive(Clone, Copy, Debug)]
pub struct FileRecords<'a> {
    bytes: &'a [u8],
}

impl<'a> Iterator for FileRecords<'a> {
    type Item = Registers<'a>;

    fn next(&mut self) -> Option<Registers<'a>> {
        let (&len, rest) = self.bytes.split_first()?;
        let group = rest.get(1..usize::from(len))?;
        self.bytes = rest.get(usize::from(len)..)?;
        Some(Registers::new(group))
    }
}

/// Write File Record (APP 6.15): one or more groups, of which all or none are written.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct WriteFiles<'a> {
    /// The groups to write, as many as fit in the request.
    pub groups: &'a [FileData<'a>],
}

impl WriteFiles<'_> {
    fn len(&self) -> usize {
        let lens = self.groups.iter();
        lens.map(|group| GROUP + 2 * group.values.len()).sum()
    }
}

impl Request for WriteFiles<'_> {
    fn encode(&self, draft: &mut Draft<'_>) -> Result<(), RequestError> {
        for group in self.groups {
            check_group(group.file, group.record, group.values.len())?;
        }
        let len = self.len();
        if !(WRITE_MIN..=WRITE_MAX).contains(&len) {
            return Err(RequestError::Data {
                len: len.min(usize::from(u16::MAX)) as u16,
                max: WRITE_MAX as u16,
            });
        }
        draft.byte(function::WRITE_FILE_RECORD);
        draft.byte(len as u8);
        for group in self.groups {
            put_group(draft, group.file, group.record, group.values.len() as u16);
            draft.words(group.values);
        }
        Ok(())
    }

    fn check(&self, frame: &[u8]) -> Result<(), AnswerError> {
        let mut rest = counted(frame)?;
        if rest.len() != self.len() {
            return Err(length(frame));
        }
        for group in self.groups {
            let Some((heard, behind)) = rest.split_at_checked(GROUP + 2 * group.values.len())
            else {
                return Err(length(frame));
            };
            let (head, values) = heard.split_at(GROUP);
            let words = [group.file, group.record, group.values.len() as u16];
            if head[0] != REFERENCE
                || !Registers::new(&head[1..]).iter().eq(words)
                || !Registers::new(values)
                    .iter()
                    .eq(group.values.iter().copied())
            {
                return Err(AnswerError::Content);
            }
            rest = behind;
        }
        Ok(())
    }
}

/// The largest byte count of Read File Record, in request and answer (APP 6.14).
const READ_MAX: usize = 0xF5;
/// The smallest byte count of Write File Record (APP 6.15).
const WRITE_MIN: usize = 0x09;
/// The largest byte count of Write File Record (APP 6.15).
const WRITE_MAX: usize = 0xFB;

/// Checks the byte count of a read, of request or answer. One group has at least the smallest byte count.
fn fits(bytes: usize) -> Result<(), RequestError> {
    if (1..=READ_MAX).contains(&bytes) {
        Ok(())
    } else {
        Err(RequestError::Data {
            len: bytes.min(usize::from(u16::MAX)) as u16,
            max: READ_MAX as u16,
        })
    }
}

fn check_group(file: u16, record: u16, count: usize) -> Result<(), RequestError> {
    if file == 0 {
        return Err(RequestError::File { file });
    }
    if count == 0 || count > READ_MAX / 2 {
        return Err(RequestError::Count {
            count: count.min(usize::from(u16::MAX)) as u16,
            max: (READ_MAX / 2) as u16,
        });
    }
    if usize::from(record) + count > usize::from(function::RECORD_MAX) + 1 {
        return Err(RequestError::Record {
            record,
            count: count as u16,
        });
    }
    Ok(())
}

fn put_group(draft: &mut Draft<'_>, file: u16, record: u16, count: u16) {
    draft.byte(REFERENCE);
    draft.word(file);
    draft.word(record);
    draft.word(count);
}
