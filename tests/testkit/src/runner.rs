//! The two emulators of the STM32; each test of its firmware runs on both.

use multidrop_bus::Emulator;

/// See the module.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Runner {
    /// QEMU, with an image that is built for it.
    Qemu,
    /// The core in this process, with the image that is flashed.
    Core,
}

impl Runner {
    /// For the bus.
    pub fn emulator(self) -> Emulator {
        let emulator = match self {
            Runner::Qemu => Emulator::qemu(),
            Runner::Core => Emulator::core(),
        };
        emulator.expect("set-up has brought it")
    }

    /// The option of a build for it.
    pub fn option(self) -> Option<&'static str> {
        (self == Runner::Qemu).then_some("--qemu")
    }
}

/// Makes two tests of each function that takes a [`Runner`].
#[macro_export]
macro_rules! on_both {
    ($($(#[$attribute:meta])* $name:ident,)*) => {
        mod qemu {
            $(
                #[test]
                $(#[$attribute])*
                fn $name() {
                    super::$name($crate::Runner::Qemu);
                }
            )*
        }

        mod flashed {
            $(
                #[test]
                $(#[$attribute])*
                fn $name() {
                    super::$name($crate::Runner::Core);
                }
            )*
        }
    };
}
