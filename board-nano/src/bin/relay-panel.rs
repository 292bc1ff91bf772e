//! A client: two buttons toggle two relays of another unit, two LEDs show their state.
//!
//! | pin | is |
//! |---|---|
//! | D3, D4 | buttons to ground, for the relays of registers 1 and 2 |
//! | D5, D6 | LEDs: the relays' state as the unit tells it |
//! | D13 | error LED, the Nano's own: on for 500 ms after a failure |
//!
//! A button sends 0x0300, toggle, to the relay's register and reads it back; the state is read every 250 ms
//! besides. What fails is tried once more. The toggle only if the relay has not moved: when an answer is
//! lost, sending the same again would toggle it back.
//!
//! The unit is 1 if not built otherwise, RTU, 38400 8N1.
#![no_std]
#![no_main]
#![feature(abi_avr_interrupt)]

use core::cell::{Cell, RefCell};

use board_nano::{CLOCK_HZ, Rs485, bind_interrupts, options, settings};
use embassy_avr_hal::gpio::{Input, Output, PB5, PD3, PD4, PD5, PD6};
use embassy_sync::blocking_mutex::raw::NoopRawMutex;
use embassy_sync::signal::Signal;
use embassy_time::{Duration, Ticker, with_timeout};
use embedded_hal::digital::{InputPin, OutputPin};
use multidrop::protocol::format::LineFormat;
use multidrop::{Client, ClientConfig, ClientError, ClientPort, PortConfig};
use static_cell::StaticCell;

// ANCHOR: port
/// The slave id is that of the unit that is asked.
const PORT: PortConfig = PortConfig::new("RS4")
    .client()
    .slave_id(options::unit(1))
    .baud(options::baud(38_400))
    .format(options::format(LineFormat::F8N1));

/// 70 % of the poll and less, as iDevOS has it.
const TOGGLE_ONCE: ClientConfig = ClientConfig::new().timeout_ms(150).late_guard_ms(50);
const READ: ClientConfig = TOGGLE_ONCE.retries(1);
// ANCHOR_END: port

const POLL: Duration = Duration::from_millis(250);
const ERROR_SHOWN: Duration = Duration::from_millis(500);
/// A button has to have the same level twice.
const SAMPLE: Duration = Duration::from_millis(10);

/// What a relay takes for the other state.
const TOGGLE: u16 = 0x0300;

/// Relays, the first of which has register [`FIRST`].
const COUNT: usize = 2;
const FIRST: u16 = 1;

bind_interrupts!(struct Irqs { USART0 => Rs485; TIME => CLOCK_HZ, tasks = [poll, press, buttons, error]; });

/// Two tasks ask.
type Port = ClientPort<Rs485, 2>;

/// What the tasks share.
struct Panel {
    client: Client<Rs485, 2>,
    leds: RefCell<(Output<PD5>, Output<PD6>)>,
    /// The state of the relays as it was last heard.
    on: Cell<Option<[bool; COUNT]>>,
    pressed: Signal<NoopRawMutex, [bool; COUNT]>,
    failed: Signal<NoopRawMutex, ()>,
}

impl Panel {
    // ANCHOR: read
    /// Reads the state of the relays and shows it.
    async fn update(&self) -> Result<[bool; COUNT], ClientError> {
        let mut registers = [0; COUNT];
        self.client
            .with(READ)
            .read_holding_registers(PORT.unit(), FIRST, &mut registers)
            .await?;
        let on = registers.map(|register| register != 0);
        self.on.set(Some(on));
        let mut leds = self.leds.borrow_mut();
        let Ok(()) = leds.0.set_state(on[0].into());
        let Ok(()) = leds.1.set_state(on[1].into());
        Ok(on)
    }
    // ANCHOR_END: read

