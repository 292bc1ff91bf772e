//! A host as a client: one request, and its answer.

use super::Bus;
use crate::host::RxByte;
use crate::record::HostId;
use crate::time::Time;

/// The answer to a request, as a host received it.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Answer {
    /// The bytes, damaged ones included.
    pub bytes: Vec<u8>,
    /// The received characters with times and flags.
    pub received: Vec<RxByte>,
    /// When the request's last stop bit ended.
    pub request_end: Time,
    /// When the answer's last stop bit ended, by the sender's clock.
    pub end: Time,
    /// The exact pauses between the answer's characters, in their order.
    pub gaps: Vec<Time>,
}

impl Answer {
    /// From the end of the request's last stop bit to the answer's first start bit.
    pub fn turnaround(&self) -> Time {
        self.received.first().map_or(Time::ZERO, |first| {
            first.start.saturating_sub(self.request_end)
        })
    }

    /// Whether every byte came without a framing or parity error.
    pub fn is_clean(&self) -> bool {
        self.received.iter().all(RxByte::is_good)
    }
}

impl Bus {
    /// Sends a request and waits for the answer: the characters that begin within `timeout` of the request's end, up
    /// to a silence of 3.5 characters (1750 us above 19200 baud). Returns `None` if none came.
    ///
    /// Returns one character later than that, so that a request sent right after it does not begin exactly at t3.5.
    pub fn transact(&mut self, id: HostId, request: &[u8], timeout: Time) -> Option<Answer> {
        let host = self.host(id);
        host.take();
        let request_end = host.send(request);
        let silence = host.line().t35() + host.line().character();
        let mut deadline = request_end + timeout;
        let mut count = 0;
        while self.now < deadline {
            let span = deadline - self.now;
            self.run_until(
                |bus| bus.host(id).heard().len() > count || bus.host(id).is_receiving(),
                span,
            );
            if self.host(id).is_receiving() {
                self.run_until(|bus| !bus.host(id).is_receiving(), Time::from_ms(100));
            }
            if self.host(id).heard().len() > count {
                count = self.host(id).heard().len();
                let end = self.host(id).heard().last().map(|byte| byte.end);
                deadline = end.unwrap_or(deadline) + silence;
            }
        }
        let received = self.host(id).take();
        let sent = |byte: &RxByte| {
            let record = &self.records[self.host_wires[id.0].0];
            let mut bytes = record.bytes.iter().rev();
            bytes
                .find(|sent| sent.start == byte.start)
                .map_or(byte.end, |sent| sent.end)
        };
        let end = received.last().map(sent)?;
        Some(Answer {
            bytes: received.iter().map(|byte| byte.value).collect(),
            gaps: received
                .windows(2)
                .map(|pair| pair[1].start.saturating_sub(sent(&pair[0])))
                .collect(),
            received,
            request_end,
            end,
        })
    }
}
