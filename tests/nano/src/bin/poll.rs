//! A client that reads a list over and over: 16 registers, 16 coils and one register of unit 1, as often as the
//! line allows. PB5, a Nano's LED, is on as long as all of it is fresh.
#![no_std]
#![no_main]
#![feature(abi_avr_interrupt)]

use embassy_avr_hal::gpio::{Output, PB5, PD2, Pins};
use embassy_avr_hal::usart::{Settings, Usart0};
use embassy_avr_hal::{bind_interrupts, executor, pac};
use embassy_time::Timer;
use embedded_hal::digital::OutputPin;
use multidrop::line::ChipLine;
use multidrop::poll::{PollEntry, PollList};
use multidrop::protocol::format::LineFormat;
use multidrop::{ClientConfig, ClientPort, PortConfig};
use static_cell::StaticCell;

const CLOCK_HZ: u32 = 16_000_000;

const PORT: PortConfig = PortConfig::new("RS4")
    .client()
    .baud(38_400)
    .format(LineFormat::F8N1);

type Usart = Usart0<PD2, CLOCK_HZ>;
type Rs485 = ChipLine<Usart>;
type Port = ClientPort<Rs485, 1>;
type List = PollList<3, 33>;

bind_interrupts!(struct Irqs { USART0 => Usart; TIME => CLOCK_HZ; });

#[embassy_executor::task]
async fn receive(port: &'static Port) -> ! {
    multidrop::client_receive(port).await
}

#[embassy_executor::task]
async fn read(port: &'static Port, list: &'static List) -> ! {
    let client = port.client(ClientConfig::new().timeout_ms(50));
    list.run(client).await
}

#[embassy_executor::task]
async fn show(list: &'static List, mut led: Output<PB5>) -> ! {
    loop {
        Timer::after_millis(50).await;
        let fresh = (0..3).all(|entry| !list.health(entry).is_stale(200));
        let Ok(()) = led.set_state(fresh.into());
    }
}

#[avr_device::entry]
fn main() -> ! {
    let chip = pac::Peripherals::take().unwrap();
    let pins = Pins::new(chip.PORTB, chip.PORTC, chip.PORTD);
    let settings = const {
        match Settings::new(&PORT.line(), CLOCK_HZ) {
            Ok(settings) => settings,
            Err(_) => panic!("38400 baud at 16 MHz"),
        }
    };
    let usart = Usart::new(chip.USART0, &chip.TC1, pins.PD0, pins.PD1, pins.PD2, Irqs);
    let line = board_nano::line(usart, &settings);

    static PORT_CELL: StaticCell<Port> = StaticCell::new();
    let port = PORT_CELL.init(Port::new(line));
    static LIST: StaticCell<List> = StaticCell::new();
    let list = LIST.init(List::new([
        PollEntry::holding_registers(1, 0, 16).period_ms(1),
        PollEntry::coils(1, 0, 16).period_ms(1),
        PollEntry::holding_registers(1, 15, 1).period_ms(1),
    ]));
    let led = Output::new(pins.PB5, false);
    executor::run(Irqs, |spawner| {
        spawner.spawn(receive(port).unwrap());
        spawner.spawn(read(port, list).unwrap());
        spawner.spawn(show(list, led).unwrap());
    })
}
