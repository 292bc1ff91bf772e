//! Instructions, as valgrind's callgrind counts them: the same number at every run.

use std::process::Command;

use host_bench::Request;

use crate::{Side, Trouble};

/// Numbers of requests; what they differ in is counted, so that start and end of the program are not.
const FEW: u32 = 1_000;
const MANY: u32 = 3_000;

/// The mean of many.
pub fn instructions_per_request(side: Side, request: Request) -> Result<u64, Trouble> {
    let few = instructions(side, request, FEW)?;
    let many = instructions(side, request, MANY)?;
    Ok((many - few) / u64::from(MANY - FEW))
}

fn instructions(side: Side, request: Request, times: u32) -> Result<u64, Trouble> {
    let output = Command::new("valgrind")
        .args(["--tool=callgrind", "--callgrind-out-file=/dev/null"])
        .arg(std::env::current_exe()?)
        .args(["work", side.name(), request.name(), &times.to_string()])
        .output()
        .map_err(|error| format!("valgrind: {error}"))?;
    let said = String::from_utf8_lossy(&output.stderr);
    if !output.status.success() {
        return Err(format!("valgrind: {said}").into());
    }
    let count = said
        .lines()
        .find_map(|line| line.split_once("Collected : "));
    let (_, count) = count.ok_or_else(|| format!("valgrind counted nothing: {said}"))?;
    Ok(count.trim().parse()?)
}
