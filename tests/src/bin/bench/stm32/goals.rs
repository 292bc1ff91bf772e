//! What the STM32's figures have to reach, whatever they were before.

use multidrop_bus::Line;

use super::{BAUDS, COUNT, FOUR};
use crate::figures::Figures;
use crate::goals::Bound::{self, AtLeast, AtMost, Below};
use crate::goals::{Goal, of_images};
use crate::traffic::Shape;

/// The RAM of each port of `ports`.
const RAM: [&str; 3] = ["ram_as1_bytes", "ram_as2_bytes", "ram_rs2_bytes"];

/// The port with the router and four clients.
const RAM_RS4: &str = "ram_rs4_bytes";

/// All goals of the STM32.
pub fn of(figures: &Figures) -> Vec<Goal> {
    let one = |what: &str, unit, image: &str, names: &[String], bound| {
        let images = [image.to_owned()];
        of_images(figures, what, unit, (&images, names), bound)
    };
    let names = |names: &[&str]| -> Vec<String> { names.iter().map(|&name| name.into()).collect() };
    let ports = |what: &str, unit, name: &str, bound: Bound| {
        one(what, unit, "ports", &names(&[name]), bound)
    };
    let four =
        |what: &str, unit, name: &str, bound: Bound| one(what, unit, FOUR, &names(&[name]), bound);
    let mut goals = vec![
        ports("flash of ports", "bytes", "flash_bytes", AtMost(65_536.0)),
        one(
            "RAM of a fixed port",
            "bytes",
            "demo-unit",
            &names(&["ram_port_bytes"]),
            Below(1024.0),
        ),
        one(
            "RAM of each managed port with its arrays",
            "bytes",
            "ports",
            &names(&RAM),
            AtMost(1024.0),
        ),
        ports(
            "RAM of RS4, a router and four clients",
            "bytes",
            RAM_RS4,
            AtMost(1100.0),
        ),
    ];
    let shapes = Shape::measured(COUNT);
    let each = |before: &str, after: &str| -> Vec<String> {
        let named = |shape: &Shape| format!("{before}{}{after}", shape.name());
        shapes.iter().map(named).collect()
    };
    for baud in BAUDS {
        let line = Line::n81(baud);
        let image = format!("registers-{COUNT}@{baud}");
        let (bit, character) = (line.bits(1).us(), line.character().us());
        goals.extend(
            [
                (
                    "never before t3.5",
                    each("turnaround_", "_min_us"),
                    AtLeast(0.0),
                ),
                (
                    "turnaround beyond t3.5, a bit",
                    each("turnaround_", "_max_us"),
                    AtMost(bit),
                ),
                ("jitter", each("jitter_", "_us"), AtMost(20.0)),
                (
                    "gap between answer bytes",
                    names(&["answer_gap_max_us"]),
                    AtMost(0.0),
                ),
                (
                    "DE up before the first start bit",
                    names(&["de_lead_min_us"]),
                    AtLeast(0.0),
                ),
                (
                    "DE up before the first start bit, a character",
                    names(&["de_lead_max_us"]),
                    AtMost(character),
                ),
                (
                    "DE up until the last stop bit has ended",
                    names(&["de_lag_min_us"]),
                    AtLeast(0.0),
                ),
                (
                    "DE down after the last stop bit",
                    names(&["de_lag_max_us"]),
                    AtMost(10.0),
                ),
            ]
            .map(|(what, names, bound)| one(what, "us", &image, &names, bound)),
        );
    }
    let first = format!("registers-{COUNT}@{}", BAUDS[0]);
    let free = names(&["loss_free_baud"]);
    let read = names(&["own_03x16_max_instructions"]);
    let interrupt = figures.get("ports", "rs2_interrupt_max_instructions");
    goals.extend([
        one("loss-free", "baud", &first, &free, AtLeast(2_000_000.0)),
        one(
            "03x16 without what QEMU alone needs",
            "instructions",
            &first,
            &read,
            AtMost(2_500.0),
        )
        .only_aimed_at(),
        ports(
            "garbage on RS2 delays AS1's answer by no more than an interrupt of RS2",
            "instructions",
            "as1_delay_instructions",
            AtMost(interrupt.unwrap_or(0.0)),
        ),
        ports(
            "garbage lost on RS2",
            "characters",
            "rs2_overruns",
            AtMost(0.0),
        ),
    ]);
    // Where it is not kept of this compiler, `--check` has nothing to hold against it.
    if figures.images.contains_key(FOUR) {
        goals.extend([
            four(
                "four ports at once, bus time",
                "s",
                "span_s",
                AtLeast(600.0),
            ),
            four("four ports at once, lost", "answers", "lost", AtMost(0.0)),
            four("four ports at once, wrong", "answers", "wrong", AtMost(0.0)),
            four(
                "four ports at once, lost",
                "characters",
                "overruns",
                AtMost(0.0),
            ),
            four(
                "four ports at once, reconfigured",
                "times",
                "reconfigurations",
                AtLeast(595.0),
            ),
        ]);
    }
    goals
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::figures::Set;

    /// Figures that just reach every goal.
    fn reached() -> Figures {
        let set = |figures: &[(&str, f64)]| -> Set {
            let named = figures.iter();
            named
                .map(|&(name, value)| (name.to_owned(), value))
                .collect()
        };
        let mut figures = Figures::new("a compiler", 125_000_000);
        let mut insert = |image: &str, set: Set| figures.images.insert(image.to_owned(), set);
        insert("demo-unit", set(&[("ram_port_bytes", 1023.0)]));
        insert(
            "ports",
            set(&[
                ("flash_bytes", 65_536.0),
                ("ram_as1_bytes", 1023.0),
                ("ram_as2_bytes", 1023.0),
                ("ram_rs2_bytes", 1023.0),
                ("ram_rs4_bytes", 1023.0),
                ("rs2_interrupt_max_instructions", 120.0),
                ("as1_delay_instructions", 120.0),
                ("rs2_overruns", 0.0),
            ]),
        );
        insert(
            FOUR,
            set(&[
                ("span_s", 600.0),
                ("lost", 0.0),
                ("wrong", 0.0),
                ("overruns", 0.0),
                ("reconfigurations", 595.0),
            ]),
        );
        for (baud, bit) in BAUDS.into_iter().zip([26.04, 8.68]) {
            let mut line = set(&[
                ("answer_gap_max_us", 0.0),
                ("de_lead_min_us", 0.0),
                ("de_lead_max_us", 10.0 * bit),
                ("de_lag_min_us", 0.0),
                ("de_lag_max_us", 10.0),
                ("loss_free_baud", 2_000_000.0),
                ("own_03x16_max_instructions", 2_500.0),
            ]);
            for shape in Shape::measured(COUNT) {
                let name = shape.name();
                line.insert(format!("turnaround_{name}_min_us"), 0.0);
                line.insert(format!("turnaround_{name}_max_us"), bit);
                line.insert(format!("jitter_{name}_us"), 20.0);
            }
            insert(&format!("registers-{COUNT}@{baud}"), line);
        }
        figures
    }

    #[test]
    fn each_figure_past_its_bound_misses_its_goal_and_no_other() {
        let met = of(&reached());
        assert!(met.iter().all(Goal::is_met));
        for (image, name, value) in [
            ("demo-unit", "ram_port_bytes", 1024.0),
            ("ports", "flash_bytes", 65_537.0),
            ("ports", "ram_rs2_bytes", 1025.0),
            ("ports", "ram_rs4_bytes", 1101.0),
            ("ports", "as1_delay_instructions", 121.0),
            ("ports", "rs2_overruns", 1.0),
            (FOUR, "span_s", 599.0),
            (FOUR, "lost", 1.0),
            (FOUR, "wrong", 1.0),
            (FOUR, "overruns", 1.0),
            (FOUR, "reconfigurations", 594.0),
            ("registers-128@115200", "turnaround_10x123_max_us", 8.69),
            ("registers-128@115200", "turnaround_03x1_min_us", -0.001),
            ("registers-128@38400", "turnaround_03x16_max_us", 26.05),
            ("registers-128@38400", "jitter_06_us", 20.001),
            ("registers-128@38400", "answer_gap_max_us", 0.001),
            ("registers-128@38400", "de_lead_min_us", -0.001),
            ("registers-128@115200", "de_lead_max_us", 86.81),
            ("registers-128@38400", "de_lag_min_us", -0.001),
            ("registers-128@38400", "de_lag_max_us", 10.001),
            ("registers-128@38400", "loss_free_baud", 1_000_000.0),
            ("registers-128@38400", "own_03x16_max_instructions", 2_501.0),
        ] {
            let mut figures = reached();
            let set = figures.images.get_mut(image).expect("there");
            assert!(set.insert(name.to_owned(), value).is_some(), "{name}");
            let goals = of(&figures);
            let missed = goals.iter().filter(|goal| !goal.is_met());
            let promised: Vec<_> = missed.map(Goal::is_promised).collect();
            assert_eq!(promised, [!name.starts_with("own_")], "{name}");
        }
    }

    #[test]
    fn what_was_not_measured_is_not_reached() {
        let goals = of(&Figures::new("a compiler", 125_000_000));
        assert!(!goals.is_empty() && goals.iter().all(|goal| !goal.is_met()));
    }
}
