//! Time in ticks of `embassy-time`, 32 bits that wrap: enough for what a client waits for, and a fraction of the work of 64.

use core::task::{Context, Poll};

use embassy_time::{Duration, Instant, TICK_HZ};

/// A time in ticks.
pub(crate) const fn ticks(ms: u16) -> u32 {
    const PER_MS: u32 = {
        // Twice 65535 ms, a timeout and a guard, must be less than half of what 32 bits count.
        assert!(
            TICK_HZ >= 1000 && TICK_HZ <= 16_000_000,
            "embassy-time must tick every millisecond, and at 16 MHz at most"
        );
        (TICK_HZ / 1000) as u32
    };
    ms as u32 * PER_MS
}

/// So many ticks.
pub(crate) const fn duration(ticks: u32) -> Duration {
    Duration::from_ticks(ticks as u64)
}

/// The lower half of the time.
#[inline(never)]
pub(crate) fn now() -> u32 {
    Instant::now().as_ticks() as u32
}

/// Whether it is `at` or later; if not, the task is woken then.
#[inline(never)]
pub(crate) fn poll_over(at: u32, context: &mut Context<'_>) -> Poll<()> {
    let now = Instant::now().as_ticks();
    let left = at.wrapping_sub(now as u32);
    if left == 0 || left > u32::MAX / 2 {
        return Poll::Ready(());
    }
    // As a `Timer` does, which is not waited for itself here.
    embassy_time_driver::schedule_wake(now + u64::from(left), context.waker());
    Poll::Pending
}
