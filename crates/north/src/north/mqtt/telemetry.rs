//! Everything that is published retained. There is no queue: what was last published is remembered per topic, and the
//! views are walked on each request for the next publication.

use super::drive_topics::DriveTopics;
use super::history::ChangeHistory;
use super::line_topics::{InfoTopic, LineTopics, infos};
use super::slot::{RenderContext, TopicSlot, retained};
use super::topics::MqttTopics;
use super::types::{Settings, TopicTree};
use crate::domain::ids::Name;
use crate::domain::time::MonoTime;
use crate::drive::description::DriveDescription;
use crate::drive::snapshot::ValueReading;
use crate::drive::view::DriveView;
use crate::north::broker::{MqttVersion, Publication, Qos, SessionLine};
use crate::north::clock::LabelClock;
use crate::north::points::PointContent;
use std::collections::BTreeSet;
use std::sync::Arc;
use std::time::Duration;

/// Most topics of removed drives and lines that are cleared again and again: those of a hundred drives. Further ones
/// stay as they are.
const GONE_MAX: usize = 4096;

/// What one of several gateways of a name publishes. The default: everything, as the only one.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub(super) struct PublishedShare {
    /// Another gateway publishes what concerns no single line.
    pub(super) is_led: bool,
    /// The status of the gateway as a whole is not published.
    pub(super) is_silent: bool,
    /// These lines; `None`: all.
    pub(super) lines: Option<Vec<bool>>,
    /// These drives; `None`: all.
    pub(super) drives: Option<Vec<bool>>,
}

impl PublishedShare {
    fn line(&self, place: usize) -> bool {
        self.lines
            .as_ref()
            .is_none_or(|lines| lines.get(place) == Some(&true))
    }

    fn drive(&self, place: usize) -> bool {
        self.drives
            .as_ref()
            .is_none_or(|drives| drives.get(place) == Some(&true))
    }
}

/// All retained topics of the gateway.
#[derive(Debug)]
pub(super) struct TelemetryTopics {
    heartbeat: Duration,
    /// Whether the broker may be given an expiry for telemetry.
    expires: bool,
    /// What the gateway and its drives are.
    infos: Vec<InfoTopic>,
    is_info_wanted: bool,
    status: TopicSlot,
    lines: Vec<LineTopics>,
    drives: Vec<DriveTopics>,
    /// Topics that the gateway no longer has or does not publish. They are cleared after each connection: a broker may
    /// bring an old state back.
    gone: Vec<String>,
    /// How many of them are cleared on this connection.
    cleared: usize,
    /// What this gateway publishes.
    share: PublishedShare,
    /// The position of the walk: 0 the information, then the lines, then the drives.
    place: usize,
}

impl TelemetryTopics {
    pub(super) fn new(
        settings: &Settings,
        topics: &MqttTopics,
        drives: &[DriveDescription],
        lines: &[Name],
        started: &str,
    ) -> Self {
        let mut telemetry = Self {
            heartbeat: settings.heartbeat,
            expires: settings.version == MqttVersion::V5,
            infos: infos(topics, drives, lines, started),
            is_info_wanted: settings.publish.contains(&TopicTree::Info),
            status: TopicSlot::new(topics.gateway("status")),
            lines: line_topics(settings, topics, drives, lines),
            drives: drives
                .iter()
                .map(|drive| DriveTopics::new(settings, topics, drive))
                .collect(),
            gone: Vec::new(),
            cleared: 0,
            share: PublishedShare::default(),
            place: 0,
        };
        telemetry.clear_all_but_own(telemetry.left_out(settings, topics, drives, lines));
        telemetry
    }

