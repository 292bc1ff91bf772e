//! Finds a shortest history that still fails.

use super::requests::Step;

/// Leaves out of `steps`, the last of which failed, what is not needed for a failure: `fails` begins anew and tells of
/// the first failure, if there is one.
pub fn minimal(
    steps: &[Step],
    mut fails: impl FnMut(&[Step]) -> Option<String>,
) -> (Vec<Step>, String) {
    let mut said = None;
    let mut kept = steps.to_vec();
    // Most failures need few of the last steps.
    let mut len = 1;
    while said.is_none() {
        let begin = steps.len().saturating_sub(len);
        said = fails(&steps[begin..]);
        kept = steps[begin..].to_vec();
        if begin == 0 {
            break;
        }
        len *= 2;
    }
    let Some(mut said) = said else {
        return (kept, "it does not fail when it is done again".to_owned());
    };
    let mut chunk = kept.len().div_ceil(2);
    loop {
        let mut at = 0;
        while at < kept.len() {
            let mut fewer = kept.clone();
            fewer.drain(at..(at + chunk).min(kept.len()));
            match fails(&fewer) {
                Some(still) if !fewer.is_empty() => (kept, said) = (fewer, still),
                _ => at += chunk,
            }
        }
        if chunk == 1 {
            return (kept, said);
        }
        chunk = chunk.div_ceil(2);
    }
}
