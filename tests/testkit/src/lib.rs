//! What the tests of several crates share.
//!
//! Always there: the [server](plain) and the [client](reference_client) as the standard has them, a [line without
//! hardware](harness) around the protocol's state machine, the [suite for a chip's driver](line_chip) with a [made-up
//! chip](made_up), [frames] and a [model] of the image `registers`. What is expected
//! is never worked out by the code under test: a fault there must not excuse itself.
//!
//! With the feature `bus`, which builds the simulators: images, the rules of the bus, a rig of one node and one host, and
//! what else runs firmware on the simulated bus.
#![allow(
    clippy::new_without_default,
    clippy::should_implement_trait,
    reason = "models at boot are no defaults, and a source of numbers is no iterator"
)]

pub mod frames;
pub mod harness;
pub mod line_chip;
pub mod made_up;
pub mod model;
pub mod plain;
pub mod reference_client;

#[cfg(feature = "bus")]
pub mod assembler;
#[cfg(feature = "bus")]
pub mod conforms;
#[cfg(feature = "bus")]
pub mod four;
#[cfg(feature = "bus")]
mod images;
#[cfg(feature = "bus")]
pub mod pair;
#[cfg(feature = "bus")]
pub mod places;
#[cfg(feature = "bus")]
pub mod random;
#[cfg(feature = "bus")]
pub mod rig;
#[cfg(feature = "bus")]
mod rules;
#[cfg(feature = "bus")]
mod runner;
#[cfg(feature = "bus")]
pub mod traffic;

#[cfg(feature = "bus")]
pub use on_bus::*;

/// What most tests on the bus need.
#[cfg(feature = "bus")]
mod on_bus {
    pub use crate::images::{
        conformance, example, example_at, faults, guarded, image, ports, registers, stm32_example,
        stm32_registers, stm32_registers_at,
    };
    pub use crate::rig::Rig;
    pub use crate::rules::{DE_LAG, Rules, assert_bus_rules};
    pub use crate::runner::Runner;

    use multidrop_bus::{Format, Line};

    /// 38400 8N1, what images are built for unless told otherwise.
    pub const LINE: Line = Line::n81(38_400);

    /// Every line that the timing tests run at.
    pub fn lines() -> impl Iterator<Item = Line> {
        [9_600, 19_200, 38_400, 115_200]
            .into_iter()
            .flat_map(|baud| [Format::N81, Format::E81].map(|format| Line { baud, format }))
    }
}
