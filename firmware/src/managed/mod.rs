//! A managed port: a line with its register set `MB_xxx`, all of which can be changed at run time.
//!
//! [`ManagedPort`] is what its two tasks share with the application. [`managed_receive`] takes frames from the line.
//! [`managed_run`] does everything else, one thing at a time: it answers as a slave, carries out the transactions of
//! START as a master, receives or prints as a [sniffer](crate::sniff), and applies loads of MODE, SLAVEID and the
//! line settings in between. So a setting never changes during a request, an answer or a transaction.
//!
//! A slave answers with the port's own arrays. With [`managed_serve`] in place of [`managed_run`] it answers with a
//! data model of the application, and with a [router](mod@crate::route) for other units too.
//!
//! ```
//! use multidrop::protocol::port_registers::{Mode, PortRegisters, Refused, Value};
//! use multidrop::protocol::registers::{Bank, NoCoils, NoRules};
//! use multidrop::{Line, ManagedPort, PortConfig};
//!
//! const RS4: PortConfig = PortConfig::new("RS4").baud(38_400).slave_id(17);
//! type Rs4<L> = ManagedPort<L, PortRegisters<Bank<16>, NoCoils, NoRules>>;
//!
//! /// Its tasks are `managed_receive(port)` and `managed_run(port)`.
//! fn open<L: Line>(line: L) -> Rs4<L> {
//!     ManagedPort::new(line, &RS4, RS4.bank(), NoCoils)
//! }
//!
//! /// Register 2 of slave 17, by a port that was a slave itself: no reset is needed.
//! async fn ask<L: Line>(port: &Rs4<L>) -> Result<Option<u16>, Refused> {
//!     port.load(Value::Mode(Mode::Master))?;
//!     port.load(Value::Func(3))?;
//!     port.load(Value::RegOff(2))?;
//!     port.load(Value::RegCnt(4))?;
//!     port.start()?; // LOAD(RS4, 1)
//!     Ok(match port.done().await {
//!         Ok(()) => Some(port.registers().with(|rs4| rs4.regs().cells()[2])), // DATAOK
//!         Err(_) => None,                                                     // DATAERR
//!     })
//! }
//! ```

mod failure;
mod tasks;

pub use failure::{Failure, Outcome};
pub use tasks::{managed_receive, managed_run, managed_serve};

use core::cell::Cell;
use core::future::poll_fn;
use core::task::Poll;

use multidrop_protocol::port_registers::{
    Change, LineSettings, Mode, PortRegisters, Reason, Refused, Register, Status, Transaction,
    Value,
};
use multidrop_protocol::registers::{Items, Rules};
use multidrop_protocol::server::{Counted, Server, Uncounted};

use crate::client::{Client, ClientConfig, Exchange};
use crate::config::{PortConfig, client_config};
use crate::line::{Frame, Line, LineConfig, LineError};
use crate::route::Gateway;
use crate::shared::Shared;
use crate::slot::{Slot, Waiter};
use crate::sniff::TextSource;

/// Events that are kept for [`ManagedPort::event`]; one more drops the oldest. A transaction takes the time of some
/// characters at least, and one task starts them all.
pub const EVENTS: usize = 2;

/// The transaction that START has started, with the settings of that moment.
#[derive(Clone, Copy)]
struct Started {
    transaction: Transaction,
    line: LineConfig,
    times: ClientConfig,
}

/// A port on line `L` with registers `P`, which are [`PortRegisters`]. `D` is [`Counted`] if its
/// server counts.
///
/// `N` tasks can wait for the line: the port itself, and each task with a [client](Self::client) of it. If more wait,
/// all requests are still sent, but the CPU does not sleep while the port waits.
pub struct ManagedPort<L: Line + 'static, P, D = Uncounted, const N: usize = 1> {
    name: &'static str,
    line: L,
    registers: Shared<P>,
    server: Server<D>,
    exchange: Exchange<L, N>,
    /// Wakes the run task with the next request.
    requests: Slot<Frame<'static, L>>,
    /// The mode in effect; register MODE may already hold the next one.
    mode: Cell<Mode>,
    config: Cell<LineConfig>,
    started: Cell<Option<Started>>,
    /// Whether the run task must apply a load.
    work: Cell<bool>,
    done: Slot<Outcome>,
    /// The events, the oldest first.
    events: [Cell<Option<Outcome>>; EVENTS],
    ended: Waiter,
    text_source: Option<&'static dyn TextSource>,
    router: Option<&'static dyn Gateway>,
}

