//! The link to the terminal. Only one that was made here is ever replaced or removed, and none that belongs to a bus which
//! runs.
//!
//! That a link was made here is on record: a file for each link in a folder of the user's for temporary files, which is locked
//! as long as the bus runs. It stays where a bus was killed, and so does the link, which the next one then replaces.

use std::fs::{self, DirBuilder, File, OpenOptions, TryLockError};
use std::hash::{DefaultHasher, Hash, Hasher};
use std::io::{self, ErrorKind, Read, Seek, Write};
use std::os::unix::fs::{DirBuilderExt, MetadataExt, OpenOptionsExt, symlink};
use std::path::{Path, PathBuf};

use nix::unistd::geteuid;

use super::LiveError;

/// The link; gone when dropped.
pub(super) struct Link {
    path: PathBuf,
    target: PathBuf,
    record: Record,
}

impl Link {
    /// Makes a link at `path` to the terminal `target`.
    pub fn make(path: &Path, target: &str) -> Result<Self, LiveError> {
        let failed = |source| LiveError::Link {
            path: path.to_owned(),
            source,
        };
        let mut record = Record::lock(path).map_err(failed)?;
        let record = record
            .take()
            .ok_or_else(|| LiveError::Taken(path.to_owned()))?;
        let mut link = Link {
            path: path.to_owned(),
            target: target.into(),
            record,
        };
        match link.clear().and_then(|()| {
            link.record.write(target).map_err(failed)?;
            symlink(target, path).map_err(failed)
        }) {
            Ok(()) => Ok(link),
            Err(error) => {
                // The path is in other use.
                link.target = PathBuf::new();
                Err(error)
            }
        }
    }

    /// Where it is.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Lets it lead to another terminal, in one step.
    pub fn lead_to(&mut self, target: &str) -> io::Result<()> {
        if !self.is_there() {
            // The user has put something else there.
            return Ok(());
        }
        let mut name = self.path.file_name().unwrap_or_default().to_owned();
        name.push(format!(".{}", std::process::id()));
        let new = self.path.with_file_name(name);
        symlink(target, &new)?;
        let moved = self
            .record
            .write(target)
            .and_then(|()| fs::rename(&new, &self.path));
        if moved.is_err() {
            let _ = fs::remove_file(&new);
        }
        self.target = target.into();
        moved
    }

    /// Makes room for it: a link is left where a bus was killed.
    fn clear(&mut self) -> Result<(), LiveError> {
        let failed = |source| LiveError::Link {
            path: self.path.clone(),
            source,
        };
        match fs::symlink_metadata(&self.path) {
            Err(error) if error.kind() == ErrorKind::NotFound => return Ok(()),
            Err(error) => return Err(failed(error)),
            Ok(meta) if !meta.is_symlink() => return Err(LiveError::NotALink(self.path.clone())),
            Ok(_) => {}
        }
        let target = fs::read_link(&self.path).map_err(failed)?;
        if self.record.read().map_err(failed)? != target {
            return Err(LiveError::ForeignLink {
                path: self.path.clone(),
                target,
            });
        }
        fs::remove_file(&self.path).map_err(failed)
    }

    /// Whether it is still the one that was made.
    fn is_there(&self) -> bool {
        fs::read_link(&self.path).is_ok_and(|target| target == self.target)
    }
}

impl Drop for Link {
    fn drop(&mut self) {
        if self.is_there() {
            let _ = fs::remove_file(&self.path);
        }
        // One that could not be removed is on record still.
        if !self.is_there() {
            self.record.remove();
        }
    }
}

/// What is on record of a link: where it leads.
struct Record {
    file: File,
    path: PathBuf,
}

impl Record {
    /// Locks the record of a link; `None` if a bus that runs has it.
    fn lock(link: &Path) -> io::Result<Option<Self>> {
        // However the link is called, it is this name in this folder.
        let folder = match link.parent() {
            Some(folder) => Path::new(".").join(folder).canonicalize()?,
            None => return Err(ErrorKind::IsADirectory.into()),
        };
        let name = link.file_name().ok_or(ErrorKind::InvalidFilename)?;
        let mut hasher = DefaultHasher::new();
        folder.join(name).hash(&mut hasher);
        let path = records().join(format!("{:016x}", hasher.finish()));
        loop {
            let folder = path.parent().expect("a file in a folder");
            match DirBuilder::new().mode(0o700).create(folder) {
                Err(error) if error.kind() != ErrorKind::AlreadyExists => {
                    return Err(named(folder, error));
                }
                _ => {}
            }
            let meta = match fs::symlink_metadata(folder) {
                // Another bus has just removed it.
                Err(error) if error.kind() == ErrorKind::NotFound => continue,
                found => found.map_err(|error| named(folder, error))?,
            };
            if !meta.is_dir() || meta.uid() != geteuid().as_raw() {
                let said = format!("{} is not a folder of this user", folder.display());
                return Err(io::Error::new(ErrorKind::PermissionDenied, said));
            }
            let mut options = OpenOptions::new();
            options.read(true).write(true).create(true).truncate(false);
            let file = match options.mode(0o600).open(&path) {
                // The same.
                Err(error) if error.kind() == ErrorKind::NotFound => continue,
                opened => opened.map_err(|error| named(&path, error))?,
            };
            match file.try_lock() {
                Err(TryLockError::WouldBlock) => return Ok(None),
                Err(TryLockError::Error(error)) => return Err(named(&path, error)),
                Ok(()) => {}
            }
            // Or the file, between the two.
            if fs::metadata(&path).is_ok_and(|meta| Some(meta.ino()) == inode(&file)) {
                return Ok(Some(Record { file, path }));
            }
        }
    }

    fn read(&mut self) -> io::Result<PathBuf> {
        let mut target = String::new();
        self.file.rewind()?;
        self.file.read_to_string(&mut target)?;
        Ok(target.into())
    }

    fn write(&mut self, target: &str) -> io::Result<()> {
        let written = self
            .file
            .set_len(0)
            .and_then(|()| self.file.rewind())
            .and_then(|()| self.file.write_all(target.as_bytes()));
        written.map_err(|error| named(&self.path, error))
    }

    fn remove(&self) {
        let _ = fs::remove_file(&self.path);
        // The last one goes with the folder.
        let _ = fs::remove_dir(records());
    }
}

/// The error with the name of what it is about, which is not the link.
fn named(path: &Path, error: io::Error) -> io::Error {
    io::Error::new(error.kind(), format!("{}: {error}", path.display()))
}

fn inode(file: &File) -> Option<u64> {
    file.metadata().ok().map(|meta| meta.ino())
}

/// Where the records of this user's links are.
fn records() -> PathBuf {
    std::env::temp_dir().join(format!("multidrop-sim-{}", geteuid()))
}
