//! Exceptions and the system control space: which interrupt is taken when (ARMv7-M B1.5, B3.2 to B3.5).
//!
//! An exception is known by its number: 1 to 15 are the core's own, interrupt 0 is 16.

mod mpu;

use super::Fault;
use mpu::Mpu;

/// Exceptions of the STM32F405: those of the core and 82 interrupts (RM0090 12.2).
const EXCEPTIONS: usize = 16 + 82;

pub(super) const NMI: u8 = 2;
pub(super) const HARD_FAULT: u8 = 3;
pub(super) const MEM_MANAGE: u8 = 4;
pub(super) const BUS_FAULT: u8 = 5;
pub(super) const USAGE_FAULT: u8 = 6;
pub(super) const SV_CALL: u8 = 11;
const PEND_SV: u8 = 14;
const SYS_TICK: u8 = 15;

/// Bits of AIRCR (ARMv7-M B3.2.6).
const VECTKEY: u32 = 0x05FA;
const SYSRESETREQ: u32 = 1 << 2;

/// The highest four bits of a priority are there (PM0214 4.3.7).
const PRIORITY_BITS: u8 = 0xF0;

/// The priority of what is not an exception.
const THREAD: i16 = 256;

/// What a store has led to.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Asked {
    Nothing,
    /// A reset by SYSRESETREQ.
    Reset,
}

/// The interrupt controller and the system control block.
pub(super) struct Nvic {
    pending: u128,
    enabled: u128,
    /// The levels of the interrupt lines.
    lines: u128,
    /// Those that are active, the one that runs last.
    active: Vec<u8>,
    priorities: [u8; EXCEPTIONS],
    vtor: u32,
    prigroup: u8,
    scr: u32,
    ccr: u32,
    shcsr: u32,
    cfsr: u32,
    hfsr: u32,
    mmfar: u32,
    bfar: u32,
    cpacr: u32,
    demcr: u32,
    fpccr: u32,
    fpcar: u32,
    fpdscr: u32,
    pub mpu: Mpu,
    pub primask: bool,
    pub faultmask: bool,
    pub basepri: u8,
    /// An event waits for the next WFE.
    pub event: bool,
}

impl Nvic {
    /// As after a reset.
    pub fn new() -> Self {
        Nvic {
            pending: 0,
            enabled: 0,
            lines: 0,
            active: Vec::new(),
            priorities: [0; EXCEPTIONS],
            vtor: 0,
            prigroup: 0,
            scr: 0,
            // STKALIGN is set at reset on a Cortex-M4 (PM0214 4.4.7).
            ccr: 0x200,
            shcsr: 0,
            cfsr: 0,
            hfsr: 0,
            mmfar: 0,
            bfar: 0,
            cpacr: 0,
            demcr: 0,
            // ASPEN and LSPEN (PM0214 4.6.2).
            fpccr: 0xC000_0000,
            fpcar: 0,
            fpdscr: 0,
            mpu: Mpu::default(),
            primask: false,
            faultmask: false,
            basepri: 0,
            event: false,
        }
    }

    /// The level of the line of interrupt `irq`. A rising one makes it pending, and so does one that is high when its handler is
    /// over.
    pub fn set_line(&mut self, irq: u8, level: bool) {
        let bit = 1 << (16 + irq);
        if level && self.lines & bit == 0 {
            self.pending |= bit;
        }
        self.lines = if level {
            self.lines | bit
        } else {
            self.lines & !bit
        };
    }

    /// The exception that runs, 0 for none.
    pub fn running(&self) -> u8 {
        self.active.last().copied().unwrap_or(0)
    }

    /// Whether the memory protection unit is off, since a hard fault is handled (ARMv7-M B3.5.5, HFNMIENA).
    pub fn is_unguarded(&self) -> bool {
        self.mpu.ctrl & 2 == 0 && matches!(self.running(), NMI | HARD_FAULT)
    }

    /// An exception that does not depend on a line.
    pub fn pend(&mut self, exception: u8) {
        self.pending |= 1 << exception;
    }

