//! The shape of a fleet: how many gateways with how many drives, their names, and when each update is due.

use std::time::Duration;
use vfd_gateway::domain::time::MonoTime;

/// What an update of a drive publishes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Update {
    /// The document `state`, with everything that is known about the drive.
    State,
    /// The topic `frequency/output`, with one number.
    Frequency,
}

impl Update {
    /// Its topic below that of the drive.
    #[must_use]
    pub const fn topic(self) -> &'static str {
        match self {
            Self::State => "state",
            Self::Frequency => "frequency/output",
        }
    }
}

/// The numbers of gateways, drives and updates, and the interval of updates.
#[derive(Clone, Debug, PartialEq)]
pub struct Shape {
    /// First levels of all topics.
    pub prefix: String,
    /// Gateways.
    pub gateways: usize,
    /// Drives of each.
    pub drives: usize,
    /// What an update publishes.
    pub update: Update,
    /// Time between two updates of one drive.
    pub interval: Duration,
    /// Updates of each drive.
    pub updates: u32,
}

impl Shape {
    /// The name of the gateway with this number, from 0.
    #[must_use]
    pub fn gateway_name(gateway: usize) -> String {
        format!("gw-{:04}", gateway + 1)
    }

    /// The name of the drive with this number, from 0.
    #[must_use]
    pub fn drive_name(drive: usize) -> String {
        format!("drive-{:02}", drive + 1)
    }

    /// The topic of a gateway with this `rest`.
    #[must_use]
    pub fn topic_of_gateway(&self, gateway: usize, rest: &str) -> String {
        format!("{}/{}/{rest}", self.prefix, Self::gateway_name(gateway))
    }

    /// The topic of the updates of a drive.
    #[must_use]
    pub fn topic(&self, gateway: usize, drive: usize) -> String {
        self.topic_of_gateway(
            gateway,
            &format!("drive/{}/{}", Self::drive_name(drive), self.update.topic()),
        )
    }

    /// The filter for the updates of one gateway; `None` for all.
    #[must_use]
    pub fn filter(&self, gateway: Option<usize>) -> String {
        let gateway = gateway.map_or_else(|| "+".to_owned(), Self::gateway_name);
        format!("{}/{gateway}/drive/+/{}", self.prefix, self.update.topic())
    }

    /// The drive whose updates are published on `topic`, counted over all gateways.
    #[must_use]
    pub fn drive_of(&self, topic: &str) -> Option<usize> {
        let below = topic
            .strip_prefix(self.prefix.as_str())?
            .strip_prefix('/')?;
        let (gateway, rest) = below.strip_prefix("gw-")?.split_once("/drive/drive-")?;
        let (drive, update) = rest.split_once('/')?;
        let number = |digits: &str, most| {
            digits
                .parse::<usize>()
                .ok()?
                .checked_sub(1)
                .filter(|it| *it < most)
        };
        let place = number(gateway, self.gateways)? * self.drives + number(drive, self.drives)?;
        (update == self.update.topic()).then_some(place)
    }

    /// All drives.
    #[must_use]
    pub const fn drives_of_all(&self) -> usize {
        self.gateways.saturating_mul(self.drives)
    }

    /// How many updates a gateway has to send.
    #[must_use]
    pub const fn updates_of_gateway(&self) -> u64 {
        self.updates as u64 * self.drives as u64
    }

    /// How many updates there are in all.
    #[must_use]
    pub const fn updates_of_all(&self) -> u64 {
        self.updates_of_gateway()
            .saturating_mul(self.gateways as u64)
    }

    /// How long all updates last.
    #[must_use]
    pub fn lasts(&self) -> Duration {
        self.interval * self.updates
    }

    /// When the update of `gateway` with this place in its order is due, if the first of all is due at `start`. Drives
    /// take turns, as polls on a line do, and no two gateways are in step.
    #[must_use]
    pub fn due(&self, gateway: usize, place: u64, start: MonoTime) -> MonoTime {
        let nanos = u64::try_from(self.interval.as_nanos()).unwrap_or(u64::MAX);
        let round = place / self.drives.max(1) as u64;
        let drive = place % self.drives.max(1) as u64;
        let slots = (self.drives_of_all() as u64).max(1);
        let slot = drive * self.gateways as u64 + gateway as u64;
        let phase = u128::from(nanos) * u128::from(slot) / u128::from(slots);
        let after = nanos
            .saturating_mul(round)
            .saturating_add(u64::try_from(phase).unwrap_or(u64::MAX));
        start + Duration::from_nanos(after)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::collections::BTreeSet;

    fn shape(update: Update) -> Shape {
        let prefix = "vfd/test".to_owned();
        Shape {
            prefix,
            gateways: 20,
            drives: 4,
            update,
            interval: Duration::from_secs(1),
            updates: 5,
        }
    }

    #[test]
    fn topics_are_found_again_and_no_others() {
        for update in [Update::State, Update::Frequency] {
            let shape = shape(update);
            for (gateway, drive) in [(0, 0), (7, 2), (19, 3)] {
                assert_eq!(
                    shape.drive_of(&shape.topic(gateway, drive)),
                    Some(gateway * 4 + drive)
                );
            }
            for topic in [
                shape.topic(20, 0),
                shape.topic(0, 4),
                shape.topic(0, 0) + "x",
                shape.topic_of_gateway(0, "status"),
            ] {
                assert_eq!(shape.drive_of(&topic), None, "{topic}");
            }
            assert_eq!(
                shape.drive_of("vfd/test/gw-0000/drive/drive-00/state"),
                None
            );
            assert_eq!(shape.drive_of(""), None);
        }
        assert_eq!(
            shape(Update::State).filter(None),
            "vfd/test/+/drive/+/state"
        );
        assert_eq!(
            shape(Update::State).filter(Some(4)),
            "vfd/test/gw-0005/drive/+/state"
        );
    }

    #[test]
    fn updates_are_spread_evenly_and_each_drive_has_its_own_pace() {
        let shape = shape(Update::State);
        let start = MonoTime::from_millis(1_000);
        let all = |gateway| (0..shape.updates_of_gateway()).map(move |place| (gateway, place));
        let due: BTreeSet<_> = (0..shape.gateways)
            .flat_map(all)
            .map(|(gateway, place)| shape.due(gateway, place, start))
            .collect();
        assert_eq!(due.len() as u64, shape.updates_of_all(), "no two at once");
        let gaps: BTreeSet<_> = due
            .iter()
            .zip(due.iter().skip(1))
            .map(|(one, next)| next.since(*one))
            .collect();
        assert_eq!(gaps, BTreeSet::from([shape.interval / 80]));
        assert_eq!(
            shape.due(3, 4, start).since(shape.due(3, 0, start)),
            shape.interval
        );
        assert!(due.iter().all(|due| due.since(start) < shape.lasts()));
        assert_eq!(shape.lasts(), Duration::from_secs(5));
    }
}