    /// Toggles a relay, once.
    async fn toggle(&self, relay: usize) -> Result<(), ClientError> {
        let client = self.client.with(TOGGLE_ONCE);
        let before = self.on.get();
        let register = FIRST + relay as u16;
        let first = client.write_register(PORT.unit(), register, TOGGLE).await;
        let now = self.update().await?;
        let Err(error) = first else { return Ok(()) };
        match before {
            Some(before) if before[relay] == now[relay] => {}
            Some(_) => return Ok(()),
            // Whether it has moved is unknown.
            None => return Err(error),
        }
        client.write_register(PORT.unit(), register, TOGGLE).await?;
        self.update().await.map(drop)
    }

    fn show_result<T>(&self, result: Result<T, ClientError>) {
        if result.is_err() {
            self.failed.signal(());
        }
    }
}

multidrop::tasks! {
    /// The tasks that have to be alive: all.
    static ROLL: Roll<Irqs>;

    fn receive(port: &'static Port) = multidrop::client_receive(port);

    fn poll(panel: &'static Panel) = async move {
        let mut ticker = Ticker::every(POLL);
        loop {
            panel.show_result(panel.update().await);
            ticker.next().await;
        }
    };

    fn press(panel: &'static Panel) = async move {
        loop {
            let pressed = panel.pressed.wait().await;
            for (relay, pressed) in pressed.into_iter().enumerate() {
                if pressed {
                    panel.show_result(panel.toggle(relay).await);
                }
            }
        }
    };

    /// Looks at the buttons. One that is pressed while the one before is still being seen to counts too.
    fn buttons(panel: &'static Panel, mut first: Input<PD3>, mut second: Input<PD4>) = async move {
        let mut ticker = Ticker::every(SAMPLE);
        let mut before = [false; COUNT];
        let mut down = [false; COUNT];
        loop {
            ticker.next().await;
            let Ok(first) = first.is_low();
            let Ok(second) = second.is_low();
            let level = [first, second];
            let mut pressed = [false; COUNT];
            for relay in 0..COUNT {
                if level[relay] == before[relay] {
                    pressed[relay] = level[relay] && !down[relay];
                    down[relay] = level[relay];
                }
            }
            before = level;
            if pressed.contains(&true) {
                if let Some(waiting) = panel.pressed.try_take() {
                    for (pressed, waiting) in pressed.iter_mut().zip(waiting) {
                        *pressed |= waiting;
                    }
                }
                panel.pressed.signal(pressed);
            }
        }
    };

    fn error(panel: &'static Panel, mut led: Output<PB5>) = async move {
        loop {
            panel.failed.wait().await;
            led.high();
            while with_timeout(ERROR_SHOWN, panel.failed.wait()).await.is_ok() {}
            led.low();
        }
    };
}

#[avr_device::entry]
fn main() -> ! {
    let board = board_nano::init(Irqs);
    let line = board.rs4.open(Irqs, const { settings(&PORT) });

    // ANCHOR: main
    static PORT_CELL: StaticCell<Port> = StaticCell::new();
    let port = PORT_CELL.init(Port::new(line));
    static PANEL: StaticCell<Panel> = StaticCell::new();
    let panel = PANEL.init(Panel {
        client: port.client(READ),
        leds: RefCell::new((
            Output::new(board.pins.PD5, false),
            Output::new(board.pins.PD6, false),
        )),
        on: Cell::new(None),
        pressed: Signal::new(),
        failed: Signal::new(),
    });
    // ANCHOR_END: main
    let first = Input::new(board.pins.PD3, true);
    let second = Input::new(board.pins.PD4, true);
    let led = Output::new(board.pins.PB5, false);
    board_nano::run(&ROLL, |spawner| {
        spawner.spawn(receive(port).unwrap());
        spawner.spawn(press(panel).unwrap());
        spawner.spawn(poll(panel).unwrap());
        spawner.spawn(buttons(panel, first, second).unwrap());
        spawner.spawn(error(panel, led).unwrap());
    })
}
