//! The poll list: blocks of registers or bits that a client reads periodically, each with its period and its health.
//!
//! A list is a `static` that the application may read at any time; [`PollList::run`] is the body of a task. When
//! several entries are due, they are read in the order of the list, starting behind the entry that was read last.
//! Each is read once before any of them is read again, so an entry with a short period does not block one with a long
//! period. A period that ends while its entry waits is skipped: the entry is read once, and next one period later. An
//! entry whose unit has still to send a late answer [to a request of that kind](mod@crate::client) lets the next entry go
//! first.
//!
//! ```
//! use multidrop::poll::{PollEntry, PollList};
//! use multidrop::{Client, Line};
//!
//! /// Two blocks with six cells in all.
//! type List = PollList<2, 6>;
//!
//! const LIST: List = PollList::new([
//!     PollEntry::holding_registers(17, 100, 4).period_ms(250), // cells 0 to 3
//!     PollEntry::input_registers(18, 0, 2).period_ms(1000),  // cells 4 and 5
//! ]);
//!
//! /// The body of a task.
//! async fn poll<L: Line>(list: &'static List, client: Client<L, 1>) -> ! {
//!     list.run(client).await
//! }
//!
//! /// The third register of unit 17, if unit 18 has answered within five seconds.
//! fn level(list: &List) -> Option<u16> {
//!     (!list.health(1).is_stale(5000)).then(|| list.with_cells(0, |cells| cells[2]))
//! }
//! ```

use core::cell::{Cell, RefCell};

use embassy_time::{Duration, Instant, Timer};
use multidrop_protocol::client::{ReadBits, ReadRegisters, Request};
use multidrop_protocol::function;

use crate::client::{Client, ClientError, Turn, duration, now, ticks};
use crate::line::Line;

/// One block that is read periodically.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct PollEntry {
    unit: u8,
    function: u8,
    first: u16,
    count: u16,
    period: Ticks,
}

/// A time in ticks of `embassy-time`, 32 bits that wrap.
type Ticks = u32;

impl PollEntry {
    /// Reads `count` holding registers, 1..=125, of `unit` from address `first` on, every second: function 03.
    ///
    /// # Panics
    /// If the unit is not 1..=247, the count is out of range, or the block runs past address 65535. In a `const` that
    /// is a build error. The other constructors panic for the corresponding ranges.
    pub const fn holding_registers(unit: u8, first: u16, count: u16) -> Self {
        let limit = function::READ_REGISTERS_MAX;
        Self::new(unit, function::READ_HOLDING_REGISTERS, first, count, limit)
    }

    /// Reads input registers: function 04. Ranges and period are those of
    /// [`holding_registers`](Self::holding_registers).
    pub const fn input_registers(unit: u8, first: u16, count: u16) -> Self {
        let limit = function::READ_REGISTERS_MAX;
        Self::new(unit, function::READ_INPUT_REGISTERS, first, count, limit)
    }

    /// Reads coils, 1..=2000, each into a cell of 0 or 1: function 01.
    pub const fn coils(unit: u8, first: u16, count: u16) -> Self {
        let limit = function::READ_BITS_MAX;
        Self::new(unit, function::READ_COILS, first, count, limit)
    }

    /// Reads discrete inputs, 1..=2000, each into a cell of 0 or 1: function 02.
    pub const fn discrete_inputs(unit: u8, first: u16, count: u16) -> Self {
        let limit = function::READ_BITS_MAX;
        Self::new(unit, function::READ_DISCRETE_INPUTS, first, count, limit)
    }

    const fn new(unit: u8, function: u8, first: u16, count: u16, limit: u16) -> Self {
        assert!(unit >= 1 && unit <= 247, "unit must be 1..=247");
        assert!(
            count >= 1 && count <= limit,
            "count must be 1..=125 registers or 1..=2000 bits"
        );
        assert!(
            first as u32 + count as u32 <= 65536,
            "first and count must end at address 65535 or before"
        );
        Self {
            unit,
            function,
            first,
            count,
            period: ticks(1000),
        }
    }

