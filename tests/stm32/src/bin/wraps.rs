//! A server on RS4, unit 1, and `embassy-time`, with their counters set near their ends: for tests in QEMU.
//!
//! | register | holds |
//! |---|---|
//! | 0 | how often 10 ms have passed |
//! | 1 | how late the latest of these was seen, in us |
//! | 2 | written: after 10 ms TIM5, which measures the silence on the line, is set this many us before its end |
//!
//! TIM2, which `embassy-time` counts with, begins a second before its end.
#![no_std]
#![no_main]

use core::cell::Cell;

use board_stm32::ports::PortSetup;
use board_stm32::usart::Usart;
use board_stm32::{Roll, Watchdog, options};
use embassy_time::{Duration, Instant, Timer};
use multidrop::protocol::data::{Registers, RegistersOut};
use multidrop::protocol::exception::Exception;
use multidrop::protocol::format::LineFormat;
use multidrop::protocol::registers::Bank;
use multidrop::protocol::server::DataModel;
use multidrop::{PortConfig, ServerPort, Shared};
use static_cell::{ConstStaticCell, StaticCell};

const RS4: PortConfig = PortConfig::new("RS4")
    .baud(options::baud(38_400))
    .format(options::format(LineFormat::F8N1));

const BEAT: Duration = Duration::from_millis(10);

struct Model {
    bank: Bank<3>,
    /// What was written to register 2.
    wrap_in_us: Cell<Option<u16>>,
}

impl DataModel for Model {
    const WRITES_MAY_FAIL: bool = false;

    fn holding_registers(&mut self, first: u16, out: RegistersOut<'_>) -> Result<(), Exception> {
        self.bank.read(first, out)
    }

    fn check_registers(&self, first: u16, values: Registers<'_>) -> Result<(), Exception> {
        self.bank.check(first, values)
    }

    fn write_registers(&mut self, first: u16, values: Registers<'_>) -> Result<(), Exception> {
        self.bank.write(first, values)?;
        self.wrap_in_us.set(self.bank.get(2));
        Ok(())
    }
}

/// The watchdog sees to the executor alone.
static ROLL: Roll<0> = Roll::new();

#[embassy_executor::task]
async fn receive(port: &'static ServerPort<Usart>) -> ! {
    multidrop::receive(port).await
}

#[embassy_executor::task]
async fn serve(port: &'static ServerPort<Usart>, model: &'static Shared<Model>) -> ! {
    multidrop::serve(port, model).await
}

#[embassy_executor::task]
async fn beat(model: &'static Shared<Model>) -> ! {
    let mut due = Instant::now();
    loop {
        due += BEAT;
        Timer::at(due).await;
        let late = due.elapsed().as_micros() as u16;
        let wrap_in_us = model.with(|model| {
            let [beats, latest, _] = model.bank.cells_mut();
            *beats = beats.wrapping_add(1);
            *latest = late.max(*latest);
            model.wrap_in_us.take()
        });
        if let Some(us) = wrap_in_us {
            // The answer to the request that has set it is over by then.
            Timer::after(BEAT).await;
            board_stm32::wrap_line_timer_in(us.into());
        }
    }
}

#[cortex_m_rt::entry]
fn main() -> ! {
    let board = board_stm32::init(Watchdog::DEFAULT);
    board_stm32::wrap_time_in(1_000_000);
    let line = board.rs4.open(const { PortSetup::new(&RS4) });
    static PORT: StaticCell<ServerPort<Usart>> = StaticCell::new();
    let port = PORT.init(ServerPort::new(line, &RS4));
    static MODEL: ConstStaticCell<Shared<Model>> = ConstStaticCell::new(Shared::new(Model {
        bank: Bank::new(0),
        wrap_in_us: Cell::new(None),
    }));
    let model = &*MODEL.take();
    board_stm32::run(&ROLL, |spawner| {
        spawner.spawn(receive(port).unwrap());
        spawner.spawn(serve(port, model).unwrap());
        spawner.spawn(beat(model).unwrap());
    })
}
