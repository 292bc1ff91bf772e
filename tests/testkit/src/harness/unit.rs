//! The two tasks of a port, as the firmware has them: one takes frames from the line, the other works out answers.

use multidrop_protocol::BROADCAST;
use multidrop_protocol::frame::ReceiveErrors;
use multidrop_protocol::server::{DataModel, Plan, Server};

use super::book::{Book, UNIT};
use super::bus::Bus;
use super::memory::{self, Memory};

/// What the tasks did, in order.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Event {
    /// Took the frame that begins with this character.
    Fetched(usize),
    /// Went through with it, at this tick: wrote, or called the application.
    Executed(usize, u64),
    /// Was told of a damaged frame.
    Damaged(ReceiveErrors),
}

enum Serving {
    Nothing,
    /// Waits for the verdict. `released` if the answer is with the line already.
    Settling {
        len: u8,
        plan: Plan,
        released: bool,
    },
    /// Waits until the answer is on the wire.
    Sent,
}

pub struct Unit<const MAY_FAIL: bool> {
    pub memory: Memory<MAY_FAIL>,
    pub events: Vec<Event>,
    server: Server,
    serving: Serving,
    /// Length of a frame handed on from one task to the other.
    handed: Option<u8>,
    /// From each waking of a task to its running, one after the other and round again.
    latencies: Vec<u64>,
    wakings: usize,
    receive_at: Option<u64>,
    serve_at: Option<u64>,
}

impl<const MAY_FAIL: bool> Unit<MAY_FAIL> {
    pub fn new(book: &Book, latencies: Vec<u64>) -> Self {
        Unit {
            memory: Memory::of(book),
            events: Vec::new(),
            server: memory::server(),
            serving: Serving::Nothing,
            handed: None,
            latencies,
            wakings: 0,
            receive_at: None,
            serve_at: None,
        }
    }

    /// When a task runs next.
    pub fn next_event(&self) -> Option<u64> {
        [self.receive_at, self.serve_at].into_iter().flatten().min()
    }

    fn wake(&mut self, now: u64) -> Option<u64> {
        self.wakings += 1;
        Some(now + self.latencies[self.wakings % self.latencies.len()])
    }

    /// Takes note of what the interrupts have woken.
    pub fn take_wakings(&mut self, bus: &mut Bus) {
        let now = bus.chip.now;
        if std::mem::take(&mut bus.chip.receiver_woken) && self.receive_at.is_none() {
            self.receive_at = self.wake(now);
        }
        if std::mem::take(&mut bus.chip.user_woken) && self.serve_at.is_none() {
            self.serve_at = self.wake(now);
        }
    }

    /// Runs a task that is due; whether there was one.
    pub fn step(&mut self, bus: &mut Bus) -> bool {
        let now = bus.chip.now;
        if self.receive_at.is_some_and(|at| at <= now) {
            self.receive_at = None;
            self.receive(bus);
        } else if self.serve_at.is_some_and(|at| at <= now) {
            self.serve_at = None;
            self.serve(bus);
        } else {
            return false;
        }
        true
    }

    fn receive(&mut self, bus: &mut Bus) {
        while let Some(fetched) = bus.fetch() {
            let len = match fetched {
                Ok(len) => len,
                Err(errors) => {
                    self.events.push(Event::Damaged(errors));
                    continue;
                }
            };
            let request = bus.chip.lent.unwrap();
            self.events.push(Event::Fetched(request));
            if [UNIT, BROADCAST].contains(&bus.adu()[0]) {
                self.handed = Some(len);
                self.serve_at = self.wake(bus.chip.now);
            } else {
                bus.give_back();
            }
        }
    }

    fn serve(&mut self, bus: &mut Bus) {
        loop {
            match self.serving {
                Serving::Nothing => {
                    let Some(len) = self.handed.take() else {
                        return;
                    };
                    self.prepare(bus, len);
                }
                Serving::Settling {
                    len,
                    plan,
                    released,
                } => match bus.machine.verdict() {
                    None => return,
                    Some(false) => self.serving = Serving::Sent,
                    Some(true) => {
                        let request = bus.chip.lent.unwrap();
                        self.events.push(Event::Executed(request, bus.chip.now));
                        self.serving = Serving::Sent;
                        if released {
                            let adu = bus.adu();
                            let before = *adu;
                            self.server.commit(&mut self.memory, adu, len, plan);
                            assert_eq!(*adu, before, "an answer is on its way");
                        } else {
                            let adu = bus.adu();
                            let answer = self.server.commit(&mut self.memory, adu, len, plan);
                            if answer > 0 {
                                bus.release(answer);
                            }
                        }
                    }
                },
                Serving::Sent => {
                    if bus.machine.sent().is_none() {
                        return;
                    }
                    bus.give_back();
                    self.serving = Serving::Nothing;
                }
            }
        }
    }

    fn prepare(&mut self, bus: &mut Bus, len: u8) {
        let before = self.memory.clone();
        let plan = self.server.prepare(&mut self.memory, bus.adu(), len);
        assert!(before == self.memory, "preparing changed the model");
        self.serving = match plan {
            Plan::Ignore | Plan::Silent { .. } => Serving::Sent,
            Plan::Answer { len } | Plan::Diagnose { len } => {
                bus.release(len);
                Serving::Sent
            }
            Plan::Write { len: answer } if !Memory::<MAY_FAIL>::WRITES_MAY_FAIL => {
                if answer > 0 {
                    bus.release(answer);
                }
                Serving::Settling {
                    len,
                    plan,
                    released: true,
                }
            }
            Plan::Write { .. } | Plan::Call => Serving::Settling {
                len,
                plan,
                released: false,
            },
        };
    }

    /// Drops what the second task is about, and begins it anew.
    pub fn cancel(&mut self, bus: &mut Bus) {
        self.handed = None;
        self.serving = Serving::Nothing;
        if bus.chip.lent.is_some() {
            bus.give_back();
        }
    }
}
