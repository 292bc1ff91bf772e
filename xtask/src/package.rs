//! The packages for the registry: put together as `cargo publish` would, looked through, and built from what is in them.
//!
//! Nothing is fetched: all that they depend on has been built before, with the same lock files.

use crate::error::Error;
use crate::image::Board;
use crate::repo;
use crate::tally::Tally;
use crate::toolchain::Toolchain;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;

/// Packages of the workspace; each may depend on those before it.
const OF_WORKSPACE: [&str; 2] = ["multidrop-protocol", "multidrop"];

/// The package for the chip, and its folder.
const HAL: &str = "embassy-avr-hal";
const HAL_FOLDER: &str = "board-nano/embassy-avr-hal";

/// What takes the place of what is not published yet, for the HAL: package and folder.
const NOT_PUBLISHED: [(&str, &str); 1] = [("multidrop-protocol", "protocol")];

/// Where cargo and we unpack packages, from the root. Cargo looks for no workspace above a folder of this name.
const UNPACKED: &str = "target/package";

/// Files that a package has beside its sources.
const FILES: [&str; 3] = ["README.md", "LICENSE-MIT", "LICENSE-APACHE"];

/// What the registry, docs.rs and cargo want to know of a package.
const FIELDS: [&str; 7] = [
    "description",
    "license",
    "readme",
    "keywords",
    "categories",
    "rust-version",
    "metadata",
];

/// Every check of the packages.
pub fn run(tally: &mut Tally, toolchain: Option<&Toolchain>) {
    let (ours, of_chip) = (
        repo::root().join("target"),
        repo::root().join(Board::Nano.target_dir()),
    );
    // An archive of an earlier run would be looked through in place of one that could not be made.
    for (target, name) in OF_WORKSPACE
        .map(|name| (&ours, name))
        .into_iter()
        .chain([(&of_chip, HAL)])
    {
        let _ = fs::remove_file(archive(target, name));
    }
    let mut package =
        repo::cargo_in_root(&["package", "--offline", "--allow-dirty", "--no-verify"]);
    for name in OF_WORKSPACE {
        package.args(["--package", name]);
    }
    check(tally, "packages of the workspace", || {
        repo::run(&mut package)
    });
    // Cargo's own build of a package takes what an earlier run has unpacked of the ones before it.
    let mut before: Vec<String> = Vec::new();
    for name in OF_WORKSPACE {
        let mut folder = None;
        check(tally, &format!("contents of the package {name}"), || {
            look_through(folder.insert(unpack(&ours, name)?))
        });
        check(tally, &format!("{name} built from its package"), || {
            let folder = folder
                .as_ref()
                .ok_or_else(|| Error::failed("there is no package"))?;
            let mut build = repo::cargo();
            build
                .current_dir(folder)
                .args(["build", "--offline", "--target-dir"])
                .arg(&ours);
            for patch in &before {
                build.args(["--config", patch]);
            }
            before.push(format!("patch.crates-io.{name}.path={folder:?}"));
            repo::run(&mut build)
        });
    }
    let Some(toolchain) = toolchain else {
        return tally.check(&format!("package {HAL}"), false);
    };
    check(tally, &format!("package {HAL}"), || {
        let mut package = hal(toolchain, &["package", "--no-verify", "--allow-dirty"]);
        repo::run(package.current_dir(repo::root().join(HAL_FOLDER)))
    });
    let mut folder = None;
    check(tally, &format!("contents of the package {HAL}"), || {
        look_through(folder.insert(unpack(&of_chip, HAL)?))
    });
    for (name, features) in [
        (format!("{HAL} built from its package"), &[][..]),
        (
            format!("{HAL} built from its package with the line"),
            &["--features", "modbus"],
        ),
    ] {
        check(tally, &name, || {
            let folder = folder.as_ref();
            let folder = folder.ok_or_else(|| Error::failed("there is no package"))?;
            let mut build = hal(toolchain, &["rustc", "--release"]);
            build.args(features).args(["--", "-D", "warnings"]);
            repo::run(build.current_dir(folder))
        });
    }
}

/// The chip's cargo with the settings of the board, and with the folders of this repository for what is not published yet.
fn hal(toolchain: &Toolchain, arguments: &[&str]) -> Command {
    let root = repo::root();
    let mut cargo = toolchain.cargo_in_board(Board::Nano);
    cargo
        .args(arguments)
        .arg("--offline")
        .arg("--target-dir")
        .arg(root.join(Board::Nano.target_dir()))
        .arg("--config")
        .arg(root.join(Board::Nano.folder()).join(".cargo/config.toml"));
    for (name, folder) in NOT_PUBLISHED {
        let folder = root.join(folder);
        cargo
            .arg("--config")
            .arg(format!("patch.crates-io.{name}.path={folder:?}"));
    }
    cargo
}

