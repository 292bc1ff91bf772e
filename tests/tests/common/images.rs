//! Firmware images, built from the sources as they are now.

use std::collections::HashMap;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::sync::{Mutex, OnceLock, PoisonError};

use multidrop_bus::Line;

use super::LINE;

/// Results of builds, made once in each process.
type Built = Mutex<HashMap<String, PathBuf>>;

fn once(key: String, build: impl FnOnce() -> PathBuf) -> PathBuf {
    static BUILT: OnceLock<Built> = OnceLock::new();
    // Held while building, so that two tests do not build the same image.
    let mut built = BUILT
        .get_or_init(Default::default)
        .lock()
        .unwrap_or_else(PoisonError::into_inner);
    built.entry(key).or_insert_with(build).clone()
}

fn root() -> &'static Path {
    Path::new(env!("CARGO_MANIFEST_DIR"))
        .parent()
        .expect("this package lies in the repository")
}

fn run(command: &mut Command) -> String {
    let output = command
        .output()
        .unwrap_or_else(|error| panic!("{command:?}: {error}"));
    let text = String::from_utf8_lossy(&output.stdout).into_owned();
    assert!(
        output.status.success(),
        "{command:?}\n{text}{}",
        String::from_utf8_lossy(&output.stderr)
    );
    text
}

/// The image of a Nano's application, as `cargo xtask build nano APP OPTIONS` makes it.
pub fn image(app: &str, options: &[&str]) -> PathBuf {
    once(format!("{app} {}", options.join(" ")), || {
        let cargo = std::env::var_os("CARGO").unwrap_or_else(|| "cargo".into());
        let text = run(Command::new(cargo)
            .current_dir(root())
            .args(["xtask", "build", "nano", app])
            .args(options));
        let path = text
            .lines()
            .last()
            .and_then(|line| line.strip_prefix("image: "))
            .unwrap_or_else(|| panic!("no path in {text}"));
        root().join(path)
    })
}

/// The `registers` image with `count` items in each table, for `line`.
pub fn registers(count: u8, line: Line) -> PathBuf {
    let (count, baud) = (count.to_string(), line.baud.to_string());
    let format = line.format.to_string();
    let mut options = Vec::new();
    if count != "16" {
        options.extend(["--count", &count]);
    }
    if line.baud != LINE.baud {
        options.extend(["--baud", &baud]);
    }
    if line.format != LINE.format {
        options.extend(["--format", &format]);
    }
    image("registers", &options)
}

/// The image of an example of the HAL.
pub fn example(name: &str) -> PathBuf {
    once(format!("example {name}"), || {
        let target = root().join("target/avr");
        let mut cargo = firmware_cargo();
        cargo
            .current_dir(root().join("board-nano"))
            .env("RUSTC_BOOTSTRAP", "1")
            .args(["build", "--release", "--package", "embassy-avr-hal"])
            .args(["--example", name, "--target-dir"])
            .arg(&target);
        // What cargo and rustup set for the host's build is not for the AVR's.
        for variable in [
            "RUSTFLAGS",
            "CARGO_ENCODED_RUSTFLAGS",
            "CARGO_BUILD_RUSTFLAGS",
            "CARGO_BUILD_TARGET",
            "CARGO_TARGET_DIR",
            "CARGO",
        ] {
            cargo.env_remove(variable);
        }
        run(&mut cargo);
        target.join(format!("avr-none/release/examples/{name}.elf"))
    })
}

/// cargo of the firmware's compiler: the one that `cargo xtask setup` has left in rustup or, where
/// there is no rustup, the distribution's.
fn firmware_cargo() -> Command {
    let Ok(listed) = Command::new("rustup").args(["toolchain", "list"]).output() else {
        let mut cargo = Command::new("/usr/bin/cargo");
        cargo.env("RUSTC", "/usr/bin/rustc");
        return cargo;
    };
    let listed = String::from_utf8_lossy(&listed.stdout).into_owned();
    let names = || listed.lines().filter_map(|line| line.split(' ').next());
    let toolchain = names()
        .find(|name| name.starts_with("1.96.0"))
        .or_else(|| names().find(|name| *name == "firmware"))
        .expect("the firmware's compiler, from cargo xtask setup");
    let mut cargo = Command::new("rustup");
    cargo.args(["run", toolchain, "cargo"]);
    cargo
}
