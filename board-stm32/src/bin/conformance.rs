//! A server with every function over a fixed map, for conformance tests: unit 17 on RS4, at 38400 baud, RTU 8N1 or ASCII 7E1,
//! unless built for others.
#![no_std]
#![no_main]

use board_stm32::ports::PortSetup;
use board_stm32::usart::Usart;
use board_stm32::{Dog, Watchdog, info, options};
use multidrop::protocol::format::{Framing, LineFormat};
use multidrop::protocol::server::Counted;
use multidrop::{PortConfig, Shared};
use multidrop_apps::conformance::{Conformance, EVENTS, UNIT};
use static_cell::{ConstStaticCell, StaticCell};

/// The data model, with 32 records in file 4.
type Model = Shared<Conformance<32>>;
type Port = multidrop::ServerPort<Usart, Counted<EVENTS>>;

const FRAMING: (Framing, LineFormat) = if options::ascii() {
    (Framing::Ascii, LineFormat::F7E1)
} else {
    (Framing::Rtu, LineFormat::F8N1)
};

const PORT: PortConfig = PortConfig::new("RS4")
    .slave_id(UNIT)
    .baud(options::baud(38_400))
    .framing(FRAMING.0)
    .format(options::format(FRAMING.1));

multidrop::tasks! {
    /// The tasks that have to be alive.
    static ROLL: Roll<Dog>;

    fn receive(port: &'static Port) = multidrop::receive(port);
    fn serve(port: &'static Port, model: &'static Model) = multidrop::serve(port, model);
}

#[cortex_m_rt::entry]
fn main() -> ! {
    let board = board_stm32::init(Watchdog::DEFAULT);
    let line = board.rs4.open(const { PortSetup::new(&PORT) });
    info!("conformance: unit {} on RS4", UNIT);

    static PORT_CELL: StaticCell<Port> = StaticCell::new();
    let port = PORT_CELL.init(Port::counted(line, &PORT));
    // The model stays where it is built: it is too large to move.
    static MODEL: ConstStaticCell<Model> =
        ConstStaticCell::new(Shared::new(Conformance::new("stm32")));
    let model = MODEL.take();
    board_stm32::run(&ROLL, |spawner| {
        spawner.spawn(receive(port).unwrap());
        spawner.spawn(serve(port, model).unwrap());
    })
}