    /// Where the handlers' addresses are.
    pub fn vectors(&self) -> u32 {
        self.vtor
    }

    fn priority(&self, exception: u8) -> i16 {
        match exception {
            NMI => -2,
            HARD_FAULT => -1,
            _ => i16::from(self.priorities[usize::from(exception)]),
        }
    }

    /// The part of a priority that decides who interrupts whom (ARMv7-M B3.2.6, PRIGROUP).
    fn group(&self, priority: i16) -> i16 {
        if priority < 0 || priority == THREAD {
            return priority;
        }
        priority >> (self.prigroup + 1) << (self.prigroup + 1)
    }

    /// The priority of what runs, masks included (ARMv7-M B1.5.4).
    fn execution_priority(&self, masked: bool) -> i16 {
        let active = self
            .active
            .iter()
            .map(|one| self.group(self.priority(*one)));
        let mut lowest = active.fold(THREAD, i16::min);
        if self.basepri != 0 {
            lowest = lowest.min(self.group(i16::from(self.basepri)));
        }
        if self.primask && masked {
            lowest = lowest.min(0);
        }
        if self.faultmask {
            lowest = lowest.min(-1);
        }
        lowest
    }

    fn candidate(&self) -> Option<(i16, u8)> {
        // Those of the core are not switched off here.
        let mut waiting = self.pending & (self.enabled | 0xFFFF);
        let mut first = None;
        while waiting != 0 {
            let exception = waiting.trailing_zeros() as u8;
            waiting &= waiting - 1;
            let found = (self.priority(exception), exception);
            if first.is_none_or(|first| found < first) {
                first = Some(found);
            }
        }
        first
    }

    /// The exception that is to be taken now.
    #[inline]
    pub fn due(&self) -> Option<u8> {
        if self.pending == 0 {
            return None;
        }
        let (priority, exception) = self.candidate()?;
        (self.group(priority) < self.execution_priority(true)).then_some(exception)
    }

    /// Whether WFI ends: as [`due`](Self::due), whatever PRIMASK is (ARMv7-M B1.5.19).
    pub fn wakes(&self) -> bool {
        let found = self.candidate();
        found.is_some_and(|(priority, _)| self.group(priority) < self.execution_priority(false))
    }

    /// An exception is taken.
    pub fn enter(&mut self, exception: u8) {
        self.pending &= !(1 << exception);
        self.active.push(exception);
        self.event = true;
    }

    /// The one that runs returns.
    pub fn leave(&mut self) {
        if let Some(exception) = self.active.pop() {
            self.pending |= self.lines & 1 << exception;
            if exception != NMI {
                self.faultmask = false;
            }
        }
        self.event = true;
    }

    /// A fault, with the bits of CFSR that tell of it and the address that it was at. Which exception it becomes; `None` if the
    /// core locks up.
    pub fn fault(&mut self, fault: Fault) -> Option<u8> {
        let (bits, exception, enabled) = match fault {
            Fault::Bus(at) => {
                self.bfar = at;
                // PRECISERR, BFARVALID.
                (0x8200, BUS_FAULT, 17)
            }
            Fault::Memory(at) => {
                self.mmfar = at;
                // DACCVIOL, MMARVALID.
                (0x82, MEM_MANAGE, 16)
            }
            // MSTKERR.
            Fault::Stacking => (0x10, MEM_MANAGE, 16),
            // IACCVIOL.
            Fault::Fetch => (0x01, MEM_MANAGE, 16),
            // UNDEFINSTR.
            Fault::Undefined => (1 << 16, USAGE_FAULT, 18),
            Fault::Breakpoint => {
                // DEBUGEVT: there is no debugger.
                self.hfsr |= 1 << 31;
                return self.escalated();
            }
        };
        self.cfsr |= bits;
        let priority = self.group(self.priority(exception));
        if self.shcsr >> enabled & 1 != 0 && priority < self.execution_priority(true) {
            return Some(exception);
        }
        // FORCED.
        self.hfsr |= 1 << 30;
        self.escalated()
    }

    fn escalated(&self) -> Option<u8> {
        (self.execution_priority(true) > -1).then_some(HARD_FAULT)
    }

