//! The description of a line, checked and ready to use.

use crate::domain::control::ControlSettings;
use crate::domain::ids::Station;
use crate::domain::link::EchoPolicy;
use crate::domain::report::StopBounds;
use crate::domain::time::MonoTime;
use crate::drive::watchdog::WatchdogRange;
use crate::journal::RememberedDrive;
use crate::line::barriers::LoopNonces;
use crate::line::budget::{self, PlannedStation, PollBudget};
use crate::line::standby::StandbyTimes;
use crate::line::timeouts::{ReplyTimeouts, longer_reply};
use crate::line::timing::LineTiming;
use crate::line::transaction::LineWire;
use crate::profile::model::Model;
use crate::wire::pdu::Request;
use std::sync::Arc;
use std::time::Duration;

/// One line and its drives.
#[derive(Clone, Debug)]
pub struct LineSetup {
    /// Times on the wire.
    pub timing: LineTiming,
    /// The drives, in the order of the configuration.
    pub drives: Vec<DriveSetup>,
    /// What to do if the line echoes.
    pub echo: EchoPolicy,
    /// Whether traffic is reported from the start.
    pub tells_traffic: bool,
    /// The first epoch of its drives: a different number at each start of the gateway.
    pub first_epoch: u64,
    /// Whether a request may have been sent to its drives just before it is opened, so that a reply may still arrive: by
    /// a previous run of the gateway, or by a tool.
    pub asked_before: bool,
    /// Whether commands were accepted before the line was created, as after a reload: a command for its drives may be
    /// older than the line.
    pub joins_late: bool,
    /// Whether there is a journal: orders that must be recorded first wait for it.
    pub keeps: bool,
    /// The times of the rule by which gateways share the line; `None`: this one is alone.
    pub standby: Option<StandbyTimes>,
}

impl LineSetup {
    /// Maximum waiting time of a stop for one drive.
    #[must_use]
    pub fn stop_bounds(&self) -> StopBounds {
        budget::stop_bounds(&self.timing, self.drives.iter().map(DriveSetup::planned))
    }

    /// The suitable range of times for the own watchdog of the drive at `place`; any time if it is read-only.
    #[must_use]
    pub fn watchdog_range(&self, place: usize) -> WatchdogRange {
        let stations: Vec<_> = self.drives.iter().map(DriveSetup::planned).collect();
        let commanded = self
            .drives
            .iter()
            .filter(|drive| drive.control.is_some())
            .count();
        let control = self
            .drives
            .get(place)
            .and_then(|drive| drive.control.as_ref());
        let gap = || budget::longest_gap_on_line(&self.timing, &stations, place, commanded);
        control.map_or(WatchdogRange::ANY, |control| WatchdogRange {
            more_than: gap().unwrap_or_default() * 2,
            at_most: control.watchdog_at_most(),
        })
    }

    /// The wire of the line, on which nothing has been received up to `now`. Each start of the
    /// gateway numbers its requests from another place.
    pub(super) fn wire(&self, now: MonoTime) -> LineWire {
        let mut wire = LineWire::new(self.timing, now);
        wire.number_from(LoopNonces::new(self.first_epoch).peek());
        if self.standby.is_some() {
            wire.listen();
        }
        wire
    }

    /// The cost of the line's polls.
    #[must_use]
    pub fn budget(&self) -> PollBudget {
        budget::of_plan(&self.timing, self.drives.iter().map(DriveSetup::planned))
    }
}

/// One drive of a line.
#[derive(Clone, Debug)]
pub struct DriveSetup {
    /// Station number on the line.
    pub station: Station,
    /// Its model.
    pub model: Arc<Model>,
    /// Period of its fast polls.
    pub poll: Duration,
    /// Maximum waits for a reply.
    pub timeouts: ReplyTimeouts,
    /// How long after a time-out a late reply may still arrive.
    pub max_lateness: Duration,
    /// Limits of control. `None`: it is read-only for every client.
    pub control: Option<Arc<ControlSettings>>,
    /// What is known about it from a previous run of the gateway.
    pub remembered: RememberedDrive,
}

impl DriveSetup {
    /// Its cost on the line.
    fn planned(&self) -> PlannedStation<'_> {
        let Self {
            model,
            poll,
            timeouts,
            max_lateness,
            ..
        } = self;
        PlannedStation {
            model,
            poll: *poll,
            timeouts: *timeouts,
            max_lateness: *max_lateness,
        }
    }

    /// Time on the wire of the reply to `request`, and the part of it that is due to characters longer than ours.
    pub(super) fn reply_time(
        &self,
        request: &Request,
        timing: &LineTiming,
    ) -> (Duration, Duration) {
        self.time_of(request.reply_pdu_bytes(), timing)
    }

    /// Time on the wire of a frame from the drive with a PDU of `pdu_bytes`, and the part of it that is due to
    /// characters longer than ours.
    pub(super) fn time_of(&self, pdu_bytes: usize, timing: &LineTiming) -> (Duration, Duration) {
        let bytes = timing.adu_bytes(pdu_bytes);
        let char_bits = self.model.timing.reply_char_bits.as_ref();
        let longer = longer_reply(timing, char_bits.map(|fact| fact.value), bytes);
        (timing.on_wire(bytes) + longer, longer)
    }
}
