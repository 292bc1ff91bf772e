//! Files that are there as a whole or not at all: a simulator never loads half an image, and a full disk leaves nothing behind.

use crate::error::Error;
use std::fs;
use std::path::Path;

/// Has `make` write a file that then takes the place of `path` in one step.
///
/// # Errors
/// What `make` says; [`Error::failed`], which names `path`, if it cannot take its place.
pub fn made(path: &Path, make: impl FnOnce(&Path) -> Result<(), Error>) -> Result<(), Error> {
    let mut name = path.file_name().unwrap_or_default().to_owned();
    name.push(".partial");
    let partial = path.with_file_name(name);
    let finished = make(&partial).and_then(|()| {
        fs::rename(&partial, path).map_err(|error| Error::io(path.display(), error))
    });
    if finished.is_err() {
        // There is nothing, or it is half of it.
        let _ = fs::remove_file(&partial);
    }
    finished
}

/// Writes a file.
///
/// # Errors
/// [`Error::failed`], which names it.
pub fn write(path: &Path, contents: &[u8]) -> Result<(), Error> {
    made(path, |partial| {
        fs::write(partial, contents).map_err(|error| Error::io(path.display(), error))
    })
}

/// Copies a file.
///
/// # Errors
/// [`Error::failed`], which names the one that could not be read, or written.
pub fn copy(from: &Path, to: &Path) -> Result<(), Error> {
    let contents = fs::read(from).map_err(|error| Error::io(from.display(), error))?;
    write(to, &contents)
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::os::unix::fs::symlink;

    /// A folder in which a file `image.elf` is written to a disk that is full.
    fn full_disk(name: &str) -> std::path::PathBuf {
        let folder = std::env::temp_dir().join(format!("xtask-{name}-{}", std::process::id()));
        fs::create_dir_all(&folder).expect("a folder");
        fs::write(folder.join("made"), [0x55; 100_000]).expect("a file");
        symlink("/dev/full", folder.join("image.elf.partial")).expect("a link");
        folder
    }

    #[test]
    fn a_full_disk_names_what_cannot_be_written_and_leaves_nothing() {
        let folder = full_disk("full");
        let (made, image) = (folder.join("made"), folder.join("image.elf"));
        let error = copy(&made, &image).expect_err("the disk is full");
        let said = error.message();
        assert!(said.starts_with(&image.display().to_string()), "{said}");
        assert!(said.contains("No space left"), "{said}");
        let left = fs::read_dir(&folder).expect("a folder").count();
        assert_eq!(left, 1, "only what was to be copied");
        fs::remove_dir_all(&folder).expect("removed");
    }

    #[test]
    fn what_is_not_there_is_named_too() {
        let error = copy(Path::new("no/such/file"), Path::new("image.elf"));
        let said = error.expect_err("not there").message().to_owned();
        assert!(said.starts_with("no/such/file: "), "{said}");
    }

    #[test]
    fn what_was_there_stays_if_it_fails() {
        let folder = full_disk("stays");
        let image = folder.join("image.elf");
        fs::write(&image, "before").expect("a file");
        assert!(copy(&folder.join("made"), &image).is_err());
        assert_eq!(fs::read_to_string(&image).expect("there"), "before");
        assert!(copy(&folder.join("made"), &image).is_ok(), "room again");
        assert_eq!(fs::read(&image).expect("there").len(), 100_000);
        fs::remove_dir_all(&folder).expect("removed");
    }
}
