//! The steps of the demonstration. Each checks the client's output, the frames on the wire, and the pins.

use multidrop_bus::{Frame, Station, Time, with_crc};

use crate::desk::{BAUD, Desk, Leds, Said, UNITS};
use crate::{Trouble, show};

/// The client's turnaround delay after a broadcast (SER 2.4.1).
const TURNAROUND_DELAY: Time = Time::from_ms(100);
/// A wait for the serial port that is longer than an answer may take.
const ANSWER_WAIT: Time = Time::from_ms(50);

type Checked = Result<(), Trouble>;

/// A frame that must be on the wire, without its checksum.
#[derive(Clone, Copy)]
enum Sent<'a> {
    Client(&'a [u8]),
    Node(usize, &'a [u8]),
}
use Sent::{Client, Node};

/// Runs all steps.
pub fn tell(desk: &mut Desk) -> Checked {
    let mut story = Story { desk, steps: 0 };
    show::title("The demonstration unit: three Nanos on one simulated RS-485 bus");
    story.boot()?;
    story.outputs()?;
    story.tables()?;
    story.broadcast()?;
    story.exceptions()?;
    story.unplugged()?;
    let tally = &story.desk.tally;
    show::summary(story.steps, tally.frames, tally.conflicts, tally.slowest);
    Ok(())
}

struct Story<'a> {
    desk: &'a mut Desk,
    steps: usize,
}

fn failed<T>(why: String) -> Result<T, Trouble> {
    Err(Trouble::Failed(why))
}

