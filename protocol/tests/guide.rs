//! The table of the port registers in the guide: numbers, defaults and ranges are those of the code.

use std::collections::BTreeMap;
use std::fs;
use std::path::Path;

use multidrop_protocol::port_registers::{PortRegisters, PortSettings, Register};
use multidrop_protocol::registers::{Bank, CoilBank, NoRules};

/// A row: number, range, default, what it does.
type Row = [String; 4];

/// The rows by the names of their registers.
fn table() -> BTreeMap<String, Row> {
    // Where it is now: a copied checkout may have been compiled elsewhere.
    let here = std::env::var("CARGO_MANIFEST_DIR").expect("cargo runs the test");
    let chapter = Path::new(&here).join("../docs/src/managed-ports.md");
    let text = fs::read_to_string(chapter).expect("the chapter");
    let (_, text) = text.split_once("## The registers").expect("the section");
    let mut rows = BTreeMap::new();
    for line in text.lines().filter(|line| line.starts_with("| ")) {
        let cells: Vec<&str> = line.split('|').map(str::trim).collect();
        let [_, name, number, range, default, does, ..] = cells[..] else {
            panic!("{line}");
        };
        if name != "register" {
            let row = [number, range, default, &without_links(does)].map(str::to_owned);
            let name = name.to_owned();
            assert_eq!(rows.insert(name, row), None, "{line}");
        }
    }
    rows
}

/// Text in place of `[text](target)`.
fn without_links(cell: &str) -> String {
    let Some((before, link)) = cell.split_once('[') else {
        return cell.to_owned();
    };
    let (text, rest) = link.split_once("](").expect("a link");
    let (_, after) = rest.split_once(')').expect("its end");
    format!("{before}{text}{}", without_links(after))
}

macro_rules! comments {
    ($($group:ident { $($section:ident { $(
        $(#[doc = $doc:literal])*
        $number:literal $NAME:ident $register:ident $([$index:ident: $index_type:ident])? $(: $type:ident)?
            $(in $low:literal ..= $high:literal)? $(of $choices:literal)? $(=> $field:ident = $default:expr)?;
    )* })* })*) => {
        /// Number and comment of each register, line by line, as they are declared.
        const COMMENTS: [(u8, &[&str]); Register::COUNT as usize] = [
            $($($( ($number, &[$($doc),*]), )*)*)*
        ];
    };
}

multidrop_protocol::port_registers!(comments);

/// The name as the table has it: an array is `REGS.n`.
fn name_in_table(register: Register) -> String {
    let index = register.index().map_or("", |_| ".n");
    format!("{}{index}", register.name())
}

fn registers() -> impl Iterator<Item = Register> {
    (0..Register::COUNT).map(|number| Register::from_number(number, 0).expect("a register"))
}

fn port() -> PortRegisters<Bank<1>, CoilBank<1>, NoRules> {
    PortRegisters::new(PortSettings::DEFAULT, Bank::new(0), CoilBank::new(0, 1))
}

fn row(table: &BTreeMap<String, Row>, register: Register) -> &Row {
    let name = name_in_table(register);
    let number = register.number();
    table
        .get(&name)
        .unwrap_or_else(|| panic!("managed-ports.md has no row for {name}, number {number}"))
}

#[test]
fn the_table_of_the_guide_has_each_register_with_its_number_and_its_default() {
    let table = table();
    for register in registers() {
        let [number, _, default, _] = row(&table, register);
        assert_eq!(*number, register.number().to_string(), "{register}");
        // Without rules there is no element to read.
        let value = port().read(register).map(|value| value.to_string());
        assert_eq!(*default, value.unwrap_or("-".to_owned()), "{register}");
    }
    assert_eq!(table.len(), usize::from(Register::COUNT));
}

#[test]
fn the_ranges_in_the_guide_are_those_of_the_registers() {
    let table = table();
    let mut ranges = 0;
    for register in registers() {
        let [_, range, ..] = row(&table, register);
        let takes = |value| {
            let mut port = port();
            // What stands in the way of some of the values.
            match register {
                Register::Format => port.load_raw(Register::Framing, 1).map(drop),
                Register::Framing => port.load_raw(Register::Mode, 3).map(drop),
                _ => Ok(()),
            }
            .expect("taken");
            port.load_raw(register, value).map(drop).map_err(|_| value)
        };
        if range == "R" {
            assert_eq!(takes(0), Err(0), "{register}");
            continue;
        }
        let Some((low, high)) = range.split_once("..=") else {
            continue;
        };
        let [low, high] = [low, high].map(|end| end.parse::<u32>().expect("a number"));
        ranges += 1;
        assert_eq!((takes(low), takes(high)), (Ok(()), Ok(())), "{register}");
        assert_eq!(takes(high + 1), Err(high + 1), "{register}");
        if let Some(below) = low.checked_sub(1) {
            assert_eq!(takes(below), Err(below), "{register}");
        }
    }
    assert_eq!(ranges, 20);
}

#[test]
fn the_table_of_the_guide_says_what_the_declaration_says() {
    let table = table();
    for (number, comment) in COMMENTS {
        let register = Register::from_number(number, 0).expect("a register");
        let paragraph: Vec<&str> = comment
            .iter()
            .map(|line| line.trim())
            .take_while(|line| !line.is_empty())
            .collect();
        let declared = paragraph.join(" ");
        let [.., does] = row(&table, register);
        // The guide's cells begin in lower case and have no full stop.
        let cell = declared.trim_end_matches('.').to_lowercase();
        assert_eq!(
            does.to_lowercase(),
            cell,
            "{register}, declared as: {declared}"
        );
    }
}
