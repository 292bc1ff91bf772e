//! `setup`: installs what is missing, and lists what must be installed by hand.

use crate::error::Error;
use crate::needs::{ALL, COMPILER_PACKAGES, Need, Purpose};
use crate::toolchain::{LINKED, RELEASE, SYSTEM_PREFIX, Toolchain};
use crate::{machine, mutants, python, repo};
use std::io::Write;
use std::process::{Command, Stdio};

/// Runs `setup --check`: lists what is installed and what is missing; changes nothing.
///
/// # Errors
/// Exit code 1 when something is missing.
pub fn report() -> Result<(), Error> {
    if list(&[]) {
        return Ok(());
    }
    println!("`cargo xtask setup` installs what it can");
    Err(Error::silent(1))
}

/// Lists all tools, and whether each is installed, after `added` were to be installed. Returns whether all are.
fn list(added: &[&Need]) -> bool {
    let mut complete = true;
    for need in ALL {
        let was_added = added.iter().any(|one| one.name == need.name);
        match (need.found)() {
            Some(place) if was_added => println!("installed  {:<22}{place}", need.name),
            Some(place) => println!("ok         {:<22}{place}", need.name),
            None => {
                println!("missing    {}", need.how());
                complete = false;
            }
        }
    }
    complete
}

/// Runs `setup`: installs what is missing.
///
/// # Errors
/// Exit code 1, with the tools that could not be installed, and how to do it by hand.
pub fn install() -> Result<(), Error> {
    let missing = missing(|_| true);
    if missing.is_empty() {
        println!("everything is there already:");
        list(&[]);
        return Ok(());
    }
    add(&missing);

    println!();
    if list(&missing) {
        Ok(())
    } else {
        Err(Error::failed("the missing tools must be installed by hand"))
    }
}

/// Installs those of the missing tools that can be installed.
fn add(missing: &[&'static Need]) {
    for need in missing {
        println!("missing: {}", need.name);
    }
    let is_missing = |name: &str| missing.iter().any(|need| need.name == name);

    if is_missing("firmware compiler") {
        install_compiler();
    }
    if is_missing("firmware clippy") {
        install_firmware_clippy();
    }
    if is_missing("rustfmt and clippy") {
        rustup(&["component", "add", "rustfmt", "clippy"]);
    }
    let packages: Vec<_> = missing
        .iter()
        .flat_map(|need| need.debian)
        .copied()
        .collect();
    apt_install(&packages);
    if is_missing("QEMU 10 for ARM") {
        install_qemu();
    }
    if is_missing("QEMU's barrier")
        && let Err(error) = machine::compile_barrier()
    {
        println!("{}", error.message());
    }
    if is_missing("Python with pymodbus") || is_missing("Unicorn's library") {
        install_python();
    }
    if is_missing("cargo-mutants")
        && let Err(error) = mutants::install()
    {
        println!("{}", error.message());
    }
}

/// Checks that all tools for `purposes` are installed; installs nothing.
///
/// # Errors
/// [`Error::usage`], with the missing tools and their packages.
pub fn require(purposes: &[Purpose]) -> Result<(), Error> {
    let missing = missing(|need| purposes.contains(&need.purpose));
    if missing.is_empty() {
        return Ok(());
    }
    Err(Error::usage(format!(
        "{}\n`cargo xtask setup` installs what it can",
        left_over(&missing)
    )))
}

/// Installs the missing tools for `purposes`, and nothing else.
///
/// # Errors
/// As [`require`].
pub fn prepare(purposes: &[Purpose]) -> Result<(), Error> {
    let missing = missing(|need| purposes.contains(&need.purpose));
    if !missing.is_empty() {
        add(&missing);
    }
    require(purposes)
}

fn missing(wanted: impl Fn(&Need) -> bool) -> Vec<&'static Need> {
    ALL.iter()
        .filter(|need| wanted(need) && (need.found)().is_none())
        .collect()
}

fn left_over(missing: &[&Need]) -> String {
    let mut text = "not installed:".to_owned();
    for need in missing {
        text.push_str("\n  ");
        text.push_str(&need.how());
    }
    text
}

