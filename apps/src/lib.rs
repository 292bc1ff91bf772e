//! What the applications of all boards share: the data model of each, and the [options] of a build.
#![no_std]
#![forbid(unsafe_code)]

pub mod conformance;
pub mod demo_unit;
pub mod faults;
pub mod options;
pub mod ports;
pub mod yardstick;
