//! A server on each of the four ports, unit 1, that counts, and a task that holds interrupts off for as long as PC0 is high: for
//! tests of what the ports do with characters and alarms that they come to see late. At the build's rate and format. In QEMU, which
//! has no pins, nothing is held.
#![no_std]
#![no_main]

mod four;

use board_stm32::Watchdog;
use board_stm32::usart::Usart;
use embassy_stm32::pac::{GPIOC, gpio::vals::Pupdr};
use embassy_time::{Duration, Timer};
use four::{AS1, AS2, ROLL, RS2, RS4};
use multidrop::Shared;
use multidrop::protocol::registers::Bank;
use multidrop::protocol::server::Counted;
use static_cell::{ConstStaticCell, StaticCell};

/// How often PC0 is looked at.
const LOOK: Duration = Duration::from_micros(50);

/// Ports that count, with the log of events.
type Port = multidrop::ServerPort<Usart, Counted<64>>;

type Model = four::Model<16>;

#[embassy_executor::task(pool_size = 4)]
async fn receive(port: &'static Port) -> ! {
    multidrop::receive(port).await
}

#[embassy_executor::task(pool_size = 4)]
async fn serve(port: &'static Port, model: &'static Shared<Model>) -> ! {
    multidrop::serve(port, model).await
}

#[embassy_executor::task]
async fn hold() -> ! {
    GPIOC.pupdr().modify(|w| w.set_pupdr(0, Pupdr::PULL_DOWN));
    loop {
        Timer::after(LOOK).await;
        critical_section::with(|_| while GPIOC.idr().read().idr(0).to_bits() == 1 {});
    }
}

#[cortex_m_rt::entry]
fn main() -> ! {
    let [as1, as2, rs2, rs4] = four::open(board_stm32::init(Watchdog::DEFAULT));

    static PORTS: StaticCell<[Port; 4]> = StaticCell::new();
    let ports = PORTS.init([
        Port::counted(as1, &AS1),
        Port::counted(as2, &AS2),
        Port::counted(rs2, &RS2),
        Port::counted(rs4, &RS4),
    ]);
    static MODEL: ConstStaticCell<Shared<Model>> =
        ConstStaticCell::new(Shared::new(four::Model(Bank::new(0))));
    let model = &*MODEL.take();
    board_stm32::run(&ROLL, |spawner| {
        for port in ports.iter() {
            spawner.spawn(receive(port).unwrap());
            spawner.spawn(serve(port, model).unwrap());
        }
        spawner.spawn(hold().unwrap());
    })
}
