//! What the north sides read and the lines write: a view of each drive, a report of each line.

use crate::daemon::exchange::bell::BrokerBell;
use crate::daemon::exchange::inbox::{LineInbox, LineMessage};
use crate::daemon::exchange::role::SharedRole;
use crate::daemon::exchange::traffic::LineTraffic;
use crate::domain::command::CommandRequest;
use crate::domain::ids::Name;
use crate::domain::link::{Interface, Wiring};
use crate::domain::report::{LineReport, StationReport};
use crate::domain::standby::StandbyPair;
use crate::drive::description::{DriveDescription, DriveRef};
use crate::drive::view::DriveView;
use crate::line::standby::StandbyTimes;
use crate::north::titles::PlantTitles;
use arc_swap::{ArcSwap, Guard};
use std::collections::BTreeMap;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::{Arc, Mutex, PoisonError};

/// Everything that north sides and lines share, for one configuration. A change of the configuration makes a new one,
/// which contains the same lines as before where they continue.
#[derive(Debug)]
pub struct SharedPlant {
    /// The drives of all lines, in the order of the configuration.
    pub drives: Vec<Arc<SharedDrive>>,
    /// The lines, in the order of the configuration.
    pub lines: Vec<Arc<SharedLine>>,
    /// What people call its parts.
    pub titles: Arc<PlantTitles>,
    /// Rung whenever a view, a line's state or the configuration has changed.
    pub changed: Arc<BrokerBell>,
}

/// One drive.
#[derive(Debug)]
pub struct SharedDrive {
    /// What does not change.
    pub description: DriveDescription,
    /// The newest view.
    pub view: ArcSwap<DriveView>,
    /// How its line sees it, at most a second old.
    pub station: ArcSwap<StationReport>,
    /// The way to it.
    pub inbox: Arc<LineInbox>,
    /// The gateway's role on its line, as of the line's last report.
    pub role: Arc<SharedRole>,
}

/// The gateways of one line.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct StandbyShare {
    /// The names of the gateways.
    pub pair: StandbyPair,
    /// When this one takes the line over.
    pub times: StandbyTimes,
}

/// One line, from its start to its end.
#[derive(Debug)]
pub struct SharedLine {
    /// Names the line in the places of its drives; no other line of the process has the same number.
    pub number: u16,
    /// Its name.
    pub name: Name,
    /// What it is physically.
    pub interface: Interface,
    /// How it is wired.
    pub wiring: Wiring,
    /// The gateways on it; `None`: this one alone.
    pub standby: Option<StandbyShare>,
    /// The way in.
    pub inbox: Arc<LineInbox>,
    /// Its drives, in order.
    pub drives: Vec<Arc<SharedDrive>>,
    /// Its traffic, for those who watch it.
    pub traffic: LineTraffic,
    role: Arc<SharedRole>,
    report: Mutex<LineReport>,
    rounds: AtomicU64,
    hangs: AtomicBool,
}

impl SharedPlant {
    /// Drives that were not polled yet, and lines that are down. `lines` names the lines in order; they are numbered
    /// from 0.
    #[must_use]
    pub fn new(lines: Vec<(Name, Interface)>, drives: Vec<DriveDescription>) -> Self {
        let line = |(number, (name, interface))| {
            let on_line = drives.iter().filter(|drive| drive.place.line == number);
            Arc::new(SharedLine::new(number, name, interface, on_line.cloned()))
        };
        Self::of((0..).zip(lines).map(line).collect(), Arc::default())
    }

    /// The shared state of these lines with their drives.
    #[must_use]
    pub fn of(lines: Vec<Arc<SharedLine>>, changed: Arc<BrokerBell>) -> Self {
        Self {
            drives: lines
                .iter()
                .flat_map(|line| line.drives.iter().cloned())
                .collect(),
            lines,
            titles: Arc::default(),
            changed,
        }
    }

    /// This plant with these titles.
    #[must_use]
    pub fn titled(self, titles: &PlantTitles) -> Self {
        Self {
            titles: Arc::new(titles.clone()),
            ..self
        }
    }