    /// Sets the period of the entry in ms: 1..=65535.
    ///
    /// # Panics
    /// If it is 0; in a `const` that is a build error.
    pub const fn period_ms(mut self, ms: u16) -> Self {
        assert!(ms > 0, "period_ms is 0, must be 1..=65535");
        self.period = ticks(ms);
        self
    }
}

/// The health of an entry since the start. Counters stop at 65535.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Health {
    /// The number of valid answers.
    pub answers: u16,
    /// Requests without an answer.
    pub timeouts: u16,
    /// The number of exception responses.
    pub exceptions: u16,
    /// Other failures: wrong or damaged answers, or no silence on the line.
    pub others: u16,
    /// The last error; `None` if every request was answered.
    pub last_error: Option<ClientError>,
    /// When the cells were last filled; `None` if never.
    pub answered_at: Option<Instant>,
}

impl Health {
    const fn new() -> Self {
        Self {
            answers: 0,
            timeouts: 0,
            exceptions: 0,
            others: 0,
            last_error: None,
            answered_at: None,
        }
    }

    /// The age of the cells; `None` if they were never filled.
    pub fn age(&self) -> Option<Duration> {
        self.answered_at.map(|at| at.elapsed())
    }

    /// Whether the cells are older than `ms` milliseconds, or were never filled.
    pub fn is_stale(&self, ms: u32) -> bool {
        self.age()
            .is_none_or(|age| age > Duration::from_millis(ms.into()))
    }

    fn note(&mut self, result: Result<(), ClientError>, now: Instant) {
        let count = match result {
            Ok(()) => {
                self.answered_at = Some(now);
                &mut self.answers
            }
            Err(ClientError::Timeout) => &mut self.timeouts,
            Err(ClientError::Exception(_) | ClientError::UnknownException(_)) => {
                &mut self.exceptions
            }
            Err(_) => &mut self.others,
        };
        *count = count.saturating_add(1);
        self.last_error = result.err().or(self.last_error);
    }
}

/// A list of `E` entries with `C` cells for the values read. The cells of the entries follow each other in the order
/// of the list.
pub struct PollList<const E: usize, const C: usize> {
    entries: [PollEntry; E],
    cells: RefCell<[u16; C]>,
    health: [Cell<Health>; E],
}

impl<const E: usize, const C: usize> PollList<E, C> {
    /// A list with all cells 0.
    ///
    /// # Panics
    /// Unless `C` is the sum of the counts of all entries. In a `const` that is a build error.
    pub const fn new(entries: [PollEntry; E]) -> Self {
        const { assert!(E > 0, "a scan list must have an entry") };
        let mut cells = 0;
        let mut index = 0;
        while index < E {
            cells += entries[index].count as usize;
            index += 1;
        }
        assert!(
            cells == C,
            "a scan list must have as many cells as its entries read"
        );
        Self {
            entries,
            cells: RefCell::new([0; C]),
            health: [const { Cell::new(Health::new()) }; E],
        }
    }

    /// The health of an entry.
    ///
    /// # Panics
    /// If the list has no such entry.
    pub fn health(&self, entry: usize) -> Health {
        self.health[entry].get()
    }

    /// Calls `f` with the cells of an entry, which are all from one answer, and returns its result.
    ///
    /// # Panics
    /// If the list has no such entry.
    pub fn with_cells<R>(&self, entry: usize, f: impl FnOnce(&[u16]) -> R) -> R {
        let (from, to) = self.range(entry);
        f(&self.cells.borrow()[from..to])
    }

    /// The cells of an entry.
    fn range(&self, entry: usize) -> (usize, usize) {
        let before = self.entries[..entry].iter();
        let from = before.map(|entry| usize::from(entry.count)).sum();
        (from, from + usize::from(self.entries[entry].count))
    }

