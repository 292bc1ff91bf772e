//! Why a command ends early, and the exit code that tells who is to blame.

use std::fmt::Display;
use std::process::ExitCode;

/// The end of a command: exit code 2 if the caller asked for something impossible, 1 if the work itself failed, or
/// the code of the program that replaced this one.
#[derive(Debug)]
pub struct Error {
    message: Option<String>,
    code: u8,
}

impl Error {
    /// A fault of the caller: a wrong word or value, or a tool that is not installed. Nothing was done.
    pub fn usage(message: impl Into<String>) -> Self {
        Self {
            message: Some(message.into()),
            code: 2,
        }
    }

    /// A fault of this program, or of a tool that it ran: the work was begun and could not be finished.
    pub fn failed(message: impl Into<String>) -> Self {
        Self {
            message: Some(message.into()),
            code: 1,
        }
    }

    /// The fault is on the terminal already; only the exit code is left.
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

    /// Prints the message, if there is one, and returns the exit code.
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
