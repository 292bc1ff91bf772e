//! Checks of [`rules!`](crate::rules!) at build time, for that macro only.

use super::rules::Span;
use crate::message::Message;

/// The values that a rule allows.
pub enum Values {
    /// All values, as the list is not for values.
    Any,
    /// The values from low to high.
    Range(Span),
    /// The values of a list.
    List(&'static [u16]),
}

/// The name of a list and its rules.
pub type List = (&'static str, &'static [(Span, Values)]);

/// The maximum number of DISABLE ranges: their flags are the bits of a `u32`.
pub const DISABLE_MAX: usize = 32;

/// The maximum number of rules in a list: their number must fit a `u8`.
pub const RULES_MAX: usize = 255;

/// Stops the build if a rule is wrong, or if two rules of a list are for one register.
pub const fn check(port: &str, lists: &[List]) {
    let mut list = 0;
    while list < lists.len() {
        let (name, rules) = lists[list];
        check_list(port, name, rules);
        list += 1;
    }
}

const fn check_list(port: &str, name: &str, rules: &[(Span, Values)]) {
    let begin = Message::new()
        .text("port ")
        .text(port)
        .text(": ")
        .text(name);
    if rules.is_empty() {
        begin
            .text(" is empty, must have a range or be left out")
            .fail();
    }
    let max = match name.as_bytes() {
        b"DISABLE_REG" => DISABLE_MAX,
        _ => RULES_MAX,
    };
    if rules.len() > max {
        begin
            .text(" has ")
            .number(rules.len() as u32)
            .text(" ranges, must be at most ")
            .number(max as u32)
            .fail();
    }
    let mut i = 0;
    while i < rules.len() {
        let (span, values) = &rules[i];
        let this = span_text(begin.text(" "), *span);
        if span.first > span.last {
            this.text(": the first register must not be above the last one")
                .fail();
        }
        check_values(this, values);
        let mut j = 0;
        while j < i {
            let other = rules[j].0;
            if span.first <= other.last && other.first <= span.last {
                span_text(this.text(" overlaps "), other).fail();
            }
            j += 1;
        }
        i += 1;
    }
}

const fn check_values(this: Message, values: &Values) {
    match values {
        Values::Any => {}
        Values::Range(allowed) => {
            if allowed.first > allowed.last {
                this.text(": low is ")
                    .number(allowed.first as u32)
                    .text(", must not be above high, which is ")
                    .number(allowed.last as u32)
                    .fail();
            }
        }
        Values::List(allowed) => {
            if allowed.is_empty() {
                this.text(": list is empty, must have a value").fail();
            }
        }
    }
}

const fn span_text(message: Message, span: Span) -> Message {
    message
        .number(span.first as u32)
        .text("..=")
        .number(span.last as u32)
}
