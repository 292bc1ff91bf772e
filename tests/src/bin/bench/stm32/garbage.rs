//! How much garbage on RS2 delays AS1's answers.

use multidrop_bus::{Time, Tx};

use super::in_instructions;
use super::work::{Managed, RS2, interrupts};
use crate::Trouble;
use crate::figures::{Range, Set, rounded};
use crate::image::Image;
use multidrop_testkit::frames::{adu, words};
use multidrop_testkit::random::Random;

/// The rate of the garbage: the highest there is.
const BAUD: u32 = 2_000_000;
/// Answers of AS1, each with and without.
const EXCHANGES: usize = 40;
/// Characters of garbage, back to back: from before the request has ended until the answer has begun.
const CHARACTERS: usize = 900;
const BEFORE_END: Time = Time::from_ms(1);

/// Instructions between t3.5 after a request to AS1 and the first store to its data register, without and with garbage; and
/// how long RS2's interrupts were.
pub fn of(image: &Image, set: &mut Set) -> Result<(), Trouble> {
    const HANDLER: &str = "USART3";
    let mut managed = Managed::new(image, &[HANDLER, "SysTick"])?;
    managed.make_slave(RS2, BAUD)?;
    let silence = image.line().t35();
    let mut random = Random::new(2);
    for (garbage, name) in [(false, "quiet"), (true, "garbage")] {
        let mut beyond = Range::default();
        for _ in 0..EXCHANGES {
            let pause = Time::from_ps(random.next() % Time::from_ms(2).ps());
            managed.bus.run_for(Time::from_ms(10) + pause);
            // FC 03, one of the port's own settings.
            let request = words(10, 3, 1000, 1);
            if garbage {
                let frame = image.line().character().ps() * request.len() as u64;
                let lead = Time::from_ps(frame).saturating_sub(BEFORE_END);
                let noise = (0..CHARACTERS).map(|index| {
                    let pause = if index == 0 { lead } else { Time::ZERO };
                    let byte = Tx::byte(random.next() as u8).after(pause);
                    if random.one_in(7) {
                        byte.bad_stop()
                    } else {
                        byte
                    }
                });
                let noise: Vec<_> = noise.collect();
                managed.bus.host(managed.hosts[RS2]).send_each(noise);
            }
            let mode = [10, 3, 2, 0, 0];
            let turnaround = managed.expect(0, &request, &adu(&mode))?;
            beyond.add(in_instructions(turnaround.us() - silence.us()));
        }
        beyond.store(set, &format!("as1_{name}"), "instructions");
    }
    let machine = managed.bus.machine(managed.machine);
    interrupts(machine, HANDLER, "rs2", set);
    interrupts(machine, "SysTick", "alarm", set);
    set.insert("rs2_overruns".to_owned(), machine.overruns(RS2) as f64);
    let get = |name: &str| set.get(name).copied().unwrap_or(f64::NAN);
    let delay = get("as1_garbage_max_instructions") - get("as1_quiet_max_instructions");
    let delay = rounded(delay.max(0.0));
    set.insert("as1_delay_instructions".to_owned(), delay);
    Ok(())
}
