//! A node on the bus answers a host.

use multidrop_bus::{Line, Station, Time};
use multidrop_testkit::assembler;

#[test]
fn a_node_echoes_over_the_wire() {
    // ANCHOR: transact
    let (mut bus, node, host) = assembler::one("echo", &[], Line::n81(38_400));
    bus.run_for(Time::from_ms(1));
    let answer = bus
        .transact(host, &[0x41], Time::from_ms(5))
        .expect("an answer");
    assert_eq!(answer.bytes, [0x42]);
    assert!(answer.is_clean());
    // ANCHOR_END: transact
    assert!(
        bus.record().bytes().iter().all(|byte| byte.is_good()),
        "{}",
        bus.record()
    );
    assert_eq!(bus.record().sent_by(Station::Node(node)).count(), 1);
    assert_eq!(bus.record().de_edges().len(), 2);
    assert_eq!(bus.record().conflicts(), []);
}
