//! The data of the application `registers`: `COUNT` of each table from address 0.

use multidrop::prelude::*;

// ANCHOR: tables
/// Holding registers and coils are kept, all 0 and off at first; inputs follow from their address. `BYTES` is what `COUNT` coils take.
///
/// # Panics
/// At compile time, if it is not.
#[inline(always)]
pub fn yardstick<const COUNT: usize, const BYTES: usize>() -> impl DataModel {
    const {
        assert!(
            BYTES == COUNT.div_ceil(8),
            "a byte for each eight coils begun"
        )
    };
    Tables::new()
        .holding(Bank::<COUNT>::new(0))
        .inputs(Computed::<0, COUNT, _>(|address| 0x1000 + address))
        .coils(CoilBank::<BYTES>::new(0, COUNT as u16))
        .discrete(Computed::<0, COUNT, _>(|address| address % 3 == 0))
}
// ANCHOR_END: tables
