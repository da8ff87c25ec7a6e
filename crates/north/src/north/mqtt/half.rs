//! One of several gateways with the same name and drives: which lines it publishes, what it reports of itself, and what
//! it knows of the others.
//!
//! On a line with several gateways the active one publishes. A listener publishes nothing of the line and its drives,
//! and leaves commands to the active one.

use super::slot::{RenderContext, TopicSlot, retained};
use super::topics::MqttTopics;
use crate::domain::ids::Name;
use crate::domain::standby::{LineRole, StandbyPair, StandbyReport};
use crate::domain::time::MonoTime;
use crate::north::broker::{Publication, Qos, SessionLine};
use crate::north::points::PointContent;
use serde_json::{Value, json};
use std::collections::BTreeMap;
use std::time::Duration;

/// How long a gateway that has taken a line over delays trip events of its drives: those that the previous one has
/// published arrive first.
pub(super) const SETTLES_WITHIN: Duration = Duration::from_secs(1);
/// After this time without a sign of life another gateway that was missed is published as offline.
const MISSED_AFTER: Duration = Duration::from_secs(5);
/// Most other gateways that are known.
const OTHERS_MAX: usize = 8;

/// A line as this gateway takes part in it.
#[derive(Debug)]
struct PairLine {
    name: Name,
    /// `None` before the line was seen; inside it `None` for a line without another gateway.
    seen: Option<Option<StandbyReport>>,
    /// When this gateway became active there.
    active_since: Option<MonoTime>,
}

/// Another gateway of the same name, as it reports itself.
#[derive(Debug, Default)]
struct PairPeer {
    /// The lines on which it is active; none if it is offline.
    active_on: Vec<String>,
    is_online: bool,
    /// It has reported since another gateway last went offline.
    is_there: bool,
}

impl PairPeer {
    const fn is_active(&self) -> bool {
        self.is_there && !self.active_on.is_empty()
    }
}

/// Which of several gateways this one is.
#[derive(Debug)]
pub(super) struct PairMember {
    pair: Option<StandbyPair>,
    lines: Vec<PairLine>,
    /// The line of each drive.
    drives: Vec<Option<usize>>,
    document: TopicSlot,
    others: BTreeMap<String, PairPeer>,
    /// When other gateways that have not reported since the last one went offline are published as offline.
    missed_at: Option<MonoTime>,
    /// Documents of others that are to be replaced.
    gone: Vec<String>,
    /// The present.
    now: MonoTime,
}

impl PairMember {
    pub(super) fn new(pair: Option<StandbyPair>, topics: &MqttTopics) -> Self {
        let topic = pair
            .as_ref()
            .map(|pair| topics.standby(pair.half.as_str()))
            .unwrap_or_default();
        let document = TopicSlot::new(topic);
        let others = BTreeMap::new();
        let (lines, drives, gone) = (Vec::new(), Vec::new(), Vec::new());
        Self {
            pair,
            lines,
            drives,
            document,
            others,
            missed_at: None,
            gone,
            now: MonoTime::ZERO,
        }
    }

    /// Has these lines from now on, and drives on `of_drives`. Lines that stay keep their role.
    pub(super) fn replace(&mut self, lines: &[Name], of_drives: impl Iterator<Item = Name>) {
        let mut before = std::mem::take(&mut self.lines);
        let line = |name: &Name| {
            let same = before
                .iter()
                .position(|it| it.name == *name)
                .map(|place| before.swap_remove(place));
            same.unwrap_or_else(|| PairLine {
                name: name.clone(),
                seen: None,
                active_since: None,
            })
        };
        self.lines = lines.iter().map(line).collect();
        self.drives = of_drives
            .map(|name| lines.iter().position(|it| *it == name))
            .collect();
    }

    /// Which one it is; `None` if it is the only one.
    pub(super) const fn pair(&self) -> Option<&StandbyPair> {
        self.pair.as_ref()
    }

    /// Takes the present roles, in the order of the lines. Returns whether it publishes other lines than before.
    pub(super) fn see(&mut self, at: MonoTime, lines: &[SessionLine]) -> bool {
        self.now = at;
        let has_pair = self.pair.is_some();
        let mut has_changed = false;
        for (line, state) in self.lines.iter_mut().zip(lines) {
            let did_publish = publishes(line, has_pair);
            line.seen = Some(state.report.standby);
            let does_publish = publishes(line, has_pair);
            if did_publish != does_publish {
                has_changed = true;
                line.active_since = does_publish.then_some(at);
            }
        }
        has_changed
    }

