//! Rules for the registers that a master may read and write: VALID_REG, DISABLE_REG and VALID_DATA of a port.
//!
//! [`rules!`](crate::rules!) turns the three lists into code. They take no RAM. A check takes one comparison per
//! rule, whatever the length of the block, and one per register to which a rule applies.

use core::ops::RangeInclusive;

use crate::data::Registers;
use crate::exception::Exception;

/// A set of rules that [`rules!`](crate::rules!) has declared.
///
/// The rules are for the holding registers of a data model. A model that holds a [`Bank`](super::Bank) asks the bank
/// first, so that an address that does not exist is refused before a rule is checked.
pub trait Rules {
    /// The number of ranges in [`RuleList::ValidReg`]; 0 if there is no such list and every register is valid.
    const VALID_REG: u8;
    /// The number of rules in [`RuleList::ValidData`].
    const VALID_DATA: u8;
    /// The number of ranges in [`RuleList::DisableReg`], each with its flag.
    const DISABLE_REG: u8;

    /// Whether VALID_REG has all registers of the block.
    #[doc(hidden)]
    fn exists(block: &Block<'_>) -> bool;
    /// Whether a register of the block is in a DISABLE range whose flag is set.
    #[doc(hidden)]
    fn disabled(block: &Block<'_>, flags: u32) -> bool;
    /// Whether VALID_DATA allows all values of the block.
    #[doc(hidden)]
    fn allowed(block: &Block<'_>) -> bool;
    /// The registers of the rule with this index, from 0.
    #[doc(hidden)]
    fn registers(list: RuleList, index: u8) -> Option<Span>;

    /// Checks whether the `count` registers from `first` on may be read.
    ///
    /// # Errors
    ///
    /// [`Exception::IllegalDataAddress`] for a register outside VALID_REG, or a block that runs past 65535.
    #[inline]
    fn check_read(first: u16, count: u16) -> Result<(), Exception> {
        if count == 0
            || Block::new(first, count, Registers::new(&[]))
                .is_some_and(|block| Self::exists(&block))
        {
            Ok(())
        } else {
            Err(Exception::IllegalDataAddress)
        }
    }

    /// Checks whether these values may be written to the registers from `first` on, for
    /// [`DataModel::check_registers`](crate::server::DataModel::check_registers). Bit i of `flags` is the flag of
    /// DISABLE range i; 1 disables it. The whole block is checked against one list before the next list is used.
    ///
    /// # Errors
    ///
    /// [`Exception::IllegalDataAddress`] for a register outside VALID_REG, else [`Exception::NegativeAcknowledge`]
    /// for a register that is disabled, else [`Exception::IllegalDataValue`] for a value that VALID_DATA does not
    /// allow, or for more than 255 values.
    fn check_write(first: u16, values: Registers<'_>, flags: u32) -> Result<(), Exception> {
        let count = values.len();
        if count == 0 {
            return Ok(());
        }
        // No request has more than 255 values.
        if count > 255 {
            return Err(Exception::IllegalDataValue);
        }
        let Some(block) =
            Block::new(first, count as u16, values).filter(|block| Self::exists(block))
        else {
            return Err(Exception::IllegalDataAddress);
        };
        if Self::disabled(&block, flags) {
            return Err(Exception::NegativeAcknowledge);
        }
        if !Self::allowed(&block) {
            return Err(Exception::IllegalDataValue);
        }
        Ok(())
    }
}

/// A set without rules: every register exists and accepts every value.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct NoRules;

impl Rules for NoRules {
    const VALID_REG: u8 = 0;
    const VALID_DATA: u8 = 0;
    const DISABLE_REG: u8 = 0;

    #[inline(always)]
    fn exists(_: &Block<'_>) -> bool {
        true
    }

    #[inline(always)]
    fn disabled(_: &Block<'_>, _: u32) -> bool {
        false
    }

    #[inline(always)]
    fn allowed(_: &Block<'_>) -> bool {
        true
    }

    #[inline(always)]
    fn registers(_: RuleList, _: u8) -> Option<Span> {
        None
    }
}

/// One of the three lists in a set of rules.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum RuleList {
    /// The registers that exist; other registers are refused with exception 02.
    ValidReg,
    /// The values that registers accept; other values are refused with exception 03.
    ValidData,
    /// The registers that are refused with exception 07 while their flag is 1.
    DisableReg,
}

/// A range of register addresses, or of values, both ends included.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Span {
    /// The lowest register or value.
    pub first: u16,
    /// The highest register or value.
    pub last: u16,
}

impl Span {
    /// The ends of this range, in its order.
    pub const fn of(range: &RangeInclusive<u16>) -> Span {
        Span {
            first: *range.start(),
            last: *range.end(),
        }
    }

