//! What is known of an instruction before it is executed: how long it takes, and whether it is one that Unicorn must not see.

/// Core clocks of an instruction, and its kind.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Instruction {
    /// Without those of a branch that is taken.
    pub clocks: u8,
    pub kind: Kind,
    /// It depends on an IT instruction: the core must not stop in front of it.
    pub conditional: bool,
    /// Its length in bytes.
    pub length: u8,
}

/// What is done about an instruction.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Kind {
    /// No special meaning.
    Ordinary,
    /// The instruction WFE.
    WaitForEvent,
    /// The instruction WFI.
    WaitForInterrupt,
    SendEvent,
    /// CPS: what is to become of PRIMASK and FAULTMASK.
    Mask {
        primask: bool,
        faultmask: bool,
        on: bool,
    },
    /// MSR: the special register, and the one it is set from.
    Set {
        special: u8,
        from: u8,
    },
    /// MRS of what Unicorn does not know.
    Get {
        special: u8,
        into: u8,
    },
    /// One that uses the floating-point unit.
    Float,
    SupervisorCall,
    Breakpoint,
    Undefined,
}

/// Clocks that a branch takes beyond its own, where it is taken: the pipeline is filled again (Cortex-M4 TRM r0p1, 3.3.1: P is 1 to 3).
pub(super) const REFILL: u64 = 2;
/// Clocks of a division, which are 2 to 12.
const DIVISION: u8 = 7;

/// All instructions of a piece of memory.
pub(super) struct Code {
    first: u32,
    table: Vec<Option<Instruction>>,
}

impl Code {
    /// That of `bytes` at `first`, each halfword as if an instruction began there.
    pub fn of(first: u32, bytes: &[u8]) -> Self {
        let (halves, _) = bytes.as_chunks();
        let halves: Vec<u16> = halves
            .iter()
            .map(|half| u16::from_le_bytes(*half))
            .collect();
        let half = |at: usize| halves.get(at).copied().unwrap_or(0);
        let mut table: Vec<_> = (0..halves.len())
            .map(|at| Some(decode(half(at), half(at + 1))))
            .collect();
        for at in 0..halves.len() {
            let mut next = at + 1;
            for _ in 0..covered(half(at)) {
                if let Some(Some(instruction)) = table.get_mut(next) {
                    instruction.conditional = true;
                }
                next += if is_long(half(next)) { 2 } else { 1 };
            }
        }
        Code { first, table }
    }

    /// The one at `address`; `None` if that is not in this memory.
    #[inline]
    pub fn at(&self, address: u32) -> Option<Instruction> {
        let place = address.wrapping_sub(self.first) / 2;
        self.table.get(place as usize).copied().flatten()
    }
}

/// Whether an instruction has 32 bits (ARMv7-M A5.1).
fn is_long(first: u16) -> bool {
    first >> 11 >= 0b11101
}

/// How many instructions depend on this one: 0 if it is not IT (ARMv7-M A7.7.37).
fn covered(first: u16) -> u32 {
    let mask = first & 0xF;
    if first & 0xFF00 != 0xBF00 || mask == 0 {
        return 0;
    }
    4 - mask.trailing_zeros()
}

/// Clocks after the table of instructions of the Cortex-M4 TRM (r0p1, 3.3.1), without wait states of the memories.
fn decode(first: u16, second: u16) -> Instruction {
    let (clocks, kind) = if is_long(first) {
        long(first, second)
    } else {
        short(first)
    };
    Instruction {
        clocks,
        kind,
        conditional: false,
        length: if is_long(first) { 4 } else { 2 },
    }
}

fn short(first: u16) -> (u8, Kind) {
    let several = |mask: u16| 1 + (first & mask).count_ones() as u8;
    match first {
        // Loads and stores of one register.
        0x4800..=0x9FFF => (2, Kind::Ordinary),
        // PUSH and POP, LDM and STM.
        0xB400..=0xB5FF | 0xBC00..=0xBDFF => (several(0x01FF), Kind::Ordinary),
        0xC000..=0xCFFF => (several(0x00FF), Kind::Ordinary),
        0xB660..=0xB67F => {
            let mask = Kind::Mask {
                primask: first & 2 != 0,
                faultmask: first & 1 != 0,
                on: first & 0x10 != 0,
            };
            (1, mask)
        }
        0xBE00..=0xBEFF => (1, Kind::Breakpoint),
        0xBF20 => (1, Kind::WaitForEvent),
        0xBF30 => (1, Kind::WaitForInterrupt),
        0xBF40 => (1, Kind::SendEvent),
        0xDE00..=0xDEFF => (1, Kind::Undefined),
        0xDF00..=0xDFFF => (1, Kind::SupervisorCall),
        _ => (1, Kind::Ordinary),
    }
}

