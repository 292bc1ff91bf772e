//! The line by itself, RTU and ASCII: every frame for unit 17 is sent back from the buffer it came in. Some functions are about
//! the line; what follows the unit id is
//!
//! | bytes | does | answer |
//! |---|---|---|
//! | 42, framing, format, baud | sets the line up anew: 0 RTU or 1 ASCII, index into `LineFormat::ALL`, hundreds of baud in two bytes | `here again` at the new settings, or `no` at the old ones |
//! | 43, character | makes it the delimiter | the same, which it ends already |
//! | 44, any two bytes | tells of damaged frames since it was asked last | 44, how many, all their errors |
#![no_std]
#![no_main]
#![feature(abi_avr_interrupt)]

use embassy_avr_hal::gpio::{PD2, Pins};
use embassy_avr_hal::usart::{RtuAndAscii, Settings, Usart0};
use embassy_avr_hal::{bind_interrupts, executor, pac};
use multidrop::line::{ChipLine, InterCharacter, Line, LineConfig, Role};
use multidrop::protocol::format::{Framing, LineFormat};
use multidrop::protocol::frame::ReceiveErrors;
use multidrop::protocol::port_registers::Flow;

const CLOCK_HZ: u32 = 16_000_000;
const UNIT: u8 = 17;
const SET_UP: u8 = 0x42;
const DELIMITER: u8 = 0x43;
const DAMAGED: u8 = 0x44;

const START: LineConfig = LineConfig {
    baud: 19_200,
    framing: Framing::Ascii,
    format: LineFormat::F7E1,
    inter_character: InterCharacter::Strict,
    flow: Flow::None,
    role: Role::Server,
    ..LineConfig::DEFAULT
};

type Usart = Usart0<PD2, CLOCK_HZ, RtuAndAscii>;
type Rs485 = ChipLine<Usart>;

bind_interrupts!(struct Irqs { USART0 => Usart; });

#[embassy_executor::task]
async fn repeat(line: Rs485) {
    let mut damaged = 0u8;
    let mut errors = ReceiveErrors::NONE;
    loop {
        let mut frame = match line.receive().await {
            Ok(frame) if frame.unit() == UNIT => frame,
            Ok(_) => continue,
            Err(of_frame) => {
                damaged = damaged.wrapping_add(1);
                errors |= of_frame;
                continue;
            }
        };
        let len = frame.request_len();
        match frame.adu()[1..usize::from(len)] {
            [SET_UP, framing, format, high, low] => {
                let stands = frame.settle().await;
                drop(frame);
                if !stands {
                    continue;
                }
                let config = LineConfig {
                    baud: 100 * u32::from(u16::from_be_bytes([high, low])),
                    framing: [Framing::Rtu, Framing::Ascii][usize::from(framing & 1)],
                    format: LineFormat::ALL[usize::from(format) % LineFormat::ALL.len()],
                    ..START
                };
                let answer: &[u8] = match line.configure(config).await {
                    Ok(()) => b"here again",
                    Err(_) => b"no",
                };
                let _ = line.transmit(answer).await;
                continue;
            }
            [DELIMITER, character] => line.set_delimiter(character),
            [DAMAGED, ref mut count, ref mut all] => {
                *count = core::mem::take(&mut damaged);
                *all = core::mem::take(&mut errors).bits();
            }
            _ => {}
        }
        frame.release(len).sent().await;
    }
}

#[avr_device::entry]
fn main() -> ! {
    let chip = pac::Peripherals::take().unwrap();
    let pins = Pins::new(chip.PORTB, chip.PORTC, chip.PORTD);
    let settings = const {
        match Settings::new(&START, CLOCK_HZ) {
            Ok(settings) => settings,
            Err(_) => panic!("19200 baud at 16 MHz"),
        }
    };
    let usart = Usart::new(chip.USART0, &chip.TC1, pins.PD0, pins.PD1, pins.PD2, Irqs);
    let line = board_nano::line(usart, &settings);
    executor::run(Irqs, |spawner| spawner.spawn(repeat(line).unwrap()))
}
