//! Changes of the settings of a port, step by step, by requests of the PC.

use multidrop_bus::{Format, Line};

use super::super::plain::wire::Way;
use super::{AS1, AS2, ASCII, LINE, RS2, RS4, TEXT};

/// Numbers of registers (`MB_xxx`) and values.
const MODE: u16 = 0;
const MASTER: u32 = 0;
const OFF: u32 = 2;
const FRAMING: u16 = 1;
const SLAVEID: u16 = 5;
const TIMEOUT: u16 = 13;
pub const BAUD: u16 = 22;
const FORMAT: u16 = 23;

/// Exceptions of a router.
const NO_PATH: u8 = 0x0A;
const NO_ANSWER: u8 = 0x0B;

/// One of them.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Step {
    /// AS2's master asks nothing any more and has its last answer.
    Hush,
    /// It asks no units any more, and waits for none.
    HushUnits,
    /// LOAD: port, register, value.
    Load(usize, u16, u32),
    /// AS1's own registers are read so often.
    Own(u32),
    /// A unit is asked, and the router answers with this exception.
    Refused(u8),
    /// The PC asks AS1 by this unit id and on this line from now on.
    Pc(u8, Line),
    /// AS2's master asks it so, and may ask again.
    Ascii(u8, Way, Line),
    /// The terminal on RS2 is changed to this as soon as the port is.
    Terminal(Line),
    /// So it was.
    Printed,
    /// The port was changed.
    Done(usize),
}

/// The next change of a port that was changed `count` times before; AS1's unit id and line are these.
pub fn change(port: usize, count: u32, as1: (u8, Line)) -> Vec<Step> {
    use Step::*;
    let mut steps = match port {
        AS1 if count.is_multiple_of(2) => {
            let unit = 50 - as1.0;
            vec![Load(AS1, SLAVEID, unit.into()), Pc(unit, as1.1)]
        }
        AS1 => {
            let baud = 96_000 - as1.1.baud;
            vec![Load(AS1, BAUD, baud), Pc(as1.0, Line::n81(baud))]
        }
        AS2 => {
            let unit = 20 + (count % 100) as u8;
            let line = Line::n81(57_600);
            let mut steps = vec![Hush];
            // RTU has no seven bits.
            steps.extend(match count.is_multiple_of(2) {
                true => [Load(AS2, FORMAT, 0), Load(AS2, FRAMING, 0)],
                false => [Load(AS2, FRAMING, 1), Load(AS2, FORMAT, 4)],
            });
            steps.push(Load(AS2, SLAVEID, unit.into()));
            let (way, line) = match count.is_multiple_of(2) {
                true => (Way::Rtu, line),
                false => (Way::Ascii, ASCII),
            };
            steps.extend([Load(AS2, BAUD, line.baud), Ascii(unit, way, line)]);
            steps
        }
        RS2 => {
            let line = match count.is_multiple_of(2) {
                true => Line::n81(460_800),
                false => TEXT,
            };
            vec![Terminal(line), Load(RS2, BAUD, line.baud), Printed]
        }
        // What is asked meanwhile is answered all the same; a poll under way is waited for.
        RS4 => match count % 3 {
            0 => vec![
                HushUnits,
                Load(RS4, MODE, OFF),
                Own(5),
                Refused(NO_PATH),
                Own(5),
                Refused(NO_PATH),
                Load(RS4, MODE, MASTER),
            ],
            1 => vec![
                HushUnits,
                Load(RS4, BAUD, 57_600),
                Own(5),
                Refused(NO_ANSWER),
                Load(RS4, BAUD, LINE.baud),
            ],
            _ => vec![Load(RS4, TIMEOUT, 50 + count % 7)],
        },
        _ => Vec::new(),
    };
    steps.push(Done(port));
    steps
}

/// Seven bits are AS2's first format.
const _: () = assert!(matches!(ASCII.format, Format::E71));
