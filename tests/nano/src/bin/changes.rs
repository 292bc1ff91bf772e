//! A line that is set up anew while it sends: every frame is sent back, and when D3 falls after its t1.5 the line goes from 38400
//! 8N1 to 9600 8E1, or back. Before that the next frame is not looked at.
#![no_std]
#![no_main]
#![feature(abi_avr_interrupt)]

use embassy_avr_hal::edge::EdgeInput;
use embassy_avr_hal::gpio::{Input, PD2, PD3, Pins};
use embassy_avr_hal::usart::{RtuOnly, Settings, Usart0};
use embassy_avr_hal::{bind_interrupts, executor, pac};
use embassy_futures::join::join;
use embedded_hal_async::digital::Wait;
use multidrop::line::{ChipLine, Line, LineConfig};
use multidrop::protocol::format::LineFormat;

const CLOCK_HZ: u32 = 16_000_000;

const SETTINGS: [LineConfig; 2] = [
    LineConfig {
        baud: 38_400,
        format: LineFormat::F8N1,
        ..LineConfig::DEFAULT
    },
    LineConfig {
        baud: 9_600,
        format: LineFormat::F8E1,
        ..LineConfig::DEFAULT
    },
];

type Usart = Usart0<PD2, CLOCK_HZ, RtuOnly>;
type Rs485 = ChipLine<Usart>;

bind_interrupts!(struct Irqs { USART0 => Usart; INT1; });

#[embassy_executor::task]
async fn repeat(line: Rs485, input: Input<PD3>) {
    let mut input = EdgeInput::new(input, Irqs);
    let mut now = 0;
    loop {
        let Ok(mut frame) = line.receive().await else {
            continue;
        };
        let len = frame.request_len();
        if !frame.settle().await {
            continue;
        }
        let mut answer = frame.release(len);
        let change = async {
            let Ok(()) = input.wait_for_falling_edge().await;
            now = 1 - now;
            let _ = line.configure(SETTINGS[now]).await;
        };
        join(answer.sent(), change).await;
    }
}

#[avr_device::entry]
fn main() -> ! {
    let chip = pac::Peripherals::take().unwrap();
    let pins = Pins::new(chip.PORTB, chip.PORTC, chip.PORTD);
    let settings = const {
        match Settings::new(&SETTINGS[0], CLOCK_HZ) {
            Ok(settings) => settings,
            Err(_) => panic!("38400 baud at 16 MHz"),
        }
    };
    let usart = Usart::new(chip.USART0, &chip.TC1, pins.PD0, pins.PD1, pins.PD2, Irqs);
    let line = board_nano::line(usart, &settings);
    let input = Input::new(pins.PD3, true);
    executor::run(Irqs, |spawner| spawner.spawn(repeat(line, input).unwrap()))
}
