//! A server that waits for edges on port D beside: unit 1, 16 items of each table, 38400 8N1 if not built otherwise.
//!
//! | pin | is |
//! |---|---|
//! | PC0 | DE |
//! | PD2, PD3 | each edge, by INT0 and INT1, changes PB0 and PB1 |
//! | PD4 | each edge changes PB2 |
//! | PD5 | each rising edge changes PB3 |
//! | PD6 | PB4 follows its level |
#![no_std]
#![no_main]
#![feature(abi_avr_interrupt)]

use embassy_avr_hal::edge::EdgeInput;
use embassy_avr_hal::gpio::{
    Input, Output, PB0, PB1, PB2, PB3, PB4, PC0, PD2, PD3, PD4, PD5, PD6, Pins,
};
use embassy_avr_hal::usart::{Settings, Usart0};
use embassy_avr_hal::{bind_interrupts, executor, pac};
use embedded_hal::digital::StatefulOutputPin;
use embedded_hal_async::digital::Wait;
use multidrop::line::ChipLine;
use multidrop::protocol::format::LineFormat;
use multidrop::{PortConfig, ServerPort, Shared};
use multidrop_apps::yardstick::yardstick;
use static_cell::StaticCell;

const CLOCK_HZ: u32 = 16_000_000;

const BAUD: u32 = match option_env!("MULTIDROP_BAUD") {
    None => 38_400,
    Some(text) => match u32::from_str_radix(text, 10) {
        Ok(baud) => baud,
        Err(_) => panic!("MULTIDROP_BAUD must be a decimal number"),
    },
};

const PORT: PortConfig = PortConfig::new("RS4")
    .slave_id(1)
    .baud(BAUD)
    .format(LineFormat::F8N1);

type Usart = Usart0<PC0, CLOCK_HZ>;
type Rs485 = ChipLine<Usart>;

bind_interrupts!(struct Irqs { USART0 => Usart; INT0; INT1; PCINT2; });

macro_rules! follow {
    ($($name:ident: $input:ident, $output:ident, $wait:ident;)*) => {
        $(
            #[embassy_executor::task]
            async fn $name(input: Input<$input>, mut output: Output<$output>) {
                let mut input = EdgeInput::new(input, Irqs);
                loop {
                    let Ok(()) = input.$wait().await;
                    let Ok(()) = output.toggle();
                }
            }
        )*
    };
}

follow! {
    follow_int0: PD2, PB0, wait_for_any_edge;
    follow_int1: PD3, PB1, wait_for_any_edge;
    follow_change: PD4, PB2, wait_for_any_edge;
    follow_rise: PD5, PB3, wait_for_rising_edge;
}

#[embassy_executor::task]
async fn follow_level(input: Input<PD6>, mut output: Output<PB4>) {
    let mut input = EdgeInput::new(input, Irqs);
    loop {
        let Ok(()) = input.wait_for_high().await;
        output.high();
        let Ok(()) = input.wait_for_low().await;
        output.low();
    }
}

#[embassy_executor::task]
async fn receive(port: &'static ServerPort<Rs485>) -> ! {
    multidrop::receive(port).await
}

#[embassy_executor::task]
async fn serve(port: &'static ServerPort<Rs485>) -> ! {
    let model = Shared::new(yardstick::<16, 2>());
    multidrop::serve(port, &model).await
}

#[avr_device::entry]
fn main() -> ! {
    let chip = pac::Peripherals::take().unwrap();
    let pins = Pins::new(chip.PORTB, chip.PORTC, chip.PORTD);
    let settings = const {
        match Settings::new(&PORT.line(), CLOCK_HZ) {
            Ok(settings) => settings,
            Err(_) => panic!("the rate"),
        }
    };
    let usart = Usart::new(chip.USART0, &chip.TC1, pins.PD0, pins.PD1, pins.PC0, Irqs);
    let line = board_nano::line(usart, &settings);
    static PORT_CELL: StaticCell<ServerPort<Rs485>> = StaticCell::new();
    let port = PORT_CELL.init(ServerPort::new(line, &PORT));
    executor::run(Irqs, |spawner| {
        spawner.spawn(receive(port).unwrap());
        spawner.spawn(serve(port).unwrap());
        let (input, output) = (Input::new(pins.PD2, true), Output::new(pins.PB0, false));
        spawner.spawn(follow_int0(input, output).unwrap());
        let (input, output) = (Input::new(pins.PD3, true), Output::new(pins.PB1, false));
        spawner.spawn(follow_int1(input, output).unwrap());
        let (input, output) = (Input::new(pins.PD4, true), Output::new(pins.PB2, false));
        spawner.spawn(follow_change(input, output).unwrap());
        let (input, output) = (Input::new(pins.PD5, true), Output::new(pins.PB3, false));
        spawner.spawn(follow_rise(input, output).unwrap());
        let (input, output) = (Input::new(pins.PD6, true), Output::new(pins.PB4, false));
        spawner.spawn(follow_level(input, output).unwrap());
    })
}
