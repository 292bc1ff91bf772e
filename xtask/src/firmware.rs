//! Building firmware images: the board's cargo, then the files that are flashed and simulated.

use crate::cli::ImageRequest;
use crate::error::Error;
use crate::image::{Board, Image, word};
use crate::needs::Purpose;
use crate::toolchain::Toolchain;
use crate::{job, repo, setup, size, whole};
use std::fs::{self, File, TryLockError};
use std::hash::{DefaultHasher, Hash, Hasher};
use std::io::ErrorKind;
use std::path::{Path, PathBuf};
use std::process::Command;

/// The sources of an image: folders, and the manifest from which their packages inherit.
const SOURCES: &[&str] = &["protocol", "firmware", "apps", "Cargo.toml"];

/// The Nano's HAL.
const HAL: &str = "board-nano/embassy-avr-hal";

/// `build`: the image, its sizes, and its path on the last line.
///
/// [`Error::usage`] for an image that does not exist or a missing compiler, before anything is built; else the error
/// of cargo.
pub fn build_and_show(request: &ImageRequest) -> Result<(), Error> {
    let image = Image::new(request.board, request.app, (&request.options).into())?;
    setup::require(&[Purpose::Firmware, purpose_of(image.board())])?;
    Builder::new()?.build(&image)?;
    let elf = image.elf();
    print!(
        "{}",
        size::of(&repo::root().join(&elf))?.shown(image.board())
    );
    if image.lacks_watchdog() {
        println!("{WITHOUT_WATCHDOG}");
    }
    println!("image: {}", elf.display());
    Ok(())
}

/// The note for an image for the old boot loader.
pub const WITHOUT_WATCHDOG: &str =
    "without watchdog: after a reset by the watchdog the old boot loader would restart for ever";

/// `example`: a program that only tests run, or an example of the Nano's HAL, and its path on the last line.
///
/// # Errors
/// [`Error::usage`] for a missing compiler, before anything is built; else the error of cargo.
pub fn build_example(name: &str, stm32: bool, qemu: bool, baud: Option<u32>) -> Result<(), Error> {
    let board = if stm32 { Board::Stm32 } else { Board::Nano };
    setup::require(&[Purpose::Firmware, purpose_of(board)])?;
    let made = Builder::new()?.example(board, qemu, name, baud)?;
    println!("image: {}", made.display());
    Ok(())
}

/// What building for a board needs besides the compiler.
pub fn purpose_of(board: Board) -> Purpose {
    match board {
        Board::Nano => Purpose::Avr,
        Board::Stm32 => Purpose::Arm,
    }
}

/// Builds images with one compiler, looked up once.
pub struct Builder {
    toolchain: Toolchain,
}

impl Builder {
    /// # Errors
    /// [`Error::usage`] when the firmware compiler is missing.
    pub fn new() -> Result<Self, Error> {
        let toolchain = Toolchain::find()
            .ok_or_else(|| Error::usage("the firmware compiler is not installed"))?;
        Ok(Self { toolchain })
    }

    /// The compiler for the firmware.
    pub fn toolchain(&self) -> &Toolchain {
        &self.toolchain
    }

    /// Builds `image`, unless its file was made from these sources, options and compiler already. Returns the full
    /// path of the ELF file.
    ///
    /// # Errors
    /// [`Error::failed`] when cargo or avr-objcopy fails.
    pub fn build(&self, image: &Image) -> Result<PathBuf, Error> {
        let elf = repo::root().join(image.elf());
        let hex = elf.with_extension("hex");
        let stamp = elf.with_extension("stamp");
        let folder = elf.parent().expect("a file in a folder");
        fs::create_dir_all(folder).map_err(|error| Error::io(folder.display(), error))?;

        // Cargo builds all images of an application under one name: until the image is copied, no other build may
        // begin.
        let lock_path = folder.join("lock");
        let lock =
            File::create(&lock_path).map_err(|error| Error::io(lock_path.display(), error))?;
        job::wait_until(|| match lock.try_lock() {
            Ok(()) => Ok(true),
            Err(TryLockError::WouldBlock) => Ok(false),
            Err(TryLockError::Error(error)) => Err(Error::io(lock_path.display(), error)),
        })?;

        let key = self.key(image)?;
        let fresh = fs::read_to_string(&stamp).is_ok_and(|made| made == key);
        let has_hex = image.board() == Board::Nano;
        if fresh && elf.exists() && (hex.exists() || !has_hex) {
            return Ok(elf);
        }
        // If this build fails, the file must not have the old stamp.
        match fs::remove_file(&stamp) {
            Err(error) if error.kind() != ErrorKind::NotFound => {
                return Err(Error::io(stamp.display(), error));
            }
            _ => {}
        }
        self.compile(image)?;
        let made = match image.board() {
            Board::Nano => format!("avr-none/release/{}.elf", image.app()),
            Board::Stm32 => format!("thumbv7em-none-eabihf/release/{}", image.app()),
        };
        let made = repo::root().join(image.board().target_dir()).join(made);
        whole::copy(&made, &elf)?;
        if has_hex {
            whole::made(&hex, |hex| {
                job::run(
                    Command::new("avr-objcopy")
                        // The hex file is for the flash only; EEPROM has its own.
                        .args(["-O", "ihex", "-R", ".eeprom"])
                        .args([elf.as_path(), hex]),
                )
            })?;
        }
        whole::write(&stamp, key.as_bytes())?;
        Ok(elf)
    }

