//! A server on each of the four ports at once: unit 1, 128 holding registers that all four share, at the
//! build's rate and format. For tests of the ports beside each other.
#![no_std]
#![no_main]

use board_stm32::ports::PortSettings;
use board_stm32::usart::Usart;
use board_stm32::{Roll, Watchdog, options};
use multidrop_firmware::protocol::data::{Registers, RegistersOut};
use multidrop_firmware::protocol::exception::Exception;
use multidrop_firmware::protocol::format::LineFormat;
use multidrop_firmware::protocol::registers::Bank;
use multidrop_firmware::protocol::server::DataModel;
use multidrop_firmware::{Port, PortConfig, Shared};
use static_cell::{ConstStaticCell, StaticCell};

const fn port(name: &'static str) -> PortConfig {
    PortConfig::new(name)
        .baud(options::baud(38_400))
        .format(options::format(LineFormat::F8N1))
}

const AS1: PortConfig = port("AS1");
const AS2: PortConfig = port("AS2");
const RS2: PortConfig = port("RS2");
const RS4: PortConfig = port("RS4");

struct Model(Bank<128>);

impl DataModel for Model {
    const WRITES_MAY_FAIL: bool = false;

    fn holding_registers(&mut self, first: u16, out: RegistersOut<'_>) -> Result<(), Exception> {
        self.0.read(first, out)
    }

    fn check_registers(&self, first: u16, values: Registers<'_>) -> Result<(), Exception> {
        self.0.check(first, values)
    }

    fn write_registers(&mut self, first: u16, values: Registers<'_>) -> Result<(), Exception> {
        self.0.write(first, values)
    }
}

/// The watchdog sees to the executor alone.
static ROLL: Roll<0> = Roll::new();

#[embassy_executor::task(pool_size = 4)]
async fn receive(port: &'static Port<Usart>) -> ! {
    multidrop_firmware::receive(port).await
}

#[embassy_executor::task(pool_size = 4)]
async fn serve(port: &'static Port<Usart>, model: &'static Shared<Model>) -> ! {
    multidrop_firmware::serve(port, model).await
}

#[cortex_m_rt::entry]
fn main() -> ! {
    let board = board_stm32::init(Watchdog::DEFAULT);
    let lines = [
        board.as1.open(const { PortSettings::new(&AS1) }),
        board.as2.open(const { PortSettings::new(&AS2) }),
        board.rs2.open(const { PortSettings::new(&RS2) }),
        board.rs4.open(const { PortSettings::new(&RS4) }),
    ];
    let [as1, as2, rs2, rs4] = lines;

    static PORTS: StaticCell<[Port<Usart>; 4]> = StaticCell::new();
    let ports = PORTS.init([
        Port::new(as1, &AS1),
        Port::new(as2, &AS2),
        Port::new(rs2, &RS2),
        Port::new(rs4, &RS4),
    ]);
    static MODEL: ConstStaticCell<Shared<Model>> =
        ConstStaticCell::new(Shared::new(Model(Bank::new(0))));
    let model = &*MODEL.take();
    board_stm32::run(&ROLL, |spawner| {
        for port in ports.iter() {
            spawner.spawn(receive(port).unwrap());
            spawner.spawn(serve(port, model).unwrap());
        }
    })
}
