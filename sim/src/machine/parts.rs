//! What the instructions of an image are for, worked out from its symbols and debug information, so that the machine can
//! count them apart.

use std::path::{Path, PathBuf};

use addr2line::Context;
use addr2line::gimli::{self, DwarfSections, EndianSlice, LittleEndian, SectionId};
use object::{Object, ObjectSection, ObjectSymbol, SectionKind};

use crate::error::BusError;

/// The function in which the firmware waits for work (`board-stm32`, `platform/qemu.rs`).
const IDLE: &str = "multidrop_idle";

/// Parts of an image: addresses, first and last.
#[derive(Clone, Debug, Default)]
pub struct Parts {
    /// Where it waits for work.
    pub(super) idle: Option<(u64, u64)>,
    /// What is counted apart.
    pub(super) marked: Vec<(u64, u64)>,
    /// All handlers: where one begins, another is over.
    handlers: Vec<u64>,
    /// Those that are asked for, by name.
    pub(super) named: Vec<(String, u64)>,
}

impl Parts {
    /// The parts of `image`: where it waits, and all instructions that the compiler made of the source file whose path ends
    /// with `source`, wherever it put them; but those made of its functions `except` only where they were called from
    /// within that file. `handlers` are those functions of the vector table whose interrupts are asked for.
    ///
    /// # Errors
    /// [`BusError`], where the image cannot be read, has no such function, or no debug information.
    pub fn of(
        image: &Path,
        source: &str,
        except: &[&str],
        handlers: &[&str],
    ) -> Result<Self, BusError> {
        let bytes = std::fs::read(image).map_err(|source| BusError::Read {
            path: image.to_owned(),
            source,
        })?;
        let not_elf = |reason: String| BusError::NotElf {
            path: image.to_owned(),
            reason,
        };
        let elf = object::File::parse(&*bytes).map_err(|error| not_elf(error.to_string()))?;
        let function = |name: &str| {
            let mut symbols = elf.symbols();
            let symbol = symbols.find(|symbol| symbol.name() == Ok(name));
            let symbol = symbol.ok_or_else(|| BusError::NoSymbol(name.to_owned()))?;
            // The lowest bit tells that it is Thumb code (ELF for the Arm architecture, 5.5.3).
            Ok((symbol.address() & !1, symbol.size()))
        };
        let (idle, idle_len) = function(IDLE)?;
        let named = handlers
            .iter()
            .map(|&name| Ok((name.to_owned(), function(name)?.0)))
            .collect::<Result<_, BusError>>()?;
        let dwarf = |error: gimli::Error| not_elf(error.to_string());
        let sections = DwarfSections::load(|id: SectionId| {
            let section = elf.section_by_name(id.name());
            let data = section.and_then(|section| section.uncompressed_data().ok());
            Ok(data.unwrap_or_default())
        });
        let sections = sections.map_err(dwarf)?;
        let borrowed = sections.borrow(|data| EndianSlice::new(data, LittleEndian));
        let context = Context::from_dwarf(borrowed).map_err(dwarf)?;
        let mut marked: Vec<(u64, u64)> = Vec::new();
        for section in elf.sections() {
            if section.kind() != SectionKind::Text {
                continue;
            }
            let addresses = section.address()..section.address() + section.size();
            for address in addresses.step_by(2) {
                if (idle..idle + idle_len).contains(&address)
                    || !is_of(&context, address, source, except)
                {
                    continue;
                }
                match marked.last_mut() {
                    Some((_, last)) if *last + 1 == address => *last = address + 1,
                    _ => marked.push((address, address + 1)),
                }
            }
        }
        if marked.is_empty() {
            return Err(not_elf(format!("its debug information has no {source}")));
        }
        Ok(Parts {
            idle: Some((idle, idle + idle_len - 1)),
            marked,
            handlers: handlers_of(&elf),
            named,
        })
    }

    /// What the barrier is told, with a file of it in `folder`.
    pub(super) fn arguments(&self, folder: &Path) -> std::io::Result<String> {
        let mut arguments = String::new();
        if let Some((first, last)) = self.idle {
            arguments.push_str(&format!(",idle={first:x}-{last:x}"));
        }
        for address in &self.handlers {
            arguments.push_str(&format!(",handler={address:x}"));
        }
        if !self.marked.is_empty() {
            let marks: PathBuf = folder.join("marks");
            let lines = self.marked.iter();
            let lines = lines.map(|(first, last)| format!("{first:x}-{last:x}\n"));
            std::fs::write(&marks, lines.collect::<String>())?;
            arguments.push_str(&format!(",marks={}", marks.display()));
        }
        Ok(arguments)
    }
}

/// The handlers in the vector table, which is at the beginning of flash: a word for the stack, one for reset, then theirs
/// (ARMv7-M B1.5.3).
fn handlers_of(elf: &object::File<'_>) -> Vec<u64> {
    const FLASH: u64 = 0x0800_0000;
    let mut sections = elf.sections();
    let table = sections.find(|section| section.address() == FLASH && section.size() > 0);
    let table = table.and_then(|section| section.data().ok());
    let (words, _) = table.unwrap_or_default().as_chunks();
    let handlers = words.iter().skip(2).map(|word| u32::from_le_bytes(*word));
    let mut handlers: Vec<_> = handlers
        .filter(|address| *address != 0)
        .map(|address| u64::from(address & !1))
        .collect();
    handlers.sort_unstable();
    handlers.dedup();
    handlers
}

type Slice<'a> = EndianSlice<'a, LittleEndian>;

/// Whether the instruction at `address` was made of `source`: itself, or a function that was put into one of there. The
/// outermost function of the file decides about `except`.
fn is_of(context: &Context<Slice<'_>>, address: u64, source: &str, except: &[&str]) -> bool {
    let Ok(mut frames) = context.find_frames(address).skip_all_loads() else {
        return false;
    };
    let mut found = false;
    while let Ok(Some(frame)) = frames.next() {
        let file = frame.location.and_then(|location| location.file);
        if !file.is_some_and(|file| file.ends_with(source)) {
            continue;
        }
        let name = frame.function.as_ref().map(|name| name.demangle());
        found = !name.is_some_and(|name| {
            let name = name.unwrap_or_default();
            let last = name.rsplit("::").next();
            except.iter().any(|except| last == Some(*except))
        });
    }
    found
}

/// Instructions that a machine has executed.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Instructions {
    /// All instructions together.
    pub all: u64,
    /// While it waited for work.
    pub idle: u64,
    /// Those that are counted apart.
    pub marked: u64,
}

impl Instructions {
    /// Those that did something.
    pub fn work(self) -> u64 {
        self.all - self.idle
    }
}

impl std::ops::Sub for Instructions {
    type Output = Self;

    fn sub(self, earlier: Self) -> Self {
        Instructions {
            all: self.all - earlier.all,
            idle: self.idle - earlier.idle,
            marked: self.marked - earlier.marked,
        }
    }
}
