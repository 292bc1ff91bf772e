//! Uses the UART in the way that the first bytes of the EEPROM say: mode, format (1: 8E1), and baud rate in four bytes, low byte first.
//! A test writes them before the start, and reads what came in from SRAM.
#![no_std]
#![no_main]
#![feature(abi_avr_interrupt)]

use core::future::{Future, poll_fn};
use core::pin::pin;
use core::sync::atomic::{AtomicU8, Ordering::Relaxed};
use core::task::Poll;

use embassy_avr_hal::eeprom::Eeprom;
use embassy_avr_hal::gpio::{Output, PD2, Pins};
use embassy_avr_hal::uart::{BufferedUart, Config, Error, LineFormat, Uart};
use embassy_avr_hal::{bind_interrupts, executor, pac};
use embassy_futures::yield_now;
use embedded_io::ReadReady;
use embedded_io_async::{BufRead, Read, Write};
use embedded_storage::ReadStorage;
use static_cell::ConstStaticCell;

bind_interrupts!(struct Irqs { UART; EEPROM; });

/// 1: nothing is read. 2: interrupts are off. The modes that log look at it before each byte.
#[unsafe(no_mangle)]
static HOLD: AtomicU8 = AtomicU8::new(0);
/// What came in, of each two bytes: 1 and the byte, or 2, 3, 4 and 0 for overrun, framing, parity.
#[unsafe(no_mangle)]
static LOG: [AtomicU8; 256] = [const { AtomicU8::new(0) }; 256];
/// How many bytes of `LOG` are written.
#[unsafe(no_mangle)]
static LOGGED: AtomicU8 = AtomicU8::new(0);

static TX: ConstStaticCell<[u8; 32]> = ConstStaticCell::new([0; 32]);
static RX: ConstStaticCell<[u8; 64]> = ConstStaticCell::new([0; 64]);

/// Bytes of a long message.
const LONG: usize = 1_000;

fn log(what: u8, byte: u8) {
    let at = LOGGED.load(Relaxed);
    LOG[usize::from(at)].store(what, Relaxed);
    LOG[usize::from(at) + 1].store(byte, Relaxed);
    LOGGED.store(at.saturating_add(2).min(254), Relaxed);
}

fn log_error(error: Error) {
    let what = match error {
        Error::Overrun => 2,
        Error::Framing => 3,
        Error::Parity => 4,
    };
    log(what, 0);
}

/// Keeps interrupts off while `HOLD` says so; whether it says anything.
fn is_held() -> bool {
    critical_section::with(|_| {
        while HOLD.load(Relaxed) == 2 {
            core::hint::spin_loop();
        }
    });
    HOLD.load(Relaxed) != 0
}

/// More than a millisecond: a peer's stop bit has ended behind it, at 9600 baud too.
fn pause() {
    for _ in 0..5_000 {
        avr_device::asm::nop();
    }
}

fn long() -> impl Iterator<Item = u8> {
    (0..LONG).map(|place| (place % 251) as u8)
}

/// Gives back messages: a byte that says how many follow, and these.
async fn exchange<U: Read<Error = Error> + Write>(mut uart: U, mut de: Output<PD2>) -> ! {
    let mut bytes = [0; 255];
    loop {
        let message = async {
            let mut len = [0];
            uart.read_exact(&mut len).await?;
            let message = &mut bytes[..usize::from(len[0])];
            uart.read_exact(message).await?;
            Ok(message)
        };
        match message.await {
            Ok(message) => {
                pause();
                de.high();
                let _ = uart.write_all(message).await;
                let _ = uart.flush().await;
                de.low();
            }
            Err(embedded_io::ReadExactError::Other(error)) => log_error(error),
            Err(embedded_io::ReadExactError::UnexpectedEof) => log(9, 0),
        }
    }
}

/// [`exchange`] without waiting for anything but the chip.
struct Blocking<U>(U);

impl<U: embedded_io::ErrorType> embedded_io::ErrorType for Blocking<U> {
    type Error = U::Error;
}

impl<U: embedded_io::Read> Read for Blocking<U> {
    async fn read(&mut self, bytes: &mut [u8]) -> Result<usize, U::Error> {
        self.0.read(bytes)
    }
}

impl<U: embedded_io::Write> Write for Blocking<U> {
    async fn write(&mut self, bytes: &[u8]) -> Result<usize, U::Error> {
        self.0.write(bytes)
    }

    async fn flush(&mut self) -> Result<(), U::Error> {
        self.0.flush()
    }
}

/// Drops each future that does not end at once, and makes a new one.
struct Impatient<U>(U);

/// What the future gives if it does at once.
async fn at_once<T>(future: impl Future<Output = T>) -> Option<T> {
    let mut future = pin!(future);
    poll_fn(|context| match future.as_mut().poll(context) {
        Poll::Ready(given) => Poll::Ready(Some(given)),
        Poll::Pending => Poll::Ready(None),
    })
    .await
}

impl<U: embedded_io::ErrorType> embedded_io::ErrorType for Impatient<U> {
    type Error = U::Error;
}