    /// How their line sees the drives of the line at `place`, in order.
    pub fn stations(&self, place: usize) -> impl Iterator<Item = Arc<StationReport>> + '_ {
        let drives = self
            .lines
            .get(place)
            .into_iter()
            .flat_map(|line| &line.drives);
        drives.map(|drive| drive.station.load_full())
    }

    /// The line of the drive at `place`.
    #[must_use]
    pub fn line(&self, place: DriveRef) -> Option<&SharedLine> {
        self.lines
            .iter()
            .find(|line| line.number == place.line)
            .map(Arc::as_ref)
    }

    /// The inbox of the line of the drive at `place`.
    #[must_use]
    pub fn inbox(&self, place: DriveRef) -> Option<&LineInbox> {
        self.line(place).map(|line| line.inbox.as_ref())
    }

    /// Passes each command to the line of its drive. A line finds all its commands together, so that a stop for all its
    /// drives can be one frame. Returns which of them were accepted.
    #[must_use]
    pub fn put_together(&self, commands: Vec<(DriveRef, CommandRequest)>) -> Vec<bool> {
        let mut taken = vec![false; commands.len()];
        let mut by_line = BTreeMap::<u16, Vec<(usize, DriveRef, CommandRequest)>>::new();
        for (index, (place, command)) in commands.into_iter().enumerate() {
            by_line
                .entry(place.line)
                .or_default()
                .push((index, place, command));
        }
        for of_line in by_line.into_values() {
            let Some(inbox) = of_line.first().and_then(|(_, place, _)| self.inbox(*place)) else {
                continue;
            };
            let indices: Vec<_> = of_line.iter().map(|(index, ..)| *index).collect();
            let messages = of_line
                .into_iter()
                .map(|(.., command)| LineMessage::Command(command));
            for (index, is_taken) in indices.into_iter().zip(inbox.put_together(messages)) {
                taken
                    .get_mut(index)
                    .into_iter()
                    .for_each(|it| *it = is_taken);
            }
        }
        taken
    }
}

impl SharedLine {
    /// A line that is down, with drives that were not polled yet.
    #[must_use]
    pub fn new(
        number: u16,
        name: Name,
        interface: Interface,
        drives: impl IntoIterator<Item = DriveDescription>,
    ) -> Self {
        let inbox = Arc::<LineInbox>::default();
        let role = Arc::<SharedRole>::default();
        let drive = |description| {
            let view = ArcSwap::default();
            let station = ArcSwap::default();
            let (inbox, role) = (Arc::clone(&inbox), Arc::clone(&role));
            Arc::new(SharedDrive {
                description,
                view,
                station,
                inbox,
                role,
            })
        };
        let drives = drives.into_iter().map(drive).collect();
        let report = Mutex::default();
        let rounds = AtomicU64::default();
        let hangs = AtomicBool::default();
        let wiring = Wiring::default();
        let traffic = LineTraffic::default();
        let standby = None;
        Self {
            number,
            name,
            interface,
            wiring,
            standby,
            inbox,
            drives,
            traffic,
            role,
            report,
            rounds,
            hangs,
        }
    }

    /// This line with another gateway on it, if there is one.
    #[must_use]
    pub fn shared_with(self, standby: Option<StandbyShare>) -> Self {
        Self { standby, ..self }
    }

    /// This line with this wiring.
    #[must_use]
    pub fn wired(self, wiring: Wiring) -> Self {
        Self { wiring, ..self }
    }

    /// The line as of its last round.
    #[must_use]
    pub fn report(&self) -> LineReport {
        self.report
            .lock()
            .unwrap_or_else(PoisonError::into_inner)
            .clone()
    }

    /// Replaces the last report.
    pub fn set_report(&self, report: LineReport) {
        self.role.set(report.standby.map(|standby| standby.role));
        *self.report.lock().unwrap_or_else(PoisonError::into_inner) = report;
    }

    /// Whether the line's thread was found to hang.
    #[must_use]
    pub fn hangs(&self) -> bool {
        self.hangs.load(Ordering::Relaxed)
    }

    /// Sets whether the line's thread hangs.
    pub fn set_hangs(&self, hangs: bool) {
        self.hangs.store(hangs, Ordering::Relaxed);
    }

    /// Counts a round of the line's thread.
    pub fn count_round(&self) {
        self.rounds.fetch_add(1, Ordering::Relaxed);
    }

    /// Rounds of the line's thread so far, wrapping.
    #[must_use]
    pub fn rounds(&self) -> u64 {
        self.rounds.load(Ordering::Relaxed)
    }
}

/// What is shared at present. It is replaced as a whole when the configuration changes.
#[derive(Clone, Debug)]
pub struct CurrentPlant(Arc<ArcSwap<SharedPlant>>);

impl CurrentPlant {
    /// Borrows it at almost no cost; not to be kept.
    #[must_use]
    pub fn load(&self) -> Guard<Arc<SharedPlant>> {
        self.0.load()
    }

    /// What is shared at present, as an `Arc` to be kept.
    #[must_use]
    pub fn get(&self) -> Arc<SharedPlant> {
        self.0.load_full()
    }

    /// Replaces it with `shared`.
    pub fn set(&self, shared: Arc<SharedPlant>) {
        self.0.store(shared);
    }
}

impl From<Arc<SharedPlant>> for CurrentPlant {
    fn from(shared: Arc<SharedPlant>) -> Self {
        Self(Arc::new(ArcSwap::new(shared)))
    }
}
