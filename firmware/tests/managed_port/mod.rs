//! A managed port with its tasks, and a slave to ask.
#![allow(dead_code, reason = "each test binary uses a part")]

use crate::bench::{Bench, Heard, TestLine, Wire};
use multidrop::PortConfig;
use multidrop::managed::{ManagedPort, managed_receive, managed_run};
use multidrop::protocol::port_registers::{PortRegisters, Register};
use multidrop::protocol::registers::{Bank, CoilBank, Items, NoRules, Rules};
use multidrop::protocol::server::Uncounted;

pub type Port<R, C = CoilBank<2>, V = NoRules> =
    &'static ManagedPort<TestLine, PortRegisters<R, C, V>, Uncounted, 2>;

pub const RS4: PortConfig = PortConfig::new("RS4")
    .slave_id(17)
    .baud(38_400)
    .timeout_ms(100)
    .turnaround_ms(50);

/// A port with these arrays, and its tasks.
pub fn open<R, C, V>(
    bench: &mut Bench<'_>,
    config: PortConfig,
    regs: R,
    coils: C,
) -> (&'static Wire, Port<R, C, V>)
where
    R: Items<Item = u16> + 'static,
    C: Items<Item = bool> + 'static,
    V: Rules + 'static,
{
    let wire = Wire::new(config.line());
    let port = ManagedPort::with(TestLine(wire), &config, regs, coils, Uncounted);
    let port: Port<R, C, V> = Box::leak(Box::new(port));
    bench.wire(wire);
    bench.spawn(async move { managed_receive(port).await });
    bench.spawn(async move { managed_run(port).await });
    bench.poll();
    (wire, port)
}

pub fn plain(bench: &mut Bench<'_>, config: PortConfig) -> (&'static Wire, Port<Bank<10>>) {
    open(bench, config, Bank::new(0), CoilBank::new(0, 16))
}

pub trait Loads {
    fn set(&self, name: &str, value: u32);
    fn get(&self, name: &str) -> u32;
}

impl<R: Items<Item = u16>, C: Items<Item = bool>, V: Rules> Loads
    for ManagedPort<TestLine, PortRegisters<R, C, V>, Uncounted, 2>
{
    fn set(&self, name: &str, value: u32) {
        let loaded = self.load_raw(Register::from_name(name).unwrap(), value);
        loaded.unwrap_or_else(|refused| panic!("{refused}"));
    }

    fn get(&self, name: &str) -> u32 {
        self.read(Register::from_name(name).unwrap()).unwrap()
    }
}

/// A slave with registers 100 times their address that takes every write.
pub fn slave(unit: u8) -> impl FnMut(&[u8]) -> Vec<(u64, Heard)> {
    move |request| {
        if request[0] != unit {
            return Vec::new();
        }
        let word = |at: usize| u16::from_be_bytes([request[at], request[at + 1]]);
        let mut answer = request[..2].to_vec();
        match request[1] {
            3 | 4 => {
                answer.push(2 * request[5]);
                for address in word(2)..word(2) + word(4) {
                    answer.extend((address.wrapping_mul(100)).to_be_bytes());
                }
            }
            1 | 2 => {
                answer.push(request[5].div_ceil(8));
                answer.extend((0..request[5].div_ceil(8)).map(|_| 0b0100_1101));
            }
            _ => answer.extend(&request[2..6]),
        }
        vec![(10, Ok(answer))]
    }
}
