//! The names of the register set.

use core::fmt;

macro_rules! registers {
    ($($group:ident { $($section:ident { $(
        $(#[$doc:meta])*
        $number:literal $NAME:ident $register:ident $([$index:ident: $index_type:ident])? $(: $type:ident)?
            $(in $low:literal ..= $high:literal)? $(of $choices:literal)? $(=> $field:ident = $default:expr)?;
    )* })* })*) => {
        /// One register of a port, `MB_<port>_<name>` in iDevOS. Those that are arrays have an index, from 0.
        #[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
        #[cfg_attr(feature = "defmt", derive(defmt::Format))]
        pub enum Register {
            $($($( $(#[$doc])* $register $(($index_type))?, )*)*)*
        }

        impl Register {
            /// How many names there are; numbers are below.
            pub const COUNT: u8 = 0 $($($( + { _ = $number; 1 } )*)*)*;

            /// The number of its name, the same in all versions.
            pub const fn number(self) -> u8 {
                match self {
                    $($($( Register::$register { .. } => $number, )*)*)*
                }
            }

            /// The register of this number; `None` for a number there is not, or an index that it cannot have.
            pub const fn from_number(number: u8, index: u16) -> Option<Register> {
                let register = match number {
                    $($($( $number => Register::$register $((index as $index_type))?, )*)*)*
                    _ => return None,
                };
                let has = match register.index() {
                    Some(taken) => taken == index,
                    None => index == 0,
                };
                if has { Some(register) } else { None }
            }

            /// The index in an array; `None` for a register that is none.
            pub const fn index(self) -> Option<u16> {
                match self {
                    $($($( $( Register::$register($index) => Some($index as u16), )? )*)*)*
                    _ => None,
                }
            }

            /// Its name, without `MB_<port>_` and without an index.
            pub const fn name(self) -> &'static str {
                match self {
                    $($($( Register::$register { .. } => stringify!($NAME), )*)*)*
                }
            }

            /// Whether this number is in its range; `true` for a register that has none.
            pub(super) const fn has_in_range(self, number: u32) -> bool {
                match self {
                    $($($( $( Register::$register { .. } => matches!(number, $low..=$high), )? )*)*)*
                    _ => true,
                }
            }

            /// The lowest and the highest number that it takes; `None` for one that takes none, or one of a few. What else it is
            /// set to may narrow it: see [`PortSettings::range`](super::PortSettings::range).
            pub const fn range(self) -> Option<(u32, u32)> {
                match self {
                    $($($( $( Register::$register { .. } => Some(($low, $high)), )? )*)*)*
                    _ => None,
                }
            }

            /// The few numbers that it takes, as text; `None` for one that takes none, or a range.
            pub const fn choices(self) -> Option<&'static str> {
                match self {
                    $($($( $( Register::$register { .. } => Some($choices), )? )*)*)*
                    _ => None,
                }
            }
        }
    };
}

port_registers!(registers);

impl Register {
    /// The highest number of its range, for constants.
    pub(super) const fn highest(self) -> u32 {
        match self.range() {
            Some((_, high)) => high,
            None => panic!("a register without a range"),
        }
    }

    /// The register of this name, such as `"BAUD"`, or `"REGS.3"`: an array without an index is its first element. `None` for
    /// any other text.
    pub fn from_name(text: &str) -> Option<Register> {
        let (name, index) = match text.split_once('.') {
            // A sign is no part of an index.
            Some((_, digits)) if !digits.starts_with(|c: char| c.is_ascii_digit()) => return None,
            Some((name, digits)) => (name, Some(digits.parse().ok()?)),
            None => (text, None),
        };
        let number = (0..Register::COUNT).find(|number| {
            Register::from_number(*number, 0).is_some_and(|register| register.name() == name)
        })?;
        let register = Register::from_number(number, index.unwrap_or(0))?;
        (register.index().is_some() || index.is_none()).then_some(register)
    }
}

/// The name, in the form that [`Register::from_name`] accepts.
impl fmt::Display for Register {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name())?;
        match self.index() {
            Some(index) => write!(f, ".{index}"),
            None => Ok(()),
        }
    }
}
