//! The fuses of the ATmega328P (DS40002061B 28.2, Fuse Bits): those that are changed, and how they are read.
//!
//! Three fuses are changed: the brown-out level, the start address after a reset, and whether an erasure of the chip
//! keeps the EEPROM. Those that can lock a programmer out (CKSEL, SPIEN, RSTDISBL, DWEN) are never changed.

use crate::error::Error;
use crate::programmer::Programmer;
use clap::ValueEnum;
use std::fmt;
use std::io::BufRead;

/// Fuses of the high byte (Table 28-8). A fuse that is 0 is programmed.
const RSTDISBL: u8 = 1 << 7;
const SPIEN: u8 = 1 << 5;
const EESAVE: u8 = 1 << 3;
const BOOTRST: u8 = 1 << 0;

/// Fuses of the extended byte (Table 28-6).
const BODLEVEL: u8 = 0b111;

/// The supply below which the chip is held in reset, typically (System and Reset Characteristics, BODLEVEL Fuse Coding).
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum Bod {
    /// 4.3 V: for 5 V and clocks above 10 MHz
    #[value(name = "4.3")]
    V43,
    /// 2.7 V: for clocks to 10 MHz
    #[value(name = "2.7")]
    V27,
    /// 1.8 V: for clocks to 4 MHz
    #[value(name = "1.8")]
    V18,
    /// No brown-out reset
    #[value(name = "off")]
    Off,
}

impl Bod {
    /// The level for a clock, if only one is suitable.
    ///
    /// # Errors
    /// [`Error::usage`] for a clock between the two with which boards are sold.
    pub fn of_clock(hz: u32) -> Result<Self, Error> {
        match hz {
            16_000_000.. => Ok(Self::V43),
            8_000_000 => Ok(Self::V27),
            _ => Err(Error::usage(format!(
                "--fuses: the brown-out level for a clock of {hz} Hz goes by the board's supply; say it with --bod 4.3, 2.7, \
                 1.8 or off"
            ))),
        }
    }

    const fn code(self) -> u8 {
        match self {
            Self::V43 => 0b100,
            Self::V27 => 0b101,
            Self::V18 => 0b110,
            Self::Off => 0b111,
        }
    }
}

/// The three fuse bytes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Fuses {
    low: u8,
    high: u8,
    extended: u8,
}

impl Fuses {
    /// The fuses from avrdude's output.
    fn parse(printed: &str) -> Option<Self> {
        let byte = |word: &str| u8::from_str_radix(word.strip_prefix("0x")?, 16).ok();
        let mut bytes = printed.split_whitespace().map(byte);
        let mut next = || bytes.next().flatten();
        let (low, high, extended) = (next()?, next()?, next()?);
        bytes.next().is_none().then_some(Self {
            low,
            high,
            extended,
        })
    }

    /// The fuses of a Nano without a boot loader: a reset starts the application, and an erasure of the chip keeps
    /// the EEPROM.
    fn without_boot_loader(self, bod: Bod) -> Self {
        Self {
            low: self.low,
            high: self.high & !EESAVE | BOOTRST,
            extended: self.extended & !BODLEVEL | bod.code(),
        }
    }

    /// Whether a programmer can have read these: without SPIEN, or with RSTDISBL or DWEN, nothing can be read.
    fn is_possible(self) -> bool {
        self.high & SPIEN == 0 && self.high & RSTDISBL != 0
    }

    /// The bits that are fuses: the other bits of the extended byte read as 1 or as 0, and avrdude writes them as 0.
    fn used(self) -> Self {
        Self {
            extended: self.extended & BODLEVEL,
            ..self
        }
    }

    /// The operations that write the bytes of `after` that differ.
    fn writes(self, after: Self) -> Vec<String> {
        let high = (self.high != after.high).then(|| format!("hfuse:w:{:#04x}:m", after.high));
        let extended = self.used().extended != after.used().extended;
        let extended = extended.then(|| format!("efuse:w:{:#04x}:m", after.extended));
        high.into_iter().chain(extended).collect()
    }
}

impl fmt::Display for Fuses {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self {
            low,
            high,
            extended,
        } = self;
        let level = match extended & BODLEVEL {
            0b111 => "off",
            0b110 => "1.8 V",
            0b101 => "2.7 V",
            0b100 => "4.3 V",
            _ => "reserved",
        };
        let start = match high & BOOTRST {
            0 => "the boot loader",
            _ => "the application",
        };
        let kept = match high & EESAVE {
            0 => "kept",
            _ => "erased too",
        };
        write!(
            f,
            "low {low:#04x}, high {high:#04x}, extended {extended:#04x}: brown-out {level}, a reset starts {start}, EEPROM {kept} \
             when the chip is erased"
        )
    }
}

