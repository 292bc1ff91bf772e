//! A line whose answers wait, on RS4: every frame is sent back, and one with function 0x42 sets DE_LEAD in us and RESPONSE_DELAY
//! in ms, each in two bytes with the high one first. What follows is a greeting with the new settings. 38400 8N1.
//!
//! One with function 0x43 is answered with a greeting, and while that is being sent the line is set to another rate, in two bytes as
//! hundreds, another format, and framing, as their numbers in the registers of a port. A second greeting follows.
#![no_std]
#![no_main]

use board_stm32::ports::PortSetup;
use board_stm32::usart::Usart;
use board_stm32::{Roll, Watchdog};
use embassy_time::{Duration, Timer};
use multidrop::PortConfig;
use multidrop::line::{Line, LineConfig};
use multidrop::protocol::format::{Framing, LineFormat};

const SET_UP: u8 = 0x42;
const CHANGE: u8 = 0x43;
const GREETING: &[u8] = b"here again";

const RS4: PortConfig = PortConfig::new("RS4")
    .baud(board_stm32::options::baud(38_400))
    .format(LineFormat::F8N1);

/// Changes the line in the middle of a greeting, which goes out first.
async fn change(line: &Usart, config: LineConfig) {
    let mut frame = line.lend().await;
    frame.adu()[..GREETING.len()].copy_from_slice(GREETING);
    let greeting = frame.release(GREETING.len() as u8);
    // It takes 3 ms, from t3.5 on, which is near.
    Timer::after(Duration::from_millis(1)).await;
    let _ = line.configure(config).await;
    drop(greeting);
    let _ = line.transmit(GREETING).await;
}

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
        let [
            _,
            function @ (SET_UP | CHANGE),
            first,
            second,
            third,
            fourth,
        ] = frame.bytes()[..len.into()]
        else {
            frame.release(len).sent().await;
            continue;
        };
        drop(frame);
        if function == CHANGE {
            let framing = match fourth {
                0 => Framing::Rtu,
                _ => Framing::Ascii,
            };
            let config = LineConfig {
                baud: u32::from(u16::from_be_bytes([first, second])) * 100,
                format: LineFormat::ALL[usize::from(third) % LineFormat::ALL.len()],
                framing,
                ..RS4.line()
            };
            change(&line, config).await;
            continue;
        }
        let config = LineConfig {
            de_lead_us: u16::from_be_bytes([first, second]),
            response_delay_ms: u16::from_be_bytes([third, fourth]),
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
    let line = board.rs4.open(const { PortSetup::new(&RS4) });
    board_stm32::run(&ROLL, |spawner| spawner.spawn(repeat(line).unwrap()))
}
