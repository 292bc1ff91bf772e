//! What a chip has to do for its line, as tests: for every [`Chip`] of a [`ChipUnderTest`], on a desk where time stands until it is
//! told to go on.
//!
//! [`line_chip_tests!`](crate::line_chip_tests) makes a test of each function here, in a module of your own:
//!
//! ```text
//! multidrop_testkit::line_chip_tests!(MyChipOnDesk);
//! ```
//!
//! The suite does what the generic line does: it calls the machine with interrupts off, and what the machine asks of the chip
//! shows in what goes out, in DE, and in the ticks at which it does.

mod answers;
mod desk;
mod frames;

pub use answers::*;
pub use frames::*;

use multidrop_protocol::frame::ReceiveErrors;
use multidrop_protocol::line::{Chip, LineConfig};
use multidrop_protocol::timing::Sight;

/// A chip under test: its driver, and a model of its hardware that the suite can drive.
pub trait ChipUnderTest: Sized {
    /// The type of the chip.
    type Chip: Chip;

    /// As it is behind a reset, not set up yet.
    fn power_up() -> Self;

    /// The chip's side of the line.
    fn chip(&self) -> &Self::Chip;

    /// How it sees the end of a character: what its settings are worked out with.
    fn sight(&self, config: &LineConfig) -> Sight;

    /// The timer of the line.
    fn now(&self) -> u32;

    /// Time goes on until the timer is at `tick`, and all interrupts come when they are due. Those that are due already, since a
    /// task has changed something, come first.
    fn run_until(&mut self, tick: u32);

    /// Interrupts are off, or on again: those that were due come then.
    fn hold_interrupts(&mut self, held: bool);

    /// RXD falls: a start bit, or a bit of a character.
    fn falling_edge(&mut self);

    /// A character has come in, and its interrupt is due: it comes now, if interrupts are not held. Nothing if the receiver is off.
    /// The edges of the character were told by [`falling_edge`](ChipUnderTest::falling_edge).
    fn character(&mut self, byte: u8, errors: ReceiveErrors);

    /// The transmitter does not come to the end of the character that it sends.
    fn stop_transmitter(&mut self);

    /// What has gone out since this was last called: the tick at which each start bit began, and the byte.
    fn sent(&mut self) -> Vec<(u32, u8)>;

    /// What DE has done since this was last called: when, and whether it has gone up.
    fn de_changes(&mut self) -> Vec<(u32, bool)>;
}

/// Makes a test of each function of the suite for a [`ChipUnderTest`](crate::line_chip::ChipUnderTest).
#[macro_export]
macro_rules! line_chip_tests {
    ($chip:ty) => {
        $crate::line_chip_tests! { $chip:
            a_line_that_is_set_up_listens_after_t3_5
            a_frame_is_complete_at_t1_5_and_wakes_once
            a_frame_stands_before_t3_5_and_its_answer_begins_at_t3_5
            de_is_up_from_the_first_character_to_the_end_of_the_last
            a_late_character_voids_a_frame_and_withholds_its_answer
            a_start_bit_at_t1_5_is_waited_for
            an_edge_that_is_no_character_delays_by_one_character
            a_start_bit_at_t3_5_holds_an_answer_back
            nothing_is_stored_while_the_buffer_is_lent
            the_first_character_of_a_frame_that_comes_early_is_kept
            a_damaged_frame_is_told_with_its_errors
            frames_of_256_bytes_fit_and_no_longer_ones
            an_answer_that_is_dropped_is_cut_off_behind_a_character
            nothing_is_heard_while_it_sends
            a_transmitter_that_stands_still_is_let_go_of
            a_transmitter_that_has_run_empty_sends_the_rest
            interrupts_that_come_late_shift_no_interval
            an_alarm_that_is_set_too_late_goes_off_at_once
            de_goes_up_its_lead_before_the_first_character
            an_answer_waits_for_its_delay
            where_gaps_are_allowed_a_frame_ends_at_t3_5
            new_settings_take_the_place_of_the_old_ones
            ascii_frames_come_and_go_where_the_chip_has_them
        }
    };
    ($chip:ty: $($name:ident)*) => {
        $(
            #[test]
            fn $name() {
                $crate::line_chip::$name::<$chip>();
            }
        )*
    };
}
