//! Programs that are run as part of a command: all of them end when the command is interrupted or killed.

use crate::error::Error;
use crate::repo;
use nix::sys::signal::{SigSet, SigmaskHow, Signal, killpg, pthread_sigmask};
use nix::unistd::{Pid, execve};
use std::ffi::{CString, OsString};
use std::io::Read;
use std::os::unix::ffi::OsStringExt;
use std::os::unix::process::CommandExt;
use std::path::PathBuf;
use std::process::{Child, Command, ExitStatus, Stdio};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, OnceLock};
use std::thread;
use std::time::{Duration, Instant};

/// The interval at which a wait checks whether it must end.
const LOOK: Duration = Duration::from_millis(5);

/// Whether a signal has requested the end.
static STOP: OnceLock<Arc<AtomicBool>> = OnceLock::new();

const ENDING: [Signal; 3] = [Signal::SIGINT, Signal::SIGTERM, Signal::SIGHUP];

/// Installs handlers: from now on Ctrl-C, SIGTERM and SIGHUP end the command in good order.
///
/// # Errors
/// [`Error::failed`] if the system refuses.
pub fn watch() -> Result<(), Error> {
    let stop = STOP.get_or_init(Arc::default);
    for signal in ENDING {
        signal_hook::flag::register(signal as i32, Arc::clone(stop))
            .map_err(|error| Error::io("cannot watch for signals", error))?;
    }
    Ok(())
}

/// Whether a signal has requested the end.
pub fn is_stopped() -> bool {
    STOP.get().is_some_and(|stop| stop.load(Ordering::Relaxed))
}

/// Returns an error if a signal has requested the end.
///
/// # Errors
/// Exit code 1, without a message.
pub fn check() -> Result<(), Error> {
    if is_stopped() {
        Err(Error::silent(1))
    } else {
        Ok(())
    }
}

/// Waits until `done` returns true.
///
/// # Errors
/// The error of `done`; and as [`check`].
pub fn wait_until(mut done: impl FnMut() -> Result<bool, Error>) -> Result<(), Error> {
    while !done()? {
        check()?;
        thread::sleep(LOOK);
    }
    Ok(())
}

/// Runs a command like [`repo::run`], for a program that starts others, as cargo does: all of them end with this
/// program.
///
/// # Errors
/// [`Error::failed`] if it fails; and as [`check`].
pub fn run(command: &mut Command) -> Result<(), Error> {
    let status = end_of(command, Duration::MAX)?;
    succeeded(status, &repo::shown(command))
}

/// Runs a command like [`run`]; returns what the program printed.
///
/// # Errors
/// As [`run`].
pub fn output_of(command: &mut Command) -> Result<String, Error> {
    let (status, printed) = output_within(command, Duration::MAX)?;
    succeeded(status, &repo::shown(command)).map(|()| printed)
}

/// Runs a command like [`output_of`], for a program that may fail or not end: it is ended when `patience` is over,
/// with all that it has started, and has no status.
///
/// # Errors
/// [`Error::failed`] if it cannot be run; and as [`check`].
pub fn output_within(
    command: &mut Command,
    patience: Duration,
) -> Result<(Option<ExitStatus>, String), Error> {
    let (mut printed, end) =
        std::io::pipe().map_err(|error| Error::io("cannot make a pipe", error))?;
    command.stdout(end);
    let reader = thread::spawn(move || {
        let mut text = Vec::new();
        printed.read_to_end(&mut text).map(|_| text)
    });
    let ended = end_of(command, patience);
    // The end of the pipe that belongs to the program closes with it here.
    command.stdout(Stdio::null());
    let status = ended?;
    let text = reader.join().expect("reading does not panic");
    let text = text.map_err(|error| Error::io(repo::shown(command), error))?;
    Ok((status, String::from_utf8_lossy(&text).into_owned()))
}

fn succeeded(status: Option<ExitStatus>, shown: &str) -> Result<(), Error> {
    match status {
        Some(status) if !status.success() => {
            Err(Error::failed(format!("{shown} ended with {status}")))
        }
        _ => Ok(()),
    }
}

/// Runs a command to its end, or until `patience` is over: no status then.
fn end_of(command: &mut Command, patience: Duration) -> Result<Option<ExitStatus>, Error> {
    let group = Group::new()?;
    let begun = Instant::now();
    let shown = repo::shown(command);
    let mut child = command
        .process_group(group.id())
        .spawn()
        .map_err(|error| Error::io(command.get_program().to_string_lossy(), error))?;
    let mut status = None;
    let waited = wait_until(|| {
        status = child.try_wait().map_err(|error| Error::io(&shown, error))?;
        Ok(status.is_some() || begun.elapsed() >= patience)
    });
    if status.is_none() {
        group.kill();
        let _ = child.wait();
    }
    waited.map(|()| status)
}

