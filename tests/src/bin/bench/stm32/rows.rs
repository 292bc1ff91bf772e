//! The STM32's table.

use super::{BAUDS, COUNT, FOUR};
use crate::table::Shown::{One, Range, Three};
use crate::table::{ANSWER_GAP, DE_LAG, DE_LEAD, Row, Table, row, turnaround};

/// The table of the STM32.
pub fn table() -> Table {
    let flashed = ["demo-unit", "registers", "conformance", "ports"].map(str::to_owned);
    let run = BAUDS.map(|baud| format!("registers-{COUNT}@{baud}"));
    let images = flashed.into_iter().chain(run).chain([FOUR.to_owned()]);
    Table::new(
        ROWS,
        images.collect(),
        "Flash and RAM are of the images that are flashed, four ports of such a one on a modelled chip; all else was measured in QEMU, 8 ns an \
         instruction.\n\
         registers-COUNT@BAUD: the image `registers` with COUNT items in each table at BAUD 8N1 on RS4.\n\
         four ports: the image `ports` with all of them loaded, one of which is reconfigured each second.",
    )
}

const fn work(title: &'static str, min: &'static str, max: &'static str) -> Row {
    row(title, "instructions", Range(min, max))
}

const fn count(title: &'static str, name: &'static str) -> Row {
    row(title, "", One(name))
}

