//! A line whose answers wait, on RS4: every frame is sent back, and one with function 0x42 sets DE_LEAD in us and RESPONSE_DELAY
//! in ms, each in two bytes with the high one first. What follows is a greeting with the new settings. 38400 8N1.
#![no_std]
#![no_main]

use board_stm32::ports::PortSettings;
use board_stm32::usart::Usart;
use board_stm32::{Roll, Watchdog};
use multidrop_firmware::PortConfig;
use multidrop_firmware::line::{Line, LineConfig};
use multidrop_firmware::protocol::format::LineFormat;

const SET_UP: u8 = 0x42;
const GREETING: &[u8] = b"here again";

const RS4: PortConfig = PortConfig::new("RS4")
    .baud(board_stm32::options::baud(38_400))
    .format(LineFormat::F8N1);

/// The watchdog sees to the executor alone.
static ROLL: Roll<0> = Roll::new();

#[embassy_executor::task]
async fn repeat(line: Usart) {
    loop {
        let Ok(mut frame) = line.receive().await else {
            continue;
        };
        let len = frame.request_len();
        if !frame.settle().await {
            continue;
        }
        let [_, SET_UP, lead_high, lead_low, delay_high, delay_low] = frame.bytes()[..len.into()]
        else {
            frame.release(len);
            frame.sent().await;
            continue;
        };
        drop(frame);
        let config = LineConfig {
            de_lead_us: u16::from_be_bytes([lead_high, lead_low]),
            response_delay_ms: u16::from_be_bytes([delay_high, delay_low]),
            ..RS4.line()
        };
        let answer = match line.configure(config).await {
            Ok(()) => GREETING,
            Err(_) => b"no",
        };
        let _ = line.transmit(answer).await;
    }
}

#[cortex_m_rt::entry]
fn main() -> ! {
    let board = board_stm32::init(Watchdog::DEFAULT);
    let line = board.rs4.open(const { PortSettings::new(&RS4) });
    board_stm32::run(&ROLL, |spawner| spawner.spawn(repeat(line).unwrap()))
}