    /// Builds a program that only tests run, for the STM32 in QEMU if `qemu`, or an example of the Nano's HAL, and gives its path,
    /// from the root of the repository.
    ///
    /// # Errors
    /// [`Error::failed`] when cargo fails.
    pub fn example(
        &self,
        board: Board,
        qemu: bool,
        name: &str,
        baud: Option<u32>,
    ) -> Result<PathBuf, Error> {
        let mut cargo = self.toolchain.cargo_in_board(board);
        let shown = format!("{HAL}/examples/{name}.rs");
        let is_shown = board == Board::Nano && repo::root().join(shown).is_file();
        cargo.args(["build", "--release"]);
        match board {
            Board::Nano if is_shown => cargo.args(["--package", "embassy-avr-hal", "--example"]),
            Board::Nano => cargo.args(["--package", "nano-fixtures", "--bin"]),
            Board::Stm32 => cargo.args(["--package", "stm32-fixtures", "--bin"]),
        };
        cargo.arg(name);
        if qemu {
            cargo.args(["--no-default-features", "--features", "qemu"]);
        }
        cargo
            .arg("--target-dir")
            .arg(repo::root().join(board.target_dir()));
        match baud {
            Some(baud) => cargo.env("MULTIDROP_BAUD", baud.to_string()),
            None => cargo.env_remove("MULTIDROP_BAUD"),
        };
        repo::run(&mut cargo)?;
        let made = match board {
            Board::Nano if is_shown => format!("target/avr/avr-none/release/examples/{name}.elf"),
            Board::Nano => format!("target/avr/avr-none/release/{name}.elf"),
            Board::Stm32 => format!("target/stm32/thumbv7em-none-eabihf/release/{name}"),
        };
        let Some(baud) = baud else {
            return Ok(made.into());
        };
        // The image at another rate has the same name.
        let kept = format!(
            "target/firmware/{}-example-{name}-baud{baud}{}.elf",
            word(board),
            if qemu { "-qemu" } else { "" }
        );
        let folder = repo::root().join("target/firmware");
        fs::create_dir_all(&folder).map_err(|error| Error::io(folder.display(), error))?;
        whole::copy(&repo::root().join(made), &repo::root().join(&kept))?;
        Ok(kept.into())
    }

    fn compile(&self, image: &Image) -> Result<(), Error> {
        eprintln!("building {}", image.stem());
        let mut cargo = self.toolchain.cargo_in_board(image.board());
        cargo
            .args(["build", "--release", "--bin", &image.app()])
            .arg("--target-dir")
            .arg(repo::root().join(image.board().target_dir()));
        let (by_default, features) = image.features();
        if !by_default {
            cargo.arg("--no-default-features");
        }
        if !features.is_empty() {
            cargo.args(["--features", &features.join(",")]);
        }
        for (name, value) in image.environment() {
            match value {
                Some(value) => cargo.env(name, value),
                None => cargo.env_remove(name),
            };
        }
        job::run(&mut cargo)
    }

    /// A key of everything that the image depends on. The contents of the sources count, not their dates, which a
    /// checkout changes.
    fn key(&self, image: &Image) -> Result<String, Error> {
        let mut files = Vec::new();
        let board = image.board().folder();
        for source in SOURCES.iter().chain([&board]) {
            collect_files(&repo::root().join(source), &mut files)
                .map_err(|error| Error::io(source, error))?;
        }
        files.sort();
        let mut hasher = DefaultHasher::new();
        self.toolchain.version().hash(&mut hasher);
        image.environment().hash(&mut hasher);
        image.features().hash(&mut hasher);
        for file in files {
            let contents = fs::read(&file).map_err(|error| Error::io(file.display(), error))?;
            (file, contents).hash(&mut hasher);
        }
        Ok(format!("{:016x}\n", hasher.finish()))
    }
}

/// Every file below `path`, except build results.
pub fn collect_files(path: &Path, files: &mut Vec<PathBuf>) -> std::io::Result<()> {
    if !path.is_dir() {
        files.push(path.to_owned());
        return Ok(());
    }
    for entry in fs::read_dir(path)? {
        let entry = entry?;
        if entry.file_name() != "target" {
            collect_files(&entry.path(), files)?;
        }
    }
    Ok(())
}
