//! The tools that must be installed, how they are found, and the names of their packages. The tools themselves are
//! looked for each time, since that takes milliseconds, and a record of an installation would be wrong after a
//! clean-up.

use crate::repo;
use crate::toolchain::Toolchain;
use crate::{machine, mutants, python, toolchain};
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

/// The work of a command, which determines the tools that it needs.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Purpose {
    /// Building images, for any board.
    Firmware,
    /// Building images for the Nano.
    Avr,
    /// Building images for the STM32.
    Arm,
    /// Running the STM32 in QEMU.
    Machine,
    /// Running the STM32 as it is flashed.
    Core,
    /// Building and running the simulated bus.
    Simulator,
    /// Running an independent Modbus client.
    Client,
    /// Counting the instructions of programs on the host.
    Profiler,
    /// Other checks of `test`.
    Checks,
    /// Planting faults in code that the host builds.
    Mutants,
}

/// A tool that must be installed.
pub struct Need {
    /// The name of the tool.
    pub name: &'static str,
    /// The work that needs the tool.
    pub purpose: Purpose,
    /// Returns where the tool was found, or `None`.
    pub found: fn() -> Option<String>,
    /// The Debian packages of the tool; empty if it is not in a package.
    pub debian: &'static [&'static str],
    /// How to install it by hand on other systems.
    pub by_hand: &'static str,
}

impl Need {
    /// How to install the tool, for a list of missing ones.
    pub fn how(&self) -> String {
        if self.debian.is_empty() {
            format!("{}: {}", self.name, self.by_hand)
        } else {
            format!(
                "{}: Debian, Ubuntu: {}; {}",
                self.name,
                self.debian.join(" "),
                self.by_hand
            )
        }
    }
}

/// The Debian packages of the firmware's compiler.
pub const COMPILER_PACKAGES: &[&str] = &["rustc-web", "cargo-web", "rust-web-src"];

