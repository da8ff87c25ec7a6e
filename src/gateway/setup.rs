//! What a line is made of, ready to use.

use crate::domain::control::ControlSettings;
use crate::domain::ids::Station;
use crate::domain::link::EchoPolicy;
use crate::domain::report::StopBounds;
use crate::drive::watchdog::WatchdogRange;
use crate::journal::Remembered;
use crate::line::budget::{self, Budget, PlannedStation};
use crate::line::timeouts::{ReplyTimeouts, longer_reply};
use crate::line::timing::Timing;
use crate::profile::model::Model;
use crate::wire::pdu::Request;
use std::sync::Arc;
use std::time::Duration;

/// One line and its drives.
#[derive(Clone, Debug)]
pub struct LineSetup {
    /// Times on the wire.
    pub timing: Timing,
    /// The drives, in the order of the configuration.
    pub drives: Vec<DriveSetup>,
    /// What to do if what is sent comes back.
    pub echo: EchoPolicy,
    /// Whether the traffic is told from the start.
    pub tells_traffic: bool,
    /// Where the epochs of its drives begin: another number at each start of the gateway.
    pub first_epoch: u64,
    /// Whether somebody may have asked its drives just before it is opened, so that a reply is still to come: an
    /// earlier life of the gateway, or a tool.
    pub asked_before: bool,
    /// Whether commands were taken before the line was made, as when a reload brings it: what comes for its drives may be
    /// older than it.
    pub joins_late: bool,
    /// Whether there is a journal: what must be kept first is waited for.
    pub keeps: bool,
}

impl LineSetup {
    /// How long a stop for one drive may have to wait.
    #[must_use]
    pub fn stop_bounds(&self) -> StopBounds {
        budget::stop_bounds(&self.timing, self.drives.iter().map(DriveSetup::planned))
    }

    /// Between which times the own watchdog of the drive at `place` fits; on one that nobody commands, any.
    #[must_use]
    pub fn watchdog_range(&self, place: usize) -> WatchdogRange {
        let stations: Vec<_> = self.drives.iter().map(DriveSetup::planned).collect();
        let commanded = self.drives.iter().filter(|drive| drive.control.is_some()).count();
        let control = self.drives.get(place).and_then(|drive| drive.control.as_ref());
        let gap = || budget::longest_gap_on_line(&self.timing, &stations, place, commanded);
        control.map_or(WatchdogRange::ANY, |control| WatchdogRange {
            more_than: gap().unwrap_or_default() * 2,
            at_most: control.watchdog_at_most(),
        })
    }

    /// What the polls of the line cost.
    #[must_use]
    pub fn budget(&self) -> Budget {
        budget::of_plan(&self.timing, self.drives.iter().map(DriveSetup::planned))
    }
}

/// One drive of a line.
#[derive(Clone, Debug)]
pub struct DriveSetup {
    /// Number on the line.
    pub station: Station,
    /// What it is.
    pub model: Arc<Model>,
    /// Period of its fast polls.
    pub poll: Duration,
    /// Longest waits for a reply.
    pub timeouts: ReplyTimeouts,
    /// How long after a time-out a reply may still come.
    pub max_lateness: Duration,
    /// What may be commanded; nothing: it is read-only from everywhere.
    pub control: Option<Arc<ControlSettings>>,
    /// What is known of it from an earlier life of the gateway.
    pub remembered: Remembered,
}

impl DriveSetup {
    /// What it costs the line.
    fn planned(&self) -> PlannedStation<'_> {
        let Self { model, poll, timeouts, max_lateness, .. } = self;
        PlannedStation { model, poll: *poll, timeouts: *timeouts, max_lateness: *max_lateness }
    }

    /// Time that the reply to `request` takes on the wire, and how much of it is because its characters are longer
    /// than ours.
    pub(super) fn reply_time(&self, request: &Request, timing: &Timing) -> (Duration, Duration) {
        self.time_of(request.reply_pdu_bytes(), timing)
    }

    /// The same for a frame with a PDU of `pdu_bytes`.
    pub(super) fn time_of(&self, pdu_bytes: usize, timing: &Timing) -> (Duration, Duration) {
        let (bytes, char_bits) = (timing.adu_bytes(pdu_bytes), self.model.timing.reply_char_bits.as_ref());
        let longer = longer_reply(timing, char_bits.map(|fact| fact.value), bytes);
        (timing.on_wire(bytes) + longer, longer)
    }
}
