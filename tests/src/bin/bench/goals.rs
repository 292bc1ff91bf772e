//! What the figures have to reach, whatever they were before.

use std::fmt;

use multidrop_bus::Line;

use crate::figures::Figures;
use crate::measure::{BAUDS, COUNTS};
use crate::traffic::Shape;

/// A goal, held against the worst of the images it is for.
pub struct Goal {
    what: String,
    unit: &'static str,
    /// The worst figure and where it was measured; nothing where there is none, which misses the goal.
    worst: Option<(f64, String)>,
    bound: Bound,
}

/// What a figure may be.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Bound {
    AtMost(f64),
    AtLeast(f64),
    Above(f64),
}

impl Bound {
    fn holds(self, value: f64) -> bool {
        match self {
            Bound::AtMost(limit) => value <= limit,
            Bound::AtLeast(limit) => value >= limit,
            Bound::Above(limit) => value > limit,
        }
    }

    /// Whether `a` is further from the goal than `b`.
    fn is_worse(self, a: f64, b: f64) -> bool {
        match self {
            Bound::AtMost(_) => a > b,
            Bound::AtLeast(_) | Bound::Above(_) => a < b,
        }
    }
}

impl Goal {
    /// Whether it is reached.
    pub fn is_met(&self) -> bool {
        matches!(self.worst, Some((value, _)) if self.bound.holds(value))
    }
}

impl fmt::Display for Goal {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let verdict = if self.is_met() { "ok    " } else { "MISSED" };
        let bound = match self.bound {
            Bound::AtMost(limit) => format!("at most {limit}"),
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
    let mut worst: Option<(f64, String)> = None;
    for count in COUNTS {
        for baud in bauds {
            let image = format!("registers-{count}@{baud}");
            for value in names.iter().filter_map(|name| figures.get(&image, name)) {
                let is_worse = |(held, _): &(f64, String)| bound.is_worse(value, *held);
                if worst.as_ref().is_none_or(is_worse) {
                    worst = Some((value, image.clone()));
                }
            }
        }
    }
    Goal {
        what: what.into(),
        unit,
        worst,
        bound,
    }
}

/// All goals.
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
        one("asleep when idle", "%", "asleep_idle_percent", Above(99.0)),
    ]);
    goals
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::figures::Set;

    fn figures(stack: [f64; 2]) -> Figures {
        let mut figures = Figures::new("a compiler");
        for (count, stack) in COUNTS.into_iter().zip(stack) {
            let set = Set::from([("stack_peak_bytes".to_owned(), stack)]);
            figures
                .images
                .insert(format!("registers-{count}@38400"), set);
        }
        figures
    }

    fn stack_goal(stack: [f64; 2]) -> Goal {
        let mut goals = of(&figures(stack));
        let at = goals.iter().position(|goal| goal.what == "peak stack");
        goals.remove(at.expect("a goal of that name"))
    }

    #[test]
    fn the_worst_image_decides_and_is_named() {
        let reached = stack_goal([300.0, 299.0]);
        assert!(reached.is_met());
        assert_eq!(
            reached.to_string(),
            "  ok      peak stack: at most 300 bytes, is 300 (registers-16@38400)"
        );
        let missed = stack_goal([120.0, 301.0]);
        assert!(!missed.is_met());
        assert!(missed.to_string().contains("MISSED"), "{missed}");
        assert!(missed.to_string().contains("is 301 (registers-128@38400)"));
    }

    #[test]
    fn what_was_not_measured_is_not_reached() {
        let goals = of(&figures([100.0, 100.0]));
        assert_eq!(goals.iter().filter(|goal| goal.is_met()).count(), 1);
    }

    #[test]
    fn asleep_for_99_percent_is_not_over_99() {
        assert!(!Bound::Above(99.0).holds(99.0));
        assert!(Bound::AtLeast(0.0).holds(0.0) && !Bound::AtLeast(0.0).holds(-0.001));
    }
}
