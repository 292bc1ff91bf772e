//! The register set of a port against a plain reading of its description: loads, reads, transactions and their answers by
//! script. Shares nothing with the crate but the names of what it calls.

mod transaction;

use multidrop_protocol::client::{AnswerError, Draft, Request, RequestError};
use multidrop_protocol::port_registers::{PortRegisters, PortSettings, Register, TransactionStep};
use multidrop_protocol::registers::{
    Bank, CoilBank, Items, NoRules, Rules, ScanList, SparseBank, SparseCoilBank,
};
use multidrop_protocol::rules;
use std::cell::Cell;
use std::collections::BTreeMap;

rules! {
    struct Limited: "RS4";
    VALID_REG { 0..=1000 }
    VALID_DATA { 10..=15 => range(100..=200) }
    DISABLE_REG { 10..=20, 109..=130, 191..=199 }
}

const TABLE: [u16; 10] = [4, 5, 6, 7, 9, 1000, 1001, 30_000, 30_004, 63_023];
const COIL_TABLE: [u16; 12] = [0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 20, 65_535];
const LIST: ([u16; 4], [u8; 4], [u16; 4]) = ([4, 9, 4, 100], [1, 2, 0, 247], [0, 3, 2, 1]);

/// What a port's arrays look like.
struct Shape {
    /// Addresses of REGS; `None` if dense.
    regs: Option<Vec<u16>>,
    regs_len: usize,
    coils: Option<Vec<u16>>,
    coils_len: usize,
    scan: bool,
    /// Rules of VALID_DATA, VALID_REG, DISABLE_REG.
    rules: [usize; 3],
}

/// Bytes not used yet; zeros behind the end.
struct Script<'a>(&'a [u8]);

impl Script<'_> {
    fn byte(&mut self) -> u8 {
        let (first, rest) = self.0.split_first().unwrap_or((&0, &[]));
        self.0 = rest;
        *first
    }

    fn word(&mut self) -> u16 {
        u16::from_be_bytes([self.byte(), self.byte()])
    }
}

/// Does what the bytes say. Panics where the crate and this reading of the description differ.
pub fn run(data: &[u8]) {
    let mut script = Script(data);
    let dense = Shape {
        regs: None,
        regs_len: 130,
        coils: None,
        coils_len: 2005,
        scan: false,
        rules: [0; 3],
    };
    let sparse = Shape {
        regs: Some(TABLE.to_vec()),
        regs_len: 10,
        coils: Some(COIL_TABLE.to_vec()),
        coils_len: 12,
        scan: false,
        rules: [1, 1, 3],
    };
    let list = Shape {
        regs: Some(LIST.0.to_vec()),
        regs_len: 4,
        coils: None,
        coils_len: 9,
        scan: true,
        rules: [0; 3],
    };
    let settings = PortSettings::DEFAULT;
    match script.byte() % 3 {
        0 => Judge::<_, _, NoRules>::new(
            PortRegisters::new(settings, Bank::<130>::new(7), CoilBank::<251>::new(7, 2005)),
            dense,
        )
        .play(script),
        1 => Judge::<_, _, Limited>::new(
            PortRegisters::new(
                settings,
                SparseBank::new(TABLE),
                SparseCoilBank::new(COIL_TABLE),
            ),
            sparse,
        )
        .play(script),
        _ => Judge::<_, _, NoRules>::new(
            PortRegisters::new(
                settings,
                ScanList::from_rows(LIST.0, [0; 4], LIST.1, LIST.2),
                CoilBank::<2>::new(0, 9),
            ),
            list,
        )
        .play(script),
    }
}

/// A request that is expected: slave, function, first address, and the indices of its items.
#[derive(Clone, Debug)]
struct Asked {
    unit: u8,
    function: u8,
    first: u16,
    items: Vec<usize>,
}

struct Judge<R, C, V> {
    port: PortRegisters<R, C, V>,
    shape: Shape,
    /// Scalar registers by name.
    value: BTreeMap<&'static str, u32>,
    regs: Vec<u16>,
    coils: Vec<bool>,
    flags: Vec<bool>,
}

impl<R: Items<Item = u16>, C: Items<Item = bool>, V: Rules> Judge<R, C, V> {
    fn new(port: PortRegisters<R, C, V>, shape: Shape) -> Self {
        let value = BTreeMap::from([
            ("MODE", 1),
            ("FRAMING", 0),
            ("BASE", 0),
            ("SLAVEID", 1),
            ("FUNC", 3),
            ("REGOFF", 0),
            ("REGCNT", 1),
            ("COILOFF", 0),
            ("COILCNT", 1),
            ("STATUS", 0),
            ("ERROR", 0),
            ("TIMEOUT", 1000),
            ("RETRIES", 0),
            ("TURNAROUND", 100),
            ("DATAOK", 0),
            ("DATAERR", 0),
            ("BAUD", 19_200),
            ("FORMAT", 1),
            ("DUPLEX", 0),
            ("FLOW", 0),
            ("INTER_CHARACTER", 0),
            ("START", 0),
            ("LATE_GUARD", 0),
            ("CTS_TIMEOUT", 1000),
            ("REQUEST_GAP", 0),
            ("DE_LEAD", 0),
            ("RESPONSE_DELAY", 0),
        ]);
        Judge {
            regs: vec![0; shape.regs_len],
            coils: vec![false; shape.coils_len],
            flags: vec![false; shape.rules[2]],
            port,
            shape,
            value,
        }
    }

