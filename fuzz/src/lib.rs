//! What the fuzz targets do with their input, apart from libFuzzer, so that the corpus is replayed by any compiler.

mod ascii_line;
mod client_answers;
mod codec;
mod input;
mod port_load;
mod rtu_line;
mod server_pdu;

pub use ascii_line::ascii_line;
pub use client_answers::client_answers;
pub use codec::codec;
pub use port_load::port_load;
pub use rtu_line::rtu_line;
pub use server_pdu::server_pdu;

/// A target, by its name.
pub type Target = (&'static str, fn(&[u8]));

/// All of them.
pub const TARGETS: &[Target] = &[
    ("server_pdu", server_pdu),
    ("rtu_line", rtu_line),
    ("ascii_line", ascii_line),
    ("codec", codec),
    ("client_answers", client_answers),
    ("port_load", port_load),
];
