//! The figures as people read them: one row for each measure, one column for each image; and the Nano's rows.

use std::fmt::Write;

use crate::figures::Figures;
use crate::measure::{BAUDS, COUNTS, GUARDED};

/// A row: what it shows, in which unit, from which figures, and what to hold it against.
pub struct Row {
    title: &'static str,
    unit: &'static str,
    shown: Shown,
    goal: &'static str,
    peer: &'static str,
    /// Whether it is in the guide too.
    brief: bool,
}

/// The figures of a cell.
pub enum Shown {
    /// One figure of this name.
    One(&'static str),
    /// `NAME_min_UNIT` and `NAME_max_UNIT`, given as these two.
    Range(&'static str, &'static str),
    /// Smallest, middle, largest.
    Three([&'static str; 3]),
}

use Shown::{One, Range, Three};

/// A row without goal or peer, in the long table only.
pub const fn row(title: &'static str, unit: &'static str, shown: Shown) -> Row {
    Row {
        title,
        unit,
        shown,
        goal: "",
        peer: "",
        brief: false,
    }
}

impl Row {
    /// With a goal.
    pub const fn goal(mut self, goal: &'static str) -> Self {
        self.goal = goal;
        self
    }

    const fn peer(mut self, peer: &'static str) -> Self {
        self.peer = peer;
        self
    }

    /// In the guide too.
    pub const fn brief(mut self) -> Self {
        self.brief = true;
        self
    }
}

/// What DE and the bytes of an answer keep to, on each board alike.
pub const DE_LEAD: Row = turnaround(
    "DE up before the first start bit",
    "de_lead_min_us",
    "de_lead_max_us",
)
.goal("<= 1 character")
.brief();
/// What DE keeps to after the last byte of an answer.
pub const DE_LAG: Row = turnaround(
    "DE down after the last stop bit",
    "de_lag_min_us",
    "de_lag_max_us",
)
.goal("0..=10")
.brief();
/// What the bytes of an answer keep to.
pub const ANSWER_GAP: Row = row(
    "longest gap between answer bytes",
    "us",
    One("answer_gap_max_us"),
)
.goal("0")
.brief();

/// Every row. The peers are Modbus slaves in C and C++ for the same chip, whole images with 16 registers,
/// measured on a model of the same kind; the best of them for each row, which is never the same one.
const ROWS: &[Row] = &[
    row("flash", "bytes", One("flash_bytes"))
        .goal("conformance <= 16384")
        .peer("2218")
        .brief(),
    row("static RAM", "bytes", One("static_ram_bytes"))
        .goal("conformance <= 1300")
        .peer("336")
        .brief(),
    row("flash of the guards", "bytes", One("guards_flash_bytes"))
        .goal("<= 500")
        .brief(),
    row("static RAM of the guards", "bytes", One("guards_ram_bytes"))
        .goal("<= 24")
        .brief(),
    row("peak stack", "bytes", One("stack_peak_bytes"))
        .goal("<= 300, conformance 400")
        .peer("33")
        .brief(),
    turnaround(
        "turnaround beyond t3.5, 03x1",
        "turnaround_03x1_min_us",
        "turnaround_03x1_max_us",
    )
    .goal("0..=120")
    .peer("43")
    .brief(),
    turnaround(
        "turnaround beyond t3.5, 03x16",
        "turnaround_03x16_min_us",
        "turnaround_03x16_max_us",
    )
    .goal(">= 0")
    .peer("106")
    .brief(),
    turnaround(
        "turnaround beyond t3.5, 06",
        "turnaround_06_min_us",
        "turnaround_06_max_us",
    )
    .goal("0..=120")
    .peer("44")
    .brief(),
    turnaround(
        "turnaround beyond t3.5, 10x16",
        "turnaround_10x16_min_us",
        "turnaround_10x16_max_us",
    )
    .goal(">= 0")
    .peer("114")
    .brief(),
    turnaround(
        "turnaround beyond t3.5, 03x125",
        "turnaround_03x125_min_us",
        "turnaround_03x125_max_us",
    )
    .goal("0..=560")
    .peer("563")
    .brief(),
    turnaround(
        "turnaround beyond t3.5, 10x123",
        "turnaround_10x123_min_us",
        "turnaround_10x123_max_us",
    )
    .goal("0..=560")
    .peer("555")
    .brief(),
    jitter("jitter, 03x1", "jitter_03x1_us").brief(),
    jitter("jitter, 03x16", "jitter_03x16_us"),
    jitter("jitter, 06", "jitter_06_us"),
    jitter("jitter, 10x16", "jitter_10x16_us"),
    jitter("jitter, 03x125", "jitter_03x125_us"),
    jitter("jitter, 10x123", "jitter_10x123_us"),
    turnaround(
        "03x1, transmitter's divider restarts",
        "tx_baud_tick_turnaround_03x1_min_us",
        "tx_baud_tick_turnaround_03x1_max_us",
    )
    .goal("0..=120"),
    turnaround(
        "03x1, transmitter's divider runs free",
        "tx_bit_clock_turnaround_03x1_min_us",
        "tx_bit_clock_turnaround_03x1_max_us",
    )
    .goal("0..=120")
    .brief(),
    DE_LEAD,
    DE_LAG,
    ANSWER_GAP,
    row(
        "receive interrupt, min/median/max",
        "cycles",
        Three([
            "rx_interrupt_min_cycles",
            "rx_interrupt_median_cycles",
            "rx_interrupt_max_cycles",
        ]),
    )
    .peer("65")
    .brief(),
    row(
        "transmit interrupt, min/median/max",
        "cycles",
        Three([
            "tx_interrupt_min_cycles",
            "tx_interrupt_median_cycles",
            "tx_interrupt_max_cycles",
        ]),
    ),
    row(
        "silence interrupt, min/median/max",
        "cycles",
        Three([
            "silence_interrupt_min_cycles",
            "silence_interrupt_median_cycles",
            "silence_interrupt_max_cycles",
        ]),
    ),
    row(
        "awake for an exchange of 03x1",
        "cycles",
        Range("active_03x1_min_cycles", "active_03x1_max_cycles"),
    )
    .peer("3826")
    .brief(),
    row(
        "awake for an exchange of 03x16",
        "cycles",
        Range("active_03x16_min_cycles", "active_03x16_max_cycles"),
    ),
    row("asleep, bus idle", "%", One("asleep_idle_percent"))
        .goal("> 99")
        .peer("none sleeps"),
    row(
        "asleep, 03x1 every 100 ms",
        "%",
        One("asleep_polled_percent"),
    )
    .peer("none sleeps")
    .brief(),
    row(
        "longest gap accepted in a frame",
        "us",
        One("gap_accepted_max_us"),
    )
    .brief(),
    row("the same", "t1.5", One("gap_accepted_max_t15")),
    row(
        "shortest gap that drops a frame",
        "us",
        One("gap_dropped_min_us"),
    ),
    row("the same", "t1.5", One("gap_dropped_min_t15")),
    row("loss-free up to", "baud", One("loss_free_baud"))
        .goal(">= 500000")
        .peer("1000000")
        .brief(),
    row(
        "the same while tasks wait for edges on port D",
        "baud",
        One("loss_free_with_edges_baud"),
    )
    .goal(">= 115200")
    .brief(),
    row(
        "node's clock fast: loss from",
        "ppm",
        One("clock_fast_loss_from_ppm"),
    )
    .brief(),
    row(
        "node's clock slow: loss from",
        "ppm",
        One("clock_slow_loss_from_ppm"),
    )
    .brief(),
    turnaround(
        "client: from answer to request beyond t3.5",
        "request_gap_min_us",
        "request_gap_max_us",
    )
    .goal("0..=52")
    .brief(),
];

/// A row of the smallest and the largest in microseconds.
pub const fn turnaround(title: &'static str, min: &'static str, max: &'static str) -> Row {
    row(title, "us", Range(min, max))
}

const fn jitter(title: &'static str, name: &'static str) -> Row {
    row(title, "us", One(name)).goal("<= 20")
}

/// A table of one board.
pub struct Table {
    rows: &'static [Row],
    /// What it has columns of.
    images: Vec<String>,
    /// What it was measured on.
    head: &'static str,
    has_peers: bool,
}

/// The Nano's table.
pub fn nano() -> Table {
    let registers = COUNTS
        .iter()
        .flat_map(|count| BAUDS.map(|baud| format!("registers-{count}@{baud}")));
    let images = ["demo-unit".to_owned()].into_iter().chain(registers);
    let others = [GUARDED, "conformance", "client-functions"].map(str::to_owned);
    Table {
        has_peers: true,
        ..Table::new(
            ROWS,
            images.chain(others).collect(),
            "registers-COUNT@BAUD: the image `registers` with COUNT items in each table at BAUD 8N1,\n\
             the others are at 38400 8N1.\n\
             ATmega328P at 16 MHz on the simulated bus; t3.5 is 1750 us.",
        )
    }
}

impl Table {
    /// A table without peers.
    pub fn new(rows: &'static [Row], images: Vec<String>, head: &'static str) -> Self {
        Table {
            rows,
            images,
            head,
            has_peers: false,
        }
    }

    /// All of it.
    pub fn of(&self, figures: &Figures) -> String {
        let cells = self.lines(figures, |_| true);
        let (head, compiler) = (self.head, &figures.compiler);
        format!("{head}\nCompiler: {compiler}\n\n{}", aligned(&cells))
    }

    /// For the guide: a part of the rows.
    pub fn brief(&self, figures: &Figures) -> String {
        let mut text = String::new();
        for (index, line) in self.lines(figures, |row| row.brief).iter().enumerate() {
            text.push_str(&format!("| {} |\n", line.join(" | ")));
            if index == 0 {
                text.push_str(&format!("|---|---|{}\n", "--:|".repeat(line.len() - 2)));
            }
        }
        format!("{text}\nCompiler: {}\n", figures.compiler)
    }

    /// The cells, heading first: title, unit, images, goal, best peer.
    fn lines(&self, figures: &Figures, wanted: fn(&Row) -> bool) -> Vec<Vec<String>> {
        let peer = |peer: &str| self.has_peers.then(|| peer.to_owned());
        let mut heading = vec![String::new(), "unit".to_owned()];
        heading.extend_from_slice(&self.images);
        heading.push("goal".to_owned());
        heading.extend(peer("best peer"));
        let mut lines = vec![heading];
        for row in self.rows.iter().filter(|row| wanted(row)) {
            let mut line = vec![row.title.to_owned(), row.unit.to_owned()];
            let images = self.images.iter();
            line.extend(images.map(|image| cell(figures, image, &row.shown)));
            line.push(row.goal.to_owned());
            line.extend(peer(row.peer));
            lines.push(line);
        }
        lines
    }
}

fn cell(figures: &Figures, image: &str, shown: &Shown) -> String {
    let one = |name: &str| figures.get(image, name).map(|value| value.to_string());
    let text = match shown {
        One(name) => one(name),
        Range(min, max) if one(min) == one(max) => one(min),
        Range(min, max) => (|| Some(format!("{}..{}", one(min)?, one(max)?)))(),
        Three([min, middle, max]) => {
            (|| Some(format!("{}/{}/{}", one(min)?, one(middle)?, one(max)?)))()
        }
    };
    text.unwrap_or_else(|| "-".to_owned())
}

/// Names to the left, figures to the right.
fn aligned(cells: &[Vec<String>]) -> String {
    let columns = cells.first().map_or(0, Vec::len);
    let width = |column: usize| {
        cells
            .iter()
            .map(|line| line[column].len())
            .max()
            .unwrap_or(0)
    };
    let widths: Vec<usize> = (0..columns).map(width).collect();
    let mut text = String::new();
    for line in cells {
        let mut shown = String::new();
        for (column, (cell, &width)) in line.iter().zip(&widths).enumerate() {
            // Writing to a string cannot fail.
            let _ = match column {
                0 | 1 => write!(shown, "{cell:<width$}  "),
                _ => write!(shown, "{cell:>width$}  "),
            };
        }
        text.push_str(shown.trim_end());
        text.push('\n');
    }
    text
}
