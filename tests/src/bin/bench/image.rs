//! The images that are measured, as `cargo xtask build` made them.

use std::path::PathBuf;
use std::str::FromStr;

use multidrop_bus::Line;

use crate::Trouble;

/// A firmware image and what is known of it without running it.
#[derive(Clone, Debug)]
pub struct Image {
    /// The name of the application.
    pub app: String,
    /// Items in each of its tables.
    pub count: u8,
    /// Its line, 8N1.
    pub baud: u32,
    /// Bytes of flash.
    pub flash: u32,
    /// Bytes of static RAM.
    pub ram: u32,
    /// The ELF file.
    pub path: PathBuf,
}

impl Image {
    /// What it is called in tables and files.
    pub fn name(&self) -> String {
        match self.app.as_str() {
            "registers" => format!("registers-{}@{}", self.count, self.baud),
            other => other.to_owned(),
        }
    }

    /// The settings of its line.
    pub fn line(&self) -> Line {
        Line::n81(self.baud)
    }
}

impl FromStr for Image {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let mut parts = text.splitn(6, ':');
        let mut next = |what| parts.next().ok_or(format!("{what} is missing"));
        let app = next("the application")?.to_owned();
        let mut number = |what| -> Result<u32, String> {
            next(what)?
                .parse()
                .map_err(|error| format!("{what}: {error}"))
        };
        let count = number("count")?;
        Ok(Image {
            app,
            count: u8::try_from(count).map_err(|error| format!("count: {error}"))?,
            baud: number("baud")?,
            flash: number("flash")?,
            ram: number("RAM")?,
            path: next("the path")?.into(),
        })
    }
}

/// All images that were handed over.
pub struct Images<'a>(pub &'a [Image]);

impl<'a> Images<'a> {
    /// `registers` with `count` items at `baud`.
    pub fn registers(&self, count: u8, baud: u32) -> Result<&'a Image, Trouble> {
        self.0
            .iter()
            .find(|image| image.app == "registers" && (image.count, image.baud) == (count, baud))
            .ok_or_else(|| Trouble::NoImage(format!("registers-{count}@{baud}")))
    }

    /// The server that waits for edges on port D, at `baud`.
    pub fn edges(&self, baud: u32) -> Result<&'a Image, Trouble> {
        self.0
            .iter()
            .find(|image| image.app == "port_d" && image.baud == baud)
            .ok_or_else(|| Trouble::NoImage(format!("port_d@{baud}")))
    }

    /// An application that has no variants here.
    pub fn app(&self, name: &str) -> Result<&'a Image, Trouble> {
        self.0
            .iter()
            .find(|image| image.app == name)
            .ok_or_else(|| Trouble::NoImage(name.to_owned()))
    }
}
