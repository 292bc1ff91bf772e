//! [`Line`] for every chip: its futures wait for events that the chip's interrupts report to the machine.

use core::cell::Cell;
use core::future::{Future, poll_fn};
use core::task::Poll;

use multidrop_protocol::frame::ReceiveErrors;
use multidrop_protocol::line::{Chip, LineConfig, LineError, Observer, Waiting};
use multidrop_protocol::port_registers::Duplex;

use super::{ChipLine, Line};

impl<C: Chip> ChipLine<C> {
    /// Lets `observer` [see](Line::show) the traffic of the line.
    ///
    /// # Panics
    /// At compile time, for a chip whose lines cannot be observed.
    pub fn observed_by(self, observer: &'static dyn Observer) -> Self {
        const {
            assert!(
                C::HAS_NEIGHBOURS,
                "nobody can look at a line without neighbours"
            )
        };
        if let Some(kept) = self.chip.observer() {
            kept.set(Some(observer));
        }
        self
    }
}

impl<C: Chip> Line for ChipLine<C> {
    const HAS_NEIGHBOURS: bool = C::HAS_NEIGHBOURS;

    fn quiet(&self) -> impl Future<Output = ReceiveErrors> {
        poll_fn(|context| self.poll_quiet(context))
    }

    fn may_be(&self, duplex: Duplex) -> bool {
        self.chip.may_be(duplex)
    }

    fn check(&self, config: &LineConfig) -> Result<(), LineError> {
        self.chip.settings(config).map(drop)
    }

    async fn configure(&self, config: LineConfig) -> Result<(), LineError> {
        let settings = self.chip.settings(&config)?;
        poll_fn(|context| {
            let waker = context.waker();
            self.chip
                .with_waker(Waiting::WithFrame, waker, |machine, wire| {
                    if machine.is_sending() {
                        return Poll::Pending;
                    }
                    self.chip.set_up(wire, &settings);
                    machine.reset(wire);
                    Poll::Ready(Ok(()))
                })
        })
        .await
    }

    fn set_delimiter(&self, delimiter: u8) {
        self.chip.set_delimiter(delimiter);
    }

    fn show(&self, seen: Result<&[u8], ReceiveErrors>) {
        if let Some(observer) = self.chip.observer().and_then(Cell::get) {
            observer.hear(seen);
        }
    }

    fn was_cut(&self) -> bool {
        self.chip.with(|machine, _| machine.was_cut())
    }
}
