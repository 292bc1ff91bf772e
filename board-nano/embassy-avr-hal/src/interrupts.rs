//! The token of a binary: a type that shows which interrupts are bound.
//!
//! [`bind_interrupts!`](crate::bind_interrupts) defines the handlers and the token. A driver takes the token and demands that it
//! binds the driver's interrupt, so that a forgotten one stops the build.

/// What the executor runs for a token. [`bind_interrupts!`](crate::bind_interrupts) implements it.
///
/// # Safety
/// The handlers of all interrupts that the token binds must be in the binary.
pub unsafe trait Interrupts: Copy + 'static {
    /// The value of the token.
    #[doc(hidden)]
    const TOKEN: Self;

    /// Starts the time, if it is bound. Before tasks are spawned.
    #[doc(hidden)]
    #[inline(always)]
    fn start() {}

    /// Serves the time, if it is bound. From the executor's loop, with the flags that were set.
    #[doc(hidden)]
    #[inline(always)]
    fn serve(flags: u8) {
        let _ = flags;
    }
}

/// Says that the watchdog is not bound. [`bind_interrupts!`](crate::bind_interrupts) implements it.
#[diagnostic::on_unimplemented(
    message = "`{Self}` binds WATCHDOG, which has to be fed: run the executor by run_watched",
    label = "nothing would feed the watchdog"
)]
pub trait Unwatched {}

