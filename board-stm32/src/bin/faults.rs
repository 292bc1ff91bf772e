//! A unit that fails while it answers, for tests: unit 5 on RS4, 38400 8N1 unless built for others. The request
//! selects the fault ([`multidrop_apps::faults`]).
#![no_std]
#![no_main]

use board_stm32::ports::PortSetup;
use board_stm32::usart::Usart;
use board_stm32::{Dog, Watchdog, options};
use cortex_m::peripheral::NVIC;
use embassy_stm32::interrupt;
use embassy_stm32::interrupt::InterruptExt;
use embassy_stm32::pac;
use embassy_time::{Duration, Timer};
use multidrop::protocol::format::LineFormat;
use multidrop::{PortConfig, ServerPort, Shared};
use multidrop_apps::faults::{Asked, Failure, Faults, keep, use_up_stack};
use static_cell::StaticCell;

const BAUD: u32 = options::baud(38_400);

const PORT: PortConfig = PortConfig::new("RS4")
    .slave_id(5)
    .baud(BAUD)
    .format(LineFormat::F8N1);

/// The time of one bit.
const BIT: Duration = Duration::from_micros(1_000_000_u64.div_ceil(BAUD as u64));

/// The bits from t1.5, when an answer is worked out, to the middle of an answer with 16 registers, which has 370 bits.
const INTO_THE_ANSWER: u32 = 170;

/// Where RAM, and with it the stack, ends (RM0090 2.3.1).
const RAM_END: usize = 0x2002_0000;

multidrop::tasks! {
    /// The tasks that have to be alive.
    static ROLL: Roll<Dog>;

    fn receive(port: &'static ServerPort<Usart>) = multidrop::receive(port);
    fn serve(port: &'static ServerPort<Usart>, asked: &'static Asked) = multidrop::serve(
        port,
        &Shared::new(Faults::new(asked, board_stm32::reset_cause(), board_stm32::stack)),
    );

    /// Fails in the way that the request selects.
    fn fail(port: &'static ServerPort<Usart>, asked: &'static Asked) = async move {
        loop {
            let failure = asked.wait().await;
            Timer::after(BIT * INTO_THE_ANSWER).await;
            match failure {
                Failure::Panic => panic!(),
                Failure::PanicInInterrupt => {
                    // SAFETY: the handler of the interrupt is below.
                    unsafe { interrupt::SPI1.enable() };
                    NVIC::pend(pac::Interrupt::SPI1);
                }
                Failure::UnhandledInterrupt => {
                    // SAFETY: an interrupt without a handler is intended.
                    unsafe { interrupt::SPI2.enable() };
                    NVIC::pend(pac::Interrupt::SPI2);
                }
                Failure::Hang => loop {
                    cortex_m::asm::nop();
                },
                Failure::HangWithInterruptsOff => {
                    cortex_m::interrupt::disable();
                    loop {
                        cortex_m::asm::nop();
                    }
                }
                // RM0090 30.6.4: TXEIE and TCIE. The port sets either of them with `Registers::send`.
                Failure::LostReady => pac::UART4.cr1().modify(|w| w.set_txeie(false)),
                Failure::Keep => keep(port).await,
                Failure::OverflowStack => {
                    // The stack grows into the guard at its end, and no farther: without the guard nothing would happen.
                    let end = RAM_END - board_stm32::stack().size - 64;
                    use_up_stack(&|| {
                        let here = 0_u8;
                        core::hint::black_box(&raw const here).addr() < end
                    });
                }
                Failure::LostSent => {
                    // Clears TCIE each time that the port sets it, until long after the answer.
                    for _ in 0..400 {
                        pac::UART4.cr1().modify(|w| w.set_tcie(false));
                        Timer::after(BIT).await;
                    }
                }
            }
        }
    };
}

#[interrupt]
fn SPI1() {
    panic!();
}

#[cortex_m_rt::entry]
fn main() -> ! {
    let board = board_stm32::init(Watchdog::DEFAULT);
    let line = board.rs4.open(const { PortSetup::new(&PORT) });

    static ASKED: StaticCell<Asked> = StaticCell::new();
    let asked = ASKED.init(Asked::new());
    static PORT_CELL: StaticCell<ServerPort<Usart>> = StaticCell::new();
    let port = PORT_CELL.init(ServerPort::new(line, &PORT));
    board_stm32::run(&ROLL, |spawner| {
        spawner.spawn(receive(port).unwrap());
        spawner.spawn(serve(port, asked).unwrap());
        spawner.spawn(fail(port, asked).unwrap());
    })
}