fn check(tally: &mut Tally, name: &str, attempt: impl FnOnce() -> Result<(), Error>) {
    println!("\n== {name}");
    let outcome = attempt();
    if let Err(error) = &outcome {
        println!("{}", error.message());
    }
    tally.check(name, outcome.is_ok());
}

/// Name and version: all packages have the version of the workspace.
fn stem(name: &str) -> String {
    format!("{name}-{}", env!("CARGO_PKG_VERSION"))
}

/// Where cargo puts the package.
fn archive(target: &Path, name: &str) -> PathBuf {
    target.join("package").join(stem(name) + ".crate")
}

/// Unpacks the package that cargo has put into `target/package`, and says where it is now.
fn unpack(target: &Path, name: &str) -> Result<PathBuf, Error> {
    let folder = repo::root().join(UNPACKED);
    fs::create_dir_all(&folder).map_err(|error| Error::io(folder.display(), error))?;
    let unpacked = folder.join(stem(name));
    if unpacked.exists() {
        fs::remove_dir_all(&unpacked).map_err(|error| Error::io(unpacked.display(), error))?;
    }
    // With the present time: cargo gives all files of a package one time, and would take an earlier build for one of these.
    let mut tar = Command::new("tar");
    tar.arg("-xzmf").arg(archive(target, name));
    repo::run(tar.arg("-C").arg(&folder))?;
    Ok(unpacked)
}

fn look_through(package: &Path) -> Result<(), Error> {
    let lacks = lacking(package)?;
    if lacks.is_empty() {
        return Ok(());
    }
    Err(Error::failed(format!("it lacks {}", lacks.join(", "))))
}

/// What is missing in an unpacked package.
///
/// # Errors
/// [`Error::failed`] for a manifest that cannot be read.
fn lacking(package: &Path) -> Result<Vec<String>, Error> {
    let manifest = package.join("Cargo.toml");
    let text =
        fs::read_to_string(&manifest).map_err(|error| Error::io(manifest.display(), error))?;
    let table: toml::Table = toml::from_str(&text)
        .map_err(|error| Error::failed(format!("{}: {error}", manifest.display())))?;
    let fields = table.get("package").and_then(toml::Value::as_table);
    let is_there = |field: &str| {
        fields.is_some_and(|fields| match fields.get(field) {
            Some(toml::Value::String(text)) => !text.is_empty(),
            Some(toml::Value::Array(list)) => !list.is_empty(),
            Some(toml::Value::Table(table)) => table
                .get("docs")
                .is_some_and(|docs| docs.get("rs").is_some()),
            _ => false,
        })
    };
    let is_file = |name: &str| {
        let file = package.join(name);
        fs::read(file).is_ok_and(|contents| !contents.is_empty())
    };
    let files = FILES.into_iter().filter(|name| !is_file(name));
    let fields = FIELDS.into_iter().filter(|field| !is_there(field));
    Ok(files.chain(fields).map(str::to_owned).collect())
}

#[cfg(test)]
mod tests {
    use super::*;

    const SOUND: &str = "[package]\nname = \"a\"\ndescription = \"b\"\nlicense = \"MIT\"\nreadme = \"README.md\"\n\
        keywords = [\"c\"]\ncategories = [\"d\"]\nrust-version = \"1.88\"\n[package.metadata.docs.rs]\nall-features = true\n";

    /// What is missing in a package of this manifest, without one of its files.
    fn lacks(manifest: &str, without: &str) -> Vec<String> {
        let folder = tempfile::tempdir().expect("a folder");
        fs::write(folder.path().join("Cargo.toml"), manifest).expect("written");
        for name in FILES.into_iter().filter(|name| *name != without) {
            fs::write(folder.path().join(name), "text").expect("written");
        }
        lacking(folder.path()).expect("a manifest")
    }

    #[test]
    fn a_package_lacks_what_is_not_there_and_nothing_else() {
        assert_eq!(lacks(SOUND, ""), [""; 0]);
        for name in FILES {
            assert_eq!(lacks(SOUND, name), [name]);
        }
        for field in FIELDS {
            let lines = SOUND.lines().filter(|line| !line.contains(field));
            let text: Vec<_> = lines.collect();
            assert_eq!(lacks(&text.join("\n"), ""), [field]);
        }
        assert_eq!(lacks(&SOUND.replace("[\"c\"]", "[]"), ""), ["keywords"]);
        assert_eq!(
            lacks(&SOUND.replace("docs.rs", "other"), ""),
            ["metadata"],
            "settings of something else"
        );
    }
}
