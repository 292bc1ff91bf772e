//! `demo`: sets up, builds, and becomes the demonstration.

use crate::error::Error;
use crate::needs::Purpose;
use crate::scenario::{LineOptions, Scenario};
use crate::sim::{build_images, program};
use crate::{job, repo, setup};

/// Comes back only if something fails.
///
/// # Errors
/// [`Error::usage`] when something is missing that set-up could not install.
pub fn run(hold: bool) -> Result<(), Error> {
    setup::prepare(&[
        Purpose::Firmware,
        Purpose::Avr,
        Purpose::Simulator,
        Purpose::Client,
    ])?;
    let mbpoll = repo::in_path("mbpoll").ok_or_else(|| Error::usage("mbpoll is not installed"))?;
    let mut demo = program("multidrop-bus", "demo")?;
    for path in build_images(&Scenario::DemoUnit.images(LineOptions::default(), false)?)? {
        demo.arg("--image").arg(path);
    }
    demo.arg("--mbpoll").arg(mbpoll);
    if hold {
        demo.arg("--hold");
    }
    Err(job::become_program(&demo))
}
