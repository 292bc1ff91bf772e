//! The UART with a buffer in each direction, filled and emptied by interrupts.

use core::cell::UnsafeCell;
use core::future::poll_fn;
use core::task::{Context, Poll};

use embedded_io::{ErrorType, ReadReady, WriteReady};

use super::ring::Ring;
use super::{Config, ERRORS, Error};
use crate::executor::{RECEIVER, USER};
use crate::gpio::{PD0, PD1};
use crate::pac::USART0;
use crate::usart0::{DOR, RXCIE, RXEN, TXCIE, TXEN, UDRIE, Usart};

/// What interrupts and tasks share.
struct State {
    rx: Ring,
    tx: Ring,
    /// Error bits of UCSR0A that are to be told.
    errors: u8,
    /// How many bytes of `rx` came before the first of them.
    good: u8,
    /// U2X, or 0.
    u2x: u8,
    /// Whether a character is in `tx` or in the chip.
    is_sending: bool,
}

struct Shared(UnsafeCell<State>);

// SAFETY: used in the UART's interrupts, which do not nest, and by tasks with interrupts off; see `Ring` for the bytes.
unsafe impl Sync for Shared {}

static SHARED: Shared = Shared(UnsafeCell::new(State {
    rx: Ring::new(),
    tx: Ring::new(),
    errors: 0,
    good: 0,
    u2x: 0,
    is_sending: false,
}));

/// With interrupts off.
#[inline(always)]
fn with<R>(f: impl FnOnce(&mut State) -> R) -> R {
    critical_section::with(|_| {
        // SAFETY: interrupts are off and `with` is never called from within `f`.
        f(unsafe { &mut *SHARED.0.get() })
    })
}

/// Receiver and transmitter with the interrupts that are always on.
const LISTEN: u8 = RXCIE | RXEN | TXEN;

impl State {
    /// Notes an error behind the bytes that are stored. If an earlier one is not yet reported, it is reported with that.
    #[inline(always)]
    fn note(&mut self, errors: u8) {
        if self.errors == 0 {
            self.good = self.rx.count();
        }
        self.errors |= errors;
    }

    /// Returns the next bytes, as far as they lie one after the other, or the next error.
    fn next(&mut self) -> Option<Result<(*const u8, u8), Error>> {
        let most = if self.errors == 0 { 255 } else { self.good };
        match self.rx.full(most) {
            (_, 0) => {
                let error = Error::of(self.errors)?;
                self.errors = 0;
                Some(Err(error))
            }
            bytes => Some(Ok(bytes)),
        }
    }

    /// Removes `count` bytes that were read, at most those in front of an error.
    fn consume(&mut self, count: u8) {
        if self.errors == 0 {
            return self.rx.consume(count);
        }
        let count = count.min(self.good);
        self.good -= count;
        self.rx.consume(count);
    }
}

/// Says that the interrupts of the UART are bound. [`bind_interrupts!`](crate::bind_interrupts) implements it.
///
/// # Safety
/// The three handlers have to be in the binary.
#[diagnostic::on_unimplemented(
    message = "the interrupts of the UART are not bound: name UART in bind_interrupts!",
    label = "the buffers need interrupts that `{Self}` does not bind"
)]
pub unsafe trait Bound {}

/// The interrupts, for [`bind_interrupts!`](crate::bind_interrupts).
#[doc(hidden)]
pub struct Interrupts;

impl Interrupts {
    /// USART_RX: stores the character.
    ///
    /// # Safety
    /// From the interrupt of this name only.
    #[doc(hidden)]
    #[inline(always)]
    pub unsafe fn on_character() {
        // SAFETY: in an interrupt, see `Shared`.
        let state = unsafe { &mut *SHARED.0.get() };
        // Before the character is taken (DS 20.11.1).
        let errors = Usart::status() & ERRORS;
        let byte = Usart::take();
        if errors == 0 {
            if !state.rx.push(byte) {
                state.note(DOR);
            }
        } else {
            state.note(errors);
            // An overrun is told with the character behind the gap (DS 20.7.4), which is good if it has no other error.
            if errors == DOR {
                state.rx.push(byte);
            }
        }
        RECEIVER.wake();
    }

    /// USART_UDRE: sends the next character, or the last.
    ///
    /// # Safety
    /// From the interrupt of this name only.
    #[doc(hidden)]
    #[inline(always)]
    pub unsafe fn on_ready() {
        // SAFETY: in an interrupt, see `Shared`.
        let state = unsafe { &mut *SHARED.0.get() };
        if let Some(byte) = state.tx.pop() {
            Usart::put(byte);
            // The end of the character before may have come by now, where this interrupt had to wait.
            Usart::clear_sent(state.u2x);
        }
        if state.tx.is_empty() {
            // UDRE would interrupt for ever; TXC says when the last one has left.
            Usart::control(LISTEN | TXCIE);
        }
        // Not for each byte: a writer that waits has found the buffer full.
        if state.tx.count() == state.tx.half() {
            USER.wake();
        }
    }

