//! A managed port that is switched by pins, under traffic: master or slave, RTU or ASCII, two bauds.
//!
//! | pin | is |
//! |---|---|
//! | D3 | open: slave 1; to ground: master, which copies registers 0..=3 of slave 2 every 20 ms |
//! | D4 | open: RTU, 8N1; to ground: ASCII, 7E1 |
//! | D5 | open: 38400 baud; to ground: 115200 |
//! | D8 | high from a pin's change until its loads are accepted |
//! | D9, D10 | change with every transaction that ends well, and badly |
#![no_std]
#![no_main]
#![feature(abi_avr_interrupt)]

use embassy_avr_hal::gpio::{Input, Output, PB0, PB1, PB2, PD2, PD3, PD4, PD5, Pins};
use embassy_avr_hal::usart::{RtuAndAscii, Settings, Usart0};
use embassy_avr_hal::{bind_interrupts, executor, pac};
use embassy_time::Timer;
use embedded_hal::digital::{InputPin, OutputPin, StatefulOutputPin};
use multidrop::line::ChipLine;
use multidrop::protocol::data::RegistersOut;
use multidrop::protocol::exception::Exception;
use multidrop::protocol::format::{Framing, LineFormat};
use multidrop::protocol::port_registers::{Mode, PortRegisters, Refused, Value};
use multidrop::protocol::registers::{Bank, NoCoils, NoRules};
use multidrop::protocol::server::DataModel;
use multidrop::{ManagedPort, PortConfig, Shared, managed_receive, managed_serve};
use static_cell::StaticCell;

const CLOCK_HZ: u32 = 16_000_000;

// ANCHOR: port
const RS4: PortConfig = PortConfig::new("RS4")
    .slave_id(1)
    .baud(38_400)
    .format(LineFormat::F8N1)
    .timeout_ms(15);

/// The slave that is asked.
const PEER: u8 = 2;
const COUNT: usize = 4;

type Usart = Usart0<PD2, CLOCK_HZ, RtuAndAscii>;
type Rs485 = ChipLine<Usart>;
type Port = ManagedPort<Rs485, PortRegisters<Bank<COUNT>, NoCoils, NoRules>>;
// ANCHOR_END: port

bind_interrupts!(struct Irqs { USART0 => Usart; TIME => CLOCK_HZ; });

// ANCHOR: tasks
#[embassy_executor::task]
async fn receive(port: &'static Port) -> ! {
    managed_receive(port).await
}

#[embassy_executor::task]
async fn run(port: &'static Port) -> ! {
    managed_serve(port, &Shared::new(Cells(port))).await
}
// ANCHOR_END: tasks

/// What a slave tells: the port's registers, to be read. The server of all that the port itself has does not fit in beside the rest.
struct Cells(&'static Port);

impl DataModel for Cells {
    fn holding_registers(&mut self, first: u16, out: RegistersOut<'_>) -> Result<(), Exception> {
        self.0
            .registers()
            .with(|rs4| rs4.holding_registers(first, out))
    }
}

// ANCHOR: ask
/// Starts what the registers describe; as a slave it is refused.
#[embassy_executor::task]
async fn ask(port: &'static Port, mut well: Output<PB1>, mut badly: Output<PB2>) -> ! {
    loop {
        Timer::after_millis(20).await;
        if port.start().is_err() {
            continue;
        }
        let Ok(()) = match port.done().await {
            Ok(()) => well.toggle(),
            Err(_) => badly.toggle(),
        };
    }
}
// ANCHOR_END: ask

/// What the pins ask for.
#[derive(Clone, Copy, PartialEq)]
struct Wanted {
    master: bool,
    ascii: bool,
    fast: bool,
}

// ANCHOR: load
fn load(port: &Port, wanted: Wanted) -> Result<(), Refused> {
    if wanted.master {
        port.load(Value::Mode(Mode::Master))?;
        port.load(Value::SlaveId(PEER))?;
    } else {
        port.load(Value::SlaveId(RS4.unit()))?;
        port.load(Value::Mode(Mode::Slave))?;
    }
    // Seven data bits are never together with RTU.
    if wanted.ascii {
        port.load(Value::Framing(Framing::Ascii))?;
        port.load(Value::Format(LineFormat::F7E1))?;
    } else {
        port.load(Value::Format(LineFormat::F8N1))?;
        port.load(Value::Framing(Framing::Rtu))?;
    }
    port.load(Value::Baud(if wanted.fast { 115_200 } else { 38_400 }))
}
// ANCHOR_END: load

#[embassy_executor::task]
async fn switch(
    port: &'static Port,
    switches: (Input<PD3>, Input<PD4>, Input<PD5>),
    mut changing: Output<PB0>,
) -> ! {
    let (mut mode, mut framing, mut baud) = switches;
    let mut before = None;
    loop {
        let Ok(master) = mode.is_low();
        let Ok(ascii) = framing.is_low();
        let Ok(fast) = baud.is_low();
        let wanted = Wanted {
            master,
            ascii,
            fast,
        };
        if before != Some(wanted) {
            let Ok(()) = changing.set_high();
            // Refused it stays high.
            if load(port, wanted).is_ok() {
                let Ok(()) = changing.set_low();
                before = Some(wanted);
            }
        }
        Timer::after_millis(2).await;
    }
}

#[avr_device::entry]
fn main() -> ! {
    let chip = pac::Peripherals::take().unwrap();
    let pins = Pins::new(chip.PORTB, chip.PORTC, chip.PORTD);
    let settings = const {
        match Settings::new(&RS4.line(), CLOCK_HZ) {
            Ok(settings) => settings,
            Err(_) => panic!("38400 baud at 16 MHz"),
        }
    };
    let usart = Usart::new(chip.USART0, &chip.TC1, pins.PD0, pins.PD1, pins.PD2, Irqs);
    let line = board_nano::line(usart, &settings);

    static PORT_CELL: StaticCell<Port> = StaticCell::new();
    let port = PORT_CELL.init(Port::new(line, &RS4, RS4.bank(), NoCoils));
    port.registers().with(|rs4| {
        for (index, cell) in (0..).zip(rs4.regs_mut().cells_mut()) {
            *cell = 0x1100 + index;
        }
    });
    let _ = port.load(Value::RegCnt(COUNT as u16));
    let switches = (
        Input::new(pins.PD3, true),
        Input::new(pins.PD4, true),
        Input::new(pins.PD5, true),
    );
    let well = Output::new(pins.PB1, false);
    let badly = Output::new(pins.PB2, false);
    let changing = Output::new(pins.PB0, false);
    executor::run(Irqs, |spawner| {
        spawner.spawn(receive(port).unwrap());
        spawner.spawn(run(port).unwrap());
        spawner.spawn(ask(port, well, badly).unwrap());
        spawner.spawn(switch(port, switches, changing).unwrap());
    })
}
