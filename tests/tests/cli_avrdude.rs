//! `flash --programmer --fuses` with avrdude itself and an emulated programmer: it speaks version 1 of the STK500's
//! protocol (Atmel AVR061), as an Arduino with the sketch ArduinoISP does, and has an emulated ATmega328P.

use multidrop_testkit::places;
mod sims;

use std::fs::File;
use std::io::{Read, Write};
use std::process::{Command, Stdio};
use std::sync::{Arc, Mutex};
use std::thread;

use nix::fcntl::OFlag;
use nix::pty::{PtyMaster, grantpt, posix_openpt, ptsname_r, unlockpt};
use nix::sys::termios::{self, SetArg};
use sims::Sim;

/// The chip, as serial programming shows it (DS40002061B, Serial Programming Instruction Set).
struct Chip {
    low: u8,
    high: u8,
    extended: u8,
    flash: Vec<u8>,
    /// Instructions that write something other than flash, in order.
    written: Vec<[u8; 4]>,
}

impl Chip {
    /// An instruction's last byte on the way out.
    fn instruction(&mut self, code: [u8; 4]) -> u8 {
        match code {
            // Read Signature Byte, Fuse Bits, Fuse High Bits, Extended Fuse Bits.
            [0x30, _, index, _] => [0x1E, 0x95, 0x0F][usize::from(index & 3) % 3],
            [0x50, 0x00, ..] => self.low,
            [0x58, 0x08, ..] => self.high,
            [0x50, 0x08, ..] => self.extended,
            // Write Fuse Bits, High, Extended; Chip Erase.
            [0xAC, 0xA0, _, value] => {
                self.written.push(code);
                self.low = value;
                0
            }
            [0xAC, 0xA8, _, value] => {
                self.written.push(code);
                self.high = value;
                0
            }
            [0xAC, 0xA4, _, value] => {
                self.written.push(code);
                // Table 28-6: five bits are none.
                self.extended = 0b1111_1000 | value;
                0
            }
            [0xAC, 0x80, ..] => {
                self.written.push(code);
                self.flash.fill(0xFF);
                0
            }
            _ => 0,
        }
    }
}

const IN_SYNC: u8 = 0x14;
const OK: u8 = 0x10;

/// Answers commands until nobody is there any more.
fn serve(mut port: impl Read + Write, chip: &Mutex<Chip>) -> std::io::Result<()> {
    let mut address = 0_usize;
    loop {
        let mut command = [0];
        port.read_exact(&mut command)?;
        let mut take = |len: usize| -> std::io::Result<Vec<u8>> {
            let mut bytes = vec![0; len];
            port.read_exact(&mut bytes)?;
            Ok(bytes)
        };
        let mut chip = chip.lock().expect("no test has failed");
        let mut answer = vec![IN_SYNC];
        match command[0] {
            // Get Parameter.
            b'A' => {
                take(1)?;
                answer.push(3);
            }
            b'B' => drop(take(20)?),
            b'E' => {
                let len = take(1)?[0];
                take(usize::from(len) - 1)?;
            }
            // Universal.
            b'V' => {
                let code = take(4)?;
                answer.push(chip.instruction([code[0], code[1], code[2], code[3]]));
            }
            // Load Address, in words.
            b'U' => {
                let words = take(2)?;
                address = 2 * usize::from(u16::from_le_bytes([words[0], words[1]]));
            }
            // Program Page, Read Page.
            kind @ (b'd' | b't') => {
                let head = take(3)?;
                let len = usize::from(u16::from_be_bytes([head[0], head[1]]));
                assert_eq!(head[2], b'F', "the flash");
                let page = address..address + len;
                if kind == b'd' {
                    let data = take(len)?;
                    chip.flash[page].copy_from_slice(&data);
                } else {
                    answer.extend(&chip.flash[page]);
                }
            }
            b'u' => answer.extend([0x1E, 0x95, 0x0F]),
            // Get Sync, Enter and Leave Program Mode, and what else has no arguments.
            _ => {}
        }
        // Sync_CRC_EOP.
        assert_eq!(take(1)?, b" ");
        answer.push(OK);
        drop(chip);
        port.write_all(&answer)?;
    }
}

