//! The data model of the server under test: banks of odd sizes at odd places, and functions of the application.

use std::sync::LazyLock;

use multidrop_protocol::data::{Coils, CoilsOut, Registers, RegistersOut};
use multidrop_protocol::exception::Exception;
use multidrop_protocol::registers::{Bank, CoilBank};
use multidrop_protocol::server::{ApplicationFunction, DataModel, Function, Server};

use super::book::{self, Book};

type Discrete = CoilBank<{ book::DISCRETE.1.div_ceil(8) }>;

static DISCRETE: LazyLock<Discrete> = LazyLock::new(|| {
    let mut bank = Discrete::new(book::DISCRETE.0, book::DISCRETE.1 as u16);
    for (index, on) in (0..).zip(book::discrete_inputs()) {
        assert!(bank.set(book::DISCRETE.0 + index, on));
    }
    bank
});

/// Four banks. `MAY_FAIL` chooses which way a port takes with writes.
#[derive(Clone, PartialEq)]
pub struct Memory<const MAY_FAIL: bool> {
    pub holding: Bank<{ book::HOLDING.1 }>,
    pub input: Bank<{ book::INPUT.1 }>,
    pub coils: CoilBank<{ book::COILS.1.div_ceil(8) }>,
    pub discrete: Discrete,
}

impl<const MAY_FAIL: bool> Memory<MAY_FAIL> {
    /// With the contents of a [`Book`].
    pub fn of(book: &Book) -> Self {
        let mut memory = Memory {
            holding: Bank::new(book::HOLDING.0),
            input: Bank::new(book::INPUT.0),
            coils: CoilBank::new(book::COILS.0, book::COILS.1 as u16),
            discrete: DISCRETE.clone(),
        };
        memory.holding.cells_mut().copy_from_slice(&book.holding);
        memory.input.cells_mut().copy_from_slice(&book.input);
        for (index, &on) in (0..).zip(&book.coils) {
            assert!(memory.coils.set(book::COILS.0 + index, on));
        }
        memory
    }

    /// Whether the contents are those of a [`Book`].
    pub fn is(&self, book: &Book) -> bool {
        let coil = |index| self.coils.get(book::COILS.0 + index);
        self.holding.cells()[..] == book.holding
            && self.input.cells()[..] == book.input
            && (0..).zip(&book.coils).all(|(i, &on)| coil(i) == Some(on))
            && self.discrete == *DISCRETE
    }
}

impl<const MAY_FAIL: bool> DataModel for Memory<MAY_FAIL> {
    const WRITES_MAY_FAIL: bool = MAY_FAIL;

    /// The functions that [`Book`] knows.
    const APPLICATION: &'static [ApplicationFunction<Self>] = &[
        ApplicationFunction {
            code: book::REVERSE,
            broadcast: true,
            run: reverse,
        },
        ApplicationFunction {
            code: book::COUNT,
            broadcast: false,
            run: count,
        },
        ApplicationFunction {
            code: book::TOO_LONG,
            broadcast: false,
            run: |_, pdu, _| {
                pdu.fill(0xEE);
                Ok(254)
            },
        },
        ApplicationFunction {
            code: book::BUSY,
            broadcast: true,
            run: |_, pdu, _| {
                pdu.fill(0xEE);
                Err(Exception::ServerDeviceBusy)
            },
        },
        ApplicationFunction {
            code: book::MUTE,
            broadcast: false,
            run: |_, _, _| Ok(0),
        },
    ];
    /// One that echoes.
    const DEFAULT: Option<Function<Self>> = Some(|_, _, len| Ok(len));

    fn coils(&mut self, first: u16, out: CoilsOut<'_>) -> Result<(), Exception> {
        self.coils.read(first, out)
    }
    fn discrete_inputs(&mut self, first: u16, out: CoilsOut<'_>) -> Result<(), Exception> {
        self.discrete.read(first, out)
    }
    fn holding_registers(&mut self, first: u16, out: RegistersOut<'_>) -> Result<(), Exception> {
        self.holding.read(first, out)
    }
    fn input_registers(&mut self, first: u16, out: RegistersOut<'_>) -> Result<(), Exception> {
        self.input.read(first, out)
    }
    fn check_coils(&self, first: u16, values: Coils<'_>) -> Result<(), Exception> {
        self.coils.check(first, values)
    }
    fn check_registers(&self, first: u16, values: Registers<'_>) -> Result<(), Exception> {
        self.holding.check(first, values)
    }
    fn write_coils(&mut self, first: u16, values: Coils<'_>) -> Result<(), Exception> {
        self.coils.write(first, values)
    }
    fn write_registers(&mut self, first: u16, values: Registers<'_>) -> Result<(), Exception> {
        self.holding.write(first, values)
    }
}

/// A server over a [`Memory`].
pub fn server() -> Server {
    Server::new(book::UNIT)
}

/// Answers the request's data in reverse order, and sets the first coil to whether there was any.
fn reverse<const MAY_FAIL: bool>(
    memory: &mut Memory<MAY_FAIL>,
    pdu: &mut [u8],
    len: usize,
) -> Result<usize, Exception> {
    pdu[1..len].reverse();
    memory.coils.set(book::COILS.0, len > 1);
    Ok(len)
}

/// Adds one to the first holding register and answers it; takes no data.
fn count<const MAY_FAIL: bool>(
    memory: &mut Memory<MAY_FAIL>,
    pdu: &mut [u8],
    len: usize,
) -> Result<usize, Exception> {
    if len != 1 {
        return Err(Exception::IllegalDataValue);
    }
    let cell = &mut memory.holding.cells_mut()[0];
    *cell = cell.wrapping_add(1);
    pdu[1..3].copy_from_slice(&cell.to_be_bytes());
    Ok(3)
}