    /// When the roles were last seen.
    pub(super) const fn now(&self) -> MonoTime {
        self.now
    }

    /// Whether it publishes each line, and each drive.
    pub(super) fn published_places(&self) -> (Vec<bool>, Vec<bool>) {
        let lines = (0..self.lines.len())
            .map(|line| self.publishes_for_line(line))
            .collect();
        (
            lines,
            (0..self.drives.len())
                .map(|drive| self.publishes_for(drive))
                .collect(),
        )
    }

    fn publishes_for_line(&self, line: usize) -> bool {
        self.lines.get(line).map_or(self.pair.is_none(), |line| {
            publishes(line, self.pair.is_some())
        })
    }

    /// Whether it publishes the drive at this place.
    pub(super) fn publishes_for(&self, drive: usize) -> bool {
        let line = self.drives.get(drive).copied().flatten();
        line.map_or(self.pair.is_none(), |line| self.publishes_for_line(line))
    }

    /// Whether a command for the drive at this place is for this gateway. A stop is, unless another gateway reports that it
    /// is active on the line, and there is traffic on it: a foreign master may hold the line, and carries out no stops.
    pub(super) fn may_take(&self, drive: usize, is_a_stop: bool) -> bool {
        let stops = || {
            let line = self
                .drives
                .get(drive)
                .copied()
                .flatten()
                .and_then(|line| self.lines.get(line))?;
            let is_quiet = line
                .seen
                .flatten()
                .is_some_and(|report| !report.hears_other);
            let is_active = |other: &PairPeer| {
                other
                    .active_on
                    .iter()
                    .any(|name| name == line.name.as_str())
            };
            Some(is_quiet || !self.others.values().any(is_active))
        };
        self.publishes_for(drive) || is_a_stop && stops() == Some(true)
    }

    /// Whether trip events of the drive at this place may be published.
    pub(super) fn may_publish(&self, at: MonoTime, drive: usize) -> bool {
        self.publishes_for(drive)
            && self
                .settles_at(drive)
                .is_none_or(|settles_at| at >= settles_at)
    }

    fn settles_at(&self, drive: usize) -> Option<MonoTime> {
        self.pair.as_ref()?;
        let line = self.lines.get(self.drives.get(drive).copied().flatten()?)?;
        Some(line.active_since? + SETTLES_WITHIN)
    }

    /// Whether it publishes any line: then it also publishes that the gateway is online.
    pub(super) fn publishes_anything(&self) -> bool {
        self.pair.is_none() || (0..self.lines.len()).any(|line| self.publishes_for_line(line))
    }

    /// Whether it publishes what concerns no single line: the first one by name among those that are active does.
    pub(super) fn leads(&self) -> bool {
        let Some(pair) = &self.pair else { return true };
        let is_before = |(name, other): (&String, &PairPeer)| {
            other.is_active() && name.as_str() < pair.half.as_str()
        };
        self.publishes_anything() && !self.others.iter().any(is_before)
    }

    /// Whether another one reports that it is active.
    pub(super) fn is_another_active(&self) -> bool {
        self.others.values().any(PairPeer::is_active)
    }

    /// Whether the partner reports that it is online, and was not missed since; `None` without one.
    pub(super) fn is_partner_online(&self) -> Option<bool> {
        let partner = self.pair.as_ref()?.partner.as_str();
        Some(self.others.get(partner).is_some_and(|it| it.is_online))
    }