/// A programmer on a terminal, and the terminal's name.
fn programmer(chip: &Arc<Mutex<Chip>>) -> (String, File) {
    let master: PtyMaster = posix_openpt(OFlag::O_RDWR | OFlag::O_NOCTTY).expect("a terminal");
    grantpt(&master)
        .and_then(|()| unlockpt(&master))
        .expect("ours");
    let name = ptsname_r(&master).expect("a name");
    // Open here too, so that it is no end when avrdude closes it between two calls.
    let client = File::options()
        .read(true)
        .write(true)
        .open(&name)
        .expect("a terminal");
    let mut raw = termios::tcgetattr(&client).expect("a terminal");
    termios::cfmakeraw(&mut raw);
    termios::tcsetattr(&client, SetArg::TCSANOW, &raw).expect("a terminal");
    let chip = Arc::clone(chip);
    thread::spawn(move || {
        // It ends with the test.
        let _ = serve(master, &chip);
    });
    (name, client)
}

/// What an Intel HEX file of less than 64 KB says, from address 0.
fn contents(hex: &str) -> Vec<u8> {
    let mut flash = Vec::new();
    for line in hex.lines() {
        let byte = |at: usize| u8::from_str_radix(&line[at..at + 2], 16).expect("hexadecimal");
        if byte(7) != 0 {
            continue;
        }
        let address = usize::from(u16::from_be_bytes([byte(3), byte(5)]));
        let data = (0..usize::from(byte(1))).map(|index| byte(9 + 2 * index));
        flash.resize(flash.len().max(address), 0xFF);
        flash.splice(address.., data);
    }
    flash
}

#[test]
fn avrdude_sets_the_fuses_and_writes_the_image() {
    let chip = Arc::new(Mutex::new(Chip {
        low: 0xFF,
        high: 0xDA,
        extended: 0xFD,
        flash: vec![0; 32 * 1024],
        written: Vec::new(),
    }));
    let (port, _client) = programmer(&chip);
    let flash = || {
        let folder = Sim::folder();
        let mut command = Command::new(places::xtask());
        sims::settle(&mut command, &folder);
        command.env("CARGO_MANIFEST_DIR", places::root());
        command.args(["flash", "nano", "registers", "--fuses", "--yes"]);
        command.args(["--programmer", "stk500v1", "--port", &port]);
        let output = command.stdin(Stdio::null()).output().expect("it runs");
        assert_eq!(output.status.code(), Some(0), "{output:?}");
        String::from_utf8_lossy(&output.stdout).into_owned()
    };
    let said = flash();
    assert!(
        said.contains("fuses before: low 0xff, high 0xda, extended 0xfd"),
        "{said}"
    );
    assert!(said.contains("fuses written"), "{said}");
    {
        let mut chip = chip.lock().expect("it served well");
        assert_eq!((chip.low, chip.high, chip.extended), (0xFF, 0xD3, 0xFC));
        // The EEPROM is to outlive the erasure, which comes last.
        let orders: Vec<_> = chip.written.iter().map(|code| code[1]).collect();
        assert_eq!(orders, [0xA8, 0xA4, 0x80]);
        let hex = places::root().join("target/firmware/nano-registers-bootloadernone.hex");
        let image = contents(&std::fs::read_to_string(hex).expect("an image"));
        assert!(image.len() > 4_000);
        assert_eq!(chip.flash[..image.len()], image);
        assert!(chip.flash[image.len()..].iter().all(|&byte| byte == 0xFF));
        chip.written.clear();
    }
    // Once more the fuses are right.
    let said = flash();
    assert!(said.contains("the fuses are set already"), "{said}");
    let written = &chip.lock().expect("it served well").written;
    assert_eq!(
        written.iter().map(|code| code[1]).collect::<Vec<_>>(),
        [0x80]
    );
}
