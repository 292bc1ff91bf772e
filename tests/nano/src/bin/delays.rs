//! A line whose answers wait: every frame is sent back, and one with function 0x42 sets DE_LEAD in us and RESPONSE_DELAY in ms,
//! each in two bytes with the high one first. What follows is a greeting with the new settings. 38400 8N1.
#![no_std]
#![no_main]
#![feature(abi_avr_interrupt)]

use embassy_avr_hal::gpio::{PD2, Pins};
use embassy_avr_hal::usart::{Delayed, RtuOnly, Settings, Usart0};
use embassy_avr_hal::{bind_interrupts, executor, pac};
use multidrop::line::{ChipLine, Line, LineConfig};
use multidrop::protocol::format::LineFormat;

const CLOCK_HZ: u32 = 16_000_000;
const SET_UP: u8 = 0x42;
const GREETING: &[u8] = b"here again";

const START: LineConfig = LineConfig {
    baud: 38_400,
    format: LineFormat::F8N1,
    ..LineConfig::DEFAULT
};

type Usart = Usart0<PD2, CLOCK_HZ, Delayed<RtuOnly>>;
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
        let [_, SET_UP, lead_high, lead_low, delay_high, delay_low] = frame.bytes()[..len.into()]
        else {
            frame.release(len).sent().await;
            continue;
        };
        drop(frame);
        let config = LineConfig {
            de_lead_us: u16::from_be_bytes([lead_high, lead_low]),
            response_delay_ms: u16::from_be_bytes([delay_high, delay_low]),
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