    /// Takes the document of one of them. Returns whether one that was active is so no longer: what it published last
    /// may have arrived late.
    pub(super) fn heard(&mut self, half: &str, payload: &[u8]) -> bool {
        let Some(pair) = &self.pair else { return false };
        let document: Value = serde_json::from_slice(payload).unwrap_or_default();
        let is_online = document.get("online").and_then(Value::as_bool) == Some(true);
        if half == pair.half.as_str() {
            if !is_online {
                self.document.forget();
            }
            return false;
        }
        if self.others.len() >= OTHERS_MAX && !self.others.contains_key(half)
            || Name::new(half).is_none()
        {
            return false;
        }
        let other = self.others.entry(half.to_owned()).or_default();
        let lines = match document.get("lines") {
            Some(Value::Array(lines)) if is_online => lines.as_slice(),
            _ => &[],
        };
        let active = |line: &Value| {
            if line.get("role")?.as_str()? != LineRole::Active.keyword() {
                return None;
            }
            Some(line.get("name")?.as_str()?.to_owned())
        };
        let active_on: Vec<_> = lines.iter().filter_map(active).collect();
        let is_less = other.active_on.iter().any(|line| !active_on.contains(line));
        *other = PairPeer {
            active_on,
            is_online,
            is_there: true,
        };
        is_less
    }

    /// The gateway was published as offline: not by this one, so a gateway has failed or left. Those that are online report again.
    pub(super) fn published_offline(&mut self, at: MonoTime) {
        self.document.forget();
        for other in self.others.values_mut() {
            other.is_there = false;
        }
        self.missed_at = Some(at + MISSED_AFTER);
    }

    /// The next publication about this gateway and the others; none without others.
    pub(super) fn next(&mut self, now: &RenderContext, topics: &MqttTopics) -> Option<Publication> {
        self.pair.as_ref()?;
        if self
            .missed_at
            .take_if(|missed_at| now.at >= *missed_at)
            .is_some()
        {
            let missed = |(name, it): (&String, &PairPeer)| {
                (it.is_online && !it.is_there).then(|| name.clone())
            };
            self.gone = self.others.iter().filter_map(missed).collect();
        }
        if let Some(half) = self.gone.pop() {
            self.others.remove(&half);
            let payload = json!({ "half": half, "online": false, "lines": [] })
                .to_string()
                .into_bytes();
            return Some(retained(
                now,
                topics.standby(&half),
                payload,
                Qos::AtLeastOnce,
            ));
        }
        let text = self.text(true);
        let payload = text.clone().into_bytes();
        self.document
            .offer(now, PointContent::Text(text.into()), |_, _| true)?;
        Some(self.document.publication(now, payload, Qos::AtLeastOnce))
    }

    /// What it publishes on an orderly end; `None` without others.
    pub(super) fn farewell(&self, now: &RenderContext) -> Option<Publication> {
        self.pair.as_ref()?;
        Some(
            self.document
                .publication(now, self.text(false).into_bytes(), Qos::AtLeastOnce),
        )
    }

    fn text(&self, is_online: bool) -> String {
        let half = self.pair.as_ref().map(|pair| pair.half.as_str());
        let partner = self.pair.as_ref().map(|pair| pair.partner.as_str());
        let of_line = |line: &PairLine| {
            let StandbyReport {
                role,
                take_overs,
                given_up,
                rivals,
                hears_other,
                listener,
                kept: _,
                trouble: _,
            } = line.seen.flatten()?;
            Some(json!({
                "name": line.name.as_str(),
                "role": role.keyword(),
                "take_overs": take_overs,
                "given_up": given_up,
                "rivals": rivals,
                "hears_other": hears_other,
                "listener": listener,
            }))
        };
        let lines: Vec<_> = if is_online {
            self.lines.iter().filter_map(of_line).collect()
        } else {
            Vec::new()
        };
        json!({ "half": half, "partner": partner, "online": is_online, "lines": lines }).to_string()
    }

    /// The connection is lost. The next one brings what the others have published in the meantime.
    pub(super) fn lost(&mut self) {
        self.document.forget();
        self.others.clear();
        self.gone.clear();
        self.missed_at = None;
    }

    /// When something may be due although nothing happens.
    pub(super) fn wake(&self, heartbeat: Duration) -> Option<MonoTime> {
        self.pair.as_ref()?;
        let settles = self
            .lines
            .iter()
            .filter_map(|line| Some(line.active_since? + SETTLES_WITHIN));
        let settles = settles.filter(|settles_at| *settles_at > self.now);
        let document = Some(self.document.due(heartbeat)).filter(|due| *due != MonoTime::NEVER);
        settles.chain(document).chain(self.missed_at).min()
    }
}

fn publishes(line: &PairLine, has_pair: bool) -> bool {
    match line.seen {
        Some(Some(report)) => report.role == LineRole::Active,
        Some(None) => true,
        None => !has_pair,
    }
}