    /// Registers from 0xE000E000 on, by their distance from there.
    pub fn read(&mut self, offset: u32) -> Option<u32> {
        let word = |bits: u128, first: u32| (bits >> (16 + (offset - first) / 4 * 32)) as u32;
        Some(match offset {
            // Interrupt lines in units of 32, less one.
            0x004 => 2,
            // SysTick is not used: it is off.
            0x010..=0x01C => 0,
            0x100..=0x108 => word(self.enabled, 0x100),
            0x180..=0x188 => word(self.enabled, 0x180),
            0x200..=0x208 => word(self.pending, 0x200),
            0x280..=0x288 => word(self.pending, 0x280),
            0x300..=0x308 => {
                let active = self.active.iter().fold(0_u128, |all, one| all | 1 << one);
                word(active, 0x300)
            }
            // r0p1.
            0xD00 => 0x410F_C241,
            0xD04 => {
                let pending = self.candidate().map_or(0, |(_, number)| u32::from(number));
                u32::from(self.running()) | pending << 12
            }
            0xD08 => self.vtor,
            0xD0C => 0xFA05_0000 | u32::from(self.prigroup) << 8,
            0xD10 => self.scr,
            0xD14 => self.ccr,
            0xD24 => self.shcsr,
            0xD28 => self.cfsr,
            0xD2C => self.hfsr,
            0xD34 => self.mmfar,
            0xD38 => self.bfar,
            0xD88 => self.cpacr,
            // Eight regions.
            0xD90 => 0x0800,
            0xD94 => self.mpu.ctrl,
            0xD98 => self.mpu.number,
            0xD9C => self.mpu.region().0,
            0xDA0 => self.mpu.region().1,
            0xDFC => self.demcr,
            0xF34 => self.fpccr,
            0xF38 => self.fpcar,
            0xF3C => self.fpdscr,
            _ => return None,
        })
    }

    /// Writes a register; `None` if it does not exist, or is not modelled.
    pub fn write(&mut self, offset: u32, value: u32) -> Option<Asked> {
        let bits = |first: u32| u128::from(value) << (16 + (offset - first) / 4 * 32);
        self.mpu.changed |= (0xD94..=0xDB8).contains(&offset);
        match offset {
            0x010..=0x01C if value == 0 => {}
            0x100..=0x108 => self.enabled |= bits(0x100),
            0x180..=0x188 => self.enabled &= !bits(0x180),
            0x200..=0x208 => self.pending |= bits(0x200),
            0x280..=0x288 => {
                self.pending &= !bits(0x280);
                // A line that is high makes it pending again.
                let active = self.active.iter().fold(0_u128, |all, one| all | 1 << one);
                self.pending |= self.lines & !active;
            }
            0xD04 => {
                for (bit, exception) in [(28, PEND_SV), (26, SYS_TICK), (31, NMI)] {
                    if value >> bit & 1 != 0 {
                        self.pend(exception);
                    }
                }
                for (bit, exception) in [(27, PEND_SV), (25, SYS_TICK)] {
                    if value >> bit & 1 != 0 {
                        self.pending &= !(1 << exception);
                    }
                }
            }
            0xD08 => self.vtor = value & 0x3FFF_FF80,
            0xD0C => {
                if value >> 16 != VECTKEY {
                    return Some(Asked::Nothing);
                }
                self.prigroup = (value >> 8 & 7) as u8;
                if value & SYSRESETREQ != 0 {
                    return Some(Asked::Reset);
                }
            }
            0xD10 => self.scr = value,
            0xD14 => self.ccr = value,
            0xD24 => self.shcsr = value,
            // Flags are cleared by ones.
            0xD28 => self.cfsr &= !value,
            0xD2C => self.hfsr &= !value,
            0xD34 => self.mmfar = value,
            0xD38 => self.bfar = value,
            0xD88 => self.cpacr = value,
            0xD94 => self.mpu.ctrl = value,
            0xD98 => self.mpu.number = value & 7,
            0xD9C | 0xDA4 | 0xDAC | 0xDB4 => {
                // VALID: the region is in the lowest bits.
                if value & 0x10 != 0 {
                    self.mpu.number = value & 7;
                }
                self.mpu.region_mut().0 = value & !0x1F;
            }
            0xDA0 | 0xDA8 | 0xDB0 | 0xDB8 => self.mpu.region_mut().1 = value,
            0xDFC => self.demcr = value,
            0xF34 => self.fpccr = value,
            0xF38 => self.fpcar = value,
            0xF3C => self.fpdscr = value,
            _ => return None,
        }
        Some(Asked::Nothing)
    }

