//! Every function over a fixed map, for conformance tests: unit 17, RTU 38400 8N1 if not built otherwise.
#![no_std]
#![no_main]
#![feature(abi_avr_interrupt)]

use board_nano::{Rs485Option as Rs485, bind_interrupts, options, settings};
use multidrop::protocol::format::LineFormat;
use multidrop::protocol::server::Counted;
use multidrop::{PortConfig, Shared};
use multidrop_apps::conformance::{Conformance, EVENTS, UNIT};
use static_cell::{ConstStaticCell, StaticCell};

/// Without files: they would take 250 bytes of stack.
type Model = Shared<Conformance<0>>;
type Port = multidrop::ServerPort<Rs485, Counted<EVENTS>>;

const PORT: PortConfig = PortConfig::new("RS4")
    .slave_id(UNIT)
    .baud(options::baud(38_400))
    .framing(options::framing())
    .format(options::format(LineFormat::F8N1));

bind_interrupts!(struct Irqs { USART0 => Rs485; });

multidrop::tasks! {
    /// The tasks that have to be alive.
    static ROLL: Roll<Irqs>;

    fn receive(port: &'static Port) = multidrop::receive(port);
    fn serve(port: &'static Port, model: &'static Model) = multidrop::serve(port, model);
}

#[avr_device::entry]
fn main() -> ! {
    let board = board_nano::init(Irqs);
    let line = board.rs4.open(Irqs, const { settings(&PORT) });

    static PORT_CELL: StaticCell<Port> = StaticCell::new();
    let port = PORT_CELL.init(Port::counted(line, &PORT));
    // Where it is built is where it stays: half a kilobyte is too much to move.
    static MODEL: ConstStaticCell<Model> =
        ConstStaticCell::new(Shared::new(Conformance::new("nano")));
    let model = MODEL.take();
    board_nano::run(&ROLL, |spawner| {
        spawner.spawn(receive(port).unwrap());
        spawner.spawn(serve(port, model).unwrap());
    })
}
