//! A server on each of the four ports, unit 1, that counts, and a task that holds interrupts off for as long as PC0 is high: for
//! tests of what the ports do with characters and alarms that they come to see late. At the build's rate and format. In QEMU, which
//! has no pins, nothing is held.
#![no_std]
#![no_main]

use board_stm32::ports::PortSettings;
use board_stm32::usart::Usart;
use board_stm32::{Roll, Watchdog, options};
use embassy_stm32::pac::{GPIOC, gpio::vals::Pupdr};
use embassy_time::{Duration, Timer};
use multidrop_firmware::protocol::data::{Registers, RegistersOut};
use multidrop_firmware::protocol::exception::Exception;
use multidrop_firmware::protocol::format::LineFormat;
use multidrop_firmware::protocol::registers::Bank;
use multidrop_firmware::protocol::server::{Counted, DataModel};
use multidrop_firmware::{PortConfig, Shared};
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

/// How often PC0 is looked at.
const LOOK: Duration = Duration::from_micros(50);

/// Ports that count, with the log of events.
type Port = multidrop_firmware::Port<Usart, Counted<64>>;

struct Model(Bank<16>);

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
async fn receive(port: &'static Port) -> ! {
    multidrop_firmware::receive(port).await
}

#[embassy_executor::task(pool_size = 4)]
async fn serve(port: &'static Port, model: &'static Shared<Model>) -> ! {
    multidrop_firmware::serve(port, model).await
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
    let board = board_stm32::init(Watchdog::DEFAULT);
    let lines = [
        board.as1.open(const { PortSettings::new(&AS1) }),
        board.as2.open(const { PortSettings::new(&AS2) }),
        board.rs2.open(const { PortSettings::new(&RS2) }),
        board.rs4.open(const { PortSettings::new(&RS4) }),
    ];
    let [as1, as2, rs2, rs4] = lines;

    static PORTS: StaticCell<[Port; 4]> = StaticCell::new();
    let ports = PORTS.init([
        Port::counted(as1, &AS1),
        Port::counted(as2, &AS2),
        Port::counted(rs2, &RS2),
        Port::counted(rs4, &RS4),
    ]);
    static MODEL: ConstStaticCell<Shared<Model>> =
        ConstStaticCell::new(Shared::new(Model(Bank::new(0))));
    let model = &*MODEL.take();
    board_stm32::run(&ROLL, |spawner| {
        for port in ports.iter() {
            spawner.spawn(receive(port).unwrap());
            spawner.spawn(serve(port, model).unwrap());
        }
        spawner.spawn(hold().unwrap());
    })
}