impl Story<'_> {
    /// Prints a step, does it, and names it if it fails.
    fn step(&mut self, what: &str, act: impl FnOnce(&mut Self) -> Checked) -> Checked {
        self.steps += 1;
        show::step(self.steps, what);
        act(self).map_err(|trouble| match trouble {
            Trouble::Failed(why) => {
                Trouble::Failed(format!("step {} failed ({what}): {why}", self.steps))
            }
            other => other,
        })
    }

    // --- what a step does -------------------------------------------------------------------

    /// Runs mbpoll, shows its output, and checks its exit code and that its output contains `wanted`.
    fn mbpoll(&mut self, words: &str, code: i32, wanted: &[&str]) -> Checked {
        let Said { code: got, text } = self.desk.mbpoll(words)?;
        for line in text.lines().map(str::trim).filter(|line| is_result(line)) {
            show::output(line);
        }
        if got != Some(code) {
            return failed(format!(
                "mbpoll ended with {got:?}, not {code}; it said:\n{text}"
            ));
        }
        match wanted.iter().find(|part| !text.contains(*part)) {
            Some(part) => failed(format!("mbpoll did not say {part:?}, but:\n{text}")),
            None => Ok(()),
        }
    }

    /// Reads `wanted.len()` items with mbpoll, and checks every one.
    fn mbpoll_reads(&mut self, words: &str, wanted: &[String]) -> Checked {
        let Said { code, text } = self.desk.mbpoll(words)?;
        let results = text.lines().filter_map(|line| {
            let (address, value) = line.trim().strip_prefix('[')?.split_once("]:")?;
            Some((address.to_owned(), value.trim().to_owned()))
        });
        let (addresses, values): (Vec<_>, Vec<_>) = results.unzip();
        if let (Some(first), Some(last)) = (addresses.first(), addresses.last()) {
            let range = if first == last {
                format!("[{first}]")
            } else {
                format!("[{first}..{last}]")
            };
            show::output(&format!("{range}: {}", values.join(" ")));
        }
        if code != Some(0) || values != wanted {
            return failed(format!(
                "mbpoll ended with {code:?} and read {values:?}, not {wanted:?}; it said:\n{text}"
            ));
        }
        Ok(())
    }

    /// Writes `body` and its checksum to the serial port, and checks the answer.
    fn serial(&mut self, body: &[u8], wait: Time, wanted: Option<&[u8]>) -> Checked {
        let answer = self.desk.serial(&with_crc(body), wait)?;
        let wanted = wanted.map(with_crc).unwrap_or_default();
        if answer != wanted {
            return failed(format!(
                "the serial port heard {answer:02X?}, not {wanted:02X?}"
            ));
        }
        Ok(())
    }

    /// Shows the new frames, and checks that they are `wanted`, complete and alone on the wire, with no answer before
    /// t3.5, and no driver on except for an answer.
    fn wire(&mut self, wanted: &[Sent]) -> Checked {
        let line = self.desk.line();
        let switched = self.desk.de_edges();
        let frames = self.desk.take_frames();
        for frame in &frames {
            show::frame(frame, line);
        }
        if self.desk.tally.conflicts > 0 {
            return failed("two drivers were on at once".to_owned());
        }
        if let Some(frame) = frames.iter().find(|frame| !frame.is_intact()) {
            return failed(format!("{} was damaged on its way", frame.hex()));
        }
        let answers = frames.iter().filter(|frame| frame.answer).count();
        if switched != 2 * answers {
            return failed(format!(
                "drivers were switched {switched} times for {answers} answers"
            ));
        }
        let early = |frame: &&Frame| frame.answer && (frame.early || frame.turnaround.is_none());
        if let Some(frame) = frames.iter().find(early) {
            return failed(format!("{} came before t3.5", frame.hex()));
        }
        let same = |(frame, wanted): (&Frame, &Sent)| match *wanted {
            Client(body) => !frame.answer && frame.body().as_deref() == Some(body),
            Node(unit, body) => {
                frame.from == Station::Node(self.desk.node(unit))
                    && frame.body().as_deref() == Some(body)
            }
        };
        if frames.len() != wanted.len() || !frames.iter().zip(wanted).all(same) {
            let wanted: Vec<_> = wanted
                .iter()
                .map(|sent| match sent {
                    Client(body) => format!("client {body:02X?}"),
                    Node(unit, body) => format!("node {unit} {body:02X?}"),
                })
                .collect();
            return failed(format!(
                "on the wire there should have been: {}",
                wanted.join(", ")
            ));
        }
        Ok(())
    }

    /// Shows the LED pins of all nodes, and checks them against their registers.
    fn leds(&mut self, registers: [u16; UNITS]) -> Checked {
        for (unit, register) in (1..).zip(registers) {
            let leds = self.desk.leds(unit)?;
            show::leds(unit, leds);
            if leds != Leds::of(register) {
                return failed(format!(
                    "node {unit} should show {register:04X}, but PORTB is {:02X}, PORTD {:02X}",
                    leds.b, leds.d
                ));
            }
        }
        Ok(())
    }

    // --- the steps --------------------------------------------------------------------------

    fn boot(&mut self) -> Checked {
        self.step(
            "The nodes have booted: unit ids 1, 2 and 3, all outputs off, and silence.",
            |s| {
                show::note(&format!(
                    "RTU, {BAUD} baud, 8N1. LEDs (0 off, 1 on) as in the ports;"
                ));
                show::note(
                    "a dot is a pin without an LED: RXD, TXD, DE, and the two of the crystal.",
                );
                s.wire(&[])?;
                s.leds([0; UNITS])
            },
        )
    }

    /// Writes the register of each node; the other nodes keep theirs.
    fn outputs(&mut self) -> Checked {
        show::part("Outputs, node by node");
        let mut registers = [0; UNITS];
        // One LED of each port, a pattern, all that there is.
        for (unit, value) in (1..).zip([0x0108_u16, 0x2DA8, 0xFFFF]) {
            registers[unit - 1] = value;
            let [high, low] = value.to_be_bytes();
            let id = unit as u8;
            self.step(
                &format!("mbpoll writes 0x{value:04X} to the register of unit {unit}."),
                |s| {
                    let words = format!("-a {unit} -t 4 -r 0 bus 0x{value:04X}");
                    s.mbpoll(&words, 0, &["Written 1 references"])?;
                    let write = [id, 6, 0, 0, high, low];
                    s.wire(&[Client(&write), Node(unit, &write)])?;
                    s.leds(registers)
                },
            )?;
            self.step(&format!("mbpoll reads it back from unit {unit}."), |s| {
                let words = format!("-a {unit} -t 4:hex -r 0 bus");
                s.mbpoll_reads(&words, &[format!("0x{value:04X}")])?;
                s.wire(&[
                    Client(&[id, 3, 0, 0, 0, 1]),
                    Node(unit, &[id, 3, 2, high, low]),
                ])
            })?;
        }
        Ok(())
    }

    /// Node 2 by its other tables: 0x2DA8 becomes 0x2DB8, then 0x12B8.
    fn tables(&mut self) -> Checked {
        show::part("One register, four tables: unit 2 bit by bit");
        self.step("mbpoll switches coil 4 on, which is bit 4: PD4.", |s| {
            s.mbpoll("-a 2 -t 0 -r 4 bus 1", 0, &["Written 1 references"])?;
            let write = [2, 5, 0, 4, 0xFF, 0];
            s.wire(&[Client(&write), Node(2, &write)])?;
            s.leds([0x0108, 0x2DB8, 0xFFFF])
        })?;
        self.step("mbpoll writes coils 8 to 13 at once: PB0 to PB5.", |s| {
            let words = "-a 2 -t 0 -r 8 bus 0 1 0 0 1 0";
            s.mbpoll(words, 0, &["Written 6 references"])?;
            s.wire(&[
                Client(&[2, 15, 0, 8, 0, 6, 1, 0x12]),
                Node(2, &[2, 15, 0, 8, 0, 6]),
            ])?;
            s.leds([0x0108, 0x12B8, 0xFFFF])
        })?;
        let bits: Vec<_> = (0..16)
            .map(|bit| (0x12B8_u16 >> bit & 1).to_string())
            .collect();
        self.step("mbpoll reads the 16 coils.", |s| {
            s.mbpoll_reads("-a 2 -t 0 -r 0 -c 16 bus", &bits)?;
            s.wire(&[
                Client(&[2, 1, 0, 0, 0, 16]),
                Node(2, &[2, 1, 2, 0xB8, 0x12]),
            ])
        })?;
        self.step("mbpoll reads the 16 discrete inputs.", |s| {
            s.mbpoll_reads("-a 2 -t 1 -r 0 -c 16 bus", &bits)?;
            s.wire(&[
                Client(&[2, 2, 0, 0, 0, 16]),
                Node(2, &[2, 2, 2, 0xB8, 0x12]),
            ])
        })?;
        self.step("mbpoll reads the input register.", |s| {
            s.mbpoll_reads("-a 2 -t 3:hex -r 0 bus", &["0x12B8".to_owned()])?;
            s.wire(&[Client(&[2, 4, 0, 0, 0, 1]), Node(2, &[2, 4, 2, 0x12, 0xB8])])
        })
    }

    fn broadcast(&mut self) -> Checked {
        show::part("Broadcast");
        self.step(
            "A broadcast to all three: each executes it, and none answers.",
            |s| {
                show::note(
                    "mbpoll takes no unit id 0 on a serial line: the frame is written to the port",
                );
                show::note(
                    "as it is, with Write Multiple Registers, which mbpoll has not used so far.",
                );
                let write = [0, 16, 0, 0, 0, 1, 2, 0x15, 0x50];
                s.serial(&write, TURNAROUND_DELAY, None)?;
                s.wire(&[Client(&write)])?;
                s.leds([0x1550; UNITS])
            },
        )?;
        self.step("The same function to unit 3 alone is answered.", |s| {
            let write = [3, 16, 0, 0, 0, 1, 2, 0x2A, 0xA8];
            let done = [3, 16, 0, 0, 0, 1];
            s.serial(&write, ANSWER_WAIT, Some(&done))?;
            s.wire(&[Client(&write), Node(3, &done)])?;
            s.leds([0x1550, 0x1550, 0x2AA8])
        })
    }

    fn exceptions(&mut self) -> Checked {
        show::part("Exceptions");
        self.step(
            "01: mbpoll asks unit 1 for its server id, which it does not have.",
            |s| {
                // mbpoll's exit code is 0 even so.
                s.mbpoll("-a 1 -u bus", 0, &["Illegal function"])?;
                s.wire(&[Client(&[1, 0x11]), Node(1, &[1, 0x91, 1])])
            },
        )?;
        self.step(
            "02: mbpoll reads register 1 of unit 2, which has only register 0.",
            |s| {
                s.mbpoll("-a 2 -t 4 -r 1 bus", 1, &["Illegal data address"])?;
                s.wire(&[Client(&[2, 3, 0, 1, 0, 1]), Node(2, &[2, 0x83, 2])])
            },
        )?;
        self.step(
            "02: mbpoll writes registers 0 and 1 of unit 2, which changes neither.",
            |s| {
                let words = "-a 2 -t 4 -r 0 bus 0x3FF8 1";
                s.mbpoll(words, 1, &["Illegal data address"])?;
                s.wire(&[
                    Client(&[2, 16, 0, 0, 0, 2, 4, 0x3F, 0xF8, 0, 1]),
                    Node(2, &[2, 0x90, 2]),
                ])?;
                s.leds([0x1550, 0x1550, 0x2AA8])
            },
        )?;
        self.step(
            "03: 126 registers of unit 3, one more than an answer can hold.",
            |s| {
                show::note(
                    "mbpoll refuses to ask for that: the frame is written to the port as it is.",
                );
                let answer = [3, 0x83, 3];
                let request = [3, 3, 0, 0, 0, 126];
                s.serial(&request, ANSWER_WAIT, Some(&answer))?;
                s.wire(&[Client(&request), Node(3, &answer)])
            },
        )
    }

    fn unplugged(&mut self) -> Checked {
        show::part("A node unplugged");
        let read = [2, 3, 0, 0, 0, 1];
        self.step("Unit 2 is unplugged: mbpoll gets no answer.", |s| {
            s.desk.plug(2, false)?;
            s.mbpoll("-a 2 -t 4:hex -r 0 -o 0.5 bus", 1, &["timed out"])?;
            s.wire(&[Client(&read)])
        })?;
        self.step("Unit 3 is not affected.", |s| {
            s.mbpoll_reads("-a 3 -t 4:hex -r 0 bus", &["0x2AA8".to_owned()])?;
            s.wire(&[Client(&[3, 3, 0, 0, 0, 1]), Node(3, &[3, 3, 2, 0x2A, 0xA8])])
        })?;
        self.step(
            "Unit 2 is plugged in again and answers; its outputs were kept.",
            |s| {
                s.desk.plug(2, true)?;
                s.mbpoll_reads("-a 2 -t 4:hex -r 0 bus", &["0x1550".to_owned()])?;
                s.wire(&[Client(&read), Node(2, &[2, 3, 2, 0x15, 0x50])])?;
                s.leds([0x1550, 0x1550, 0x2AA8])
            },
        )
    }
}

/// Whether a line of mbpoll's output is about the request, not about mbpoll or its settings.
fn is_result(line: &str) -> bool {
    line.starts_with('[') || line.starts_with("Written") || line.contains("failed")
}

/// How to drive the bus, which stays up.
pub fn invite() {
    show::part("The bus stays up: ./bus, until Ctrl-C");
    show::note(&format!(
        "{BAUD} baud, 8N1, unit ids 1, 2 and 3. From another terminal, here:"
    ));
    for command in [
        "mbpoll -m rtu -b 38400 -P none -0 -1 -a 2 -t 4 -r 0 ./bus 0x2DA8",
        "mbpoll -m rtu -b 38400 -P none -0 -1 -a 2 -t 0 -r 0 -c 16 ./bus",
    ] {
        show::command(command);
    }
    show::note("or with pymodbus:");
    for line in [
        "from pymodbus.client import ModbusSerialClient",
        "client = ModbusSerialClient('./bus', baudrate=38400)",
        "client.connect()",
        "client.write_register(0, 0x2DA8, device_id=2)",
        "print(client.read_coils(0, count=16, device_id=2).bits)",
    ] {
        show::output(line);
    }
}