/// A process group with a watcher in it, which reads from this program: when this program is gone, even by SIGKILL,
/// the watcher ends the whole group.
struct Group(Child);

impl Group {
    fn new() -> Result<Self, Error> {
        Command::new("sh")
            .args(["-c", "read nothing; kill -KILL 0"])
            .process_group(0)
            .stdin(Stdio::piped())
            .stdout(Stdio::null())
            .stderr(Stdio::null())
            .spawn()
            .map(Self)
            .map_err(|error| Error::io("sh", error))
    }

    fn id(&self) -> i32 {
        self.0.id().cast_signed()
    }

    fn kill(&self) {
        let _ = killpg(Pid::from_raw(self.id()), Signal::SIGKILL);
    }
}

impl Drop for Group {
    fn drop(&mut self) {
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

/// Replaces this program by `command`, of which only the program, the arguments and the environment count. A signal
/// that comes meanwhile goes to the new program: signals are blocked until it accepts them. Returns only if that
/// fails.
pub fn become_program(command: &Command) -> Error {
    let name = command.get_program().to_string_lossy().into_owned();
    let failed = |reason: String| Error::failed(format!("{name}: {reason}"));
    let text = |text: OsString| CString::new(text.into_vec()).map_err(|error| error.to_string());
    let mut environment: Vec<(OsString, OsString)> = std::env::vars_os().collect();
    for (key, value) in command.get_envs() {
        environment.retain(|(known, _)| known != key);
        environment.extend(value.map(|value| (key.to_owned(), value.to_owned())));
    }
    let environment = environment.into_iter().map(|(mut key, value)| {
        key.push("=");
        key.push(value);
        text(key)
    });
    let program = command.get_program();
    let words = std::iter::once(program).chain(command.get_args());
    let prepared = || -> Result<_, String> {
        let words: Vec<_> = words
            .map(|word| text(word.to_owned()))
            .collect::<Result<_, _>>()?;
        Ok((words, environment.collect::<Result<Vec<_>, _>>()?))
    };
    let (words, environment) = match prepared() {
        Ok(prepared) => prepared,
        Err(reason) => return failed(reason),
    };
    let ending = SigSet::from_iter(ENDING);
    if let Err(error) = pthread_sigmask(SigmaskHow::SIG_BLOCK, Some(&ending), None) {
        return failed(error.to_string());
    }
    if let Err(stopped) = check() {
        return stopped;
    }
    match execve(&words[0], &words, &environment) {
        Err(error) => failed(error.to_string()),
        Ok(never) => match never {},
    }
}

/// The program that cargo has built, from cargo's JSON messages.
pub fn executable(printed: &str) -> Option<PathBuf> {
    let built = printed.lines().rev().find_map(|line| {
        let (_, rest) = line.split_once("\"executable\":\"")?;
        // A quotation mark within the path stands behind a backslash.
        let mut path = String::new();
        let mut letters = rest.chars();
        loop {
            match letters.next()? {
                '"' => return Some(path),
                '\\' => path.push(letters.next()?),
                letter => path.push(letter),
            }
        }
    });
    built.map(PathBuf::from)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_program_is_the_last_that_cargo_reports() {
        let printed = r#"{"reason":"compiler-artifact","executable":null,"fresh":true}
{"reason":"compiler-artifact","executable":"/a \"b\"/c\\d/sim","fresh":true}
{"reason":"build-finished","success":true}"#;
        let path = executable(printed);
        assert_eq!(path, Some(PathBuf::from(r#"/a "b"/c\d/sim"#)));
        assert_eq!(executable("{\"executable\":null}"), None);
    }

    #[test]
    fn a_program_that_takes_too_long_is_ended_with_its_children() {
        let script = "(sleep 2; echo late) & echo early; sleep 600";
        let mut command = Command::new("sh");
        let ended = output_within(command.args(["-c", script]), Duration::from_millis(300));
        assert_eq!(ended.ok(), Some((None, "early\n".to_owned())));
    }

    #[test]
    fn a_program_that_fails_is_named_and_its_output_is_kept() {
        let error = run(Command::new("sh").args(["-c", "exit 3"])).expect_err("it fails");
        assert_eq!(error.message(), "sh -c exit 3 ended with exit status: 3");
        let said = output_of(Command::new("sh").args(["-c", "echo $PPID; echo done"]));
        assert!(said.expect("it works").ends_with("\ndone\n"));
        let error = run(&mut Command::new("no-such-program")).expect_err("it is not there");
        assert!(error.message().starts_with("no-such-program: "));
    }
}
