//! Ports with RTS/CTS whose peers hold them: for tests. Both are 38400 8N1, CTS_TIMEOUT 200 ms.
//!
//! AS1 is slave 1, a managed port that counts, with holding registers 0 to 7. 1 written to register 0 has RS2 ask unit 9 for a
//! register: register 1 becomes 1 for an answer, 2 where the request was cut off, 3 for any other end. 2 written to register 0
//! makes BAUD of AS1 9600, 3 makes its CTS_TIMEOUT 60 s.
#![no_std]
#![no_main]

use board_stm32::ports::PortSetup;
use board_stm32::usart::Usart;
use board_stm32::{Roll, Watchdog};
use embassy_time::{Duration, Timer};
use multidrop::protocol::format::LineFormat;
use multidrop::protocol::port_registers::{Flow, PortRegisters, Value};
use multidrop::protocol::registers::{Bank, NoCoils, NoRules};
use multidrop::protocol::server::Counted;
use multidrop::{
    ClientConfig, ClientError, ClientPort, ManagedPort, PortConfig, client_receive,
    managed_receive, managed_run, signed,
};
use static_cell::StaticCell;

const fn port(name: &'static str) -> PortConfig {
    PortConfig::new(name)
        .baud(38_400)
        .format(LineFormat::F8N1)
        .flow(Flow::RtsCts)
        .cts_timeout_ms(200)
}

const AS1: PortConfig = port("AS1").slave_id(1);
const RS2: PortConfig = port("RS2").client();

type As1 = ManagedPort<Usart, PortRegisters<Bank<8>, NoCoils, NoRules>, Counted<0>>;
type Rs2 = ClientPort<Usart, 1>;

/// The tasks that have to be alive.
static ROLL: Roll<4> = Roll::new();

#[embassy_executor::task]
async fn receive(port: &'static As1) -> ! {
    signed(|task| ROLL.sign::<0>(task), managed_receive(port)).await
}

#[embassy_executor::task]
async fn run(port: &'static As1) -> ! {
    signed(|task| ROLL.sign::<1>(task), managed_run(port)).await
}

#[embassy_executor::task]
async fn hear(port: &'static Rs2) -> ! {
    signed(|task| ROLL.sign::<2>(task), client_receive(port)).await
}

/// Does what is written to register 0.
#[embassy_executor::task]
async fn obey(as1: &'static As1, rs2: &'static Rs2) -> ! {
    signed(|task| ROLL.sign::<3>(task), async move {
        let client = rs2.client(ClientConfig::new().timeout_ms(1000).late_guard_ms(20));
        loop {
            Timer::after(Duration::from_millis(5)).await;
            let order = as1
                .registers()
                .with(|port| core::mem::take(&mut port.regs_mut().cells_mut()[0]));
            match order {
                1 => {
                    let mut word = [0];
                    let outcome = match client.read_holding_registers(9, 0, &mut word).await {
                        Ok(()) => 1,
                        Err(ClientError::CutOff) => 2,
                        Err(_) => 3,
                    };
                    as1.registers()
                        .with(|port| port.regs_mut().cells_mut()[1] = outcome);
                }
                2 => as1.load(Value::Baud(9_600)).unwrap(),
                3 => as1.load(Value::CtsTimeout(60_000)).unwrap(),
                _ => {}
            }
        }
    })
    .await
}

#[cortex_m_rt::entry]
fn main() -> ! {
    let board = board_stm32::init(Watchdog::DEFAULT);
    let as1 = board.as1.open(const { PortSetup::new(&AS1) });
    let rs2 = board.rs2.open(const { PortSetup::new(&RS2) });

    static AS1_CELL: StaticCell<As1> = StaticCell::new();
    static RS2_CELL: StaticCell<Rs2> = StaticCell::new();
    let as1: &'static _ = AS1_CELL.init(ManagedPort::counted(as1, &AS1, AS1.bank(), NoCoils));
    let rs2: &'static _ = RS2_CELL.init(ClientPort::new(rs2));
    board_stm32::run(&ROLL, |spawner| {
        spawner.spawn(receive(as1).unwrap());
        spawner.spawn(run(as1).unwrap());
        spawner.spawn(hear(rs2).unwrap());
        spawner.spawn(obey(as1, rs2).unwrap());
    })
}