fn install_compiler() {
    if repo::in_path("rustup").is_some() {
        println!("firmware compiler: trying rustup's {RELEASE}");
        let components = ["-c", "rust-src", "-c", "clippy"];
        let install = [
            &["toolchain", "install", RELEASE, "--profile", "minimal"],
            &components[..],
        ]
        .concat();
        if rustup(&install) && Toolchain::find().is_some() {
            println!("firmware compiler: installed by rustup");
            return;
        }
        println!("firmware compiler: rustup cannot get it; trying the distribution's packages");
    }
    if !Toolchain::system_is_complete() && !apt_install(COMPILER_PACKAGES) {
        return;
    }
    if !Toolchain::system_is_complete() {
        println!("firmware compiler: the distribution's packages are of another release");
        return;
    }
    if repo::in_path("rustup").is_some() {
        rustup(&["toolchain", "link", LINKED, SYSTEM_PREFIX]);
    }
    println!("firmware compiler: installed from the distribution's packages");
}

fn install_firmware_clippy() {
    let Some(found) = Toolchain::find() else {
        return;
    };
    if found.has_clippy() {
        return;
    }
    match found.rustup_name() {
        Some(name) => rustup(&["component", "add", "clippy", "--toolchain", name]),
        None => apt_install(&["rust-web-clippy"]),
    };
}

/// Installs QEMU, from Debian's backports if the distribution's own version is too old.
fn install_qemu() {
    let release = match machine::candidate() {
        Some(major) if major >= machine::VERSION_MIN => None,
        // The version is too old, or unknown because the lists were not fetched: then the backports do no harm.
        _ => machine::Backports::of_this_system(),
    };
    let Some(release) = release else {
        apt_install(&[machine::PACKAGE]);
        return;
    };
    let suite = release.suite();
    println!("QEMU: taking it from {suite}");
    if release.is_listed() || as_root(&["tee", machine::BACKPORTS_LIST], Some(&release.list())) {
        apt_install(&["-t", &suite, machine::PACKAGE]);
    }
}

/// Runs a command as root, with `input`.
fn as_root(command: &[&str], input: Option<&str>) -> bool {
    let Some(mut line) = becoming_root() else {
        println!("not root, and no sudo: as root, run {}", command.join(" "));
        return false;
    };
    line.extend(command);
    println!("> {}", line.join(" "));
    let spawned = Command::new(line[0])
        .args(&line[1..])
        .stdin(Stdio::piped())
        .stdout(Stdio::null())
        .spawn();
    let Ok(mut child) = spawned else {
        return false;
    };
    let written = match (child.stdin.take(), input) {
        (Some(mut pipe), Some(input)) => pipe.write_all(input.as_bytes()).is_ok(),
        _ => true,
    };
    child.wait().is_ok_and(|status| status.success()) && written
}

fn install_python() {
    if let Err(first) = python::install() {
        println!("Python: {}", first.message());
        // On Debian the module for environments is a separate package.
        if apt_install(&["python3", "python3-venv"])
            && let Err(second) = python::install()
        {
            println!("Python: {}", second.message());
        }
    }
}

fn rustup(arguments: &[&str]) -> bool {
    if repo::in_path("rustup").is_none() {
        return false;
    }
    println!("> rustup {}", arguments.join(" "));
    let mut command = Command::new("rustup");
    command.args(arguments);
    repo::run(&mut command).is_ok()
}

/// Installs Debian packages: all at once, or one by one if that fails, so that a package that the release lacks does
/// not prevent the others.
fn apt_install(packages: &[&str]) -> bool {
    if packages.is_empty() {
        return true;
    }
    if repo::in_path("apt-get").is_none() {
        println!("no apt-get on this system: install the tools below by hand");
        return false;
    }
    let Some(root) = becoming_root() else {
        println!(
            "not root, and no sudo: as root, run apt-get install {}",
            packages.join(" ")
        );
        return false;
    };
    let apt = |arguments: &[&str]| {
        let mut line = root.clone();
        line.extend(["env", "DEBIAN_FRONTEND=noninteractive", "apt-get"]);
        line.extend([
            "-y",
            "-o",
            "DPkg::Lock::Timeout=120",
            "-o",
            "Dpkg::Use-Pty=0",
        ]);
        line.extend(arguments);
        println!("> {}", line.join(" "));
        repo::run(Command::new(line[0]).args(&line[1..])).is_ok()
    };
    // An outdated list may be sufficient; a failure shows at the installation.
    apt(&["-qq", "update"]);
    let install = ["-qq", "install", "--no-install-recommends"];
    if apt(&[&install, packages].concat()) {
        return true;
    }
    let mut all = packages.len() > 1;
    for package in packages.iter().filter(|_| packages.len() > 1) {
        all &= apt(&[&install[..], &[package]].concat());
    }
    all
}

fn becoming_root() -> Option<Vec<&'static str>> {
    let id = repo::output_of(Command::new("id").arg("-u"))?;
    if id == "0" {
        Some(Vec::new())
    } else {
        repo::in_path("sudo").map(|_| vec!["sudo"])
    }
}
