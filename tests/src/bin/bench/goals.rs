//! What the figures have to reach, whatever they were before.

use std::fmt;

use multidrop_bus::Line;

use crate::figures::Figures;
use crate::measure::{BAUDS, COUNTS, GUARDED};
use crate::traffic::Shape;

/// A goal, held against the worst of the images it is for.
pub struct Goal {
    what: String,
    unit: &'static str,
    /// The worst figure and where it was measured; nothing where there is none, which misses the goal.
    worst: Option<(f64, String)>,
    bound: Bound,
    /// What is aimed at and not promised yet: shown, and no check.
    is_aim: bool,
}

/// What a figure may be.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Bound {
    AtMost(f64),
    Below(f64),
    AtLeast(f64),
    Above(f64),
}

impl Bound {
    fn holds(self, value: f64) -> bool {
        match self {
            Bound::AtMost(limit) => value <= limit,
            Bound::Below(limit) => value < limit,
            Bound::AtLeast(limit) => value >= limit,
            Bound::Above(limit) => value > limit,
        }
    }

    /// Whether `a` is further from the goal than `b`.
    fn is_worse(self, a: f64, b: f64) -> bool {
        match self {
            Bound::AtMost(_) | Bound::Below(_) => a > b,
            Bound::AtLeast(_) | Bound::Above(_) => a < b,
        }
    }
}

impl Goal {
    /// Whether it is reached.
    pub fn is_met(&self) -> bool {
        matches!(self.worst, Some((value, _)) if self.bound.holds(value))
    }

    /// Makes it a goal that is only aimed at: missing it does not fail.
    pub fn only_aimed_at(mut self) -> Self {
        self.is_aim = true;
        self
    }

    /// Whether it is to be checked that it is reached.
    pub fn is_promised(&self) -> bool {
        !self.is_aim
    }
}

impl fmt::Display for Goal {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let verdict = match (self.is_met(), self.is_aim) {
            (true, _) => "ok    ",
            (false, false) => "MISSED",
            (false, true) => "aim   ",
        };
        let bound = match self.bound {
            Bound::AtMost(limit) => format!("at most {limit}"),
            Bound::Below(limit) => format!("below {limit}"),
            Bound::AtLeast(limit) => format!("at least {limit}"),
            Bound::Above(limit) => format!("above {limit}"),
        };
        write!(f, "  {verdict}  {}: {bound} {}, ", self.what, self.unit)?;
        match &self.worst {
            Some((value, image)) => write!(f, "is {value} ({image})"),
            None => write!(f, "was not measured"),
        }
    }
}

/// The worst of the figures `names` over all images of `registers` at `bauds`.
fn goal(
    figures: &Figures,
    what: impl Into<String>,
    unit: &'static str,
    (bauds, names): (&[u32], &[String]),
    bound: Bound,
) -> Goal {
    let named = |count: u8| {
        let name = move |baud: &u32| format!("registers-{count}@{baud}");
        bauds.iter().map(name)
    };
    let images: Vec<_> = COUNTS.into_iter().flat_map(named).collect();
    of_images(figures, what, unit, (&images, names), bound)
}

/// The worst of the figures `names` over `images`.
pub fn of_images(
    figures: &Figures,
    what: impl Into<String>,
    unit: &'static str,
    (images, names): (&[String], &[String]),
    bound: Bound,
) -> Goal {
    let mut worst: Option<(f64, String)> = None;
    for image in images {
        for value in names.iter().filter_map(|name| figures.get(image, name)) {
            let is_worse = |(held, _): &(f64, String)| bound.is_worse(value, *held);
            if worst.as_ref().is_none_or(is_worse) {
                worst = Some((value, image.clone()));
            }
        }
    }
    Goal {
        what: what.into(),
        unit,
        worst,
        bound,
        is_aim: false,
    }
}

