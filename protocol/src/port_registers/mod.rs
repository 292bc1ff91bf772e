//! The register set of a port, `MB_<port>_<name>` of iDevOS: what it does, how its line is set, and the arrays it works with.
//!
//! [`PortRegisters`] holds all of it and decides what each register takes; it neither waits nor sends. As a slave it is a
//! [`DataModel`](crate::server::DataModel): REGS and COILS under the port's rules. As a master it says what the registers
//! describe, [`Transaction`] by [`TransactionStep`]. `multidrop::managed` is the port around it.
//!
//! ```
//! use multidrop_protocol::port_registers::{PortRegisters, PortSettings, Register, Value};
//! use multidrop_protocol::registers::{Bank, NoCoils, NoRules};
//!
//! let mut rs4: PortRegisters<_, _, NoRules> =
//!     PortRegisters::new(PortSettings::DEFAULT, Bank::<16>::new(0), NoCoils);
//! rs4.load(Value::SlaveId(17)).unwrap();
//! // As it comes from the wire: by number.
//! let refused = rs4.load_raw(Register::SlaveId, 248).unwrap_err();
//! assert_eq!(refused.to_string(), "SLAVEID is 248, must be 1..=247");
//! assert_eq!(rs4.read(Register::SlaveId), Ok(17));
//! ```

#[macro_use]
mod declaration;
mod load;
mod model;
mod refused;
mod register;
mod settings;
mod transaction;
mod value;

pub use refused::{Reason, Refused};
pub use register::Register;
pub use settings::{LineSettings, PortSettings, Status};
pub use transaction::{Transaction, TransactionStep};
pub use value::{Duplex, Flow, InterCharacter, Mode, Value};

use core::marker::PhantomData;

use crate::function::READ_HOLDING_REGISTERS;
use crate::registers::{Items, Rules};

/// What a load is followed by.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Change {
    /// Nothing: it is done.
    Done,
    /// MODE or SLAVEID is another: to be followed when no request is being served and no transaction runs.
    Mode,
    /// The line is to be set up anew, when nothing is being sent.
    Line,
    /// The transaction is to be run, and then [`finish`](PortRegisters::finish)ed.
    Start,
}

/// The registers of one port, with the arrays `R` and `C` behind REGS and COILS, under the rules `V`.
///
/// Dense arrays begin at BASE. As a slave REGS are the holding and the input registers, COILS the coils and the discrete
/// inputs. As a master element REGOFF + i of REGS is the item at BASE + REGOFF + i, or where its table of addresses says; element
/// i of dense COILS is the item at BASE + COILOFF + i, element COILOFF + i of sparse ones is where the table says.
#[derive(Debug)]
pub struct PortRegisters<R, C, V> {
    settings: PortSettings,
    regs: R,
    coils: C,
    function: u8,
    reg_offset: u16,
    reg_count: u16,
    coil_offset: u16,
    coil_count: u16,
    status: Status,
    error: u8,
    running: bool,
    ended_well: u16,
    ended_badly: u16,
    flags: u32,
    rules: PhantomData<V>,
}

impl<R, C, V> PortRegisters<R, C, V>
where
    R: Items<Item = u16>,
    C: Items<Item = bool>,
    V: Rules,
{
    /// Registers with these settings; FUNC is 3, counts are 1, all else is 0. Dense arrays are moved to BASE.
    ///
    /// # Panics
    ///
    /// If the last item of an array would be behind address 65535.
    pub fn new(settings: PortSettings, mut regs: R, mut coils: C) -> PortRegisters<R, C, V> {
        assert!(
            regs.rebase(settings.base) && coils.rebase(settings.base),
            "array runs past address 65535"
        );
        PortRegisters {
            settings,
            regs,
            coils,
            function: READ_HOLDING_REGISTERS,
            reg_offset: 0,
            reg_count: 1,
            coil_offset: 0,
            coil_count: 1,
            status: Status::Idle,
            error: 0,
            running: false,
            ended_well: 0,
            ended_badly: 0,
            flags: 0,
            rules: PhantomData,
        }
    }

    /// The settings as they were last loaded.
    pub const fn settings(&self) -> &PortSettings {
        &self.settings
    }

    /// The array behind REGS.
    pub const fn regs(&self) -> &R {
        &self.regs
    }

    /// The array behind REGS, to be changed. Its addresses are BASE's business.
    pub const fn regs_mut(&mut self) -> &mut R {
        &mut self.regs
    }

    /// The array behind COILS.
    pub const fn coils(&self) -> &C {
        &self.coils
    }

    /// The array behind COILS, to be changed. Its addresses are BASE's business.
    pub const fn coils_mut(&mut self) -> &mut C {
        &mut self.coils
    }

    /// How the transaction under way stands: [`Status::Transmitting`] or [`Status::Receiving`]. Nothing if there is none.
    pub fn proceed(&mut self, status: Status) {
        if self.running {
            self.status = status;
        }
    }

    /// The transaction under way has ended: `status` and `error` are STATUS and ERROR from now on, and it ended well if both
    /// are 0. Nothing if there is none.
    pub fn finish(&mut self, status: Status, error: u8) {
        if !self.running {
            return;
        }
        self.running = false;
        self.status = status;
        self.error = error;
        let counter = if status == Status::Idle && error == 0 {
            &mut self.ended_well
        } else {
            &mut self.ended_badly
        };
        *counter = counter.wrapping_add(1);
    }
}
