//! What is printed, in colour where that is a terminal.

use anstream::{eprintln, println};
use anstyle::{AnsiColor, Style};
use multidrop_bus::{Frame, Line, Time};

use crate::desk::Leds;

const BOLD: Style = Style::new().bold();
const FAINT: Style = Style::new().dimmed();
const REQUEST: Style = AnsiColor::Cyan.on_default();
const ANSWER: Style = AnsiColor::Green.on_default();
const EXCEPTION: Style = AnsiColor::Yellow.on_default();
const WRONG: Style = AnsiColor::Red.on_default().bold();
const LIT: Style = AnsiColor::BrightYellow.on_default().bold();

pub fn title(text: &str) {
    println!("{BOLD}{text}{BOLD:#}");
}

pub fn part(text: &str) {
    println!();
    title(text);
}

pub fn step(number: usize, text: &str) {
    println!();
    println!("{BOLD}{number:2}.{BOLD:#} {text}");
}

pub fn note(text: &str) {
    println!("    {text}");
}

pub fn command(line: &str) {
    println!("    {FAINT}${FAINT:#} {line}");
}

pub fn output(line: &str) {
    println!("      {FAINT}{line}{FAINT:#}");
}

/// The bytes, what they mean, and for an answer how long after the request it began.
pub fn frame(frame: &Frame, line: Line) {
    let (arrow, style) = match (frame.body(), frame.answer, frame.is_exception()) {
        (None, _, _) => ("??", WRONG),
        (_, false, _) => ("->", REQUEST),
        (_, true, false) => ("<-", ANSWER),
        (_, true, true) => ("<-", EXCEPTION),
    };
    println!("    {style}{arrow} {}{style:#}", frame.hex());
    let after = match frame.turnaround {
        Some(time) if frame.answer => format!("; {}", turnaround(time, line)),
        _ => String::new(),
    };
    println!("       {}{FAINT}{after}{FAINT:#}", frame.meaning());
}

fn turnaround(time: Time, line: Line) -> String {
    let beyond = time.saturating_sub(line.t35());
    format!("after {:.1} us = t3.5 + {:.1} us", time.us(), beyond.us())
}

pub fn leds(unit: usize, leds: Leds) {
    println!(
        "    node {unit}  PORTB {}  PORTD {}",
        port(leds.b, Leds::B),
        port(leds.d, Leds::D)
    );
}

/// Bit 7 first; a dot for a pin that has no LED.
fn port(value: u8, mask: u8) -> String {
    (0..8)
        .rev()
        .map(|bit| match (mask >> bit & 1, value >> bit & 1) {
            (0, _) => ".".to_owned(),
            (_, 0) => "0".to_owned(),
            _ => format!("{LIT}1{LIT:#}"),
        })
        .collect()
}

pub fn summary(steps: usize, frames: usize, conflicts: usize, slowest: Time) {
    println!();
    println!(
        "{ANSWER}All right:{ANSWER:#} {steps} steps, {frames} frames, {conflicts} conflicts, \
         longest turnaround t3.5 + {:.1} us",
        slowest.us()
    );
}

pub fn trouble(text: &str) {
    eprintln!("{WRONG}error:{WRONG:#} {text}");
}