/// Binds interrupts and defines the token that says so.
///
/// | written | binds | for |
/// |---|---|---|
/// | `USART0 => Rs485;` | the four interrupts of the line, to a [`Usart0`](crate::usart::Usart0) type (DS 12.4: vectors 12, 18, 19, 20, counted from 0), and what becomes of a [fault](crate::fault) | `Usart0::new` |
/// | `UART;` | the interrupts of the [plain UART](crate::uart) (18, 19, 20), in place of `USART0` | [`BufferedUart::new`](crate::uart::BufferedUart::new) |
/// | `WATCHDOG;` | the interrupt of the [watchdog](crate::watchdog) (6) | `Watchdog::start`, [`run_watched`](crate::executor::run_watched) |
/// | `EEPROM;` | EE READY (22) | [`Eeprom::new`](crate::eeprom::Eeprom::new) |
/// | `INT0; INT1; PCINT2;` | edges of PD2, of PD3, of PD4 to PD7 (1, 2, 5); some of the three | [`EdgeInput::new`](crate::edge::EdgeInput::new) |
/// | `TIME => CLOCK_HZ;` | the driver of `embassy-time` at this clock in Hz, with [`SLOTS`](crate::time::SLOTS) slots (11, 13) | [`run`](crate::executor::run()) |
/// | `TIME => CLOCK_HZ, slots = 6;` | with room for six tasks that wait at a time, 1..=32 | |
/// | `TIME => CLOCK_HZ, tasks = [poll, blink];` | with a slot for each of these tasks | |
/// | `TIME => CLOCK_HZ, slots = 2, tasks = [poll, blink];` | and a build error where more tasks are named than there are slots | |
///
/// Name every task that waits for a time, which those do that ask as a client: a compiler cannot see it by itself. A task with a
/// `pool_size` is named that many times. A binary that uses `embassy-time` without `TIME` is not linked.
///
/// The order does not matter. A binary has one `bind_interrupts!`: a second one is not linked.
#[macro_export]
macro_rules! bind_interrupts {
    ($(#[$attribute:meta])* $vis:vis struct $name:ident { $($bound:tt)* }) => {
        $(#[$attribute])*
        #[derive(Clone, Copy)]
        $vis struct $name;

        #[doc(hidden)]
        mod bound_interrupts {
            #[allow(unused_imports)]
            use super::*;

            #[unsafe(no_mangle)]
            extern "C" fn embassy_avr_hal_bind_interrupts_is_used_twice() {}

            $crate::bind_interrupts!(@next $name time() unwatched, $($bound)*);
        }
    };
    (@next $name:ident time $time:tt $watch:ident, USART0 => $line:ty; $($rest:tt)*) => {
        $crate::bind_faults!($line);

        #[unsafe(no_mangle)]
        extern "avr-interrupt" fn __vector_12() {
            // SAFETY: TIMER1_COMPB.
            unsafe { <$line>::on_silence() }
        }

        #[unsafe(no_mangle)]
        extern "avr-interrupt" fn __vector_18() {
            // SAFETY: USART_RX.
            unsafe { <$line>::on_character() }
        }

        #[unsafe(no_mangle)]
        extern "avr-interrupt" fn __vector_19() {
            // SAFETY: USART_UDRE.
            unsafe { <$line>::on_ready() }
        }

        #[unsafe(no_mangle)]
        extern "avr-interrupt" fn __vector_20() {
            // SAFETY: USART_TX.
            unsafe { <$line>::on_sent() }
        }

        // SAFETY: bound above.
        unsafe impl $crate::usart::Bound<$line> for $name {}

        $crate::bind_interrupts!(@next $name time $time $watch, $($rest)*);
    };
    (@next $name:ident time $time:tt $watch:ident, UART; $($rest:tt)*) => {
        #[unsafe(no_mangle)]
        extern "avr-interrupt" fn __vector_18() {
            // SAFETY: USART_RX.
            unsafe { $crate::uart::Interrupts::on_character() }
        }

        #[unsafe(no_mangle)]
        extern "avr-interrupt" fn __vector_19() {
            // SAFETY: USART_UDRE.
            unsafe { $crate::uart::Interrupts::on_ready() }
        }

        #[unsafe(no_mangle)]
        extern "avr-interrupt" fn __vector_20() {
            // SAFETY: USART_TX.
            unsafe { $crate::uart::Interrupts::on_sent() }
        }

        // SAFETY: bound above.
        unsafe impl $crate::uart::Bound for $name {}

        $crate::bind_interrupts!(@next $name time $time $watch, $($rest)*);
    };
    (@next $name:ident time $time:tt $watch:ident, WATCHDOG; $($rest:tt)*) => {
        // SAFETY: the handler is in this crate, since it has to be written in assembler.
        unsafe impl $crate::watchdog::Bound for $name {}

        $crate::bind_interrupts!(@next $name time $time watched, $($rest)*);
    };
    (@next $name:ident time $time:tt $watch:ident, EEPROM; $($rest:tt)*) => {
        #[unsafe(no_mangle)]
        extern "avr-interrupt" fn __vector_22() {
            // SAFETY: EE READY.
            unsafe { $crate::eeprom::Eeprom::on_ready() }
        }

        // SAFETY: bound above.
        unsafe impl $crate::eeprom::Bound for $name {}

        $crate::bind_interrupts!(@next $name time $time $watch, $($rest)*);
    };
    (@next $name:ident time $time:tt $watch:ident, INT0; $($rest:tt)*) => {
        #[unsafe(no_mangle)]
        extern "avr-interrupt" fn __vector_1() {
            // SAFETY: INT0.
            unsafe { $crate::edge::Int0::on_edge() }
        }

        // SAFETY: bound above.
        unsafe impl $crate::edge::Bound<$crate::edge::Int0> for $name {}

        $crate::bind_interrupts!(@next $name time $time $watch, $($rest)*);
    };
    (@next $name:ident time $time:tt $watch:ident, INT1; $($rest:tt)*) => {
        #[unsafe(no_mangle)]
        extern "avr-interrupt" fn __vector_2() {
            // SAFETY: INT1.
            unsafe { $crate::edge::Int1::on_edge() }
        }

        // SAFETY: bound above.
        unsafe impl $crate::edge::Bound<$crate::edge::Int1> for $name {}

        $crate::bind_interrupts!(@next $name time $time $watch, $($rest)*);
    };
    (@next $name:ident time $time:tt $watch:ident, PCINT2; $($rest:tt)*) => {
        #[unsafe(no_mangle)]
        extern "avr-interrupt" fn __vector_5() {
            // SAFETY: PCINT2.
            unsafe { $crate::edge::PortD::on_change() }
        }

        // SAFETY: bound above.
        unsafe impl $crate::edge::Bound<$crate::edge::PortD> for $name {}

        $crate::bind_interrupts!(@next $name time $time $watch, $($rest)*);
    };
    (@next $name:ident time() $watch:ident, TIME => $hz:expr; $($rest:tt)*) => {
        $crate::bind_interrupts!(@next $name time($hz, $crate::time::SLOTS, 0) $watch, $($rest)*);
    };
    (@next $name:ident time() $watch:ident, TIME => $hz:expr, tasks = [$($task:path),+ $(,)?]; $($rest:tt)*) => {
        $crate::bind_interrupts!(
            @next $name time() $watch,
            TIME => $hz, slots = [$(stringify!($task)),+].len(), tasks = [$($task),+]; $($rest)*
        );
    };
    (@next $name:ident time() $watch:ident, TIME => $hz:expr, slots = $slots:expr, tasks = [$($task:path),+ $(,)?]; $($rest:tt)*) => {
        const _: () = {
            // Each is a function of this binary.
            $(let _ = $task;)+
            $crate::time::check_slots($slots, [$(stringify!($task)),+].len());
        };
        $crate::bind_interrupts!(@next $name time($hz, $slots, 0) $watch, $($rest)*);
    };
    (@next $name:ident time() $watch:ident, TIME => $hz:expr, slots = $slots:expr; $($rest:tt)*) => {
        $crate::bind_interrupts!(@next $name time($hz, $slots, 0) $watch, $($rest)*);
    };
    // For tests: the time begins at this tick.
    (@next $name:ident time() $watch:ident, TIME => $hz:expr, slots = $slots:expr, begin = $begin:expr; $($rest:tt)*) => {
        $crate::bind_interrupts!(@next $name time($hz, $slots, $begin) $watch, $($rest)*);
    };
    (@next $name:ident time $time:tt $watch:ident,) => {
        $crate::bind_interrupts!(@time $name $time);
        $crate::bind_interrupts!(@$watch $name);
    };
    (@next $name:ident time $time:tt $watch:ident, $($wrong:tt)+) => {
        compile_error!(concat!(
            "bind_interrupts! does not know `",
            stringify!($($wrong)+),
            "`: must be some of `USART0 => TYPE;`, `UART;`, `WATCHDOG;`, `EEPROM;`, `INT0;`, `INT1;`, `PCINT2;`, `TIME => HZ;`, each once"
        ));
    };
    (@time $name:ident ()) => {
        // SAFETY: all that is bound is bound above.
        unsafe impl $crate::interrupts::Interrupts for $name {
            const TOKEN: Self = Self;
        }
    };
    (@time $name:ident ($hz:expr, $slots:expr, $begin:expr)) => {
        $crate::time::time_driver_impl!(
            static DRIVER: $crate::time::TimeDriver<{ $hz }, { $slots }> =
                $crate::time::TimeDriver::new($begin)
        );

        #[unsafe(no_mangle)]
        extern "avr-interrupt" fn __vector_11() {
            // SAFETY: TIMER1_COMPA.
            unsafe { DRIVER.on_alarm() }
        }

        #[unsafe(no_mangle)]
        extern "avr-interrupt" fn __vector_13() {
            // SAFETY: TIMER1_OVF.
            unsafe { DRIVER.on_overflow() }
        }

        // SAFETY: all that is bound is bound above.
        unsafe impl $crate::interrupts::Interrupts for $name {
            const TOKEN: Self = Self;

            #[inline(always)]
            fn start() {
                DRIVER.start();
            }

            #[inline(always)]
            fn serve(flags: u8) {
                DRIVER.serve(flags);
            }
        }
    };
    (@unwatched $name:ident) => {
        impl $crate::interrupts::Unwatched for $name {}
    };
    (@watched $name:ident) => {};
    ($($wrong:tt)*) => {
        compile_error!("bind_interrupts! is written `bind_interrupts!(struct Irqs { USART0 => Rs485; });`");
    };
}

#[doc(hidden)]
#[cfg(not(feature = "bare"))]
#[macro_export]
macro_rules! bind_faults {
    ($line:ty) => {
        /// What a panic calls.
        #[unsafe(no_mangle)]
        extern "C" fn abort() -> ! {
            <$line>::abort()
        }

        /// What avr-libc's vector table has for an interrupt without a handler.
        #[unsafe(no_mangle)]
        extern "C" fn __vector_default() -> ! {
            abort()
        }
    };
}

#[doc(hidden)]
#[cfg(feature = "bare")]
#[macro_export]
macro_rules! bind_faults {
    ($line:ty) => {};
}
