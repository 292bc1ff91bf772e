//! `flash`, with a stand-in for avrdude that keeps the fuses of a chip and logs its calls.

use multidrop_testkit::places;
mod sims;

use std::fs;
use std::io::Write;
use std::os::unix::fs::{PermissionsExt, chown};
use std::os::unix::process::CommandExt;
use std::process::{Command, Output, Stdio};

use multidrop_testkit::image;
use nix::fcntl::OFlag;
use nix::pty::{grantpt, posix_openpt, ptsname_r, unlockpt};
use nix::unistd::geteuid;
use sims::Sim;
use tempfile::TempDir;

/// Lists programmers; keeps each fuse in a file of its name; logs its calls. With a file `masked` in its folder it writes the bits that
/// are no fuses as 0, as avrdude does; with `deaf` it
/// writes no fuse and says that it has.
const AVRDUDE: &str = r#"
cd "$TMPDIR"
if [ "$2" = "?" ]; then
    printf '\nValid programmers are:\n  arduino            = Boot loader\n  usbasp             = USBasp\n  stk500v1           = STK500\n\n' >&2
    exit 1
fi
echo "$@" >> log
mask=255; [ -e masked ] && mask=7
while [ $# -gt 0 ]; do
    case "$1" in -U) case "$2" in
        ?fuse:r:-:h) cat "${2%%:*}" ;;
        efuse:w:*:m) value=${2#*:w:}; [ -e deaf ] || printf '0x%02x\n' $((${value%:m} & mask)) > efuse ;;
        ?fuse:w:*:m) value=${2#*:w:}; [ -e deaf ] || echo "${value%:m}" > "${2%%:*}" ;;
    esac ;; esac
    shift
done
"#;

/// A Nano as it is sold: 16 MHz crystal, boot loader of 2 KB, 2.7 V.
const SOLD: [&str; 3] = ["0xff", "0xda", "0xfd"];

/// A chip with these fuses, low, high, extended.
fn chip(fuses: [&str; 3]) -> TempDir {
    // What is flashed is built, so that the stand-in has to be called for nothing else.
    image("registers", &[]);
    let folder = Sim::folder();
    for (name, value) in ["lfuse", "hfuse", "efuse"].iter().zip(fuses) {
        fs::write(folder.path().join(name), format!("{value}\n")).expect("written");
    }
    sims::stand_in(&folder, "avrdude", AVRDUDE);
    folder
}

fn flash(chip: &TempDir, words: &str) -> Command {
    let mut command = Command::new(places::xtask());
    sims::settle(&mut command, chip);
    command
        .env("CARGO_MANIFEST_DIR", places::root())
        .args(["flash", "nano", "registers"])
        .args(words.split_whitespace())
        .stdin(Stdio::null());
    command
}

fn run(chip: &TempDir, words: &str) -> Output {
    flash(chip, words).output().expect("it runs")
}

fn answered(chip: &TempDir, words: &str, answer: &str) -> Output {
    let mut command = flash(chip, words);
    command.stdin(Stdio::piped()).stdout(Stdio::piped());
    let mut child = command.stderr(Stdio::piped()).spawn().expect("it runs");
    let mut stdin = child.stdin.take().expect("piped");
    stdin.write_all(answer.as_bytes()).expect("written");
    drop(stdin);
    child.wait_with_output().expect("it ends")
}

/// Low, high, extended.
fn fuses(chip: &TempDir) -> [String; 3] {
    ["lfuse", "hfuse", "efuse"].map(|name| {
        let value = fs::read_to_string(chip.path().join(name)).expect("a fuse");
        value.trim().to_owned()
    })
}

/// How avrdude was called, without the path of the image.
fn log(chip: &TempDir) -> Vec<String> {
    let log = fs::read_to_string(chip.path().join("log")).unwrap_or_default();
    let folder = places::root().join("target/firmware/");
    let folder = folder.display().to_string();
    log.lines().map(|line| line.replace(&folder, "")).collect()
}

fn said(output: &Output) -> String {
    String::from_utf8_lossy(&[&output.stdout[..], &output.stderr].concat()).into_owned()
}

fn assert_ends(output: &Output, code: i32, parts: &[&str]) {
    let said = said(output);
    assert_eq!(output.status.code(), Some(code), "{said}");
    for part in parts {
        assert!(said.contains(part), "{part:?} is not in {said}");
    }
}

const FLASHED: &str = "-c usbasp -p atmega328p -U flash:w:nano-registers";

#[test]
fn a_programmer_writes_without_a_boot_loader() {
    let chip = chip(SOLD);
    assert_ends(&run(&chip, "--programmer usbasp"), 0, &[]);
    let calls = log(&chip);
    assert_eq!(calls.len(), 1, "{calls:?}");
    assert!(calls[0].starts_with(FLASHED), "{calls:?}");
    assert!(calls[0].ends_with(".hex:i"), "{calls:?}");
    assert_eq!(fuses(&chip), SOLD);
    // An Arduino as programmer has a port and a speed.
    let words = "--programmer stk500v1 --port usb:1";
    assert_ends(&run(&chip, words), 0, &[]);
    let call = "-c stk500v1 -p atmega328p -P usb:1 -b 19200 -U flash:w:";
    assert!(log(&chip)[1].starts_with(call), "{:?}", log(&chip));
}

#[test]
fn fuses_are_shown_and_written_before_the_chip_is_erased() {
    let chip = chip(SOLD);
    let output = run(&chip, "--programmer usbasp --fuses --yes");
    let before = "fuses before: low 0xff, high 0xda, extended 0xfd: brown-out 2.7 V, a reset starts the boot loader, EEPROM erased";
    let after = "fuses after:  low 0xff, high 0xd3, extended 0xfc: brown-out 4.3 V, a reset starts the application, EEPROM kept";
    assert_ends(
        &output,
        0,
        &[before, after, "not for a board that runs from 3.3 V"],
    );
    assert_eq!(fuses(&chip), ["0xff", "0xd3", "0xfc"]);
    let calls = log(&chip);
    let read = "-c usbasp -p atmega328p -q -q -U lfuse:r:-:h -U hfuse:r:-:h -U efuse:r:-:h";
    let written = "-c usbasp -p atmega328p -U hfuse:w:0xd3:m -U efuse:w:0xfc:m";
    assert_eq!(calls[..3], [read, written, read]);
    assert!(calls[3].starts_with(FLASHED), "{calls:?}");

    // Once more there is nothing to write, and nothing to ask; bits that are no fuses may read as 0.
    fs::write(chip.path().join("efuse"), "0x04\n").expect("written");
    let output = run(&chip, "--programmer usbasp --fuses");
    assert_ends(&output, 0, &["the fuses are set already"]);
    assert!(!log(&chip)[4..].iter().any(|call| call.contains("fuse:w:")));
}

#[test]
fn bits_that_are_not_fuses_are_ignored() {
    let chip = chip(["0xff", "0xda", "0x05"]);
    fs::write(chip.path().join("masked"), "").expect("written");
    let output = run(&chip, "--programmer usbasp --fuses --yes");
    assert_ends(
        &output,
        0,
        &["extended 0x04: brown-out 4.3 V", "fuses written"],
    );
    let chip = self::chip(SOLD);
    fs::write(chip.path().join("masked"), "").expect("written");
    let output = run(&chip, "--programmer usbasp --fuses --yes");
    assert_ends(
        &output,
        0,
        &["extended 0xfc: brown-out 4.3 V", "fuses written"],
    );
    assert_eq!(fuses(&chip)[2], "0x04");
}

#[test]
fn fuses_are_written_only_after_confirmation() {
    for answer in ["", "n\n", "\n", "maybe\n"] {
        let chip = chip(SOLD);
        let output = answered(&chip, "--programmer usbasp --fuses", answer);
        assert_ends(&output, 1, &["Write them? [y/N]", "nothing was written"]);
        assert_eq!(fuses(&chip), SOLD);
        assert_eq!(log(&chip).len(), 1, "they are read, and no more");
    }
    let chip = chip(SOLD);
    let output = answered(&chip, "--programmer usbasp --fuses", "y\n");
    assert_ends(&output, 0, &["fuses written"]);
    assert_eq!(fuses(&chip), ["0xff", "0xd3", "0xfc"]);
}

#[test]
fn the_brown_out_level_follows_the_clock_or_the_option() {
    for (words, efuse) in [
        ("--bod 1.8", "0xfe"),
        ("--bod off", "0xff"),
        ("--bod 2.7", "0xfd"),
    ] {
        let chip = chip(SOLD);
        let words = format!("--programmer usbasp --fuses --yes {words}");
        assert_ends(&run(&chip, &words), 0, &[]);
        assert_eq!(fuses(&chip)[2], efuse, "{words}");
    }
    let chip = chip(SOLD);
    let words = "--clock 12000000 --programmer usbasp --fuses --yes";
    assert_ends(&run(&chip, words), 2, &["--fuses", "12000000 Hz", "--bod"]);
    assert_eq!(log(&chip), [""; 0]);
}

#[test]
fn impossible_fuses_stop_the_command() {
    // No wire, and a chip whose SPIEN is off: neither can be read by a programmer.
    for wrong in [
        ["0x00"; 3],
        ["0xff"; 3],
        ["0xff", "0xfa", "0xfd"],
        ["", "", ""],
    ] {
        let chip = chip(wrong);
        let output = run(&chip, "--programmer usbasp --fuses --yes");
        assert_ends(
            &output,
            1,
            &["impossible fuses were read", "Nothing was written"],
        );
        assert_eq!(log(&chip).len(), 1);
    }
    let chip = chip(SOLD);
    fs::write(chip.path().join("deaf"), "").expect("written");
    let output = run(&chip, "--programmer usbasp --fuses --yes");
    assert_ends(&output, 1, &["were not written", "high 0xda"]);
    assert!(!log(&chip).iter().any(|call| call.contains("flash:w:")));
}

#[test]
fn options_that_exclude_each_other_are_refused_by_name() {
    let chip = chip(SOLD);
    for (words, parts) in [
        (
            "--programmer usbsap",
            &["--programmer usbsap", "usbasp, stk500v1"][..],
        ),
        (
            "--programmer arduino",
            &["--programmer arduino", "boot loader"],
        ),
        ("--programmer usbasp --bootloader old", &["--bootloader"]),
        (
            "--programmer usbasp --port /dev/null",
            &["--port /dev/null"],
        ),
        ("--bootloader none", &["--bootloader none", "--programmer"]),
        ("--fuses", &["--fuses", "--programmer"]),
        ("--bod 2.7 --programmer usbasp", &["--fuses"]),
        ("--yes --programmer usbasp", &["--fuses"]),
        (
            "--fuses --programmer usbasp --bod 3.3",
            &["--bod", "3.3", "4.3, 2.7, 1.8, off"],
        ),
    ] {
        assert_ends(&run(&chip, words), 2, parts);
    }
    assert_eq!(log(&chip), [""; 0]);
}

#[test]
fn options_that_an_stm32_does_not_have_are_refused_by_name() {
    let chip = chip(SOLD);
    for words in ["--port /dev/ttyACM0", "--programmer usbasp", "--fuses"] {
        let mut command = Command::new(places::xtask());
        sims::settle(&mut command, &chip);
        command.env("CARGO_MANIFEST_DIR", places::root());
        command.args(["flash", "stm32", "registers"]);
        let output = command.args(words.split_whitespace()).output();
        let name = words.split_whitespace().next().expect("an option");
        let parts = [name, "--unit, --count, --baud, --format, --ascii"];
        assert_ends(&output.expect("it runs"), 2, &parts);
    }
}

#[test]
fn a_port_that_is_not_a_terminal_is_refused() {
    let chip = chip(SOLD);
    for (port, why) in [
        ("no/such/port", "there is no such port"),
        ("lfuse", "not a serial port"),
        (".", "not a serial port"),
        ("/dev/null", "not a serial port"),
    ] {
        assert_ends(&run(&chip, &format!("--port {port}")), 2, &[port, why]);
    }
    assert_eq!(log(&chip), [""; 0]);
    // One that is a terminal is avrdude's.
    let master = posix_openpt(OFlag::O_RDWR | OFlag::O_NOCTTY).expect("a terminal");
    grantpt(&master)
        .and_then(|()| unlockpt(&master))
        .expect("ours");
    let port = ptsname_r(&master).expect("a name");
    assert_ends(&run(&chip, &format!("--port {port}")), 0, &[]);
    let call = format!("-c arduino -p atmega328p -b 57600 -D -P {port} -U flash:w:");
    assert!(log(&chip)[0].starts_with(&call), "{:?}", log(&chip));
}

#[test]
fn a_port_of_another_group_names_the_group() {
    if !geteuid().is_root() {
        println!("not run: only root can make a terminal that belongs to somebody else");
        return;
    }
    let master = posix_openpt(OFlag::O_RDWR | OFlag::O_NOCTTY).expect("a terminal");
    grantpt(&master)
        .and_then(|()| unlockpt(&master))
        .expect("ours");
    let port = ptsname_r(&master).expect("a name");
    // As udev makes serial ports: root, dialout, no others. Group 20 is that on Debian; another system may call it otherwise.
    chown(&port, Some(0), Some(20)).expect("root may");
    fs::set_permissions(&port, fs::Permissions::from_mode(0o660)).expect("root may");
    let groups = fs::read_to_string("/etc/group").expect("groups");
    let group = groups
        .lines()
        .find(|line| line.split(':').nth(2) == Some("20"));
    let group = group
        .and_then(|line| line.split(':').next())
        .unwrap_or("20");

    let mut reach = Command::new("test");
    let reached = reach.arg("-x").arg(places::xtask()).uid(65_534).status();
    if !reached.is_ok_and(|status| status.success()) {
        println!("not run: other users have no way into this checkout");
        return;
    }
    let chip = chip(SOLD);
    chown(chip.path(), Some(65_534), None).expect("root may");
    let mut command = flash(&chip, &format!("--port {port}"));
    let output = command.uid(65_534).gid(65_534).output().expect("it runs");
    let advice = format!("it belongs to the group {group}: sudo usermod -aG {group}");
    assert_ends(&output, 2, &["permission denied", &advice]);
}
