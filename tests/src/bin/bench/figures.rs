//! What was measured: numbers under names that stay.

use std::collections::BTreeMap;

use multidrop_bus::Time;
use serde::{Deserialize, Serialize, Serializer};
use serde_json::{Value, json};

/// Figures of one image, by name. The unit is the end of the name.
pub type Set = BTreeMap<String, f64>;

/// Everything measured in one run.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Figures {
    /// What the images were compiled and linked with.
    pub compiler: String,
    /// The clock of the chip, or the instructions in a second of the machine, in Hz.
    pub clock_hz: u32,
    /// The figures by image.
    #[serde(serialize_with = "whole_where_whole")]
    pub images: BTreeMap<String, Set>,
}

impl Figures {
    /// A record without figures.
    pub fn new(compiler: &str, clock_hz: u32) -> Self {
        Figures {
            compiler: compiler.to_owned(),
            clock_hz,
            images: BTreeMap::new(),
        }
    }

    /// One figure of an image.
    pub fn get(&self, image: &str, name: &str) -> Option<f64> {
        self.images.get(image)?.get(name).copied()
    }
}

/// Bytes and cycles without a decimal point.
fn whole_where_whole<S: Serializer>(
    images: &BTreeMap<String, Set>,
    serializer: S,
) -> Result<S::Ok, S::Error> {
    let number = |value: f64| match value as i64 {
        whole if whole as f64 == value => json!(whole),
        _ => json!(value),
    };
    let shown = |set: &Set| -> BTreeMap<String, Value> {
        set.iter()
            .map(|(name, value)| (name.clone(), number(*value)))
            .collect()
    };
    serializer.collect_map(images.iter().map(|(image, set)| (image, shown(set))))
}

/// The smallest and the largest of what was seen.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Range(Option<(f64, f64)>);

impl Range {
    /// Takes in one value.
    pub fn add(&mut self, value: f64) {
        let (min, max) = self.0.unwrap_or((value, value));
        self.0 = Some((min.min(value), max.max(value)));
    }

    /// Takes in all of another range.
    pub fn include(&mut self, other: Range) {
        if let Some((min, max)) = other.0 {
            self.add(min);
            self.add(max);
        }
    }

    /// Writes `NAME_min_UNIT` and `NAME_max_UNIT`, if anything was seen.
    pub fn store(self, set: &mut Set, name: &str, unit: &str) {
        if let Some((min, max)) = self.0 {
            set.insert(format!("{name}_min_{unit}"), rounded(min));
            set.insert(format!("{name}_max_{unit}"), rounded(max));
        }
    }

    /// Largest less smallest.
    pub fn width(self) -> f64 {
        self.0.map_or(0.0, |(min, max)| max - min)
    }
}

/// `a - b` in microseconds.
pub fn us_between(a: Time, b: Time) -> f64 {
    (a.ps() as i128 - b.ps() as i128) as f64 / 1e6
}

/// To a thousandth: a nanosecond where the unit is the microsecond.
pub fn rounded(value: f64) -> f64 {
    let value = (value * 1000.0).round() / 1000.0;
    // Not "-0".
    if value == 0.0 { 0.0 } else { value }
}