    fn play(mut self, mut script: Script<'_>) {
        let mut steps = 0;
        while !script.0.is_empty() && steps < 2_000 {
            steps += 1;
            match script.byte() % 8 {
                0 => self.compare_all(),
                1 | 2 => self.transact(&mut script),
                _ => self.load(&mut script),
            }
        }
        self.compare_all();
    }

    fn get(&self, name: &str) -> u32 {
        self.value[name]
    }

    fn set(&mut self, name: &'static str, value: u32) {
        self.value.insert(name, value);
    }

    fn load(&mut self, script: &mut Script<'_>) {
        // The first thirty numbers as the kept scripts have them.
        let number = match script.byte() {
            byte @ 225.. => 28 + byte % 7,
            byte => byte % 30,
        };
        let is_array = matches!(number, 3 | 4 | 18..=21);
        let index = match script.byte() {
            255 => script.word(),
            byte if is_array => byte.into(),
            _ => 0,
        };
        let value = match script.byte() % 4 {
            0 => script.byte().into(),
            1 => u32::from(script.word()),
            // Where an array runs past the end: REGS, or COILS alone.
            2 => {
                [65_530, 65_400, 63_525, 64_000][usize::from(script.byte() % 4)]
                    + u32::from(script.byte() % 16)
            }
            _ => u32::from(script.word()) << 16 | u32::from(script.word()),
        };
        let Some(register) = Register::from_number(number, index) else {
            assert!(number > 32 || index > if is_array { 255 } else { 0 });
            return;
        };
        assert_eq!(register.number(), number);
        assert_eq!(Register::from_name(&register.to_string()), Some(register));
        self.try_load(register, value);
    }

    fn try_load(&mut self, register: Register, value: u32) {
        let (name, index) = (register.name(), usize::from(register.index().unwrap_or(0)));
        let expected = self.takes(name, index, value);
        let loaded = self.port.load_raw(register, value);
        assert_eq!(
            loaded.is_ok(),
            expected,
            "{register} := {value}: {loaded:?}"
        );
        if let Err(refused) = loaded {
            // Whatever is wrong is named, with its value, and what would be right.
            let text = refused.to_string();
            assert!(text.starts_with(&refused.register.to_string()), "{text}");
            if name != "START" || value != 1 {
                assert_eq!((refused.register, refused.value), (register, value));
            }
        } else {
            match name {
                "REGS" => self.regs[index] = value as u16,
                "COILS" => self.coils[index] = value != 0,
                "DISABLE_FLG" => self.flags[index] = value == 1,
                "START" => {
                    self.set("START", 1);
                    self.set("STATUS", 1);
                    self.set("ERROR", 0);
                }
                _ => self.set(register.name(), value),
            }
        }
        self.compare(register);
    }

    /// What the description says of this value.
    fn takes(&self, name: &str, index: usize, value: u32) -> bool {
        let dense_end = |len: usize, dense: bool| !dense || value + len as u32 <= 65_536;
        match name {
            "MODE" => match value {
                0 => self.get("FRAMING") != 2,
                1 => self.get("FRAMING") != 2 && self.get("SLAVEID") != 0,
                _ => value == 2 || value == 3,
            },
            "FRAMING" => match value {
                0 => self.get("FORMAT") < 4,
                1 => true,
                _ => value == 2 && self.get("MODE") >= 2,
            },
            "FORMAT" => value < if self.get("FRAMING") == 0 { 4 } else { 7 },
            "BASE" => {
                value < 65_536
                    && dense_end(self.shape.regs_len, self.shape.regs.is_none())
                    && dense_end(self.shape.coils_len, self.shape.coils.is_none())
            }
            "REGS" => index < self.shape.regs_len && value < 65_536,
            "COILS" => index < self.shape.coils_len && [0, 1, 255].contains(&value),
            "SLAVEID" => value < 248 && (value > 0 || self.get("MODE") != 1),
            "FUNC" => [1, 2, 3, 4, 5, 6, 15, 16, 23].contains(&value),
            "REGOFF" | "COILOFF" | "TURNAROUND" | "LATE_GUARD" | "REQUEST_GAP" => value < 65_536,
            "REGCNT" => (1..=if self.shape.scan { 65_535 } else { 125 }).contains(&value),
            "COILCNT" => (1..=2000).contains(&value),
            "TIMEOUT" | "CTS_TIMEOUT" => (1..65_536).contains(&value),
            "RETRIES" => value < 256,
            "DISABLE_FLG" => index < self.shape.rules[2] && value < 2,
            "BAUD" => (300..=10_000_000).contains(&value),
            "DUPLEX" | "FLOW" => value < 2,
            "INTER_CHARACTER" => value <= 50,
            "DE_LEAD" => value <= 10_000,
            "RESPONSE_DELAY" => value <= 1000,
            "START" => value == 1 && self.get("START") == 0 && self.describes(),
            _ => false,
        }
    }

