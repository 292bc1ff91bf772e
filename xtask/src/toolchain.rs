//! The compiler for the firmware: one release, which comes from rustup or from the distribution.
//!
//! The boards need the library sources and unstable flags, so the firmware is tied to the one release it
//! was tested with; `RUSTC_BOOTSTRAP=1` makes that stable compiler accept them.

use crate::image::Board;
use crate::repo;
use std::path::PathBuf;
use std::process::Command;

/// The release that the firmware is tested with; the boards' `rust-toolchain.toml` name it too.
pub const RELEASE: &str = "1.96.0";

/// The name under which a distribution's compiler of that release is linked into rustup.
pub const LINKED: &str = "firmware";

/// Where a distribution puts its compiler.
pub const SYSTEM_PREFIX: &str = "/usr";

/// A compiler that can build the firmware: of the right release, with the library sources.
pub struct Toolchain {
    source: Source,
    version: String,
    clippy: bool,
}

enum Source {
    Rustup(String),
    System,
}

impl Toolchain {
    /// The first of: rustup's own, the one linked into rustup, and, where there is no rustup, the
    /// distribution's.
    pub fn find() -> Option<Self> {
        if repo::in_path("rustup").is_none() {
            return Self::probe(Source::System);
        }
        // Asking rustup for a toolchain that it does not have would make it install one.
        let listed = repo::output_of(Command::new("rustup").args(["toolchain", "list"]))?;
        let names: Vec<_> = listed
            .lines()
            .filter_map(|line| line.split_whitespace().next())
            .collect();
        let own = names
            .iter()
            .find(|name| **name == RELEASE || name.starts_with(&format!("{RELEASE}-")));
        let linked = names.iter().find(|name| **name == LINKED);
        [own, linked]
            .into_iter()
            .flatten()
            .find_map(|name| Self::probe(Source::Rustup((*name).to_owned())))
    }

    /// Whether the distribution's compiler is installed, with the library sources.
    pub fn system_is_complete() -> bool {
        Self::probe(Source::System).is_some()
    }

    fn probe(source: Source) -> Option<Self> {
        let version = repo::output_of(source.program("rustc").arg("-vV"))?;
        let sysroot = repo::output_of(source.program("rustc").args(["--print", "sysroot"]))?;
        let sysroot = PathBuf::from(sysroot);
        let right = version.contains(&format!("\nrelease: {RELEASE}\n"));
        let sources = sysroot.join("lib/rustlib/src/rust/library/core/Cargo.toml");
        let clippy = sysroot.join("bin/clippy-driver").exists();
        (right && sources.exists()).then_some(Self {
            source,
            version,
            clippy,
        })
    }

    /// cargo of this toolchain in the board's folder, from which cargo takes its settings.
    pub fn cargo_in_board(&self, board: Board) -> Command {
        let mut command = self.source.program("cargo");
        command.current_dir(repo::root().join(board.folder()));
        command.env("RUSTC_BOOTSTRAP", "1");
        // Settings of the host's build, which would reach the board's compiler or mislead it.
        for name in [
            "RUSTFLAGS",
            "CARGO_ENCODED_RUSTFLAGS",
            "CARGO_BUILD_RUSTFLAGS",
            "CARGO_BUILD_TARGET",
            "CARGO_TARGET_DIR",
            "CARGO",
        ] {
            command.env_remove(name);
        }
        command
    }

    /// Whether clippy of the same release is there.
    pub fn has_clippy(&self) -> bool {
        self.clippy
    }

    /// All that `rustc -vV` says: two builds of one release may hold different versions of LLVM.
    pub fn version(&self) -> &str {
        &self.version
    }

    /// The name and version of the compiler, for people.
    pub fn describe(&self) -> String {
        let llvm = self
            .version
            .lines()
            .find_map(|line| line.strip_prefix("LLVM version: "))
            .unwrap_or("unknown");
        let way = match &self.source {
            Source::Rustup(name) => format!("rustup toolchain {name}"),
            Source::System => format!("{SYSTEM_PREFIX}/bin/rustc"),
        };
        format!("rustc {RELEASE}, LLVM {llvm}, {way}")
    }

    /// The arguments that add clippy to this toolchain, where rustup keeps it.
    pub fn rustup_name(&self) -> Option<&str> {
        match &self.source {
            Source::Rustup(name) if name != LINKED => Some(name),
            _ => None,
        }
    }
}

impl Source {
    fn program(&self, name: &str) -> Command {
        match self {
            Self::Rustup(toolchain) => {
                let mut command = Command::new("rustup");
                command.args(["run", toolchain, name]);
                command
            }
            Self::System => {
                let bin = PathBuf::from(SYSTEM_PREFIX).join("bin");
                let mut command = Command::new(bin.join(name));
                command.env("RUSTC", bin.join("rustc"));
                command.env_remove("RUSTUP_TOOLCHAIN");
                command
            }
        }
    }
}