/// All tools, in the order in which they are listed.
pub const ALL: &[Need] = &[
    Need {
        name: "firmware compiler",
        purpose: Purpose::Firmware,
        found: || Toolchain::find().map(|found| found.describe()),
        // Not by the list of packages: setup tries rustup first.
        debian: &[],
        by_hand: "with rustup: rustup toolchain install 1.96.0 -c rust-src -c clippy; on Debian \
                  without it: rustc-web cargo-web rust-web-src rust-web-clippy of release 1.96",
    },
    Need {
        name: "avr-gcc",
        purpose: Purpose::Avr,
        found: || program("avr-gcc"),
        debian: &["gcc-avr"],
        by_hand: "Fedora: avr-gcc; Arch: avr-gcc; macOS: brew install osx-cross/avr/avr-gcc",
    },
    Need {
        name: "avr-libc",
        purpose: Purpose::Avr,
        found: avr_libc,
        debian: &["avr-libc"],
        by_hand: "Fedora: avr-libc; Arch: avr-libc; macOS: comes with osx-cross/avr/avr-gcc",
    },
    Need {
        name: "avr-objcopy",
        purpose: Purpose::Avr,
        found: || program("avr-objcopy"),
        debian: &["binutils-avr"],
        by_hand: "Fedora: avr-binutils; Arch: avr-binutils; macOS: brew install osx-cross/avr/avr-binutils",
    },
    Need {
        name: "arm-none-eabi-ld",
        purpose: Purpose::Arm,
        found: || program("arm-none-eabi-ld"),
        debian: &["binutils-arm-none-eabi"],
        by_hand: "Fedora: arm-none-eabi-binutils-cs; Arch: arm-none-eabi-binutils; macOS: brew install arm-none-eabi-binutils",
    },
    Need {
        name: "C compiler",
        purpose: Purpose::Simulator,
        found: || program("cc"),
        debian: &["gcc", "libc6-dev"],
        by_hand: "Fedora: gcc; Arch: base-devel; macOS: xcode-select --install",
    },
    Need {
        name: "make",
        purpose: Purpose::Simulator,
        found: || program("make"),
        debian: &["make"],
        by_hand: "Fedora: make; Arch: base-devel; macOS: xcode-select --install",
    },
    Need {
        name: "pkg-config",
        purpose: Purpose::Simulator,
        found: || program("pkg-config"),
        debian: &["pkg-config"],
        by_hand: "Fedora: pkgconf-pkg-config; Arch: pkgconf; macOS: brew install pkgconf",
    },
    Need {
        name: "libclang",
        purpose: Purpose::Simulator,
        found: libclang,
        debian: &["libclang-dev"],
        by_hand: "Fedora: clang-devel; Arch: clang; macOS: brew install llvm",
    },
    Need {
        name: "libelf headers",
        purpose: Purpose::Simulator,
        found: || header("libelf.h"),
        debian: &["libelf-dev"],
        by_hand: "Fedora: elfutils-libelf-devel; Arch: libelf; macOS: brew install libelf",
    },
    Need {
        name: "zstd headers",
        purpose: Purpose::Simulator,
        found: || header("zstd.h"),
        debian: &["libzstd-dev"],
        by_hand: "Fedora: libzstd-devel; Arch: zstd; macOS: brew install zstd",
    },
    Need {
        name: "zlib headers",
        purpose: Purpose::Simulator,
        found: || header("zlib.h"),
        debian: &["zlib1g-dev"],
        by_hand: "Fedora: zlib-devel; Arch: zlib; macOS: part of the system's tools",
    },
    Need {
        name: "QEMU 10 for ARM",
        purpose: Purpose::Machine,
        found: machine::qemu,
        // Not by the list of packages: some releases have it in their backports only.
        debian: &[],
        by_hand: "Debian, Ubuntu: qemu-system-arm of version 10 or newer, for Debian 12 from its backports; Fedora: \
                  qemu-system-arm; Arch: qemu-system-arm; macOS: brew install qemu",
    },
    Need {
        name: "QEMU's barrier",
        purpose: Purpose::Machine,
        found: machine::barrier,
        debian: &[],
        by_hand: "cargo xtask setup compiles it from sim/qemu/barrier.c once there is a C compiler",
    },
    Need {
        name: "Unicorn's library",
        purpose: Purpose::Core,
        found: python::unicorn,
        // It comes with a Python package, which set-up installs with the others.
        debian: &[],
        by_hand: "Python 3.10 or newer with venv and access to a Python package registry: cargo xtask setup puts it into \
                  target/python",
    },
    Need {
        name: "mbpoll",
        purpose: Purpose::Client,
        found: || program("mbpoll"),
        debian: &["mbpoll"],
        by_hand: "elsewhere: build it from the repository epsilonrt/mbpoll",
    },
    Need {
        name: "valgrind",
        purpose: Purpose::Profiler,
        found: || program("valgrind"),
        debian: &["valgrind"],
        by_hand: "Fedora, Arch: valgrind; macOS: only up to the version that its site names",
    },
    Need {
        name: "sigrok-cli",
        purpose: Purpose::Checks,
        found: || program("sigrok-cli"),
        debian: &["sigrok-cli"],
        by_hand: "Fedora, Arch, macOS with Homebrew: sigrok-cli",
    },
    Need {
        name: "avrdude",
        purpose: Purpose::Checks,
        found: || program("avrdude"),
        debian: &["avrdude"],
        by_hand: "Fedora, Arch, macOS with Homebrew: avrdude",
    },
    Need {
        name: "firmware clippy",
        purpose: Purpose::Checks,
        found: || {
            Toolchain::find()?
                .has_clippy()
                .then(|| toolchain::RELEASE.to_owned())
        },
        debian: &[],
        by_hand: "with rustup: rustup component add clippy --toolchain 1.96.0; on Debian without \
                  it: rust-web-clippy",
    },
    Need {
        name: "rustfmt and clippy",
        purpose: Purpose::Checks,
        found: host_lints,
        debian: &[],
        by_hand: "with rustup: rustup component add rustfmt clippy",
    },
    Need {
        name: "Python with pymodbus",
        purpose: Purpose::Checks,
        found: python::found,
        // The packages bring Python itself; pymodbus comes from its own registry.
        debian: &[],
        by_hand: "Python 3.10 or newer with venv (Debian: python3 python3-venv; Fedora: python3; \
                  Arch: python; macOS: brew install python) and access to a Python package registry",
    },
    Need {
        name: "cargo-mutants",
        purpose: Purpose::Mutants,
        found: || mutants::program().map(|path| path.display().to_string()),
        debian: &[],
        by_hand: "cargo install cargo-mutants --locked",
    },
];

