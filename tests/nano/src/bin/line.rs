//! The line by itself, without a server: every frame is sent back, and one with function 0x42 sets the
//! line up anew: index into `LineFormat::ALL`, the baud in hundreds, high byte first, and what ends a frame, as the
//! register INTER_CHARACTER has it. What follows is a greeting at the new settings.
#![no_std]
#![no_main]
#![feature(abi_avr_interrupt)]

use embassy_avr_hal::gpio::{PD2, Pins};
use embassy_avr_hal::usart::{RtuOnly, Settings, Slow, Usart0};
use embassy_avr_hal::{bind_interrupts, executor, pac};
use multidrop::line::{ChipLine, InterCharacter, Line, LineConfig, Role};
use multidrop::protocol::format::{Framing, LineFormat};
use multidrop::protocol::port_registers::Flow;

const CLOCK_HZ: u32 = 16_000_000;
const SET_UP: u8 = 0x42;
const GREETING: &[u8] = b"here again";

const START: LineConfig = LineConfig {
    baud: 38_400,
    framing: Framing::Rtu,
    format: LineFormat::F8N1,
    inter_character: InterCharacter::Strict,
    flow: Flow::None,
    role: Role::Server,
    ..LineConfig::DEFAULT
};

type Usart = Usart0<PD2, CLOCK_HZ, Slow<RtuOnly>>;
type Rs485 = ChipLine<Usart>;

bind_interrupts!(struct Irqs { USART0 => Usart; });

#[embassy_executor::task]
async fn repeat(line: Rs485) {
    loop {
        let Ok(mut frame) = line.receive().await else {
            continue;
        };
        let len = frame.request_len();
        if !frame.settle().await {
            continue;
        }
        let [_, SET_UP, format, high, low, gap] = frame.bytes()[..len.into()] else {
            frame.release(len).sent().await;
            continue;
        };
        drop(frame);
        let config = LineConfig {
            baud: 100 * u32::from(u16::from_be_bytes([high, low])),
            format: LineFormat::ALL[usize::from(format) % LineFormat::ALL.len()],
            inter_character: match gap {
                0 => InterCharacter::Strict,
                1 => InterCharacter::Off,
                ms => InterCharacter::Gap(ms),
            },
            ..START
        };
        let answer = match line.configure(config).await {
            Ok(()) => GREETING,
            Err(_) => b"no",
        };
        let _ = line.transmit(answer).await;
    }
}

#[avr_device::entry]
fn main() -> ! {
    let chip = pac::Peripherals::take().unwrap();
    let pins = Pins::new(chip.PORTB, chip.PORTC, chip.PORTD);
    let settings = const {
        match Settings::new(&START, CLOCK_HZ) {
            Ok(settings) => settings,
            Err(_) => panic!("38400 baud at 16 MHz"),
        }
    };
    let usart = Usart::new(chip.USART0, &chip.TC1, pins.PD0, pins.PD1, pins.PD2, Irqs);
    let line = board_nano::line(usart, &settings);
    executor::run(Irqs, |spawner| spawner.spawn(repeat(line).unwrap()))
}
