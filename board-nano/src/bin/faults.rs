//! A unit that fails while it answers, for tests: unit 5, 38400 8N1 unless built for others. The request
//! selects the fault ([`multidrop_apps::faults`]).
#![no_std]
#![no_main]
#![feature(abi_avr_interrupt)]

use avr_device::asm::delay_cycles;
use avr_device::interrupt;
use board_nano::{CLOCK_HZ, Rs485, bind_interrupts, options, settings};
use embassy_avr_hal::pac;
use multidrop::protocol::format::LineFormat;
use multidrop::{PortConfig, ServerPort, Shared};
use multidrop_apps::faults::{Asked, Failure, Faults, keep, use_up_stack};
use static_cell::StaticCell;

const BAUD: u32 = options::baud(38_400);

const PORT: PortConfig = PortConfig::new("RS4")
    .slave_id(5)
    .baud(BAUD)
    .format(LineFormat::F8N1);

/// The time of one character.
const CHARACTER: u32 = 10 * CLOCK_HZ / BAUD;

/// From t1.5, when an answer is worked out, into the middle of one with 16 registers, which has 37 characters.
const INTO_THE_ANSWER: u32 = 17 * CHARACTER;

/// Bits of UCSR0B (DS 20.11.3).
const TXCIE: u8 = 1 << 6;
const UDRIE: u8 = 1 << 5;

bind_interrupts!(struct Irqs { USART0 => Rs485; });

/// Turns interrupts of the USART off behind the line's back.
fn lose(interrupts: u8) {
    interrupt::free(|_| {
        // SAFETY: a unit that fails.
        let usart = unsafe { pac::Peripherals::steal() }.USART0;
        // SAFETY: enable bits only.
        usart
            .ucsr0b()
            .modify(|r, w| unsafe { w.bits(r.bits() & !interrupts) });
    });
}

multidrop::tasks! {
    /// The tasks that have to be alive.
    static ROLL: Roll<Irqs>;

    fn receive(port: &'static ServerPort<Rs485>) = multidrop::receive(port);
    fn serve(port: &'static ServerPort<Rs485>, asked: &'static Asked) = multidrop::serve(
        port,
        &Shared::new(Faults::new(asked, board_nano::reset_cause(), board_nano::stack)),
    );

    /// Fails as it is asked to.
    fn fail(
        port: &'static ServerPort<Rs485>,
        asked: &'static Asked,
        timer0: pac::TC0,
        timer2: pac::TC2
    ) = async move {
        loop {
            let failure = asked.wait().await;
            delay_cycles(INTO_THE_ANSWER);
            match failure {
                Failure::Panic => panic!(),
                Failure::PanicInInterrupt => {
                    timer0.tccr0b().write(|w| w.cs0().direct());
                    timer0.timsk0().write(|w| w.toie0().set_bit());
                }
                Failure::UnhandledInterrupt => {
                    timer2.tccr2b().write(|w| w.cs2().direct());
                    timer2.timsk2().write(|w| w.toie2().set_bit());
                }
                Failure::Hang => loop {
                    avr_device::asm::nop();
                },
                Failure::HangWithInterruptsOff => {
                    interrupt::disable();
                    loop {
                        avr_device::asm::nop();
                    }
                }
                Failure::LostReady => lose(UDRIE),
                Failure::Keep => keep(port).await,
                Failure::OverflowStack => {
                    use_up_stack(&|| {
                        let stack = board_nano::stack();
                        stack.used >= stack.size
                    });
                }
                Failure::LostSent => {
                    // Whenever the line sets it, until long after.
                    for _ in 0..400 {
                        lose(TXCIE);
                        delay_cycles(CHARACTER / 10);
                    }
                }
            }
        }
    };
}

/// TIMER0_OVF (DS 12.4: vector 16, counted from 0).
#[unsafe(no_mangle)]
extern "avr-interrupt" fn __vector_16() {
    panic!();
}

#[avr_device::entry]
fn main() -> ! {
    let board = board_nano::init(Irqs);
    let line = board.rs4.open(Irqs, const { settings(&PORT) });

    static ASKED: StaticCell<Asked> = StaticCell::new();
    let asked = ASKED.init(Asked::new());
    static PORT_CELL: StaticCell<ServerPort<Rs485>> = StaticCell::new();
    let port = PORT_CELL.init(ServerPort::new(line, &PORT));
    board_nano::run(&ROLL, |spawner| {
        spawner.spawn(receive(port).unwrap());
        spawner.spawn(serve(port, asked).unwrap());
        spawner.spawn(fail(port, asked, board.TC0, board.TC2).unwrap());
    })
}