/// What is shown of each image, or of those that have it.
const ROWS: &[Row] = &[
    row("flash", "bytes", One("flash_bytes"))
        .goal("ports <= 65536")
        .brief(),
    row("static RAM", "bytes", One("static_ram_bytes")).brief(),
    row("RAM of a fixed port", "bytes", One("ram_port_bytes"))
        .goal("< 1024")
        .brief(),
    row(
        "RAM of a managed port: RS2, 1 register",
        "bytes",
        One("ram_rs2_bytes"),
    )
    .goal("<= 1024")
    .brief(),
    row(
        "RAM of AS1, 1 register and a data model",
        "bytes",
        One("ram_as1_bytes"),
    )
    .goal("<= 1024")
    .brief(),
    row(
        "RAM of AS2, 16 registers, 16 coils",
        "bytes",
        One("ram_as2_bytes"),
    )
    .goal("<= 1024")
    .brief(),
    row(
        "RAM of RS4, 16 registers, 4 clients",
        "bytes",
        One("ram_rs4_bytes"),
    )
    .goal("<= 1100")
    .brief(),
    work(
        "work, 03x1",
        "work_03x1_min_instructions",
        "work_03x1_max_instructions",
    )
    .brief(),
    work(
        "work, 03x16",
        "work_03x16_min_instructions",
        "work_03x16_max_instructions",
    )
    .brief(),
    work(
        "work, 10x16",
        "work_10x16_min_instructions",
        "work_10x16_max_instructions",
    )
    .brief(),
    work(
        "work, 03x125",
        "work_03x125_min_instructions",
        "work_03x125_max_instructions",
    )
    .brief(),
    work(
        "work but for QEMU's alarms, 03x1",
        "own_03x1_min_instructions",
        "own_03x1_max_instructions",
    )
    .brief(),
    work(
        "work but for QEMU's alarms, 03x16",
        "own_03x16_min_instructions",
        "own_03x16_max_instructions",
    )
    .goal("aim: registers <= 2500")
    .brief(),
    work(
        "work but for QEMU's alarms, 10x16",
        "own_10x16_min_instructions",
        "own_10x16_max_instructions",
    )
    .brief(),
    work(
        "work but for QEMU's alarms, 03x125",
        "own_03x125_min_instructions",
        "own_03x125_max_instructions",
    )
    .brief(),
    work(
        "QEMU's alarms, 03x1",
        "emulation_03x1_min_instructions",
        "emulation_03x1_max_instructions",
    ),
    work(
        "QEMU's alarms, 03x16",
        "emulation_03x16_min_instructions",
        "emulation_03x16_max_instructions",
    ),
    work(
        "QEMU's alarms, 10x16",
        "emulation_10x16_min_instructions",
        "emulation_10x16_max_instructions",
    ),
    work(
        "QEMU's alarms, 03x125",
        "emulation_03x125_min_instructions",
        "emulation_03x125_max_instructions",
    ),
    turnaround(
        "turnaround beyond t3.5, 03x1",
        "turnaround_03x1_min_us",
        "turnaround_03x1_max_us",
    )
    .goal("0..=1 bit")
    .brief(),
    turnaround(
        "turnaround beyond t3.5, 03x16",
        "turnaround_03x16_min_us",
        "turnaround_03x16_max_us",
    )
    .goal("0..=1 bit")
    .brief(),
    turnaround(
        "turnaround beyond t3.5, 06",
        "turnaround_06_min_us",
        "turnaround_06_max_us",
    )
    .goal("0..=1 bit"),
    turnaround(
        "turnaround beyond t3.5, 10x16",
        "turnaround_10x16_min_us",
        "turnaround_10x16_max_us",
    )
    .goal("0..=1 bit"),
    turnaround(
        "turnaround beyond t3.5, 03x125",
        "turnaround_03x125_min_us",
        "turnaround_03x125_max_us",
    )
    .goal("0..=1 bit"),
    turnaround(
        "turnaround beyond t3.5, 10x123",
        "turnaround_10x123_min_us",
        "turnaround_10x123_max_us",
    )
    .goal("0..=1 bit")
    .brief(),
    row("jitter, 03x1", "us", One("jitter_03x1_us"))
        .goal("<= 20")
        .brief(),
    row("jitter, 03x16", "us", One("jitter_03x16_us")).goal("<= 20"),
    row("jitter, 06", "us", One("jitter_06_us")).goal("<= 20"),
    row("jitter, 10x16", "us", One("jitter_10x16_us")).goal("<= 20"),
    row("jitter, 03x125", "us", One("jitter_03x125_us")).goal("<= 20"),
    row("jitter, 10x123", "us", One("jitter_10x123_us")).goal("<= 20"),
    DE_LEAD,
    DE_LAG,
    ANSWER_GAP,
    row("loss-free up to", "baud", One("loss_free_baud"))
        .goal(">= 2000000")
        .brief(),
    row(
        "interrupt of a character, min/median/max",
        "instructions",
        Three([
            "character_interrupt_min_instructions",
            "character_interrupt_median_instructions",
            "character_interrupt_max_instructions",
        ]),
    )
    .brief(),
    row(
        "interrupt of an alarm, min/median/max",
        "instructions",
        Three([
            "alarm_interrupt_min_instructions",
            "alarm_interrupt_median_instructions",
            "alarm_interrupt_max_instructions",
        ]),
    ),
    work(
        "AS1's answer beyond t3.5",
        "as1_quiet_min_instructions",
        "as1_quiet_max_instructions",
    )
    .brief(),
    work(
        "the same, garbage on RS2 at 2 Mbaud",
        "as1_garbage_min_instructions",
        "as1_garbage_max_instructions",
    )
    .brief(),
    row(
        "RS2's interrupt, min/median/max",
        "instructions",
        Three([
            "rs2_interrupt_min_instructions",
            "rs2_interrupt_median_instructions",
            "rs2_interrupt_max_instructions",
        ]),
    )
    .brief(),
    row("bus time", "s", One("span_s")).goal(">= 600").brief(),
    count("answers, AS1", "answers_as1").brief(),
    count("answers, AS2", "answers_as2").brief(),
    count("answers that RS4 got", "answers_rs4").brief(),
    count("lines that RS2 printed", "answers_rs2").brief(),
    count("lost", "lost").goal("0").brief(),
    count("wrong", "wrong").goal("0").brief(),
    count("characters lost", "overruns").goal("0"),
    count("reconfigurations", "reconfigurations")
        .goal(">= 595")
        .brief(),
    count("reconfigurations of AS1", "reconfigurations_as1"),
    count("reconfigurations of AS2", "reconfigurations_as2"),
    count("reconfigurations of RS2", "reconfigurations_rs2"),
    count("reconfigurations of RS4", "reconfigurations_rs4"),
    row(
        "longest turnaround, AS1",
        "us",
        One("turnaround_as1_max_us"),
    )
    .brief(),
    row(
        "longest turnaround, AS2",
        "us",
        One("turnaround_as2_max_us"),
    )
    .brief(),
    row(
        "longest turnaround, AS1, routed",
        "us",
        One("routed_as1_max_us"),
    ),
    row(
        "longest turnaround, AS2, routed",
        "us",
        One("routed_as2_max_us"),
    ),
];
