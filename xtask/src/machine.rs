//! QEMU for the STM32: its version, its Debian package, and the plugin that keeps it in step with the bus.

use crate::error::Error;
use crate::{repo, whole};
use std::fs;
use std::hash::{DefaultHasher, Hash, Hasher};
use std::path::PathBuf;
use std::process::Command;

/// The package of Debian.
pub const PACKAGE: &str = "qemu-system-arm";

/// The first version whose STM32F405 has the clock control and the plugin interface that are needed.
pub const VERSION_MIN: u32 = 10;

/// QEMU, if it is new enough.
pub fn qemu() -> Option<String> {
    let text = repo::output_of(Command::new("qemu-system-arm").arg("--version"))?;
    let version = text.split_whitespace().nth(3)?;
    let major: u32 = version.split('.').next()?.parse().ok()?;
    (major >= VERSION_MIN).then(|| version.to_owned())
}

/// The major version that the distribution would install; `None` if it has none, or if its lists were never fetched.
pub fn candidate() -> Option<u32> {
    let text = repo::output_of(Command::new("apt-cache").args(["policy", PACKAGE]))?;
    major_of_candidate(&text)
}

fn major_of_candidate(policy: &str) -> Option<u32> {
    let mut lines = policy.lines().map(str::trim);
    let version = lines.find_map(|line| line.strip_prefix("Candidate: "))?;
    // The version follows the epoch.
    let version = version
        .split_once(':')
        .map_or(version, |(_, version)| version);
    let digits: String = version.chars().take_while(char::is_ascii_digit).collect();
    digits.parse().ok()
}

/// The file for the list of backports.
pub const BACKPORTS_LIST: &str = "/etc/apt/sources.list.d/multidrop-backports.sources";

/// The backports of this system's Debian release.
pub struct Backports {
    codename: String,
    mirror: String,
    key: Option<String>,
}

impl Backports {
    /// The backports, from the mirror of the system's own packages; `None` if the system is not Debian.
    pub fn of_this_system() -> Option<Self> {
        let release = fs::read_to_string("/etc/os-release").ok()?;
        let value = |name: &str| {
            let line = release.lines().find_map(|line| line.strip_prefix(name))?;
            Some(line.trim_matches('"').to_owned())
        };
        if value("ID=")? != "debian" {
            return None;
        }
        let codename = value("VERSION_CODENAME=")?;
        let lists = fs::read_dir("/etc/apt/sources.list.d")
            .into_iter()
            .flatten();
        let lists = lists.flatten().map(|entry| entry.path());
        let (mirror, key) = lists
            .chain([PathBuf::from("/etc/apt/sources.list")])
            .filter_map(|list| fs::read_to_string(list).ok())
            .find_map(|text| mirror(&text, &codename))?;
        Some(Self {
            codename,
            mirror,
            key,
        })
    }

    /// The name of the suite in apt.
    pub fn suite(&self) -> String {
        format!("{}-backports", self.codename)
    }

    /// The list of the suite for apt.
    pub fn list(&self) -> String {
        let key = match &self.key {
            Some(key) => format!("Signed-By: {key}\n"),
            None => String::new(),
        };
        format!(
            "Types: deb\nURIs: {}\nSuites: {}\nComponents: main\n{key}",
            self.mirror,
            self.suite()
        )
    }

    /// Whether the system's lists have the suite already.
    pub fn is_listed(&self) -> bool {
        repo::output_of(Command::new("apt-cache").arg("policy"))
            .is_some_and(|text| text.contains(&format!("n={}", self.suite())))
    }
}

/// The mirror of a release's own suite, and the file of its key if it is named, from a list in one of apt's formats.
fn mirror(text: &str, codename: &str) -> Option<(String, Option<String>)> {
    for stanza in text.split("\n\n") {
        let field = |name: &str| {
            let line = stanza.lines().find_map(|line| line.strip_prefix(name))?;
            Some(line.trim().to_owned())
        };
        if let (Some(uris), Some(suites)) = (field("URIs:"), field("Suites:"))
            && suites.split_whitespace().any(|suite| suite == codename)
        {
            let uri = uris.split_whitespace().next()?.to_owned();
            return Some((uri, field("Signed-By:")));
        }
    }
    text.lines().find_map(|line| {
        let line = line.strip_prefix("deb ")?.trim_start();
        let (options, rest) = match line.strip_prefix('[') {
            Some(line) => line.split_once(']')?,
            None => ("", line),
        };
        let mut words = rest.split_whitespace();
        let uri = words.next()?;
        let key = options
            .split_whitespace()
            .find_map(|o| o.strip_prefix("signed-by="));
        (words.next()? == codename).then(|| (uri.to_owned(), key.map(str::to_owned)))
    })
}