impl<L, R, C, V> ManagedPort<L, PortRegisters<R, C, V>>
where
    L: Line + 'static,
    R: Items<Item = u16>,
    C: Items<Item = bool>,
    V: Rules,
{
    /// A port on `line`, which the board has set up from the same `config`, with one place to wait and a server
    /// that does not count.
    ///
    /// # Panics
    /// If the arrays run past address 65535; [`PortConfig::bank`] finds that at compile time.
    pub fn new(line: L, config: &PortConfig, regs: R, coils: C) -> Self {
        Self::with(line, config, regs, coils, Uncounted)
    }
}

impl<L, R, C, V, const LOG: usize> ManagedPort<L, PortRegisters<R, C, V>, Counted<LOG>>
where
    L: Line + 'static,
    R: Items<Item = u16>,
    C: Items<Item = bool>,
    V: Rules,
{
    /// A port with all counters of a server and a log of the last `LOG` events, 0 to 64, on `line`, which the board
    /// has set up from the same `config`.
    ///
    /// # Panics
    /// If the arrays run past address 65535; [`PortConfig::bank`] finds that at compile time.
    pub fn counted(line: L, config: &PortConfig, regs: R, coils: C) -> Self {
        Self::with(line, config, regs, coils, Counted::new())
    }
}

impl<L, R, C, V, D, const N: usize> ManagedPort<L, PortRegisters<R, C, V>, D, N>
where
    L: Line + 'static,
    R: Items<Item = u16>,
    C: Items<Item = bool>,
    V: Rules,
{
    /// A port on `line`, which the board has set up from the same `config`, with these counters.
    ///
    /// # Panics
    /// If the arrays run past address 65535; [`PortConfig::bank`] finds that at compile time.
    pub fn with(line: L, config: &PortConfig, regs: R, coils: C, diagnostics: D) -> Self {
        let settings = *config.settings();
        let exchange = Exchange::new();
        exchange.set_times(config.times());
        if settings.mode != Mode::Master {
            exchange.close();
        }
        Self {
            name: config.name(),
            line,
            registers: Shared::new(PortRegisters::new(settings, regs, coils)),
            server: Server::with(config.unit().max(1), diagnostics),
            exchange,
            requests: Slot::new(),
            mode: Cell::new(settings.mode),
            config: Cell::new(config.line()),
            started: Cell::new(None),
            work: Cell::new(false),
            done: Slot::new(),
            events: [const { Cell::new(None) }; EVENTS],
            ended: Waiter::new(),
            text_source: None,
            router: None,
        }
    }

    /// Adds routes to units on other ports, which a slave uses.
    pub fn routed(self, router: &'static dyn Gateway) -> Self {
        const { assert!(L::HAS_NEIGHBOURS, "the line has no other port to route to") };
        Self {
            router: Some(router),
            ..self
        }
    }

    /// Adds the text that the port prints while it is a sniffer with framing text.
    pub fn printing(self, text_source: &'static dyn TextSource) -> Self {
        Self {
            text_source: Some(text_source),
            ..self
        }
    }

    /// The port's name, such as `"RS4"`.
    pub const fn name(&self) -> &'static str {
        self.name
    }

    /// Loads a register with a value of its type, `LOAD(MB_RS4_name, value)`. A change of the line or the mode takes effect when
    /// no request is being answered and no transaction runs: what is loaded before START takes effect before its
    /// request is sent, what is loaded after START takes effect after the end of the transaction.
    ///
    /// # Errors
    /// [`Refused`], which names the register, the value, and the values that are accepted. The register keeps its old
    /// value, and a transaction under way goes on.
    #[inline(always)]
    pub fn load(&self, value: Value) -> Result<(), Refused> {
        self.load_raw(value.register(), value.number())
    }

    /// Loads a register with a number, as it is on the wire. See [`load`](Self::load).
    ///
    /// # Errors
    /// [`Refused`], as for [`load`](Self::load).
    pub fn load_raw(&self, register: Register, value: u32) -> Result<(), Refused> {
        if !L::HAS_NEIGHBOURS && register == Register::Mode && value == Mode::Sniffer as u32 {
            return Err(Refused {
                register,
                value,
                reason: Reason::NoSniffer,
            });
        }
        self.registers.with(|registers| {
            let mode = registers.settings().mode;
            let change = registers.load_checked(register, value, &|line| self.check(mode, line))?;
            self.exchange.set_times(client_config(registers.settings()));
            match change {
                Change::Done => return Ok(()),
                Change::Mode | Change::Line => {}
                Change::Start => {
                    self.done.take();
                    let settings = registers.settings();
                    self.started.set(Some(Started {
                        transaction: registers.transaction(),
                        line: LineConfig::of(Mode::Master, &settings.line),
                        times: client_config(settings),
                    }));
                }
            }
            self.work.set(true);
            self.requests.waiter.wake();
            Ok(())
        })
    }

    fn check(&self, mode: Mode, line: &LineSettings) -> Result<(), Reason> {
        if !self.line.may_be(line.duplex) {
            return Err(Reason::Wiring);
        }
        let config = LineConfig::of(mode, line);
        self.line.check(&config).map_err(|error| match error {
            LineError::Baud { nearest } => Reason::Baud(nearest),
            LineError::Format(_) => Reason::Chip,
            LineError::Flow => Reason::Wiring,
            LineError::Delay => Reason::Chip,
            LineError::Silence => Reason::Silence,
            LineError::Framing(framing) => Reason::Framing(framing),
        })
    }

    /// Reads a register, at any time.
    ///
    /// # Errors
    /// [`Refused`] for an element that an array does not have.
    pub fn read(&self, register: Register) -> Result<u32, Refused> {
        self.registers.with(|registers| {
            registers.proceed(if self.exchange.awaits_started() {
                Status::Receiving
            } else {
                Status::Transmitting
            });
            registers.read(register)
        })
    }

    /// Starts the transaction that the registers describe, `LOAD(RS4, 1)`.
    ///
    /// # Errors
    /// [`Refused`], with the register that prevents it; a transaction under way goes on.
    pub fn start(&self) -> Result<(), Refused> {
        self.load_raw(Register::Start, 1)
    }

    /// Waits for the end of the last transaction: DATAOK, or DATAERR with its reason. For one task; others use
    /// [`event`](Self::event).
    ///
    /// # Cancellation
    /// Safe: the transaction goes on, and its result is kept until it is read or another transaction is started.
    pub async fn done(&self) -> Outcome {
        poll_fn(|context| self.done.poll(context)).await
    }

    /// Waits for the result of the next transaction: DATAOK or DATAERR, for a task other than the one that starts
    /// them. [`EVENTS`] results are kept.
    ///
    /// Safe: an event is taken only when the future completes.
    /// Safe.
    pub async fn event(&self) -> Outcome {
        poll_fn(|context| {
            let [first, second] = &self.events;
            match first.replace(second.take()) {
                Some(outcome) => Poll::Ready(outcome),
                None => {
                    self.ended.wait(context);
                    Poll::Pending
                }
            }
        })
        .await
    }

    /// The registers with their arrays.
    pub const fn registers(&self) -> &Shared<PortRegisters<R, C, V>> {
        &self.registers
    }

    /// The server of the port, with its unit id and counters.
    pub const fn server(&self) -> &Server<D> {
        &self.server
    }

    /// A client of this port with times of its own, for requests that the registers do not describe. While the port
    /// is not a master, requests are refused with [`ClientError::NotMaster`](crate::client::ClientError::NotMaster).
    pub const fn client(&'static self, times: ClientConfig) -> Client<L, N> {
        Client::new(&self.line, &self.exchange, times)
    }

    /// A client of this port with the times of the registers TIMEOUT, RETRIES and TURNAROUND, as they are at the time
    /// of each request.
    pub const fn client_as_set(&'static self) -> Client<L, N> {
        Client::of_port(&self.line, &self.exchange)
    }
}
