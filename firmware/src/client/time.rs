//! Time in ticks of `embassy-time`, in 32 bits that wrap: enough for the times of a client, and less code than 64
//! bits.

use core::task::{Context, Poll};

use embassy_time::{Duration, Instant, TICK_HZ};

/// The number of ticks in `ms` milliseconds.
pub(crate) const fn ticks(ms: u16) -> u32 {
    const PER_MS: u32 = {
        // Twice 65535 ms, a timeout and a guard, must be less than half of what 32 bits count.
        assert!(
            TICK_HZ >= 1000 && TICK_HZ <= 16_000_000,
            "the tick rate of embassy-time must be 1 kHz to 16 MHz"
        );
        (TICK_HZ / 1000) as u32
    };
    ms as u32 * PER_MS
}

/// The duration of this number of ticks.
pub(crate) const fn duration(ticks: u32) -> Duration {
    Duration::from_ticks(ticks as u64)
}

/// The lower 32 bits of the present time.
#[inline(never)]
pub(crate) fn now() -> u32 {
    Instant::now().as_ticks() as u32
}

/// Ready when it is `at` or later; until then the task is registered to be woken at `at`.
#[inline(never)]
pub(crate) fn poll_over(at: u32, context: &mut Context<'_>) -> Poll<()> {
    let now = Instant::now().as_ticks();
    let left = at.wrapping_sub(now as u32);
    if left == 0 || left > u32::MAX / 2 {
        return Poll::Ready(());
    }
    // A `Timer` does this when it is polled.
    embassy_time_driver::schedule_wake(now + u64::from(left), context.waker());
    Poll::Pending
}