fn long(first: u16, second: u16) -> (u8, Kind) {
    let several = 1 + second.count_ones() as u8;
    match (first, second) {
        (0xF3AF, 0x8002) => (1, Kind::WaitForEvent),
        (0xF3AF, 0x8003) => (1, Kind::WaitForInterrupt),
        (0xF3AF, 0x8004) => (1, Kind::SendEvent),
        (0xF7F0..=0xF7FF, 0xA000..=0xAFFF) => (1, Kind::Undefined),
        (0xF380..=0xF39F, 0x8000..=0x8FFF) => {
            let set = Kind::Set {
                special: second as u8,
                from: (first & 0xF) as u8,
            };
            (2, set)
        }
        (0xF3EF, 0x8000..=0x8FFF) => {
            let special = second as u8;
            let into = (second >> 8 & 0xF) as u8;
            // APSR, MSP, PRIMASK, BASEPRI and FAULTMASK are Unicorn's as well (ARMv7-M B5.1.1).
            let kind = match special {
                0 | 8 | 16..=19 => Kind::Ordinary,
                _ => Kind::Get { special, into },
            };
            (2, kind)
        }
        // TBB and TBH.
        (0xE8D0..=0xE8DF, _) if second & 0xFFE0 == 0xF000 => (2, Kind::Ordinary),
        (0xE800..=0xE9FF, _) => match first & 0x0040 {
            0 => (several, Kind::Ordinary),
            // LDRD and STRD have a second register where LDREX and its like have ones or an offset.
            _ if first & 0x0120 != 0 => (3, Kind::Ordinary),
            _ => (2, Kind::Ordinary),
        },
        (0xF800..=0xF9FF, _) => (2, Kind::Ordinary),
        (0xFB00..=0xFB0F, _) if second >> 12 != 0xF => (2, Kind::Ordinary),
        (0xFB90..=0xFB9F | 0xFBB0..=0xFBBF, _) => (DIVISION, Kind::Ordinary),
        // Coprocessors 10 and 11.
        (0xEC00..=0xEFFF | 0xFC00..=0xFFFF, _) if second & 0x0E00 == 0x0A00 => (2, Kind::Float),
        _ => (1, Kind::Ordinary),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn code(halves: &[u16]) -> Code {
        let bytes: Vec<u8> = halves.iter().flat_map(|half| half.to_le_bytes()).collect();
        Code::of(0x0800_0000, &bytes)
    }

    #[test]
    fn clocks_are_those_of_the_cores_manual() {
        for (halves, clocks) in [
            // movs r0, #5; ldr r0, [r1]; push {r4, lr}; pop {r4-r6, pc}
            (&[0x2005][..], 1),
            (&[0x6808], 2),
            (&[0xB510], 3),
            (&[0xBD70], 5),
            // ldmia.w r0, {r1-r4}; ldrd r0, r1, [r2]; ldrex r0, [r1]; udiv r0, r1, r2; mla r0, r1, r2, r3
            (&[0xE890, 0x001E], 5),
            (&[0xE9D2, 0x0100], 3),
            (&[0xE851, 0x0F00], 2),
            (&[0xFBB1, 0xF0F2], 7),
            (&[0xFB01, 0x3002], 2),
            // tbb [r0, r1]
            (&[0xE8D0, 0xF001], 2),
        ] {
            let found = code(halves).at(0x0800_0000).map(|found| found.clocks);
            assert_eq!(found, Some(clocks), "{halves:04x?}");
        }
    }

    #[test]
    fn what_depends_on_an_it_instruction_is_known() {
        // ite eq; ldr.w r0, [r1]; movne r0, #1; movs r0, #2
        let code = code(&[0xBF0C, 0xF8D1, 0x0000, 0x2001, 0x2002]);
        let found = [0, 2, 6, 8].map(|at| code.at(0x0800_0000 + at).expect("code").conditional);
        assert_eq!(found, [false, true, true, false]);
        assert_eq!(code.at(0x0800_000A), None);
        assert_eq!(code.at(0x07FF_FFFE), None);
    }

    #[test]
    fn special_instructions_are_known() {
        let kind = |halves: &[u16]| code(halves).at(0x0800_0000).map(|found| found.kind);
        let set = Kind::Set {
            special: 16,
            from: 9,
        };
        assert_eq!(kind(&[0xF389, 0x8810]), Some(set));
        let mask = Kind::Mask {
            primask: true,
            faultmask: false,
            on: true,
        };
        assert_eq!(kind(&[0xB672]), Some(mask));
        let get = Kind::Get {
            special: 5,
            into: 3,
        };
        assert_eq!(kind(&[0xF3EF, 0x8305]), Some(get));
        assert_eq!(kind(&[0xF3EF, 0x8310]), Some(Kind::Ordinary));
        assert_eq!(kind(&[0xBF20]), Some(Kind::WaitForEvent));
        assert_eq!(kind(&[0xEE00, 0x0A10]), Some(Kind::Float));
    }
}
