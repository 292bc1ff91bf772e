//! Whether the bus keeps up with the clock on the wall.

use std::fmt;
use std::time::Duration;

/// The most wall time that is caught up with after the machine was busy elsewhere; what is beyond
/// is left out.
const CATCH_UP: Duration = Duration::from_millis(250);

/// From here on it is told of: a client that waits for a tenth of a second may see a timeout.
const TOLD_FROM: Duration = Duration::from_millis(50);

/// How often it is told of at most, unless it gets twice as bad.
const TOLD_EVERY: Duration = Duration::from_secs(10);

/// How far the bus was behind real time, since this was told last.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Behind {
    /// The most that it was behind.
    pub most: Duration,
    /// What was never caught up with: the bus stood still meanwhile.
    pub left_out: Duration,
}

impl fmt::Display for Behind {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let most = self.most.as_millis();
        write!(
            f,
            "the bus is up to {most} ms behind real time, since this machine is busy: clients may see timeouts"
        )?;
        match self.left_out.as_millis() {
            0 => Ok(()),
            ms => write!(f, " ({ms} ms are never caught up with)"),
        }
    }
}

/// Hands out the time that the bus is to run for. Time on the wall comes in as an argument.
#[derive(Default)]
pub(super) struct Pace {
    until: Duration,
    untold: Behind,
    /// When it was told of last, and how far it was behind.
    told: Option<(Duration, Duration)>,
}

impl Pace {
    /// How far the bus is to run at `now`, counted from the start; and what there is to tell.
    pub fn step(&mut self, now: Duration) -> (Duration, Option<Behind>) {
        let behind = now.saturating_sub(self.until);
        self.until = now;
        let span = behind.min(CATCH_UP);
        if behind >= TOLD_FROM {
            self.untold.most = self.untold.most.max(behind);
            self.untold.left_out += behind - span;
        }
        let most = self.untold.most;
        let due = self
            .told
            .is_none_or(|(at, told)| now >= at + TOLD_EVERY || most >= told * 2);
        if !due || self.untold == Behind::default() {
            return (span, None);
        }
        self.told = Some((now, most));
        (span, Some(std::mem::take(&mut self.untold)))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const fn ms(ms: u64) -> Duration {
        Duration::from_millis(ms)
    }

    #[test]
    fn a_bus_that_keeps_up_has_nothing_to_tell() {
        let mut pace = Pace::default();
        for now in 1..100_000 {
            assert_eq!(pace.step(ms(now)), (ms(1), None));
        }
        assert_eq!(pace.step(ms(99_999 + 49)), (ms(49), None));
    }

    #[test]
    fn what_is_too_late_is_told_and_left_out() {
        let mut pace = Pace::default();
        let told = |most, left_out| {
            Some(Behind {
                most: ms(most),
                left_out: ms(left_out),
            })
        };
        assert_eq!(pace.step(ms(50)), (ms(50), told(50, 0)));
        // Again at once if it is twice as bad.
        assert_eq!(pace.step(ms(950)), (ms(250), told(900, 650)));
        // Else later; but nothing is forgotten.
        assert_eq!(pace.step(ms(1_250)), (ms(250), None));
        assert_eq!(pace.step(ms(1_750)), (ms(250), None));
        for now in (1_760..10_950).step_by(10) {
            assert_eq!(pace.step(ms(now)), (ms(10), None));
        }
        assert_eq!(pace.step(ms(10_950)), (ms(10), told(500, 300)));
    }

    #[test]
    fn it_is_told_in_words() {
        let behind = Behind {
            most: ms(700),
            left_out: ms(450),
        };
        assert_eq!(
            behind.to_string(),
            "the bus is up to 700 ms behind real time, since this machine is busy: clients may see timeouts \
             (450 ms are never caught up with)"
        );
    }
}