impl<U: Read> Read for Impatient<U> {
    async fn read(&mut self, bytes: &mut [u8]) -> Result<usize, U::Error> {
        loop {
            if let Some(read) = at_once(self.0.read(bytes)).await {
                return read;
            }
            yield_now().await;
        }
    }
}

impl<U: Write> Write for Impatient<U> {
    async fn write(&mut self, bytes: &[u8]) -> Result<usize, U::Error> {
        loop {
            if let Some(written) = at_once(self.0.write(bytes)).await {
                return written;
            }
            yield_now().await;
        }
    }

    async fn flush(&mut self) -> Result<(), U::Error> {
        loop {
            if let Some(flushed) = at_once(self.0.flush()).await {
                return flushed;
            }
            yield_now().await;
        }
    }
}

/// Logs what comes in, byte by byte.
async fn listen(mut uart: BufferedUart) -> ! {
    loop {
        if is_held() || !uart.read_ready().unwrap_or(false) {
            yield_now().await;
            continue;
        }
        match uart.fill_buf().await {
            Ok(bytes) => {
                log(1, bytes[0]);
                BufRead::consume(&mut uart, 1);
            }
            Err(error) => log_error(error),
        }
    }
}

/// [`listen`] without interrupts.
fn listen_blocking(mut uart: Uart) -> ! {
    loop {
        if is_held() || !uart.read_ready().unwrap_or(false) {
            continue;
        }
        let mut bytes = [0];
        match embedded_io::Read::read(&mut uart, &mut bytes) {
            Ok(_) => log(1, bytes[0]),
            Err(error) => log_error(error),
        }
    }
}

/// Logs how many bytes have room at once, and sends a long message with these in front.
async fn send<U: Write + embedded_io::WriteReady>(mut uart: U, mut de: Output<PD2>) -> ! {
    let mut bytes = [0; LONG];
    bytes
        .iter_mut()
        .zip(long())
        .for_each(|(to, byte)| *to = byte);
    de.high();
    let mut sent = 0;
    while uart.write_ready().unwrap_or(false) {
        let _ = uart.write_all(&[sent]).await;
        sent += 1;
    }
    log(1, sent);
    let _ = uart.write_all(&bytes).await;
    let _ = uart.flush().await;
    de.low();
    core::future::pending().await
}

impl<U: embedded_io::WriteReady> embedded_io::WriteReady for Blocking<U> {
    fn write_ready(&mut self) -> Result<bool, U::Error> {
        self.0.write_ready()
    }
}

#[embassy_executor::task]
async fn run(mode: u8, uart: Either, de: Output<PD2>) {
    match (mode, uart) {
        (0, Either::Buffered(uart)) => exchange(uart, de).await,
        (1, Either::Blocking(uart)) => exchange(Blocking(uart), de).await,
        (2, Either::Buffered(uart)) => exchange(Impatient(uart), de).await,
        (3, Either::Buffered(uart)) => listen(uart).await,
        (4, Either::Blocking(uart)) => listen_blocking(uart),
        (5, Either::Buffered(uart)) => send(uart, de).await,
        (6, Either::Blocking(uart)) => send(Blocking(uart), de).await,
        (7, Either::Buffered(uart)) => exchange(Blocking(uart), de).await,
        _ => core::future::pending().await,
    }
}

/// Keeps interrupts off while `HOLD` says so, beside what sends.
#[embassy_executor::task]
async fn hold() {
    loop {
        is_held();
        yield_now().await;
    }
}

enum Either {
    Buffered(BufferedUart),
    Blocking(Uart),
}

#[avr_device::entry]
fn main() -> ! {
    let chip = pac::Peripherals::take().unwrap();
    let pins = Pins::new(chip.PORTB, chip.PORTC, chip.PORTD);
    let mut wanted = [0; 6];
    let _ = ReadStorage::read(&mut Eeprom::new(chip.EEPROM, Irqs), 0, &mut wanted);
    let [mode, format, baud @ ..] = wanted;
    let format = match format {
        1 => LineFormat::F8E1,
        _ => LineFormat::F8N1,
    };
    let baud = u32::from_le_bytes(baud);
    let config = Config::new(16_000_000, baud, format).unwrap();
    let de = Output::new(pins.PD2, false);
    let uart = match mode {
        1 | 4 | 6 => Either::Blocking(Uart::new(chip.USART0, pins.PD0, pins.PD1, config)),
        _ => Either::Buffered(BufferedUart::new(
            chip.USART0,
            pins.PD0,
            pins.PD1,
            Irqs,
            config,
            TX.take(),
            RX.take(),
        )),
    };
    executor::run(Irqs, |spawner| {
        spawner.spawn(run(mode, uart, de).unwrap());
        if mode == 5 {
            spawner.spawn(hold().unwrap());
        }
    })
}

#[panic_handler]
fn panic(_: &core::panic::PanicInfo) -> ! {
    // Never linked: `panic = "immediate-abort"`.
    loop {}
}
