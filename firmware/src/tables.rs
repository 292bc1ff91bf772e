//! A data model built from banks, for those who need no other.
//!
//! ```
//! use multidrop::prelude::*;
//! use multidrop::protocol::registers::SparseBank;
//!
//! rules! {
//!     struct Limits: "RS4";
//!     VALID_DATA { 100..=103 => range(50..=800) }
//! }
//!
//! let mut tables = Tables::new()
//!     .holding(Bank::<4>::new(100))
//!     .inputs(SparseBank::new([0, 1, 1000]))
//!     .coils(CoilBank::<2>::new(0, 16))
//!     .rules(Limits);
//! tables.inputs.cells_mut()[2] = 215;
//! assert_eq!(tables.holding.get(100), Some(0));
//! ```
//!
//! What is not given does not exist: its functions are answered with exception 01, and it takes no flash and no RAM.

use core::marker::PhantomData;

use multidrop_protocol::data::{Coils, CoilsOut, Registers, RegistersOut};
use multidrop_protocol::exception::Exception;
use multidrop_protocol::function::{
    MASK_WRITE_REGISTER, READ_COILS, READ_DISCRETE_INPUTS, READ_HOLDING_REGISTERS,
    READ_INPUT_REGISTERS, READ_WRITE_REGISTERS, WRITE_MULTIPLE_COILS, WRITE_MULTIPLE_REGISTERS,
    WRITE_SINGLE_COIL, WRITE_SINGLE_REGISTER,
};
use multidrop_protocol::registers::{
    Bank, CoilBank, NoRules, Rules, SparseBank, SparseCoilBank, items, within,
};
use multidrop_protocol::server::{ApplicationFunction, DataModel, FunctionSet};

/// Registers that a client reads: [`Tables::inputs`].
pub trait RegisterSource: 'static {
    /// Whether there are any.
    const EXISTS: bool = true;

    /// Reads registers from address `first` on, 1..=125 of them.
    ///
    /// # Errors
    /// [`Exception::IllegalDataAddress`] unless all of them exist.
    fn read(&self, first: u16, out: RegistersOut<'_>) -> Result<(), Exception>;
}

/// Registers that a client reads and writes: [`Tables::holding`].
pub trait RegisterTable: RegisterSource {
    /// Whether the `count` registers from address `first` on exist.
    ///
    /// # Errors
    /// [`Exception::IllegalDataAddress`] unless they do.
    fn check(&self, first: u16, count: u16) -> Result<(), Exception>;

    /// Writes registers that were [checked](Self::check), 1..=123 of them. The answer may be on its way: nobody is told of a
    /// failure.
    ///
    /// # Errors
    /// [`Exception::IllegalDataAddress`] unless all of them exist; nothing is changed then.
    fn write(&mut self, first: u16, values: Registers<'_>) -> Result<(), Exception>;
}

/// Bits that a client reads: [`Tables::discrete`].
pub trait CoilSource: 'static {
    /// Whether there are any.
    const EXISTS: bool = true;

    /// Reads bits from address `first` on, 1..=2000 of them.
    ///
    /// # Errors
    /// [`Exception::IllegalDataAddress`] unless all of them exist.
    fn read(&self, first: u16, out: CoilsOut<'_>) -> Result<(), Exception>;
}

/// Bits that a client reads and writes: [`Tables::coils`].
pub trait CoilTable: CoilSource {
    /// Whether the `count` coils from address `first` on exist.
    ///
    /// # Errors
    /// [`Exception::IllegalDataAddress`] unless they do.
    fn check(&self, first: u16, count: u16) -> Result<(), Exception>;