    /// Reads the entries for ever. Cells are filled by a valid answer that stands at t3.5, and by nothing else.
    ///
    /// # Cancellation
    /// Safe: the list may be run again.
    pub async fn run<L: Line + 'static, const N: usize>(&self, client: Client<L, N>) -> ! {
        let mut due = [now(); E];
        let mut entry = E - 1;
        // Until an entry that is due may be requested.
        let mut parked = None;
        loop {
            if let Err(soonest) = self.next(&due, &mut { entry }, |_| None) {
                Timer::after(duration(soonest.wrapping_sub(now()))).await;
                continue;
            }
            let turn = client.turn(parked.take()).await;
            let held_until = |of: &PollEntry| match &turn {
                Ok(_) => client.parked(of.unit, of.function),
                Err(_) => None,
            };
            if let Err(soonest) = self.next(&due, &mut entry, held_until) {
                parked = Some(soonest);
                continue;
            }
            let now = now();
            let period = self.entries[entry].period;
            due[entry] = due[entry].wrapping_add(period);
            if is_past(due[entry], now) {
                due[entry] = now.wrapping_add(period);
            }
            let result = match turn {
                Ok(turn) => self.read(entry, &client, turn).await,
                Err(error) => Err(error),
            };
            let mut health = self.health[entry].get();
            health.note(result, Instant::now());
            self.health[entry].set(health);
        }
    }

    /// Moves `entry` on to the next entry that is due and whose request no late answer holds up; returns otherwise
    /// the time at which the first of them will be.
    fn next(
        &self,
        due: &[Ticks; E],
        entry: &mut usize,
        held_until: impl Fn(&PollEntry) -> Option<Ticks>,
    ) -> Result<(), Ticks> {
        let now = now();
        let mut soonest = u32::MAX;
        for _ in 0..E {
            *entry = if *entry + 1 < E { *entry + 1 } else { 0 };
            let mut until = due[*entry];
            if is_past(until, now) {
                let Some(time) = held_until(&self.entries[*entry]) else {
                    return Ok(());
                };
                until = time;
            }
            soonest = soonest.min(until.wrapping_sub(now));
        }
        Err(now.wrapping_add(soonest))
    }

    async fn read<L: Line + 'static, const N: usize>(
        &self,
        entry: usize,
        client: &Client<L, N>,
        turn: Turn<N>,
    ) -> Result<(), ClientError> {
        let PollEntry {
            unit,
            function,
            first,
            count,
            ..
        } = self.entries[entry];
        let (from, to) = self.range(entry);
        let bits = match function {
            function::READ_COILS => Some(ReadBits::coils(first, count)),
            function::READ_DISCRETE_INPUTS => Some(ReadBits::discrete_inputs(first, count)),
            _ => None,
        };
        let registers = match function {
            function::READ_INPUT_REGISTERS => ReadRegisters::input(first, count),
            _ => ReadRegisters::holding(first, count),
        };
        let request: &dyn Request = match &bits {
            Some(bits) => bits,
            None => &registers,
        };
        let asked = client.run_with(unit, request, turn);
        let Some(reply) = asked.await? else {
            return Ok(());
        };
        let mut cells = self.cells.borrow_mut();
        let cells = &mut cells[from..to];
        match bits {
            Some(bits) => {
                let coils = bits.answer(reply.bytes())?;
                for (eight, &byte) in cells.chunks_mut(8).zip(coils.bytes()) {
                    let mut byte = byte;
                    for cell in eight {
                        *cell = u16::from(byte & 1);
                        byte >>= 1;
                    }
                }
            }
            None => registers.answer(reply.bytes())?.copy_to(cells),
        }
        Ok(())
    }
}

/// Whether `now` is `at` or later.
fn is_past(at: Ticks, now: Ticks) -> bool {
    now.wrapping_sub(at) <= u32::MAX / 2
}