    /// The byte of a priority register, of interrupts (0xE000E400 on) or of the core's own (0xE000ED18 on).
    fn priority_at(&mut self, offset: u32) -> Option<&mut u8> {
        let exception = match offset {
            0x400..=0x451 => 16 + offset - 0x400,
            0xD18..=0xD23 => 4 + offset - 0xD18,
            _ => return None,
        };
        Some(&mut self.priorities[exception as usize])
    }

    /// Reads `size` bytes of priorities; `None` if there are none.
    pub fn read_priorities(&mut self, offset: u32, size: u32) -> Option<u32> {
        let mut value = 0;
        for byte in 0..size {
            value |= u32::from(*self.priority_at(offset + byte)?) << (8 * byte);
        }
        Some(value)
    }

    /// Writes `size` bytes of priorities; whether there are some.
    pub fn write_priorities(&mut self, offset: u32, size: u32, value: u32) -> bool {
        for byte in 0..size {
            let Some(priority) = self.priority_at(offset + byte) else {
                return false;
            };
            *priority = (value >> (8 * byte)) as u8 & PRIORITY_BITS;
        }
        true
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Interrupts 37 (priority 0), 50 (0x10) and 28 (0x80), on, in groups of the highest bit.
    fn nvic() -> Nvic {
        let mut nvic = Nvic::new();
        nvic.write(0xD0C, 0x05FA_0600);
        for (irq, priority) in [(37, 0), (50, 0x10), (28, 0x80)] {
            assert!(nvic.write_priorities(0x400 + irq, 1, priority));
            nvic.write(0x100 + irq / 32 * 4, 1 << (irq % 32));
        }
        nvic
    }

    #[test]
    fn those_of_one_group_wait_for_each_other_and_the_higher_goes_first() {
        let mut nvic = nvic();
        assert_eq!(nvic.due(), None);
        nvic.set_line(28, true);
        assert_eq!(nvic.due(), Some(16 + 28));
        nvic.enter(16 + 28);
        nvic.set_line(50, true);
        assert_eq!(nvic.due(), Some(16 + 50));
        nvic.enter(16 + 50);
        nvic.set_line(37, true);
        assert_eq!(nvic.due(), None);
        nvic.set_line(50, false);
        nvic.leave();
        assert_eq!(nvic.due(), Some(16 + 37));
        nvic.primask = true;
        assert_eq!(nvic.due(), None);
        nvic.primask = false;
        nvic.enter(16 + 37);
        nvic.leave();
        // Its line is still high.
        assert_eq!(nvic.due(), Some(16 + 37));
    }

    #[test]
    fn primask_keeps_an_interrupt_off_but_ends_wfi() {
        let mut nvic = nvic();
        nvic.primask = true;
        assert!(!nvic.wakes());
        nvic.set_line(37, true);
        assert_eq!(nvic.due(), None);
        assert!(nvic.wakes());
    }

    #[test]
    fn a_fault_within_a_hard_fault_locks_the_core_up() {
        let mut nvic = nvic();
        assert_eq!(nvic.fault(Fault::Undefined), Some(HARD_FAULT));
        assert_eq!(nvic.read(0xD28), Some(1 << 16));
        assert_eq!(nvic.read(0xD2C), Some(1 << 30));
        nvic.enter(HARD_FAULT);
        assert_eq!(nvic.fault(Fault::Undefined), None);
        nvic.leave();
        nvic.write(0xD24, 1 << 18);
        assert_eq!(nvic.fault(Fault::Undefined), Some(USAGE_FAULT));
    }
}