fn program(name: &str) -> Option<String> {
    repo::in_path(name).map(|path| path.display().to_string())
}

/// The start-up object of the Nano's chip is what the linker takes from avr-libc.
fn avr_libc() -> Option<String> {
    let file = repo::output_of(
        Command::new("avr-gcc").args(["-mmcu=atmega328p", "-print-file-name=crtatmega328p.o"]),
    )?;
    // Without it avr-gcc gives the bare name back.
    Path::new(&file).is_absolute().then_some(file)
}

fn header(name: &str) -> Option<String> {
    let mut compiler = Command::new("cc")
        .args(["-E", "-x", "c", "-", "-o", "/dev/null"])
        .stdin(Stdio::piped())
        .stdout(Stdio::null())
        .stderr(Stdio::null())
        .spawn()
        .ok()?;
    let source = format!("#include <{name}>\n");
    std::io::Write::write_all(&mut compiler.stdin.take()?, source.as_bytes()).ok()?;
    compiler.wait().ok()?.success().then(|| name.to_owned())
}

/// The library that bindgen loads, and the compiler's own headers without which it reads no source.
fn libclang() -> Option<String> {
    if let Some(set) = std::env::var_os("LIBCLANG_PATH") {
        let path = PathBuf::from(set);
        return path.exists().then(|| path.display().to_string());
    }
    let mut folders: Vec<PathBuf> = subfolders("/usr/lib", |name| name.starts_with("llvm"))
        .map(|llvm| llvm.join("lib"))
        .collect();
    folders.extend(subfolders("/usr/lib", |name| name.contains("-linux-")));
    folders.extend(
        [
            "/usr/lib64",
            "/usr/lib",
            "/usr/local/lib",
            "/opt/homebrew/opt/llvm/lib",
            "/usr/local/opt/llvm/lib",
            "/Library/Developer/CommandLineTools/usr/lib",
        ]
        .map(PathBuf::from),
    );
    let headers = |folder: &Path| {
        subfolders(folder.join("clang"), |_| true)
            .any(|version| version.join("include/stddef.h").exists())
    };
    let found = folders.iter().find_map(|folder| library_in(folder))?;
    folders
        .iter()
        .any(|folder| headers(folder))
        .then(|| found.display().to_string())
}

fn library_in(folder: &Path) -> Option<PathBuf> {
    let entries = std::fs::read_dir(folder).ok()?;
    entries.flatten().map(|entry| entry.path()).find(|path| {
        let name = path.file_name().unwrap_or_default().to_string_lossy();
        (name.starts_with("libclang.so") || name.starts_with("libclang-") && name.contains(".so"))
            || name == "libclang.dylib"
    })
}

fn subfolders(folder: impl AsRef<Path>, wanted: fn(&str) -> bool) -> impl Iterator<Item = PathBuf> {
    std::fs::read_dir(folder)
        .into_iter()
        .flatten()
        .flatten()
        .filter(move |entry| wanted(&entry.file_name().to_string_lossy()))
        .map(|entry| entry.path())
}

fn host_lints() -> Option<String> {
    for tool in ["fmt", "clippy"] {
        repo::output_of(repo::cargo().args([tool, "--version"]))?;
    }
    Some("the host's toolchain".to_owned())
}