    fn for_coils(&self) -> bool {
        [1, 2, 5, 15].contains(&self.get("FUNC"))
    }

    /// Whether START has something to start.
    fn describes(&self) -> bool {
        let (offset, count, len) = if self.for_coils() {
            (
                self.get("COILOFF"),
                self.get("COILCNT"),
                self.shape.coils_len,
            )
        } else {
            (self.get("REGOFF"), self.get("REGCNT"), self.shape.regs_len)
        };
        let most = match self.get("FUNC") {
            1 | 2 => 2000,
            3 | 4 => 125,
            15 => 1968,
            16 => 123,
            23 => 121,
            _ => 1,
        };
        let scans = self.shape.scan && !self.for_coils();
        let fits = if self.for_coils() && self.shape.coils.is_none() {
            count as usize <= len && self.get("BASE") + offset + count <= 65_536
        } else {
            (offset + count) as usize <= len
        };
        self.get("MODE") == 0 && (scans || count <= most) && fits
    }

    /// The requests that the registers describe.
    fn asked(&self) -> Vec<Asked> {
        let function = self.get("FUNC") as u8;
        let unit = self.get("SLAVEID") as u8;
        let base = self.get("BASE") as u16;
        let one = |unit, first, items| Asked {
            unit,
            function,
            first,
            items,
        };
        let (table, offset, count) = if self.for_coils() {
            (&self.shape.coils, self.get("COILOFF"), self.get("COILCNT"))
        } else {
            (&self.shape.regs, self.get("REGOFF"), self.get("REGCNT"))
        };
        let places = offset as usize..(offset + count) as usize;
        if self.shape.scan && !self.for_coils() {
            return places
                .map(|place| {
                    let item = usize::from(LIST.2[place]);
                    one(LIST.1[place], LIST.0[item], vec![item])
                })
                .collect();
        }
        let Some(table) = table else {
            let first = base + offset as u16;
            let items = match self.for_coils() {
                true => (0..count as usize).collect(),
                false => places.collect(),
            };
            return vec![one(unit, first, items)];
        };
        let mut asked: Vec<Asked> = Vec::new();
        for place in places {
            match asked.last_mut() {
                Some(last)
                    if u32::from(table[place])
                        == u32::from(last.first) + last.items.len() as u32 =>
                {
                    last.items.push(place);
                }
                _ => asked.push(one(unit, table[place], vec![place])),
            }
        }
        asked
    }

    fn compare(&self, register: Register) {
        let index = usize::from(register.index().unwrap_or(0));
        let expected = match register.name() {
            "REGS" => self.regs.get(index).map(|value| u32::from(*value)),
            "COILS" => self.coils.get(index).map(|on| u32::from(*on)),
            "DISABLE_FLG" => self.flags.get(index).map(|on| u32::from(*on)),
            list @ ("VALID_DATA" | "VALID_REG" | "DISABLE_REG") => {
                let spans: &[(u32, u32)] = match list {
                    "VALID_DATA" => &[(10, 15)],
                    "VALID_REG" => &[(0, 1000)],
                    _ => &[(10, 20), (109, 130), (191, 199)],
                };
                let spans = if self.flags.is_empty() { &[] } else { spans };
                spans.get(index).map(|(first, last)| first * 65_536 + last)
            }
            name => Some(self.get(name)),
        };
        assert_eq!(self.port.read(register).ok(), expected, "{register}");
    }

    fn compare_all(&self) {
        for number in 0..=u8::MAX {
            for index in [0, 1, 9, 10, 2004, 2005] {
                if let Some(register) = Register::from_number(number, index) {
                    self.compare(register);
                }
            }
        }
        let base = self.get("BASE") as u16;
        let at = |table: &Option<Vec<u16>>| table.as_ref().map_or(base, |table| table[0]);
        assert_eq!(self.port.regs().address_of(0), Some(at(&self.shape.regs)));
        assert_eq!(self.port.coils().address_of(0), Some(at(&self.shape.coils)));
        let indices = 0..=u16::MAX;
        assert!(
            indices
                .clone()
                .map_while(|index| self.port.regs().item(index))
                .eq(self.regs.iter().copied())
        );
        assert!(
            indices
                .map_while(|index| self.port.coils().item(index))
                .eq(self.coils.iter().copied())
        );
    }
}

/// A step as a client sends it.
struct Written<'a, R, C, V> {
    port: &'a PortRegisters<R, C, V>,
    step: &'a TransactionStep,
    value: Cell<u16>,
}

impl<R: Items<Item = u16>, C: Items<Item = bool>, V: Rules> Request for Written<'_, R, C, V> {
    fn encode(&self, draft: &mut Draft<'_>) -> Result<(), RequestError> {
        self.value.set(self.port.encode(self.step, draft)?);
        Ok(())
    }

    fn check(&self, frame: &[u8]) -> Result<(), AnswerError> {
        PortRegisters::<R, C, V>::check(self.step, self.value.get(), frame)
    }
}
