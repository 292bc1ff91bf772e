//! Why a command ends early, and the exit code that tells a script whose fault it was.

use std::fmt::Display;
use std::process::ExitCode;

/// A command's end: exit code 2 where the caller asked for something impossible, 1 where the work
/// itself failed, or the code of the program that this one stood in for.
#[derive(Debug)]
pub struct Error {
    message: Option<String>,
    code: u8,
}

impl Error {
    /// The caller's: a wrong word or value, or a tool that is not installed. Nothing was done yet.
    pub fn usage(message: impl Into<String>) -> Self {
        Self {
            message: Some(message.into()),
            code: 2,
        }
    }

    /// Ours, or the tool's that was run: the work was begun and could not be finished.
    pub fn failed(message: impl Into<String>) -> Self {
        Self {
            message: Some(message.into()),
            code: 1,
        }
    }

    /// What went wrong is on the terminal already; only the exit code is left to give.
    pub fn silent(code: u8) -> Self {
        Self {
            message: None,
            code,
        }
    }

    /// [`Error::failed`] for an operation of the system on something that has a name.
    pub fn io(what: impl Display, error: std::io::Error) -> Self {
        Self::failed(format!("{what}: {error}"))
    }

    /// Prints the message, if there is one, and gives the exit code.
    pub fn report(&self) -> ExitCode {
        if let Some(message) = &self.message {
            eprintln!("error: {message}");
        }
        ExitCode::from(self.code)
    }

    /// The message, for a caller that goes on and lists it later.
    pub fn message(&self) -> &str {
        self.message.as_deref().unwrap_or("failed")
    }

    /// The exit code, for tests.
    #[cfg(test)]
    pub fn code(&self) -> u8 {
        self.code
    }
}