    /// Writes coils that were [checked](Self::check), 1..=1968 of them, as [`RegisterTable::write`].
    ///
    /// # Errors
    /// [`Exception::IllegalDataAddress`] unless all of them exist; nothing is changed then.
    fn write(&mut self, first: u16, values: Coils<'_>) -> Result<(), Exception>;
}

/// A table that is not given.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Absent;

/// Inputs that follow from their address: `COUNT` of them from address `BASE` on. Registers for `Fn(u16) -> u16`, discrete
/// inputs for `Fn(u16) -> bool`.
#[derive(Clone, Copy, Debug)]
pub struct Computed<const BASE: u16, const COUNT: usize, F>(pub F);

impl<const BASE: u16, const COUNT: usize, F> Computed<BASE, COUNT, F> {
    #[inline(always)]
    fn check(first: u16, count: u16) -> Result<(), Exception> {
        const {
            assert!(
                COUNT <= u16::MAX as usize - BASE as usize,
                "inputs run past address 65535"
            )
        };
        let offset = first.checked_sub(BASE);
        within(
            offset.ok_or(Exception::IllegalDataAddress)?,
            count,
            COUNT as u16,
        )
    }
}

/// Rules and the flags of their DISABLE ranges.
#[derive(Clone, Copy, Debug)]
pub struct Ruled<R> {
    /// Bit i is the flag of DISABLE range i: 1 disables.
    pub flags: u32,
    rules: PhantomData<R>,
}

/// What judges a block of holding registers: [`NoRules`] or [`Ruled`].
pub trait Judge: 'static {
    /// Checks a read, see [`Rules::check_read`].
    ///
    /// # Errors
    /// Those of [`Rules::check_read`].
    fn check_read(&self, first: u16, count: u16) -> Result<(), Exception>;

    /// Checks a write, see [`Rules::check_write`].
    ///
    /// # Errors
    /// Those of [`Rules::check_write`].
    fn check_write(&self, first: u16, values: Registers<'_>) -> Result<(), Exception>;
}

impl Judge for NoRules {
    #[inline(always)]
    fn check_read(&self, _: u16, _: u16) -> Result<(), Exception> {
        Ok(())
    }

    #[inline(always)]
    fn check_write(&self, _: u16, _: Registers<'_>) -> Result<(), Exception> {
        Ok(())
    }
}

impl<R: Rules + 'static> Judge for Ruled<R> {
    #[inline(always)]
    fn check_read(&self, first: u16, count: u16) -> Result<(), Exception> {
        R::check_read(first, count)
    }

    #[inline(always)]
    fn check_write(&self, first: u16, values: Registers<'_>) -> Result<(), Exception> {
        R::check_write(first, values, self.flags)
    }
}

/// Functions that a model `M` has beside those of its tables, for [`Tables::functions`].
pub trait Functions<M: 'static>: 'static {
    /// The standard's functions. Of those for tables only the ones remain whose table is given.
    const STANDARD: FunctionSet = FunctionSet::EIGHT;

