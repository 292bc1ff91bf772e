//! The data of the image `faults`, the same on every board: a unit that fails while it answers, for tests of what keeps a
//! bus alive then.

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
    /// An interrupt comes that nobody handles.
    UnhandledInterrupt = 3,
    /// A task does not come back.
    Hang = 4,
    /// The same with interrupts off.
    HangWithInterruptsOff = 5,
    /// The transmitter does not tell that it takes the next character.
    LostReady = 6,
    /// The transmitter does not tell that all has left.
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

/// How many registers there are from any address.
const COUNT: usize = 16;

/// Holding register 0 has the number of the [`ResetCause`], 2 and 3 how many bytes of the stack were in use and how many there are, at
/// most 65535; the others up to 15 read as 0x0100 and their address. Input registers read as 0, up to 16 of them; where the
/// first has the number of a [`Failure`], that is what happens while it is answered.
pub struct Faults {
    asked: &'static Asked,
    cause: ResetCause,
    stack: fn() -> Stack,
}

/// [`Failure::Keep`]: takes the line's buffer when it is free, and does not give it back.
///
/// # Cancellation
/// Safe: then it is given back.
pub async fn keep<L: Line, D>(port: &'static ServerPort<L, D>) -> ! {
    let _kept = port.line().lend().await;
    core::future::pending().await
}

/// Tells the task that fails how.
pub type Asked = Signal<NoopRawMutex, Failure>;

impl Faults {
    /// A model that tells `asked`, of a board that has started for this `cause`.
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

/// [`Failure::OverflowStack`]: calls itself until `is_over`, or for ever.
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