const SOURCE: &str = "sim/qemu/barrier.c";
const PLUGIN: &str = "target/qemu/barrier.so";
const STAMP: &str = "target/qemu/barrier.stamp";

/// The compiled plugin, if it was made from the present source.
pub fn barrier() -> Option<String> {
    let stamp = fs::read_to_string(repo::root().join(STAMP)).ok()?;
    let made = repo::root().join(PLUGIN).exists() && stamp == key()?;
    made.then(|| PLUGIN.to_owned())
}

/// Compiles the plugin.
///
/// # Errors
/// [`Error::failed`] with the message of the compiler.
pub fn compile_barrier() -> Result<(), Error> {
    let plugin = repo::root().join(PLUGIN);
    let folder = plugin.parent().expect("a file in a folder");
    fs::create_dir_all(folder).map_err(|error| Error::io(folder.display(), error))?;
    // In one step, since a simulation may be using the old one.
    whole::made(&plugin, |plugin| {
        let mut compiler = Command::new("cc");
        compiler
            .current_dir(repo::root())
            .args([
                "-std=c11",
                "-D_GNU_SOURCE",
                "-O2",
                "-Wall",
                "-Wextra",
                "-Werror",
            ])
            .args(["-shared", "-fPIC", "-fvisibility=hidden", SOURCE, "-o"])
            .arg(plugin);
        repo::run(&mut compiler)
    })?;
    let stamp = repo::root().join(STAMP);
    whole::write(&stamp, key().unwrap_or_default().as_bytes())
}

fn key() -> Option<String> {
    let source = fs::read(repo::root().join(SOURCE)).ok()?;
    let mut hasher = DefaultHasher::new();
    source.hash(&mut hasher);
    Some(format!("{:016x}\n", hasher.finish()))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_candidate_is_read_without_its_epoch() {
        let policy = "qemu-system-arm:\n  Installed: (none)\n  Candidate: 1:7.2+dfsg-7+deb12u18\n  Version table:\n";
        assert_eq!(major_of_candidate(policy), Some(7));
        assert_eq!(major_of_candidate("  Candidate: 10.0.2\n"), Some(10));
        assert_eq!(major_of_candidate("  Candidate: (none)\n"), None);
        assert_eq!(major_of_candidate(""), None);
    }

    #[test]
    fn the_mirror_is_that_of_the_releases_own_suite() {
        let deb822 = "Types: deb\nURIs: http://other/debian\nSuites: trixie\n\n\
                      Types: deb\n# a comment\nURIs: http://mirror/debian\nSuites: bookworm bookworm-updates\n\
                      Components: main\nSigned-By: /usr/share/keyrings/key.gpg\n\n\
                      Types: deb\nURIs: http://mirror/security\nSuites: bookworm-security\n";
        let key = Some("/usr/share/keyrings/key.gpg".to_owned());
        let found = mirror(deb822, "bookworm");
        assert_eq!(found, Some(("http://mirror/debian".to_owned(), key)));
        let lines = "# deb http://old/debian bookworm main\n\
                     deb http://mirror/security bookworm-security main\n\
                     deb [arch=amd64 signed-by=/key.gpg] http://mirror/debian bookworm main\n";
        let key = Some("/key.gpg".to_owned());
        let found = mirror(lines, "bookworm");
        assert_eq!(found, Some(("http://mirror/debian".to_owned(), key)));
        let plain = "deb http://mirror/debian bookworm main\n";
        assert_eq!(
            mirror(plain, "bookworm"),
            Some(("http://mirror/debian".to_owned(), None))
        );
        assert_eq!(mirror(plain, "trixie"), None);
    }
}
