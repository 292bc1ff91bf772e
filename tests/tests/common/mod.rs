//! What the tests of the Nano's firmware share: images, frames, a plain model of the tables, the
//! rules of the bus, and a rig of one node and one host.
//!
//! Nothing here uses the firmware's own protocol crate: a fault there must not excuse itself.
#![allow(dead_code, unused_imports, reason = "each test binary uses a part")]

pub mod conforms;
pub mod four;
pub mod frames;
mod images;
pub mod model;
pub mod pair;
pub mod plain;
pub mod random;
pub mod rig;
mod rules;
mod runner;

pub use images::{
    conformance, example, example_at, faults, guarded, image, ports, registers, stm32_example,
    stm32_registers, stm32_registers_at,
};
pub use rig::Rig;
pub use rules::{DE_LAG, Rules, assert_bus_rules};
pub use runner::Runner;
pub(crate) use runner::on_both;

use multidrop_bus::{Format, Line};

/// 38400 8N1, what images are built for unless told otherwise.
pub const LINE: Line = Line::n81(38_400);

/// Every line that the timing tests run at.
pub fn lines() -> impl Iterator<Item = Line> {
    [9_600, 19_200, 38_400, 115_200]
        .into_iter()
        .flat_map(|baud| [Format::N81, Format::E81].map(|format| Line { baud, format }))
}