    /// Functions of the application.
    const OWN: &'static [ApplicationFunction<M>] = &[];
}

impl<M: 'static> Functions<M> for () {}

/// A data model built from banks: holding registers `H`, input registers `I`, coils `C`, discrete inputs `D`, rules `R` on the
/// holding registers, and functions `F` of the application.
///
/// The order of the checks is: the addresses, then the rules.
#[derive(Clone, Copy, Debug)]
pub struct Tables<H = Absent, I = Absent, C = Absent, D = Absent, R = NoRules, F = ()> {
    /// The holding registers.
    pub holding: H,
    /// The input registers.
    pub inputs: I,
    /// The table of coils.
    pub coils: C,
    /// The discrete inputs.
    pub discrete: D,
    /// The rules on the holding registers, with their flags.
    pub rules: R,
    functions: PhantomData<F>,
}

impl Tables {
    /// No table at all.
    pub const fn new() -> Self {
        Self {
            holding: Absent,
            inputs: Absent,
            coils: Absent,
            discrete: Absent,
            rules: NoRules,
            functions: PhantomData,
        }
    }
}

impl Default for Tables {
    fn default() -> Self {
        Self::new()
    }
}

/// One part in place of another.
macro_rules! with {
    ($tables:ident, $($part:ident: $value:expr),* ; $($kept:ident)*) => {
        Tables { $($part: $value,)* $($kept: $tables.$kept,)* }
    };
}

impl<I, C, D, R, F> Tables<Absent, I, C, D, R, F> {
    /// With these holding registers.
    #[inline(always)]
    pub fn holding<H: RegisterTable>(self, holding: H) -> Tables<H, I, C, D, R, F> {
        with!(self, holding: holding; inputs coils discrete rules functions)
    }
}

impl<H, C, D, R, F> Tables<H, Absent, C, D, R, F> {
    /// With these input registers.
    #[inline(always)]
    pub fn inputs<I: RegisterSource>(self, inputs: I) -> Tables<H, I, C, D, R, F> {
        with!(self, inputs: inputs; holding coils discrete rules functions)
    }
}

impl<H, I, D, R, F> Tables<H, I, Absent, D, R, F> {
    /// With these coils.
    #[inline(always)]
    pub fn coils<C: CoilTable>(self, coils: C) -> Tables<H, I, C, D, R, F> {
        with!(self, coils: coils; holding inputs discrete rules functions)
    }
}

impl<H, I, C, R, F> Tables<H, I, C, Absent, R, F> {
    /// With these discrete inputs.
    #[inline(always)]
    pub fn discrete<D: CoilSource>(self, discrete: D) -> Tables<H, I, C, D, R, F> {
        with!(self, discrete: discrete; holding inputs coils rules functions)
    }
}

impl<H, I, C, D, F> Tables<H, I, C, D, NoRules, F> {
    /// With these rules on the holding registers, declared with [`rules!`](crate::protocol::rules!). No flag is set.
    #[inline(always)]
    pub fn rules<R: Rules>(self, _: R) -> Tables<H, I, C, D, Ruled<R>, F> {
        let rules = Ruled {
            flags: 0,
            rules: PhantomData,
        };
        with!(self, rules: rules; holding inputs coils discrete functions)
    }
}

impl<H, I, C, D, R> Tables<H, I, C, D, R, ()>
where
    H: 'static,
    I: 'static,
    C: 'static,
    D: 'static,
    R: 'static,
{
    /// With these functions. `F` implements [`Functions`] for the type that this gives.
    #[inline(always)]
    pub fn functions<F>(self, _: F) -> Tables<H, I, C, D, R, F>
    where
        F: Functions<Tables<H, I, C, D, R, F>> + 'static,
    {
        with!(self, functions: PhantomData; holding inputs coils discrete rules)
    }
}

impl<H, I, C, D, R, F> DataModel for Tables<H, I, C, D, R, F>
where
    H: RegisterTable,
    I: RegisterSource,
    C: CoilTable,
    D: CoilSource,
    R: Judge,
    F: Functions<Self> + 'static,
{
    const FUNCTIONS: FunctionSet = {
        let mut functions = F::STANDARD;
        if !H::EXISTS {
            functions = functions
                .without(READ_HOLDING_REGISTERS)
                .without(WRITE_SINGLE_REGISTER)
                .without(WRITE_MULTIPLE_REGISTERS)
                .without(MASK_WRITE_REGISTER)
                .without(READ_WRITE_REGISTERS);
        }
        if !I::EXISTS {
            functions = functions.without(READ_INPUT_REGISTERS);
        }
        if !C::EXISTS {
            functions = functions
                .without(READ_COILS)
                .without(WRITE_SINGLE_COIL)
                .without(WRITE_MULTIPLE_COILS);
        }
        if !D::EXISTS {
            functions = functions.without(READ_DISCRETE_INPUTS);
        }
        functions
    };
    const APPLICATION: &'static [ApplicationFunction<Self>] = F::OWN;
    const WRITES_MAY_FAIL: bool = false;

    fn coils(&mut self, first: u16, out: CoilsOut<'_>) -> Result<(), Exception> {
        self.coils.read(first, out)
    }

    fn discrete_inputs(&mut self, first: u16, out: CoilsOut<'_>) -> Result<(), Exception> {
        self.discrete.read(first, out)
    }

    fn holding_registers(&mut self, first: u16, out: RegistersOut<'_>) -> Result<(), Exception> {
        self.rules.check_read(first, out.len() as u16)?;
        self.holding.read(first, out)
    }

    fn input_registers(&mut self, first: u16, out: RegistersOut<'_>) -> Result<(), Exception> {
        self.inputs.read(first, out)
    }

    fn check_coils(&self, first: u16, values: Coils<'_>) -> Result<(), Exception> {
        self.coils.check(first, values.len())
    }

    fn check_registers(&self, first: u16, values: Registers<'_>) -> Result<(), Exception> {
        self.holding.check(first, values.len() as u16)?;
        self.rules.check_write(first, values)
    }

    fn write_coils(&mut self, first: u16, values: Coils<'_>) -> Result<(), Exception> {
        self.coils.write(first, values)
    }

    fn write_registers(&mut self, first: u16, values: Registers<'_>) -> Result<(), Exception> {
        self.holding.write(first, values)
    }

    fn check_holding_registers(&mut self, first: u16, count: u16) -> Result<(), Exception> {
        self.rules.check_read(first, count)?;
        self.holding.check(first, count)
    }
}

/// What is not there, and what a bank is, for one kind of items.
macro_rules! tables {
    ($source:ident, $table:ident, $out:ident, $values:ident, $item:ty, $sparse:ident, $bank:ident, |$one:ident, $first:ident, $count:ident| $contains:expr) => {
        impl $source for Absent {
            const EXISTS: bool = false;

            fn read(&self, _: u16, _: $out<'_>) -> Result<(), Exception> {
                Err(Exception::IllegalDataAddress)
            }
        }

        impl $table for Absent {
            fn check(&self, _: u16, _: u16) -> Result<(), Exception> {
                Err(Exception::IllegalDataAddress)
            }

            fn write(&mut self, _: u16, _: $values<'_>) -> Result<(), Exception> {
                Err(Exception::IllegalDataAddress)
            }
        }

        impl<const N: usize> $source for $bank<N> {
            #[inline(always)]
            fn read(&self, first: u16, out: $out<'_>) -> Result<(), Exception> {
                Self::read(self, first, out)
            }
        }

        impl<const N: usize> $table for $bank<N> {
            #[inline(always)]
            fn check(&self, $first: u16, $count: u16) -> Result<(), Exception> {
                let $one = self;
                if $contains {
                    Ok(())
                } else {
                    Err(Exception::IllegalDataAddress)
                }
            }

            #[inline(always)]
            fn write(&mut self, first: u16, values: $values<'_>) -> Result<(), Exception> {
                Self::write(self, first, values)
            }
        }

        impl<const N: usize> $source for $sparse<N> {
            #[inline(always)]
            fn read(&self, first: u16, out: $out<'_>) -> Result<(), Exception> {
                Self::read(self, first, out)
            }
        }

        impl<const N: usize> $table for $sparse<N> {
            #[inline(always)]
            fn check(&self, first: u16, count: u16) -> Result<(), Exception> {
                items::check(self, first, count)
            }

            #[inline(always)]
            fn write(&mut self, first: u16, values: $values<'_>) -> Result<(), Exception> {
                Self::write(self, first, values)
            }
        }

        impl<const BASE: u16, const COUNT: usize, F> $source for Computed<BASE, COUNT, F>
        where
            F: Fn(u16) -> $item + 'static,
        {
            #[inline(always)]
            fn read(&self, first: u16, mut out: $out<'_>) -> Result<(), Exception> {
                Self::check(first, out.len() as u16)?;
                out.fill_from((first..).map(&self.0));
                Ok(())
            }
        }
    };
}

tables!(
    RegisterSource,
    RegisterTable,
    RegistersOut,
    Registers,
    u16,
    SparseBank,
    Bank,
    |bank, first, count| bank.contains(first, count.into())
);
tables!(
    CoilSource,
    CoilTable,
    CoilsOut,
    Coils,
    bool,
    SparseCoilBank,
    CoilBank,
    |bank, first, count| bank.contains(first, count)
);