/// Reads the fuses, shows their old and new values, asks unless `is_sure`, and writes the bytes that differ.
///
/// # Errors
/// [`Error::failed`] if the answer is no, if the fuses read are impossible, or if they are not as written.
pub fn set(programmer: &Programmer, bod: Bod, is_sure: bool) -> Result<(), Error> {
    let before = read(programmer)?;
    let after = before.without_boot_loader(bod);
    println!("fuses before: {before}");
    println!("fuses after:  {after}");
    let writes = before.writes(after);
    if writes.is_empty() {
        println!("the fuses are set already");
        return Ok(());
    }
    if bod == Bod::V43 && before.extended != after.extended {
        println!(
            "below 4.3 V the chip will not start, nor be programmed: not for a board that runs from 3.3 V"
        );
    }
    if !is_sure && !is_wanted()? {
        return Err(Error::failed("nothing was written"));
    }
    programmer.write(&writes)?;
    let read = read(programmer)?;
    if read.used() != after.used() {
        return Err(Error::failed(format!(
            "the fuses were not written; they are: {read}"
        )));
    }
    println!("fuses written");
    Ok(())
}

fn read(programmer: &Programmer) -> Result<Fuses, Error> {
    let printed = programmer.read(&["lfuse:r:-:h", "hfuse:r:-:h", "efuse:r:-:h"])?;
    match Fuses::parse(&printed) {
        Some(fuses) if fuses.is_possible() => Ok(fuses),
        _ => Err(Error::failed(format!(
            "impossible fuses were read: {}; check the wires of the programmer. Nothing was written",
            printed.split_whitespace().collect::<Vec<_>>().join(" ")
        ))),
    }
}

fn is_wanted() -> Result<bool, Error> {
    println!("Write them? [y/N]");
    let mut answer = String::new();
    let read = std::io::stdin().lock().read_line(&mut answer);
    read.map_err(|error| Error::io("standard input", error))?;
    Ok(matches!(answer.trim(), "y" | "Y" | "yes"))
}

#[cfg(test)]
mod tests {
    use super::*;

    const LEVELS: [Bod; 4] = [Bod::V43, Bod::V27, Bod::V18, Bod::Off];

    #[test]
    fn three_fuses_change_and_no_other() {
        for byte in 0..=u8::MAX {
            for bod in LEVELS {
                let before = Fuses {
                    low: byte,
                    high: byte,
                    extended: byte,
                };
                let after = before.without_boot_loader(bod);
                assert_eq!(after.low, byte);
                // EESAVE programmed, BOOTRST not, RSTDISBL, DWEN, SPIEN, WDTON and BOOTSZ as they were.
                assert_eq!(after.high & 0b1111_0110, byte & 0b1111_0110);
                assert_eq!(after.high & 0b0000_1001, 0b0000_0001);
                assert_eq!(after.extended & 0b1111_1000, byte & 0b1111_1000);
                assert_eq!(after.extended & 0b0000_0111, bod.code());
            }
        }
    }

    #[test]
    fn the_level_goes_by_the_clock_only_where_there_is_no_doubt() {
        for (hz, level) in [(16, Bod::V43), (20, Bod::V43), (8, Bod::V27)] {
            assert_eq!(Bod::of_clock(hz * 1_000_000).unwrap(), level);
        }
        for hz in [8_000_001, 11_059_200, 12_000_000, 15_999_999] {
            let error = Bod::of_clock(hz).unwrap_err();
            assert_eq!(error.code(), 2);
            assert!(error.message().contains(&hz.to_string()));
            assert!(error.message().contains("--bod"));
        }
    }

    #[test]
    fn only_three_bytes_are_fuses() {
        let fuses = Fuses::parse("0xff\n0xda\n0x5\n").expect("three bytes");
        assert_eq!((fuses.low, fuses.high, fuses.extended), (0xFF, 0xDA, 5));
        for printed in [
            "",
            "0xff 0xda",
            "0xff 0xda 0x05 0x05",
            "0xff 0xda ok",
            "0xff 0x1da 0x05",
        ] {
            assert_eq!(Fuses::parse(printed), None, "{printed}");
        }
        assert!(fuses.is_possible());
        for high in [0xFF, 0x00, 0xFA, 0x5A] {
            assert!(!Fuses { high, ..fuses }.is_possible(), "{high:#x}");
        }
    }

    #[test]
    fn only_what_differs_is_written() {
        let fuses = Fuses::parse("0xff 0xd3 0xfd").expect("three bytes");
        let same = fuses.without_boot_loader(Bod::V27);
        assert_eq!(fuses.writes(same), [""; 0]);
        let other = fuses.without_boot_loader(Bod::V43);
        assert_eq!(fuses.writes(other), ["efuse:w:0xfc:m"]);
    }
}