/// All goals of the Nano.
pub fn of(figures: &Figures) -> Vec<Goal> {
    use Bound::{Above, AtLeast, AtMost};
    // Those of the smaller images are among those of the larger.
    let shapes = Shape::measured(128);
    let each = |before: &str, after: &str| -> Vec<String> {
        let named = |shape: &Shape| format!("{before}{}{after}", shape.name());
        shapes.iter().map(named).collect()
    };
    let names = |names: &[&str]| -> Vec<String> { names.iter().map(|&name| name.into()).collect() };
    let mut earliest = each("turnaround_", "_min_us");
    earliest.push("tx_bit_clock_turnaround_03x1_min_us".to_owned());
    let one = |what: &str, unit, name: &str, bound| {
        goal(figures, what, unit, (&BAUDS, &names(&[name])), bound)
    };

    let mut goals = vec![
        goal(
            figures,
            "turnaround beyond t3.5 for 03x1 and 06",
            "us",
            (
                &BAUDS,
                &names(&["turnaround_03x1_max_us", "turnaround_06_max_us"]),
            ),
            AtMost(120.0),
        ),
        one(
            "the same for 03x1 with a bit clock that runs free",
            "us",
            "tx_bit_clock_turnaround_03x1_max_us",
            AtMost(120.0),
        ),
        goal(
            figures,
            "turnaround beyond t3.5 for the longest frames",
            "us",
            (&BAUDS, &each("turnaround_", "_max_us")),
            AtMost(560.0),
        ),
        goal(
            figures,
            "never before t3.5",
            "us",
            (&BAUDS, &earliest),
            AtLeast(0.0),
        ),
        goal(
            figures,
            "jitter",
            "us",
            (&BAUDS, &each("jitter_", "_us")),
            AtMost(20.0),
        ),
        one(
            "gap between answer bytes",
            "us",
            "answer_gap_max_us",
            AtMost(0.0),
        ),
        one(
            "DE up before the first start bit",
            "us",
            "de_lead_min_us",
            AtLeast(0.0),
        ),
    ];
    for baud in BAUDS {
        goals.push(goal(
            figures,
            format!("DE up before the first start bit, a character at {baud}"),
            "us",
            (&[baud], &names(&["de_lead_max_us"])),
            AtMost(Line::n81(baud).character().us()),
        ));
    }
    goals.extend([
        one(
            "DE up until the last stop bit has ended",
            "us",
            "de_lag_min_us",
            AtLeast(0.0),
        ),
        one(
            "DE down after the last stop bit",
            "us",
            "de_lag_max_us",
            AtMost(10.0),
        ),
        one("peak stack", "bytes", "stack_peak_bytes", AtMost(300.0)),
        one("loss-free", "baud", "loss_free_baud", AtLeast(500_000.0)),
        one(
            "loss-free while tasks wait for edges on port D",
            "baud",
            "loss_free_with_edges_baud",
            AtLeast(115_200.0),
        ),
        one("asleep when idle", "%", "asleep_idle_percent", Above(99.0)),
    ]);
    let two_bits = Line::n81(38_400).bits(2).us();
    goals.extend(
        [
            (
                "guards: flash",
                "bytes",
                GUARDED,
                "guards_flash_bytes",
                AtMost(500.0),
            ),
            (
                "guards: static RAM",
                "bytes",
                GUARDED,
                "guards_ram_bytes",
                AtMost(24.0),
            ),
            (
                "every function: flash",
                "bytes",
                "conformance",
                "flash_bytes",
                AtMost(16_384.0),
            ),
            (
                "every function: static RAM",
                "bytes",
                "conformance",
                "static_ram_bytes",
                AtMost(1_300.0),
            ),
            (
                "every function: peak stack",
                "bytes",
                "conformance",
                "stack_peak_bytes",
                AtMost(400.0),
            ),
            (
                "client: from answer to request beyond t3.5",
                "us",
                "client-functions",
                "request_gap_max_us",
                AtMost(two_bits),
            ),
            (
                "client: never before t3.5",
                "us",
                "client-functions",
                "request_gap_min_us",
                AtLeast(0.0),
            ),
        ]
        .map(|(what, unit, image, name, bound)| {
            let images = [image.to_owned()];
            of_images(figures, what, unit, (&images, &names(&[name])), bound)
        }),
    );
    goals
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::figures::Set;

    /// Figures that just reach every goal, and the same for each image.
    fn reached() -> Figures {
        let mut set = Set::from([
            ("tx_bit_clock_turnaround_03x1_min_us".to_owned(), 0.0),
            ("tx_bit_clock_turnaround_03x1_max_us".to_owned(), 120.0),
            ("answer_gap_max_us".to_owned(), 0.0),
            ("de_lead_min_us".to_owned(), 0.0),
            ("de_lead_max_us".to_owned(), 86.8),
            ("de_lag_min_us".to_owned(), 0.0),
            ("de_lag_max_us".to_owned(), 10.0),
            ("stack_peak_bytes".to_owned(), 300.0),
            ("loss_free_baud".to_owned(), 500_000.0),
            ("loss_free_with_edges_baud".to_owned(), 115_200.0),
            ("asleep_idle_percent".to_owned(), 99.001),
        ]);
        for shape in Shape::measured(128) {
            let name = shape.name();
            let short = ["03x1", "06"].contains(&name.as_str());
            let latest = if short { 120.0 } else { 560.0 };
            set.insert(format!("turnaround_{name}_min_us"), 0.0);
            set.insert(format!("turnaround_{name}_max_us"), latest);
            set.insert(format!("jitter_{name}_us"), 20.0);
        }
        let mut figures = Figures::new("a compiler", 16_000_000);
        for count in COUNTS {
            for baud in BAUDS {
                let image = format!("registers-{count}@{baud}");
                figures.images.insert(image, set.clone());
            }
        }
        for (image, set) in [
            (
                "conformance",
                [
                    ("flash_bytes", 16_384.0),
                    ("static_ram_bytes", 1_300.0),
                    ("stack_peak_bytes", 400.0),
                ],
            ),
            (
                "client-functions",
                [
                    ("flash_bytes", 0.0),
                    ("request_gap_min_us", 0.0),
                    ("request_gap_max_us", 52.08),
                ],
            ),
        ] {
            let set = set.map(|(name, value)| (name.to_owned(), value));
            figures.images.insert(image.to_owned(), Set::from(set));
        }
        let guards = [("guards_flash_bytes", 500.0), ("guards_ram_bytes", 24.0)];
        let guards = guards.map(|(name, value)| (name.to_owned(), value));
        figures.images.insert(GUARDED.to_owned(), Set::from(guards));
        figures
    }

    #[test]
    fn the_images_with_every_function_have_goals_of_their_own() {
        for (image, name, value, what) in [
            (
                "conformance",
                "flash_bytes",
                16_385.0,
                "every function: flash",
            ),
            (
                "conformance",
                "static_ram_bytes",
                1_301.0,
                "every function: static RAM",
            ),
            (
                "conformance",
                "stack_peak_bytes",
                401.0,
                "every function: peak stack",
            ),
            (GUARDED, "guards_flash_bytes", 501.0, "guards: flash"),
            (GUARDED, "guards_ram_bytes", 25.0, "guards: static RAM"),
            (
                "client-functions",
                "request_gap_max_us",
                52.09,
                "client: from answer to request beyond t3.5",
            ),
            (
                "client-functions",
                "request_gap_min_us",
                -0.001,
                "client: never before t3.5",
            ),
        ] {
            let mut figures = reached();
            let set = figures.images.get_mut(image).expect("there");
            set.insert(name.to_owned(), value);
            let goals = of(&figures);
            let missed: Vec<_> = goals.iter().filter(|goal| !goal.is_met()).collect();
            assert_eq!(missed.len(), 1, "{name}");
            assert_eq!(missed[0].what, what);
        }
    }

    #[test]
    fn each_figure_past_its_bound_misses_its_goal_and_no_other() {
        assert!(of(&reached()).iter().all(Goal::is_met));
        let wrong = [
            (
                "turnaround_03x1_max_us",
                120.001,
                "turnaround beyond t3.5 for 03x1 and 06",
            ),
            (
                "turnaround_06_max_us",
                120.001,
                "turnaround beyond t3.5 for 03x1 and 06",
            ),
            (
                "turnaround_03x125_max_us",
                560.001,
                "turnaround beyond t3.5 for the longest frames",
            ),
            (
                "turnaround_10x123_max_us",
                560.001,
                "turnaround beyond t3.5 for the longest frames",
            ),
            ("turnaround_10x16_min_us", -0.001, "never before t3.5"),
            (
                "tx_bit_clock_turnaround_03x1_min_us",
                -0.001,
                "never before t3.5",
            ),
            (
                "tx_bit_clock_turnaround_03x1_max_us",
                120.001,
                "the same for 03x1 with a bit clock that runs free",
            ),
            ("jitter_03x16_us", 20.001, "jitter"),
            ("answer_gap_max_us", 0.063, "gap between answer bytes"),
            ("de_lead_min_us", -0.063, "DE up before the first start bit"),
            (
                "de_lead_max_us",
                86.81,
                "DE up before the first start bit, a character at 115200",
            ),
            (
                "de_lag_min_us",
                -0.063,
                "DE up until the last stop bit has ended",
            ),
            ("de_lag_max_us", 10.001, "DE down after the last stop bit"),
            ("stack_peak_bytes", 301.0, "peak stack"),
            ("loss_free_baud", 250_000.0, "loss-free"),
            (
                "loss_free_with_edges_baud",
                57_600.0,
                "loss-free while tasks wait for edges on port D",
            ),
            ("asleep_idle_percent", 99.0, "asleep when idle"),
        ];
        for (name, value, what) in wrong {
            for image in ["registers-16@115200", "registers-128@115200"] {
                let mut figures = reached();
                let set = figures.images.get_mut(image).expect("there");
                set.insert(name.to_owned(), value);
                let goals = of(&figures);
                let missed: Vec<_> = goals.iter().filter(|goal| !goal.is_met()).collect();
                assert_eq!(missed.len(), 1, "{name}");
                assert_eq!(missed[0].what, what);
                let text = missed[0].to_string();
                assert!(text.starts_with("  MISSED"), "{text}");
                assert!(text.ends_with(&format!("is {value} ({image})")), "{text}");
            }
        }
    }

    #[test]
    fn what_was_not_measured_is_not_reached() {
        let goals = of(&Figures::new("a compiler", 16_000_000));
        assert!(!goals.is_empty() && goals.iter().all(|goal| !goal.is_met()));
        assert!(goals[0].to_string().ends_with("was not measured"));
    }

    #[test]
    fn asleep_for_99_percent_is_not_over_99() {
        assert!(!Bound::Above(99.0).holds(99.0));
        assert!(Bound::AtLeast(0.0).holds(0.0) && !Bound::AtLeast(0.0).holds(-0.001));
    }
}
