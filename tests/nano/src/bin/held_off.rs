//! A server that is kept from its line: while D3 is low, interrupts are off. The map is that of `conformance`, unit 17, 38400 8N1
//! if not built otherwise.
#![no_std]
#![no_main]
#![feature(abi_avr_interrupt)]

use embassy_avr_hal::edge::EdgeInput;
use embassy_avr_hal::gpio::{Input, PD2, PD3, Pins};
use embassy_avr_hal::usart::{Settings, Usart0};
use embassy_avr_hal::{bind_interrupts, executor, pac};
use embedded_hal::digital::InputPin;
use embedded_hal_async::digital::Wait;
use multidrop::line::ChipLine;
use multidrop::protocol::format::LineFormat;
use multidrop::protocol::server::Counted;
use multidrop::{PortConfig, Shared};
use multidrop_apps::conformance::{Conformance, EVENTS, UNIT};
use static_cell::{ConstStaticCell, StaticCell};

const CLOCK_HZ: u32 = 16_000_000;

const BAUD: u32 = match option_env!("MULTIDROP_BAUD") {
    None => 38_400,
    Some(text) => match u32::from_str_radix(text, 10) {
        Ok(baud) => baud,
        Err(_) => panic!("MULTIDROP_BAUD must be a decimal number"),
    },
};

const PORT: PortConfig = PortConfig::new("RS4")
    .slave_id(UNIT)
    .baud(BAUD)
    .format(LineFormat::F8N1);

type Usart = Usart0<PD2, CLOCK_HZ>;
type Rs485 = ChipLine<Usart>;
type Port = multidrop::ServerPort<Rs485, Counted<EVENTS>>;
type Model = Shared<Conformance<0>>;

bind_interrupts!(struct Irqs { USART0 => Usart; INT1; });

#[embassy_executor::task]
async fn receive(port: &'static Port) -> ! {
    multidrop::receive(port).await
}

#[embassy_executor::task]
async fn serve(port: &'static Port, model: &'static Model) -> ! {
    multidrop::serve(port, model).await
}

#[embassy_executor::task]
async fn hold_off(input: Input<PD3>) {
    let mut input = EdgeInput::new(input, Irqs);
    loop {
        let Ok(()) = input.wait_for_low().await;
        critical_section::with(|_| while input.is_low() == Ok(true) {});
    }
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
    let usart = Usart::new(chip.USART0, &chip.TC1, pins.PD0, pins.PD1, pins.PD2, Irqs);
    let line = board_nano::line(usart, &settings);
    static PORT_CELL: StaticCell<Port> = StaticCell::new();
    let port = PORT_CELL.init(Port::counted(line, &PORT));
    static MODEL: ConstStaticCell<Model> =
        ConstStaticCell::new(Shared::new(Conformance::new("nano")));
    let model = MODEL.take();
    let input = Input::new(pins.PD3, true);
    executor::run(Irqs, |spawner| {
        spawner.spawn(receive(port).unwrap());
        spawner.spawn(serve(port, model).unwrap());
        spawner.spawn(hold_off(input).unwrap());
    })
}
