//! The made-up chip on the desk of the suite.

use std::cell::{Cell, RefCell};
use std::ptr::NonNull;
use std::rc::Rc;

use multidrop_protocol::Adu;
use multidrop_protocol::format::Framing;
use multidrop_protocol::frame::ReceiveErrors;
use multidrop_protocol::line::{Ascii, LineConfig, LineMachine};
use multidrop_protocol::rtu::Reception;
use multidrop_protocol::timing::{Intervals, Sight};

use super::silicon::{Awaited, Hardware};
use super::{Driver, MadeUp, State, sight};
use crate::line_chip::ChipUnderTest;

/// [`MadeUp`] on the desk of the suite.
pub struct OnDesk {
    state: Rc<RefCell<State>>,
    chip: MadeUp,
    is_held: bool,
}

impl OnDesk {
    /// The chip for a line of its own; what is on the desk goes on to drive it.
    pub fn chip_for_a_line(&self) -> MadeUp {
        MadeUp {
            state: self.state.clone(),
            adu: self.chip.adu,
            observer: Cell::new(None),
        }
    }

    /// Interrupts come until there are none to come.
    fn interrupt(&mut self) {
        if self.is_held {
            return;
        }
        let mut state = self.state.borrow_mut();
        loop {
            let hardware = &state.driver.hardware;
            let is_usart = match hardware.interrupt {
                Awaited::Received => hardware.receiver_on && hardware.received.is_some(),
                Awaited::Ready => hardware.waiting.is_none(),
                Awaited::Sent => hardware.all_sent,
            };
            if is_usart {
                state.on_usart();
            } else if hardware.compare_interrupt && hardware.compare_matched {
                state.on_timer();
            } else {
                return;
            }
        }
    }
}

impl ChipUnderTest for OnDesk {
    type Chip = MadeUp;

    fn power_up() -> Self {
        // For ever, as a static.
        let adu = NonNull::from(Box::leak(Box::new([0; size_of::<Adu>()])));
        let driver = Driver {
            hardware: Hardware::new(),
            adu,
            framing: Framing::Rtu,
            intervals: Intervals::NONE,
            lead: 0,
            response: 0,
            reception: Reception::new(),
            ascii: Ascii::new(),
            alarm_at: 0,
            delay_left: 0,
            receiver: None,
            user: None,
        };
        let machine = LineMachine::new();
        let state = Rc::new(RefCell::new(State { machine, driver }));
        let chip = MadeUp {
            state: state.clone(),
            adu,
            observer: Cell::new(None),
        };
        OnDesk {
            state,
            chip,
            is_held: false,
        }
    }

    fn chip(&self) -> &MadeUp {
        &self.chip
    }

    fn sight(&self, config: &LineConfig) -> Sight {
        sight(config)
    }

    fn now(&self) -> u32 {
        self.state.borrow().driver.hardware.now
    }

    fn run_until(&mut self, tick: u32) {
        self.interrupt();
        while self.now() != tick {
            {
                let hardware = &mut self.state.borrow_mut().driver.hardware;
                let next = hardware.next_event(tick);
                hardware.go_to(next);
            }
            self.interrupt();
        }
    }

    fn hold_interrupts(&mut self, held: bool) {
        self.is_held = held;
        self.interrupt();
    }

    fn falling_edge(&mut self) {
        self.state.borrow_mut().driver.hardware.start_bit = true;
    }

    fn character(&mut self, byte: u8, errors: ReceiveErrors) {
        {
            let hardware = &mut self.state.borrow_mut().driver.hardware;
            if !hardware.receiver_on {
                return;
            }
            let lost = match hardware.received {
                Some(_) => ReceiveErrors::OVERRUN,
                None => ReceiveErrors::NONE,
            };
            hardware.received = Some((byte, errors | lost));
        }
        self.interrupt();
    }

    fn stop_transmitter(&mut self) {
        self.state.borrow_mut().driver.hardware.stands_still = true;
    }

    fn sent(&mut self) -> Vec<(u32, u8)> {
        std::mem::take(&mut self.state.borrow_mut().driver.hardware.sent)
    }

    fn de_changes(&mut self) -> Vec<(u32, bool)> {
        std::mem::take(&mut self.state.borrow_mut().driver.hardware.de_changes)
    }
}
