//! The memory protection unit (ARMv7-M B3.5).

/// The memory protection unit's registers (ARMv7-M B3.5).
#[derive(Clone, Debug, Default)]
pub(in crate::machine::core) struct Mpu {
    pub(super) ctrl: u32,
    pub(super) number: u32,
    /// RBAR and RASR of each region.
    regions: [(u32, u32); 8],
    /// Whether it was written to.
    pub changed: bool,
}

impl Mpu {
    /// Where privileged code may not store (ARMv7-M B3.5.9): first and last address of each region that is on and says so. Regions
    /// over others, which have a say there, and those of subregions are not modelled: `None`.
    pub fn guarded(&self) -> Option<Vec<(u32, u32)>> {
        if self.ctrl & 1 == 0 {
            return Some(Vec::new());
        }
        let on = self.regions.iter().filter(|(_, rasr)| rasr & 1 != 0);
        let mut guarded = Vec::new();
        for (rbar, rasr) in on {
            let last = (2_u64 << (rasr >> 1 & 0x1F)) as u32 - 1;
            let writes = matches!(rasr >> 24 & 7, 1..=3);
            if rasr & 0xFF00 != 0 || rbar & last != 0 || writes {
                return None;
            }
            guarded.push((*rbar, rbar + last));
        }
        // PRIVDEFENA: elsewhere all is as without the unit.
        (self.ctrl & 4 != 0).then_some(guarded)
    }

    pub(super) fn region(&self) -> (u32, u32) {
        self.regions[self.number as usize]
    }

    pub(super) fn region_mut(&mut self) -> &mut (u32, u32) {
        &mut self.regions[self.number as usize]
    }
}
