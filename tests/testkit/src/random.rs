//! The bus library's generator, with the types of the firmware's tests.

/// Gives the same numbers everywhere.
pub struct Random(multidrop_bus::Random);

impl Random {
    /// Its numbers depend on `seed` alone.
    pub fn new(seed: u64) -> Self {
        Self(multidrop_bus::Random::new(seed))
    }

    /// A number of 64 bits.
    pub fn next(&mut self) -> u64 {
        self.0.any()
    }

    /// A number below `end`.
    pub fn below(&mut self, end: u16) -> u16 {
        self.0.below(end.into()) as u16
    }

    /// True once in `n` times.
    pub fn one_in(&mut self, n: u16) -> bool {
        self.0.one_in(n.into())
    }

    /// One of `choices`.
    pub fn pick<T: Copy>(&mut self, choices: &[T]) -> T {
        self.0.pick(choices)
    }

    /// A vector of `count` random bytes.
    pub fn bytes(&mut self, count: usize) -> Vec<u8> {
        (0..count).map(|_| self.next() as u8).collect()
    }
}
