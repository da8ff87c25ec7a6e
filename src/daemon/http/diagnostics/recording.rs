//! The traffic of a line, recorded for diagnostics as a file for network analysers.

use crate::daemon::exchange::shared::SharedLine;
use crate::daemon::exchange::traffic::{RECORDS_MAX, TrafficListener};
use crate::daemon::host::clock;
use crate::daemon::http::traffic::{WallClock, about, facts};
use crate::north::traffic::TrafficDecoder;
use crate::north::traffic::packets::{PacketFrame, beginning_of};
use crate::north::traffic::pcapng;
use std::env::consts::{ARCH, OS};
use std::sync::Arc;

/// Most bytes of one file: minutes of a fast line.
const BYTES_MAX: usize = 2 * 1024 * 1024;

/// The recording of one line.
pub(super) struct LineRecording {
    listener: TrafficListener,
    decoder: TrafficDecoder,
    clock: WallClock,
    file: Vec<u8>,
}

impl LineRecording {
    /// Records `line` from now on; `None` if too many clients watch it.
    pub fn begin(line: &Arc<SharedLine>) -> Option<Self> {
        let listener = TrafficListener::new(Arc::clone(line), None, clock::now)?;
        let decoder = TrafficDecoder::new(facts(line));
        Some(Self {
            listener,
            decoder,
            clock: WallClock::new(),
            file: beginning_of(&about(line), (ARCH, OS)),
        })
    }

    /// Takes what was recorded since the last time.
    pub fn take(&mut self) {
        let framing = self.listener.line().wiring.framing;
        let mut news = self.listener.look(RECORDS_MAX);
        if news.lost > 0 {
            self.decoder.skip();
        }
        for (_, record) in news.records {
            let at = self.clock.rfc3339(record.at());
            let frame = self.decoder.decode(&record).document(at, &record.bytes);
            let Some(frame) = PacketFrame::of(&frame, framing) else {
                continue;
            };
            if self.file.len() < BYTES_MAX {
                self.file.extend(pcapng::packet(
                    &frame.packet(std::mem::take(&mut news.lost)),
                ));
            }
        }
    }

    /// The name of its line, and the file.
    pub fn end(self) -> (String, Vec<u8>) {
        (self.listener.line().name.to_string(), self.file)
    }
}
