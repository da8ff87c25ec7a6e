//! What one line thread publishes to the north sides: answers, the views of its drives, its own state.

use super::rows::LineRows;
use crate::daemon::exchange::answers::LineNews;
use crate::daemon::exchange::bell::BrokerBell;
use crate::daemon::exchange::inbox::{LineInbox, LineMessage};
use crate::daemon::exchange::north_sides::NorthSides;
use crate::daemon::exchange::shared::SharedLine;
use crate::daemon::host::clock;
use crate::daemon::journal::Journal;
use crate::domain::ids::{AskerId, DriveIndex};
use crate::domain::report::LineReport;
use crate::domain::time::MonoTime;
use crate::domain::traffic::TrafficRecord;
use crate::drive::description::DriveRef;
use crate::drive::view::TripEvent;
use crate::gateway::LineCore;
use crate::journal::EntryToKeep;
use std::sync::Arc;

/// The side of a line that its thread writes.
#[derive(Debug)]
pub struct LineBoard {
    line: Arc<SharedLine>,
    changed: Arc<BrokerBell>,
    north: NorthSides,
    journal: Option<LineRows>,
    /// The line is being watched.
    is_watched: bool,
    /// Recorded traffic that is not handed over yet.
    traffic: Vec<TrafficRecord>,
    /// News of this round.
    modbus: Vec<LineNews>,
    mqtt: Vec<LineNews>,
    sparkplug: Vec<LineNews>,
    local: Vec<LineNews>,
}

impl LineBoard {
    /// The board of `line`, whose news are sent to `north` and whose rows to `journal`; `changed` is rung for them.
    #[must_use]
    pub fn new(
        line: Arc<SharedLine>,
        changed: Arc<BrokerBell>,
        north: NorthSides,
        journal: Option<&Arc<Journal>>,
    ) -> Self {
        let journal = journal.map(|journal| {
            let drives = line
                .drives
                .iter()
                .map(|drive| drive.description.clone())
                .collect();
            LineRows::new(journal.line(line.name.clone(), drives, Arc::clone(&line.inbox)))
        });
        let is_watched = false;
        let traffic = Vec::new();
        let modbus = Vec::new();
        let mqtt = Vec::new();
        let sparkplug = Vec::new();
        let local = Vec::new();
        Self {
            line,
            changed,
            north,
            journal,
            is_watched,
            traffic,
            modbus,
            mqtt,
            sparkplug,
            local,
        }
    }

    /// The way into the line.
    #[must_use]
    pub fn inbox(&self) -> &LineInbox {
        &self.line.inbox
    }

    /// Counts a round of the thread.
    pub fn count_round(&self) {
        self.line.count_round();
    }

    /// Whether the line is watched at `now`. The recorded traffic is dropped with the last listener.
    pub fn is_watched(&mut self, now: MonoTime) -> bool {
        let is_watched = self.line.traffic.is_watched(now);
        if self.is_watched && !is_watched {
            self.traffic = Vec::new();
            self.line.traffic.forget();
        }
        self.is_watched = is_watched;
        is_watched
    }

    /// Keeps `record` for the listeners, if there are any.
    pub fn tell_traffic(&mut self, record: TrafficRecord) {
        if self.is_watched {
            self.traffic.push(record);
        }
    }

    /// Notes a message to the line.
    pub fn note(&mut self, message: &LineMessage) {
        if let Some(journal) = &mut self.journal {
            let drives = &self.line.drives;
            journal.note(message, |drive| {
                drives
                    .get(drive.get())
                    .map(|drive| &drive.description.model)
            });
        }
    }

    /// Passes a row of the line to the journal, if there is one.
    pub fn keep(&mut self, keep: EntryToKeep) {
        if let Some(journal) = &mut self.journal {
            journal.keep(keep);
        }
    }

    /// Keeps `news` for the end of the round.
    pub fn tell(&mut self, news: LineNews) {
        let news = match &mut self.journal {
            Some(journal) => journal.hold(news),
            None => Some(news),
        };
        let Some(news) = news else { return };
        match news.asker() {
            AskerId::LOCAL | AskerId::PAGE => self.local.push(news),
            AskerId::MQTT if self.north.mqtt.is_some() => self.mqtt.push(news),
            AskerId::SPARKPLUG if self.north.sparkplug.is_some() => self.sparkplug.push(news),
            AskerId::MQTT | AskerId::SPARKPLUG => {}
            _ => self.modbus.push(news),
        }
    }

    /// Keeps what happened to the trips of `drive` for the end of the round. With a journal they come from there.
    pub fn tell_trip(&mut self, drive: DriveIndex, event: TripEvent) {
        if self.journal.is_some() {
            return;
        }
        self.tell(LineNews::Trip(
            DriveRef {
                line: self.line.number,
                drive,
            },
            event,
        ));
    }

    /// Publishes what has changed in this round. Views before answers: a client that receives a confirmation finds the
    /// view already updated.
    pub fn show(&mut self, core: &mut LineCore) {
        // Both sides of the broker are woken by the same bell for answers and for views.
        let mut has_changed = !self.mqtt.is_empty() || !self.sparkplug.is_empty();
        for (drive, view) in core.changed_views() {
            if let Some(shared) = self.line.drives.get(drive.get()) {
                shared.view.store(view);
                has_changed = true;
            }
        }
        if let Some((drive, station)) = core.next_station(clock::now())
            && let Some(shared) = self.line.drives.get(drive.get())
        {
            shared.station.store(Arc::new(station));
        }
        let report = core.report();
        let before = self.line.report();
        let role = |report: &LineReport| report.standby.map(|standby| standby.role);
        has_changed |= role(&report) != role(&before);
        if report.state != before.state {
            has_changed = true;
            self.journal
                .iter()
                .for_each(|journal| journal.source().state(&report));
        }
        self.line.set_report(report);
        self.line.traffic.take_over(&mut self.traffic);
        self.north.modbus.put(&mut self.modbus);
        self.north.local.put(&mut self.local);
        for (side, news) in [
            (&self.north.mqtt, &mut self.mqtt),
            (&self.north.sparkplug, &mut self.sparkplug),
        ] {
            if let Some(side) = side {
                side.put(news);
            }
        }
        for held in self.journal.iter_mut().flat_map(LineRows::held) {
            let by_broker = match held.news.asker() {
                AskerId::LOCAL | AskerId::PAGE => {
                    self.north.local.hold(held);
                    continue;
                }
                AskerId::MQTT => &self.north.mqtt,
                AskerId::SPARKPLUG => &self.north.sparkplug,
                _ => {
                    self.north.modbus.hold(held);
                    continue;
                }
            };
            if let Some(side) = by_broker {
                side.hold(held);
                has_changed = true;
            }
        }
        if has_changed {
            self.changed.ring();
        }
    }
}
