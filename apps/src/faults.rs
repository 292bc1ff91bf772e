//! The data model of the image `faults` on every board: a unit that fails while it answers. Tests use it to see what
//! keeps a bus alive when a unit fails.

use embassy_sync::blocking_mutex::raw::NoopRawMutex;
use embassy_sync::signal::Signal;
use multidrop::protocol::data::RegistersOut;
use multidrop::protocol::exception::Exception;
use multidrop::protocol::registers::within;
use multidrop::protocol::server::DataModel;

use multidrop::{Line, ResetCause, ServerPort, Stack};

/// How the unit fails.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u16)]
pub enum Failure {
    /// A task panics.
    Panic = 1,
    /// An interrupt panics.
    PanicInInterrupt = 2,
    /// An interrupt occurs that has no handler.
    UnhandledInterrupt = 3,
    /// A task loops for ever.
    Hang = 4,
    /// A task loops for ever with interrupts off.
    HangWithInterruptsOff = 5,
    /// The transmitter loses the interrupt that asks for the next character.
    LostReady = 6,
    /// The transmitter loses the interrupt that reports the end of a transmission.
    LostSent = 7,
    /// A task keeps the line's buffer.
    Keep = 8,
    /// A task uses up the stack.
    OverflowStack = 9,
}

const ALL: [Failure; 9] = [
    Failure::Panic,
    Failure::PanicInInterrupt,
    Failure::UnhandledInterrupt,
    Failure::Hang,
    Failure::HangWithInterruptsOff,
    Failure::LostReady,
    Failure::LostSent,
    Failure::Keep,
    Failure::OverflowStack,
];

/// Registers in one request, at most, from any address.
const COUNT: usize = 16;

/// The data model. Holding register 0 is the number of the [`ResetCause`]; registers 2 and 3 are the bytes of stack
/// in use and its size, at most 65535; the others up to 15 read as 0x0100 plus their address. Input registers read as
/// 0, up to 16 in a request. If the address of the first one is the number of a [`Failure`], the unit fails that way
/// while it answers.
pub struct Faults {
    asked: &'static Asked,
    cause: ResetCause,
    stack: fn() -> Stack,
}

/// Carries out [`Failure::Keep`]: takes the line's buffer when it is free, and never gives it back.
///
/// # Cancellation
/// Safe: the buffer is given back.
pub async fn keep<L: Line, D>(port: &'static ServerPort<L, D>) -> ! {
    let _kept = port.line().lend().await;
    core::future::pending().await
}

/// Tells the failing task which failure to carry out.
pub type Asked = Signal<NoopRawMutex, Failure>;

impl Faults {
    /// A model that signals `asked`, on a board whose reset had this `cause`.
    pub const fn new(asked: &'static Asked, cause: ResetCause, stack: fn() -> Stack) -> Self {
        Self {
            asked,
            cause,
            stack,
        }
    }
}

impl DataModel for Faults {
    fn holding_registers(
        &mut self,
        first: u16,
        mut out: RegistersOut<'_>,
    ) -> Result<(), Exception> {
        within(first, out.len() as u16, COUNT as u16)?;
        let cause = self.cause as u16;
        let stack = (self.stack)();
        let bytes = |bytes: usize| u16::try_from(bytes).unwrap_or(u16::MAX);
        out.fill_from((first..).map(|address| match address {
            0 => cause,
            2 => bytes(stack.used),
            3 => bytes(stack.size),
            _ => 0x0100 + address,
        }));
        Ok(())
    }

    fn input_registers(&mut self, first: u16, mut out: RegistersOut<'_>) -> Result<(), Exception> {
        if out.len() > COUNT {
            return Err(Exception::IllegalDataAddress);
        }
        let failure = ALL.iter().find(|failure| **failure as u16 == first);
        self.asked
            .signal(*failure.ok_or(Exception::IllegalDataAddress)?);
        out.fill_from(core::iter::repeat(0));
        Ok(())
    }
}

/// Carries out [`Failure::OverflowStack`]: calls itself until `is_over` returns true, or for ever.
#[inline(never)]
pub fn use_up_stack(is_over: &dyn Fn() -> bool) -> u8 {
    let frame = core::hint::black_box([0xAA_u8; 32]);
    if is_over() {
        return 0;
    }
    let below = use_up_stack(is_over);
    core::hint::black_box(&frame);
    below.wrapping_add(frame[0])
}
