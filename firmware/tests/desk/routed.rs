//! A port whose requests are routed.

use multidrop::protocol::port_registers::PortRegisters;
use multidrop::protocol::registers::{Bank, NoCoils, NoRules};
use multidrop::{
    Client, ManagedPort, PortConfig, Route, Router, managed_receive, managed_run, route,
};

use super::{Desk, TestLine, Wire};

pub type ClientSide = ManagedPort<TestLine, PortRegisters<Bank<4>, NoCoils, NoRules>>;

/// One more port that asks, through `through`: it is unit 1; units 2 and 3 are themselves, 4 is unit 17, 5 is unit 9,
/// which is not there.
pub fn open<const A: usize, const N: usize>(
    desk: &mut Desk<'_, A>,
    through: Client<TestLine, N>,
) -> (&'static Wire, &'static ClientSide) {
    const PORT: PortConfig = PortConfig::new("AS1").slave_id(1);
    let wire = desk.other();
    let routes = [(2, 2), (3, 3), (4, 17), (5, 9)].map(|(unit, target)| Route {
        unit,
        target,
        through,
    });
    let router: &'static Router<TestLine, N> =
        Box::leak(Box::new(Router::new(Box::leak(Box::new(routes)))));
    let port = ManagedPort::new(TestLine(wire), &PORT, PORT.bank(), NoCoils);
    let port: &'static ClientSide = Box::leak(Box::new(port.routed(router)));
    desk.spawn(async move { managed_receive(port).await });
    desk.spawn(async move { managed_run(port).await });
    desk.spawn(async move { route(router).await });
    (wire, port)
}

/// What went out on a line.
pub fn sent(wire: &Wire) -> Vec<Vec<u8>> {
    let sent = wire.sent.borrow();
    sent.iter().map(|(_, bytes)| bytes.clone()).collect()
}
