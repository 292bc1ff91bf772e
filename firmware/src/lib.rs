//! Managed serial ports that speak Modbus, on Embassy, for any chip.
//!
//! A board implements [`Line`] for its USART. This crate has the layers above the line: the port and its
//! configuration, the task that takes frames from the line ([`receive()`]) and the task that answers them
//! ([`serve()`]). The two tasks share one `embassy_sync` channel. [`server!`] makes tasks of both functions, and
//! [`client!`] those of a client; [`tasks!`] is for applications with more. [`Tables`] is the data model of a server
//! that needs banks and nothing else. The names for all of this are in the [`prelude`].
//!
//! Half duplex means one frame at a time. The line owns one buffer and lends it: from the interrupt to the receive
//! task, on to the serve task, and back. Frames are never copied.
#![no_std]
#![deny(unsafe_code)]

pub mod client;
pub mod config;
pub mod line;
pub mod managed;
pub mod manager;
pub mod poll;
pub mod port;
pub mod prelude;
pub mod receive;
pub mod roll;
pub mod route;
pub mod serve;
pub mod shared;
mod slot;
pub mod sniff;
pub mod stack;
pub mod tables;
mod tasks;

pub use client::{Client, ClientConfig, ClientError, ClientPort, client_receive};
pub use config::PortConfig;
pub use line::{Frame, InterCharacter, Line, LineConfig, Released, Role};
pub use managed::{ManagedPort, managed_receive, managed_run, managed_serve};
pub use manager::Manager;
pub use multidrop_protocol as protocol;
pub use multidrop_protocol::server::ResetCause;
pub use port::ServerPort;
pub use receive::receive;
pub use roll::{Roll, signed};
pub use route::{Route, Router, route};
pub use serve::serve;
pub use shared::Shared;
pub use stack::Stack;
pub use tables::Tables;

/// Compiles and runs the example of the README.
#[cfg(doctest)]
#[doc = include_str!("../README.md")]
struct Readme;

#[cfg(feature = "defmt")]
const _: () = {
    const fn can_be_logged<T: defmt::Format>() {}
    can_be_logged::<client::Blame>();
    can_be_logged::<ClientError>();
    can_be_logged::<line::LineError>();
    can_be_logged::<line::TransmitError>();
    can_be_logged::<managed::Outcome>();
    can_be_logged::<manager::ManagerError<'static>>();
    can_be_logged::<protocol::client::AnswerError>();
    can_be_logged::<protocol::client::Failure>();
    can_be_logged::<protocol::frame::EncodeError>();
    can_be_logged::<protocol::frame::ReceiveErrors>();
    can_be_logged::<protocol::number::TextError>();
    can_be_logged::<protocol::port_registers::Refused>();
};
