//! The fuzz targets: their corpus is always replayed, and each target runs for a while if there is a C++ compiler.
//!
//! This does what cargo-fuzz would do, so that it need not be installed: the code under test has no `unsafe` for a
//! sanitizer to watch, and the rest works with a stable compiler.

use crate::repo;
use std::process::Command;

/// The targets are a workspace of their own, since libFuzzer is C++.
const FOLDER: &str = "fuzz";

const TARGETS: [&str; 6] = [
    "server_pdu",
    "rtu_line",
    "ascii_line",
    "codec",
    "client_answers",
    "port_load",
];

/// Where cargo puts what it builds of them, from the root of the repository.
const BUILT: &str = "target/fuzz";

const SECONDS: u32 = 20;

/// The flags of cargo-fuzz for libFuzzer's coverage, and overflow checks.
const FLAGS: &[&str] = &[
    "--cfg",
    "fuzzing",
    "-Cdebug-assertions",
    "-Ccodegen-units=1",
    "-Cpasses=sancov-module",
    "-Cllvm-args=-sanitizer-coverage-level=4",
    "-Cllvm-args=-sanitizer-coverage-inline-8bit-counters",
    "-Cllvm-args=-sanitizer-coverage-pc-table",
    "-Cllvm-args=-sanitizer-coverage-trace-compares",
];

/// The test that replays the corpus.
pub fn replay() -> Command {
    cargo("test", &["--no-default-features"])
}

/// Format and lints of the targets, and the runs, each with its name.
pub fn checks() -> Vec<(String, Command)> {
    let format = cargo("fmt", &["--check"]);
    let lint = [
        "--no-default-features",
        "--all-targets",
        "--",
        "-D",
        "warnings",
    ];
    let mut checks = vec![
        ("format of the fuzz targets".to_owned(), format),
        (
            "clippy of the fuzz targets".to_owned(),
            cargo("clippy", &lint),
        ),
    ];
    match compiler() {
        Ok(triple) => {
            println!("\nfuzzing: each target for {SECONDS} s");
            checks.push(("build of the fuzz targets".to_owned(), build(&triple)));
            for target in TARGETS {
                let name = format!("fuzzing {target} for {SECONDS} s");
                checks.push((name, run(target, &triple)));
            }
        }
        Err(missing) => println!("\nfuzzing: only the corpus is replayed; {missing}"),
    }
    checks
}

/// The host's triple if its compilers can build the targets, else what is missing.
fn compiler() -> Result<String, &'static str> {
    if std::env::var_os("CXX").is_none() && repo::in_path("c++").is_none() {
        return Err("to fuzz, install a C++ compiler (Debian: g++)");
    }
    let version = repo::output_of(Command::new("rustc").arg("-vV"));
    let triple = version.as_deref().and_then(|text| {
        let mut lines = text.lines();
        lines.find_map(|line| line.strip_prefix("host: "))
    });
    triple
        .map(str::to_owned)
        .ok_or("rustc does not print its host")
}

fn cargo(command: &str, arguments: &[&str]) -> Command {
    let mut cargo = repo::cargo();
    cargo.current_dir(repo::root().join(FOLDER)).arg(command);
    if command != "fmt" {
        cargo.arg("--target-dir").arg(repo::root().join(BUILT));
    }
    cargo.args(arguments);
    cargo
}

/// Builds for the named triple, so that the flags do not apply to programs that cargo runs itself.
fn build(triple: &str) -> Command {
    let mut cargo = cargo("build", &["--release", "--bins", "--target", triple]);
    cargo.env("CARGO_ENCODED_RUSTFLAGS", FLAGS.join("\x1f"));
    cargo
}

/// New inputs go to a folder of their own, so that the committed corpus grows by hand only; one that
/// fails is left in `target/fuzz/failed`.
fn run(target: &str, triple: &str) -> Command {
    let built = repo::root().join(BUILT);
    let (found, failed) = (built.join("found").join(target), built.join("failed"));
    for folder in [&found, &failed] {
        // If it fails, the run reports that the folder is missing.
        let _ = std::fs::create_dir_all(folder);
    }
    let mut fuzzer = Command::new(built.join(triple).join("release").join(target));
    fuzzer
        .current_dir(repo::root())
        .arg(found)
        .arg(format!("{FOLDER}/corpus/{target}"))
        .arg(format!("-max_total_time={SECONDS}"))
        .args(["-max_len=700", "-timeout=20", "-verbosity=0"])
        .args(["-print_final_stats=1"])
        .arg(format!("-artifact_prefix={}/{target}-", failed.display()));
    fuzzer
}
