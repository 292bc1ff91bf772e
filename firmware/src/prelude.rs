//! What a server or a client needs, in one `use multidrop::prelude::*`.

pub use crate::tables::{Computed, Functions, Tables};
pub use crate::{
    Client, ClientConfig, ClientError, ClientPort, PortConfig, Roll, ServerPort, Shared,
};
pub use multidrop_protocol::data::{Coils, CoilsOut, Registers, RegistersOut};
pub use multidrop_protocol::exception::Exception;
pub use multidrop_protocol::format::{Framing, LineFormat};
pub use multidrop_protocol::registers::{Bank, CoilBank, NoCoils, NoRules, within};
pub use multidrop_protocol::rules;
pub use multidrop_protocol::server::DataModel;
