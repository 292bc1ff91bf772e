//! A server on each of the four ports at once: unit 1, 128 holding registers that all four share, at the
//! build's rate and format. For tests of the ports beside each other.
#![no_std]
#![no_main]

mod four;

use board_stm32::Watchdog;
use board_stm32::usart::Usart;
use four::{AS1, AS2, ROLL, RS2, RS4};
use multidrop::protocol::registers::Bank;
use multidrop::{ServerPort, Shared};
use static_cell::{ConstStaticCell, StaticCell};

type Model = four::Model<128>;

#[embassy_executor::task(pool_size = 4)]
async fn receive(port: &'static ServerPort<Usart>) -> ! {
    multidrop::receive(port).await
}

#[embassy_executor::task(pool_size = 4)]
async fn serve(port: &'static ServerPort<Usart>, model: &'static Shared<Model>) -> ! {
    multidrop::serve(port, model).await
}

#[cortex_m_rt::entry]
fn main() -> ! {
    let [as1, as2, rs2, rs4] = four::open(board_stm32::init(Watchdog::DEFAULT));

    static PORTS: StaticCell<[ServerPort<Usart>; 4]> = StaticCell::new();
    let ports = PORTS.init([
        ServerPort::new(as1, &AS1),
        ServerPort::new(as2, &AS2),
        ServerPort::new(rs2, &RS2),
        ServerPort::new(rs4, &RS4),
    ]);
    static MODEL: ConstStaticCell<Shared<Model>> =
        ConstStaticCell::new(Shared::new(four::Model(Bank::new(0))));
    let model = &*MODEL.take();
    board_stm32::run(&ROLL, |spawner| {
        for port in ports.iter() {
            spawner.spawn(receive(port).unwrap());
            spawner.spawn(serve(port, model).unwrap());
        }
    })
}