    /// Whether the span includes this register or value.
    #[inline(always)]
    pub const fn has(self, one: u16) -> bool {
        self.first <= one && one <= self.last
    }
}

/// The registers of one request, at least one, with their values if it is a write.
#[doc(hidden)]
#[derive(Clone, Copy, Debug)]
pub struct Block<'a> {
    first: u16,
    last: u16,
    values: Registers<'a>,
}

impl<'a> Block<'a> {
    #[inline(always)]
    fn new(first: u16, count: u16, values: Registers<'a>) -> Option<Block<'a>> {
        let last = first.checked_add(count.wrapping_sub(1))?;
        Some(Block {
            first,
            last,
            values,
        })
    }

    /// Whether the span includes a register of the block.
    #[inline(always)]
    pub fn meets(&self, span: Span) -> bool {
        self.first <= span.last && self.last >= span.first
    }

    /// The number of registers of the block in the span.
    #[inline(always)]
    pub fn common(&self, span: Span) -> u16 {
        if !self.meets(span) {
            0
        } else if span.first == span.last {
            1
        } else {
            self.overlap(span)
        }
    }

    /// Whether `covered` is the number of all registers of the block.
    #[inline(always)]
    pub fn is_covered_by(&self, covered: u16) -> bool {
        covered == self.last - self.first + 1
    }

    /// Whether the values for registers in `span` are all in `allowed`.
    #[inline(always)]
    pub fn all_within(&self, span: Span, allowed: Span) -> bool {
        if !self.meets(span) {
            true
        } else if span.first == span.last {
            allowed.has(self.value(span.first))
        } else {
            self.are_within(span, allowed)
        }
    }

    /// Whether the values for registers in `span` are all `allowed`.
    #[inline(always)]
    pub fn all_pass(&self, span: Span, allowed: fn(u16) -> bool) -> bool {
        if !self.meets(span) {
            true
        } else if span.first == span.last {
            allowed(self.value(span.first))
        } else {
            self.do_pass(span, allowed)
        }
    }

    // All rules share one copy of these functions. The inlined functions above compare both ends, since most rules of
    // a set do not apply to the block. A rule for a single register, the usual one, needs no loop.

    #[inline(never)]
    fn overlap(&self, span: Span) -> u16 {
        self.last.min(span.last) - self.first.max(span.first) + 1
    }

    #[inline(never)]
    fn value(&self, register: u16) -> u16 {
        let index = register.wrapping_sub(self.first);
        self.values.get(index.into()).unwrap_or(0)
    }

    #[inline(never)]
    fn are_within(&self, span: Span, allowed: Span) -> bool {
        self.all(span, |value| allowed.has(value))
    }

    #[inline(never)]
    fn do_pass(&self, span: Span, allowed: fn(u16) -> bool) -> bool {
        self.all(span, allowed)
    }

    /// For a write, whose registers fit an index of 8 bits.
    #[inline(always)]
    fn all(&self, span: Span, allowed: impl Fn(u16) -> bool) -> bool {
        let mut index = span.first.saturating_sub(self.first) as u8;
        let last = (self.last.min(span.last) - self.first) as u8;
        loop {
            if !allowed(self.values.get(index.into()).unwrap_or(0)) {
                return false;
            }
            if index == last {
                return true;
            }
            index = index.wrapping_add(1);
        }
    }
}

/// Declares a set of rules: an empty type that implements [`Rules`](crate::registers::Rules).
///
/// The lists are those of the port registers `MB_xxx_VALID_REG`, `VALID_DATA` and `DISABLE_REG`, each of them optional, in this
/// order. Addresses and values are `u16` constants; ranges have both ends included. A rule of VALID_DATA is `range(low..=high)` or `list(value, ...)`.
///
/// ```
/// use multidrop_protocol::data::Registers;
/// use multidrop_protocol::exception::Exception;
/// use multidrop_protocol::registers::Rules;
/// use multidrop_protocol::rules;
///
/// rules! {
///     /// The rules for the registers of RS4.
///     pub struct Rs4Rules: "RS4";
///     VALID_REG { 10..=90, 120..=190, 1000..=1000 }
///     VALID_DATA {
///         10..=15 => range(100..=200),
///         1000..=1000 => list(1, 2, 3),
///     }
///     DISABLE_REG { 120..=125 }
/// }
///
/// let written = |first, value: u16, flags| {
///     Rs4Rules::check_write(first, Registers::new(&value.to_be_bytes()), flags)
/// };
/// assert_eq!(written(91, 0, 0), Err(Exception::IllegalDataAddress));
/// assert_eq!(written(15, 99, 0), Err(Exception::IllegalDataValue));
/// assert_eq!(written(1000, 3, 0), Ok(()));
/// assert_eq!(written(125, 0, 0b1), Err(Exception::NegativeAcknowledge));
/// assert_eq!(written(125, 0, 0b0), Ok(()));
/// assert_eq!(Rs4Rules::check_read(125, 1), Ok(()));
/// ```
///
/// A wrong rule stops the build:
///
/// ```compile_fail,E0080
/// // port RS4: VALID_DATA 10..=15: low is 200, must not be above high, which is 100
/// multidrop_protocol::rules! {
///     struct Reversed: "RS4";
///     VALID_DATA { 10..=15 => range(200..=100) }
/// }
/// ```
#[macro_export]
macro_rules! rules {
    (
        $(#[$attribute:meta])*
        $visibility:vis struct $name:ident: $port:literal;
        $(VALID_REG { $($valid:expr),* $(,)? })?
        $(VALID_DATA { $($registers:expr => $kind:ident($($allowed:expr),* $(,)?)),* $(,)? })?
        $(DISABLE_REG { $($disable:expr),* $(,)? })?
    ) => {
        $(#[$attribute])*
        #[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
        $visibility struct $name;

        const _: () = {
            use $crate::registers::rules_check::{Values, check};
            use $crate::registers::Span;
            check($port, &[
                $(("VALID_REG", &[$((Span::of(&($valid)), Values::Any)),*]),)?
                $(("VALID_DATA", &[
                    $((Span::of(&($registers)), $crate::rules!(@values $kind($($allowed),*)))),*
                ]),)?
                $(("DISABLE_REG", &[$((Span::of(&($disable)), Values::Any)),*]),)?
            ]);
        };

        #[allow(unused_variables, unused_mut)]
        impl $crate::registers::Rules for $name {
            const VALID_REG: u8 = 0 $($(+ $crate::rules!(@one $valid))*)?;
            const VALID_DATA: u8 = 0 $($(+ $crate::rules!(@one $registers))*)?;
            const DISABLE_REG: u8 = 0 $($(+ $crate::rules!(@one $disable))*)?;

            #[inline]
            fn exists(block: &$crate::registers::Block<'_>) -> bool {
                $(
                    let mut covered: u16 = 0;
                    $({
                        const SPAN: $crate::registers::Span = $crate::registers::Span::of(&($valid));
                        covered += block.common(SPAN);
                    })*
                    if !block.is_covered_by(covered) {
                        return false;
                    }
                )?
                true
            }

            #[inline]
            fn disabled(block: &$crate::registers::Block<'_>, flags: u32) -> bool {
                let mut flags = flags;
                $($({
                    const SPAN: $crate::registers::Span = $crate::registers::Span::of(&($disable));
                    if flags & 1 != 0 && block.meets(SPAN) {
                        return true;
                    }
                    flags >>= 1;
                })*)?
                false
            }

            #[inline]
            fn allowed(block: &$crate::registers::Block<'_>) -> bool {
                $($({
                    const SPAN: $crate::registers::Span = $crate::registers::Span::of(&($registers));
                    if !$crate::rules!(@holds $kind(block, SPAN, $($allowed),*)) {
                        return false;
                    }
                })*)?
                true
            }

            fn registers(
                list: $crate::registers::RuleList,
                index: u8,
            ) -> ::core::option::Option<$crate::registers::Span> {
                let mut left = index;
                match list {
                    $crate::registers::RuleList::ValidReg => {
                        $($($crate::rules!(@nth left $valid);)*)?
                    }
                    $crate::registers::RuleList::ValidData => {
                        $($($crate::rules!(@nth left $registers);)*)?
                    }
                    $crate::registers::RuleList::DisableReg => {
                        $($($crate::rules!(@nth left $disable);)*)?
                    }
                }
                ::core::option::Option::None
            }
        }
    };

    (@one $each:expr) => { 1 };

    (@nth $left:ident $span:expr) => {{
        const SPAN: $crate::registers::Span = $crate::registers::Span::of(&($span));
        if $left == 0 {
            return ::core::option::Option::Some(SPAN);
        }
        $left -= 1;
    }};

    (@values range($allowed:expr)) => { Values::Range(Span::of(&($allowed))) };
    (@values list($($allowed:expr),*)) => { Values::List(&[$($allowed),*]) };
    (@values $kind:ident($($allowed:expr),*)) => {
        ::core::compile_error!("a rule of VALID_DATA is range(low..=high) or list(value, ...)")
    };

    (@holds range($block:ident, $span:ident, $allowed:expr)) => {{
        const ALLOWED: $crate::registers::Span = $crate::registers::Span::of(&($allowed));
        $block.all_within($span, ALLOWED)
    }};
    (@holds list($block:ident, $span:ident, $($allowed:expr),*)) => {
        // A slice would be in RAM on AVR.
        $block.all_pass($span, |value| false $(|| value == $allowed)*)
    };
    // `@values` has reported the error.
    (@holds $kind:ident($($rest:tt)*)) => { true };
}
