//! Where the repository lies, found when a program runs: a checkout that was copied together with what was built in it is
//! to use its own files, not those of the checkout it was copied from.

use std::path::{Path, PathBuf};

/// A file that is in the root of this repository and of no other.
const MARK: &str = "sim/qemu/barrier.c";

/// The root of the repository: that of the package which cargo runs, or else the one that the current folder is in.
pub fn repository() -> Option<PathBuf> {
    let package = std::env::var_os("CARGO_MANIFEST_DIR").map(PathBuf::from);
    let current = std::env::current_dir().ok();
    let mut starts = [package, current].into_iter().flatten();
    starts.find_map(|start| root_above(&start).map(Path::to_path_buf))
}

fn root_above(start: &Path) -> Option<&Path> {
    start.ancestors().find(|folder| folder.join(MARK).is_file())
}
