//! Four ports loaded at once, for longer than a test may take: the image that is flashed, on the core in this process.

use multidrop_bus::{Emulator, Time};

use crate::Trouble;
use crate::figures::{Set, rounded};
use crate::image::Images;
use multidrop_testkit::four::{self, AS1, AS2, Desk, Report};

/// Of bus time.
const SPAN: Time = Time::from_ms(600_000);

/// The load of the tests' half minute, for ten.
pub fn of(images: &Images<'_>, flashed: &Images<'_>) -> Result<Set, Trouble> {
    let units = ["unit1", "unit2", "unit3"].map(|unit| images.app(unit));
    let mut paths = Vec::new();
    for unit in units {
        paths.push(unit?.path.as_path());
    }
    let minutes = SPAN.us() / 60e6;
    eprintln!("four ports at once for {minutes} min of bus time: that takes some three");
    let mut desk = Desk::new(&flashed.app("ports")?.path, Emulator::core()?, &paths)?;
    let report = four::run(&mut desk, SPAN);
    for trouble in &report.troubles {
        println!("four ports: {trouble}");
    }
    Ok(told(&report))
}

fn told(report: &Report) -> Set {
    let mut set = Set::new();
    let mut insert = |name: String, value: f64| set.insert(name, value);
    insert("span_s".to_owned(), SPAN.us() / 1e6);
    insert("lost".to_owned(), report.lost as f64);
    insert("wrong".to_owned(), report.wrong as f64);
    for (port, name) in ["as1", "as2", "rs2", "rs4"].into_iter().enumerate() {
        insert(format!("answers_{name}"), report.answers[port] as f64);
        let changes = f64::from(report.reconfigurations[port]);
        insert(format!("reconfigurations_{name}"), changes);
        insert(format!("overruns_{name}"), report.overruns[port] as f64);
        if [AS1, AS2].contains(&port) {
            let longest = rounded(report.turnaround[port].us());
            insert(format!("turnaround_{name}_max_us"), longest);
            let routed = rounded(report.routed[port].us());
            insert(format!("routed_{name}_max_us"), routed);
        }
    }
    let changes: u32 = report.reconfigurations.iter().sum();
    insert("reconfigurations".to_owned(), f64::from(changes));
    let overruns: u64 = report.overruns.iter().sum();
    insert("overruns".to_owned(), overruns as f64);
    set
}