    /// Replaces drives and lines; `old` and `new` are in the order of the views. Those that continue keep what was
    /// published of them.
    pub(super) fn replace(
        &mut self,
        settings: &Settings,
        topics: &MqttTopics,
        (old, new): (&[DriveDescription], &[DriveDescription]),
        lines: &[Name],
        started: &str,
    ) {
        let before = self.topics();
        let old_infos = std::mem::replace(&mut self.infos, infos(topics, new, lines, started));
        for info in &mut self.infos {
            info.is_published = old_infos
                .iter()
                .any(|old| old.is_published && old.is_of_the_same(info));
        }
        let mut old_lines = std::mem::take(&mut self.lines);
        let mut old_drives = std::mem::take(&mut self.drives);
        self.lines = line_topics(settings, topics, new, lines)
            .into_iter()
            .map(|fresh| {
                let same = old_lines.iter().position(|it| it.is_of_the_same(&fresh));
                same.map(|at| old_lines.swap_remove(at)).unwrap_or(fresh)
            })
            .collect();
        let mut known: Vec<_> = old.iter().zip(old_drives.drain(..)).collect();
        self.drives = new
            .iter()
            .map(|drive| {
                let same = known.iter().position(|(it, _)| *it == drive);
                same.map_or_else(
                    || DriveTopics::new(settings, topics, drive),
                    |at| known.swap_remove(at).1,
                )
            })
            .collect();
        let left_out = self.left_out(settings, topics, new, lines);
        self.clear_all_but_own(before.into_iter().chain(left_out));
        self.place = 0;
    }

    /// Retained topics that are not published although there is content for them. Registers that were read on demand
    /// are not included: which ones is not known.
    fn left_out(
        &self,
        settings: &Settings,
        topics: &MqttTopics,
        drives: &[DriveDescription],
        lines: &[Name],
    ) -> Vec<String> {
        let of_drives = self.drives.iter().flat_map(DriveTopics::left_out);
        let mut left_out: Vec<String> = of_drives.map(str::to_owned).collect();
        if self.lines.is_empty() {
            for name in lines {
                let line = LineTopics::new(topics, name, drives);
                left_out.extend(line.topics().map(str::to_owned));
            }
        }
        if !settings.publish.contains(&TopicTree::Info) {
            left_out.extend(self.infos.iter().map(|info| info.topic.clone()));
        }
        left_out
    }

    /// Adds `topics` to those that are cleared.
    fn clear_all_but_own(&mut self, topics: impl IntoIterator<Item = String>) {
        self.gone.extend(topics);
        let own: BTreeSet<_> = self.topics().into_iter().collect();
        self.gone.retain(|topic| !own.contains(topic));
        self.gone.sort_unstable();
        self.gone.dedup();
        self.gone.truncate(GONE_MAX);
        self.cleared = 0;
    }

    /// All retained topics of lines and drives.
    fn topics(&self) -> Vec<String> {
        let lines = self.lines.iter().flat_map(LineTopics::topics);
        let infos = if self.is_info_wanted {
            self.infos.as_slice()
        } else {
            &[]
        };
        let infos = infos.iter().map(|info| info.topic.as_str());
        let drives = self.drives.iter().flat_map(DriveTopics::topics);
        lines
            .chain(drives)
            .chain(infos)
            .map(str::to_owned)
            .collect()
    }

    fn clear_next(&mut self, now: &RenderContext) -> Option<Publication> {
        if self.share.is_led {
            return None;
        }
        let topic = self.gone.get(self.cleared)?.clone();
        self.cleared += 1;
        Some(retained(now, topic, Vec::new(), Qos::AtLeastOnce))
    }

    /// Everything is to be published again: a birth.
    pub(super) fn forget(&mut self) {
        self.infos
            .iter_mut()
            .for_each(|info| info.is_published = false);
        self.place = 0;
        self.cleared = 0;
        self.status.forget();
        self.lines.iter_mut().for_each(LineTopics::forget);
        self.drives.iter_mut().for_each(DriveTopics::forget);
    }

    /// Publishes this share from now on. What is new in it is published again.
    pub(super) fn publish_for(&mut self, share: PublishedShare) {
        let before = std::mem::replace(&mut self.share, share);
        let now = &self.share;
        let lines = self
            .lines
            .iter_mut()
            .enumerate()
            .filter(|(place, _)| before.line(*place) != now.line(*place));
        lines.for_each(|(_, line)| line.forget());
        let drives = self
            .drives
            .iter_mut()
            .enumerate()
            .filter(|(place, _)| before.drive(*place) != now.drive(*place));
        drives.for_each(|(_, drive)| drive.forget());
        if before.is_led != now.is_led {
            self.infos
                .iter_mut()
                .for_each(|info| info.is_published = false);
            self.cleared = 0;
        }
        if before.is_silent != now.is_silent {
            self.status.forget();
        }
    }

    /// The status was changed by another gateway: it is published again.
    pub(super) fn forget_status(&mut self) {
        self.status.forget();
    }