    /// USART_TX: the last character has left.
    ///
    /// # Safety
    /// From the interrupt of this name only.
    #[doc(hidden)]
    #[inline(always)]
    pub unsafe fn on_sent() {
        // SAFETY: in an interrupt, see `Shared`.
        let state = unsafe { &mut *SHARED.0.get() };
        // Bytes that were written just now have UDRE's interrupt on, and come to an end of their own.
        if state.tx.is_empty() {
            state.is_sending = false;
            Usart::control(LISTEN);
            USER.wake();
        }
    }
}

/// USART0 on RXD and TXD, with a buffer in each direction.
pub struct BufferedUart {
    tx: BufferedUartTx,
    rx: BufferedUartRx,
}

/// The transmitter of a [`BufferedUart`].
pub struct BufferedUartTx(());

/// The receiver of a [`BufferedUart`].
pub struct BufferedUartRx(());

impl BufferedUart {
    /// Sets the UART up, with the token that its interrupts are bound. The peripherals are taken so that nobody else has them, and the
    /// buffers, of 1 to 255 bytes, for good. It receives once interrupts are enabled.
    pub fn new<const TX: usize, const RX: usize>(
        _: USART0,
        _: PD0,
        _: PD1,
        _: impl Bound,
        config: Config,
        tx: &'static mut [u8; TX],
        rx: &'static mut [u8; RX],
    ) -> Self {
        with(|state| {
            state.tx.take(tx);
            state.rx.take(rx);
            state.u2x = config.u2x();
            config.apply();
            Usart::control(LISTEN);
        });
        Self {
            tx: BufferedUartTx(()),
            rx: BufferedUartRx(()),
        }
    }

    /// Transmitter and receiver apart, for two tasks.
    pub fn split(self) -> (BufferedUartTx, BufferedUartRx) {
        (self.tx, self.rx)
    }
}

impl BufferedUartRx {
    /// Returns the next bytes or the next error, if there is one.
    fn next(&mut self) -> Option<Result<&[u8], Error>> {
        let next = with(State::next)?;
        // SAFETY: the interrupt leaves these bytes alone until they are consumed, for which `self` is needed again.
        Some(
            next.map(|(bytes, len)| unsafe {
                core::slice::from_raw_parts(bytes, usize::from(len))
            }),
        )
    }

    /// Copies the next bytes, or returns the next error, if there is one.
    fn copy(&mut self, into: &mut [u8]) -> Option<Result<usize, Error>> {
        let count = match self.next()? {
            Ok(bytes) => {
                let count = bytes.len().min(into.len());
                into[..count].copy_from_slice(&bytes[..count]);
                count
            }
            Err(error) => return Some(Err(error)),
        };
        // At most 255 bytes are there.
        with(|state| state.consume(count as u8));
        Some(Ok(count))
    }

    fn consume(&mut self, count: usize) {
        with(|state| state.consume(count.min(255) as u8));
    }

    /// Waits for a byte or an error. The waker is registered first: an interrupt between that and the look wakes the task.
    async fn wait(&mut self) {
        poll_fn(|context: &mut Context<'_>| {
            RECEIVER.register(context.waker());
            match with(|state| state.errors != 0 || !state.rx.is_empty()) {
                true => Poll::Ready(()),
                false => Poll::Pending,
            }
        })
        .await;
    }
}

impl BufferedUartTx {
    /// Copies as many bytes as there is room for, if there is room.
    fn copy(&mut self, bytes: &[u8]) -> Option<usize> {
        let (room, len) = with(|state| state.tx.room());
        let count = bytes.len().min(usize::from(len));
        if count == 0 {
            return None;
        }
        // SAFETY: the interrupt leaves this room alone until it is committed, and nobody else writes: `self` is the one writer.
        unsafe { core::ptr::copy_nonoverlapping(bytes.as_ptr(), room, count) };
        with(|state| {
            state.tx.commit(count as u8);
            state.is_sending = true;
            Usart::control(LISTEN | UDRIE);
        });
        Some(count)
    }

    /// Waits until `is_so`.
    async fn wait(&mut self, is_so: fn(&mut State) -> bool) {
        poll_fn(|context: &mut Context<'_>| {
            USER.register(context.waker());
            match with(is_so) {
                true => Poll::Ready(()),
                false => Poll::Pending,
            }
        })
        .await;
    }
}

