//! Exceptions: what is kept on the stack, and how the core comes back (ARMv7-M B1.5).

use super::Fault;
use super::unicorn::Register;
use super::{Silicon, State};

/// Clocks from an interrupt to the first instruction of its handler, back from there, and from one handler to the next one
/// (Cortex-M4 TRM r0p1, 3.9.1).
const ENTRY: u64 = 12;
const EXIT: u64 = 10;
const TAIL_CHAIN: u64 = 6;

impl Silicon {
    pub(super) fn fault(&mut self, fault: Fault) {
        match self.chip_mut().nvic.fault(fault) {
            Some(exception) => self.chip_mut().nvic.pend(exception),
            None => self.state = State::LockedUp,
        }
    }

    /// ARMv7-M B1.5.6 to B1.5.8.
    pub(super) fn enter(&mut self, exception: u8) {
        let from = self.chip().nvic.running();
        let float = self.chip().float;
        let sp = self.core.get(Register::Sp);
        let bytes = if float { 0x68 } else { 0x20 };
        let frame = (sp - bytes) & !7;
        let padded = u32::from(sp & 4 != 0) << 9;
        let mut words = Vec::new();
        for register in [0, 1, 2, 3, 12].map(Register::R) {
            words.push(self.core.get(register));
        }
        words.push(self.core.get(Register::Lr));
        words.push(self.pc);
        let flags = self.core.get(Register::Xpsr) & 0xF80F_0000;
        words.push(flags | 0x0100_0000 | padded | u32::from(from));
        if float {
            words.extend((0..16).map(|number| self.core.get(Register::S(number))));
            words.push(self.core.get(Register::Fpscr));
        }
        let bytes: Vec<u8> = words.iter().flat_map(|word| word.to_le_bytes()).collect();
        let last = frame + bytes.len() as u32 - 1;
        let mut exception = exception;
        let unguarded = self.chip().nvic.is_unguarded();
        if !unguarded && (self.guarded.iter()).any(|guard| frame <= guard.1 && last >= guard.0) {
            // Nothing is kept, and the fault is taken first (ARMv7-M B1.5.14).
            match self.chip_mut().nvic.fault(Fault::Stacking) {
                Some(fault) if fault < exception => exception = fault,
                _ => {}
            }
        } else if !self.core.store(frame, &bytes) {
            // The stack has run over: nothing can be kept of what was interrupted.
            self.state = State::LockedUp;
            return;
        }
        self.core.set(Register::Sp, frame);
        let back = match (from, float) {
            (0, false) => 0xFFFF_FFF9,
            (0, true) => 0xFFFF_FFE9,
            (_, false) => 0xFFFF_FFF1,
            (_, true) => 0xFFFF_FFE1,
        };
        self.chip_mut().float = false;
        self.handle(exception, back, ENTRY);
    }

    /// The number of clocks in which the handler of an exception, which returns to `back`, is reached.
    fn handle(&mut self, exception: u8, back: u32, clocks: u64) {
        self.core.set(Register::Lr, back);
        let table = match self.chip().nvic.vectors() {
            0 => self.vectors,
            table => table,
        };
        self.pc = self.word(table + 4 * u32::from(exception)) & !1;
        let chip = self.core.board_mut();
        chip.nvic.enter(exception);
        chip.spend(clocks);
    }

    pub(super) fn leave(&mut self, back: u32) {
        let nvic = &mut self.chip_mut().nvic;
        nvic.leave();
        let faultmask = u32::from(nvic.faultmask);
        self.core.set(Register::Faultmask, faultmask);
        let nvic = &mut self.chip_mut().nvic;
        if let Some(next) = nvic.due() {
            // What is kept on the stack stays there.
            return self.handle(next, back, TAIL_CHAIN);
        }
        let float = back & 0x10 == 0;
        let frame = self.core.get(Register::Sp);
        let word = |place: u32| self.word(frame + 4 * place);
        let kept = [0, 1, 2, 3, 4, 5, 6, 7].map(word);
        let floats: Vec<u32> = (8..25).map(word).collect();
        for (register, value) in [0, 1, 2, 3, 12].into_iter().zip(kept) {
            self.core.set(Register::R(register), value);
        }
        self.core.set(Register::Lr, kept[5]);
        self.pc = kept[6] & !1;
        let xpsr = kept[7];
        self.core
            .set(Register::Xpsr, xpsr & 0xF80F_0000 | 0x0100_0000);
        if float {
            for (number, value) in (0..16).zip(&floats) {
                self.core.set(Register::S(number), *value);
            }
            self.core.set(Register::Fpscr, floats[16]);
        }
        let bytes = if float { 0x68 } else { 0x20 };
        let padding = if xpsr >> 9 & 1 != 0 { 4 } else { 0 };
        self.core.set(Register::Sp, frame + bytes + padding);
        let chip = self.core.board_mut();
        chip.float = float;
        chip.spend(EXIT);
    }
}