    /// What another gateway published last may have replaced what lines and drives show: they are published again.
    pub(super) fn forget_lines(&mut self) {
        self.lines.iter_mut().for_each(LineTopics::forget);
        self.drives.iter_mut().for_each(DriveTopics::forget);
    }

    /// Takes a register of a drive that was read on demand.
    pub(super) fn take_param(
        &mut self,
        drive: usize,
        register: usize,
        reading: ValueReading,
        topic: String,
    ) {
        if let Some(topics) = self.drives.get_mut(drive) {
            topics.take_param(register, reading, topic);
        }
    }

    /// Keeps changes in `history` while there is no broker to publish to. Returns how many were dropped for them.
    pub(super) fn record(
        &mut self,
        (at, clock): (MonoTime, LabelClock),
        drives: &[DriveDescription],
        views: &[Arc<DriveView>],
        history: &mut ChangeHistory,
    ) -> u64 {
        let now = RenderContext {
            at,
            clock,
            heartbeat: self.heartbeat,
            expires: self.expires,
        };
        let share = &self.share;
        let each = self
            .drives
            .iter_mut()
            .zip(drives.iter().zip(views))
            .enumerate();
        let each = each.filter(|(place, _)| share.drive(*place));
        let changes = each
            .flat_map(|(place, (topics, (drive, view)))| topics.record(&now, place, drive, view));
        changes.map(|change| u64::from(history.add(change))).sum()
    }

    /// The next publication; `None` if all topics show the views. `status` is published last, so that a client that
    /// waits for it finds the rest complete.
    pub(super) fn next(
        &mut self,
        at: MonoTime,
        clock: LabelClock,
        drives: &[DriveDescription],
        views: &[Arc<DriveView>],
        lines: &[SessionLine],
    ) -> Option<Publication> {
        let now = RenderContext {
            at,
            clock,
            heartbeat: self.heartbeat,
            expires: self.expires,
        };
        if let Some(clearing) = self.clear_next(&now) {
            return Some(clearing);
        }
        let places = 1 + self.lines.len() + self.drives.len();
        for _ in 0..places {
            let found = self.at_place(&now, drives, views, lines);
            if found.is_some() {
                return found;
            }
            self.place = (self.place + 1) % places;
        }
        if self.share.is_silent {
            return None;
        }
        let is_due = self
            .status
            .offer(&now, PointContent::Text("online".into()), |_, _| true)
            .is_some();
        is_due.then(|| {
            self.status
                .publication(&now, b"online".to_vec(), Qos::AtLeastOnce)
        })
    }

    fn at_place(
        &mut self,
        now: &RenderContext,
        drives: &[DriveDescription],
        views: &[Arc<DriveView>],
        lines: &[SessionLine],
    ) -> Option<Publication> {
        let Some(place) = self.place.checked_sub(1) else {
            return self.take_info();
        };
        if let Some(topics) = self.lines.get_mut(place) {
            if !self.share.line(place) {
                return None;
            }
            return topics.next(now, lines.get(place)?);
        }
        let place = place - self.lines.len();
        if !self.share.drive(place) {
            return None;
        }
        let topics = self.drives.get_mut(place)?;
        topics.next(now, drives.get(place)?, views.get(place)?)
    }

    fn take_info(&mut self) -> Option<Publication> {
        if !self.is_info_wanted || self.share.is_led {
            return None;
        }
        let info = self.infos.iter_mut().find(|info| !info.is_published)?;
        info.is_published = true;
        Some(Publication {
            retain: true,
            qos: Qos::AtLeastOnce,
            ..Publication::new(info.topic.clone(), info.payload.clone())
        })
    }

    /// When something may be due although no view changes.
    pub(super) fn wake(&self) -> Option<MonoTime> {
        let lines = self.lines.iter().filter_map(|it| it.wake(self.heartbeat));
        let drives = self.drives.iter().filter_map(DriveTopics::wake);
        let all = lines.chain(drives).chain([self.status.due(self.heartbeat)]);
        all.min().filter(|wake| *wake != MonoTime::NEVER)
    }
}

/// The topics of the lines; none if they are not published.
fn line_topics(
    settings: &Settings,
    topics: &MqttTopics,
    drives: &[DriveDescription],
    lines: &[Name],
) -> Vec<LineTopics> {
    if !settings.publish.contains(&TopicTree::Line) {
        return Vec::new();
    }
    lines
        .iter()
        .map(|name| LineTopics::new(topics, name, drives))
        .collect()
}