fn has_room(state: &mut State) -> bool {
    !state.tx.is_full()
}

fn is_idle(state: &mut State) -> bool {
    !state.is_sending
}

both!(BufferedUart);

impl embedded_io::BufRead for BufferedUart {
    fn fill_buf(&mut self) -> Result<&[u8], Error> {
        embedded_io::BufRead::fill_buf(&mut self.rx)
    }

    fn consume(&mut self, count: usize) {
        self.rx.consume(count);
    }
}

impl embedded_io_async::Read for BufferedUart {
    async fn read(&mut self, bytes: &mut [u8]) -> Result<usize, Error> {
        embedded_io_async::Read::read(&mut self.rx, bytes).await
    }
}

impl embedded_io_async::BufRead for BufferedUart {
    async fn fill_buf(&mut self) -> Result<&[u8], Error> {
        embedded_io_async::BufRead::fill_buf(&mut self.rx).await
    }

    fn consume(&mut self, count: usize) {
        self.rx.consume(count);
    }
}

impl embedded_io_async::Write for BufferedUart {
    async fn write(&mut self, bytes: &[u8]) -> Result<usize, Error> {
        embedded_io_async::Write::write(&mut self.tx, bytes).await
    }

    async fn flush(&mut self) -> Result<(), Error> {
        embedded_io_async::Write::flush(&mut self.tx).await
    }
}

impl ErrorType for BufferedUartTx {
    type Error = Error;
}

impl ErrorType for BufferedUartRx {
    type Error = Error;
}

impl ReadReady for BufferedUartRx {
    /// Whether there is a byte or an error.
    fn read_ready(&mut self) -> Result<bool, Error> {
        Ok(with(|state| state.errors != 0 || !state.rx.is_empty()))
    }
}

impl WriteReady for BufferedUartTx {
    fn write_ready(&mut self) -> Result<bool, Error> {
        Ok(with(has_room))
    }
}

/// Waits until the first byte has come, and takes what lies behind it in the buffer.
///
/// # Cancellation
/// Nothing is taken.
impl embedded_io_async::Read for BufferedUartRx {
    async fn read(&mut self, bytes: &mut [u8]) -> Result<usize, Error> {
        if bytes.is_empty() {
            return Ok(0);
        }
        loop {
            if let Some(read) = self.copy(bytes) {
                return read;
            }
            self.wait().await;
        }
    }
}

/// # Cancellation
/// Nothing is taken.
impl embedded_io_async::BufRead for BufferedUartRx {
    async fn fill_buf(&mut self) -> Result<&[u8], Error> {
        self.wait().await;
        self.next().unwrap_or(Ok(&[]))
    }

    fn consume(&mut self, count: usize) {
        BufferedUartRx::consume(self, count);
    }
}

/// Waits until a byte has room, and writes as many as have.
///
/// # Cancellation
/// Nothing is written. What was written before goes out all the same.
impl embedded_io_async::Write for BufferedUartTx {
    async fn write(&mut self, bytes: &[u8]) -> Result<usize, Error> {
        if bytes.is_empty() {
            return Ok(0);
        }
        loop {
            if let Some(count) = self.copy(bytes) {
                return Ok(count);
            }
            self.wait(has_room).await;
        }
    }

    /// Waits until the last stop bit has left.
    async fn flush(&mut self) -> Result<(), Error> {
        self.wait(is_idle).await;
        Ok(())
    }
}

/// Blocks, awake, with interrupts on.
impl embedded_io::Read for BufferedUartRx {
    fn read(&mut self, bytes: &mut [u8]) -> Result<usize, Error> {
        if bytes.is_empty() {
            return Ok(0);
        }
        loop {
            if let Some(read) = self.copy(bytes) {
                return read;
            }
        }
    }
}

/// Blocks, awake, with interrupts on.
impl embedded_io::BufRead for BufferedUartRx {
    fn fill_buf(&mut self) -> Result<&[u8], Error> {
        while !self.read_ready()? {}
        self.next().unwrap_or(Ok(&[]))
    }

    fn consume(&mut self, count: usize) {
        BufferedUartRx::consume(self, count);
    }
}

/// Blocks, awake, with interrupts on.
impl embedded_io::Write for BufferedUartTx {
    fn write(&mut self, bytes: &[u8]) -> Result<usize, Error> {
        if bytes.is_empty() {
            return Ok(0);
        }
        loop {
            if let Some(count) = self.copy(bytes) {
                return Ok(count);
            }
        }
    }

    fn flush(&mut self) -> Result<(), Error> {
        while !with(is_idle) {}
        Ok(())
    }
}
