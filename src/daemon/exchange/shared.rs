//! What the north sides read and the lines write: one picture of each drive, one report of each line.

use crate::daemon::exchange::bell::Bell;
use crate::daemon::exchange::inbox::{Inbox, Message};
use crate::daemon::exchange::traffic::Traffic;
use crate::domain::command::CommandRequest;
use crate::domain::ids::Name;
use crate::domain::link::{Interface, Wiring};
use crate::domain::report::{LineReport, StationReport};
use crate::drive::description::{DriveDescription, DriveRef};
use crate::drive::view::DriveView;
use arc_swap::{ArcSwap, Guard};
use std::collections::BTreeMap;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::{Arc, Mutex, PoisonError};

/// Everything that north sides and lines share, as of one configuration. A change of that makes another one, in which
/// lines that go on are the same as before.
#[derive(Debug)]
pub struct Shared {
    /// The drives of all lines, in the order of the configuration.
    pub drives: Vec<Arc<SharedDrive>>,
    /// The lines, in the order of the configuration.
    pub lines: Vec<Arc<SharedLine>>,
    /// Rung whenever a picture or a line's state has changed, or the configuration.
    pub changed: Arc<Bell>,
}

/// One drive.
#[derive(Debug)]
pub struct SharedDrive {
    /// What does not change.
    pub description: DriveDescription,
    /// The newest picture.
    pub view: ArcSwap<DriveView>,
    /// How its line sees it, a second old at most.
    pub station: ArcSwap<StationReport>,
    /// The way to it.
    pub inbox: Arc<Inbox>,
}

/// One line, from its start to its end.
#[derive(Debug)]
pub struct SharedLine {
    /// By which places of drives name it; no other line of the process has it.
    pub number: u16,
    /// Its name.
    pub name: Name,
    /// What it is physically.
    pub interface: Interface,
    /// How it is wired.
    pub wiring: Wiring,
    /// The way in.
    pub inbox: Arc<Inbox>,
    /// Its drives, in order.
    pub drives: Vec<Arc<SharedDrive>>,
    /// What goes over it, for whoever watches.
    pub traffic: Traffic,
    report: Mutex<LineReport>,
    rounds: AtomicU64,
    hangs: AtomicBool,
}

impl Shared {
    /// Drives that nobody has looked at yet, and lines that are down. `lines` names the lines in order; they are numbered
    /// from 0.
    #[must_use]
    pub fn new(lines: Vec<(Name, Interface)>, drives: Vec<DriveDescription>) -> Self {
        let line = |(number, (name, interface))| {
            let on_line = drives.iter().filter(|drive| drive.place.line == number);
            Arc::new(SharedLine::new(number, name, interface, on_line.cloned()))
        };
        Self::of((0..).zip(lines).map(line).collect(), Arc::default())
    }

    /// These lines with their drives.
    #[must_use]
    pub fn of(lines: Vec<Arc<SharedLine>>, changed: Arc<Bell>) -> Self {
        Self { drives: lines.iter().flat_map(|line| line.drives.iter().cloned()).collect(), lines, changed }
    }

    /// How their line sees the drives of the line at `place`, in order.
    pub fn stations(&self, place: usize) -> impl Iterator<Item = Arc<StationReport>> + '_ {
        let drives = self.lines.get(place).into_iter().flat_map(|line| &line.drives);
        drives.map(|drive| drive.station.load_full())
    }

    /// The line that the drive at `place` hangs on.
    #[must_use]
    pub fn line(&self, place: DriveRef) -> Option<&SharedLine> {
        self.lines.iter().find(|line| line.number == place.line).map(Arc::as_ref)
    }

    /// The inbox of the line that the drive at `place` hangs on.
    #[must_use]
    pub fn inbox(&self, place: DriveRef) -> Option<&Inbox> {
        self.line(place).map(|line| line.inbox.as_ref())
    }

    /// Hands each command to the line of its drive. What goes to one line is found there together, so that a stop for all
    /// its drives can be one frame. Returns which of them were taken.
    #[must_use]
    pub fn put_together(&self, commands: Vec<(DriveRef, CommandRequest)>) -> Vec<bool> {
        let mut taken = vec![false; commands.len()];
        let mut by_line = BTreeMap::<u16, Vec<(usize, DriveRef, CommandRequest)>>::new();
        for (index, (place, command)) in commands.into_iter().enumerate() {
            by_line.entry(place.line).or_default().push((index, place, command));
        }
        for of_line in by_line.into_values() {
            let Some(inbox) = of_line.first().and_then(|(_, place, _)| self.inbox(*place)) else { continue };
            let indices: Vec<_> = of_line.iter().map(|(index, ..)| *index).collect();
            let messages = of_line.into_iter().map(|(.., command)| Message::Command(command));
            for (index, is_taken) in indices.into_iter().zip(inbox.put_together(messages)) {
                taken.get_mut(index).into_iter().for_each(|it| *it = is_taken);
            }
        }
        taken
    }
}

impl SharedLine {
    /// A line that is down, with drives that nobody has looked at yet.
    #[must_use]
    pub fn new(
        number: u16,
        name: Name,
        interface: Interface,
        drives: impl IntoIterator<Item = DriveDescription>,
    ) -> Self {
        let inbox = Arc::<Inbox>::default();
        let drive = |description| {
            let (view, station) = (ArcSwap::default(), ArcSwap::default());
            Arc::new(SharedDrive { description, view, station, inbox: Arc::clone(&inbox) })
        };
        let drives = drives.into_iter().map(drive).collect();
        let (report, rounds, hangs) = (Mutex::default(), AtomicU64::default(), AtomicBool::default());
        let (wiring, traffic) = (Wiring::default(), Traffic::default());
        Self { number, name, interface, wiring, inbox, drives, traffic, report, rounds, hangs }
    }

    /// The same line, wired so.
    #[must_use]
    pub fn wired(self, wiring: Wiring) -> Self {
        Self { wiring, ..self }
    }

    /// The line as of its last round.
    #[must_use]
    pub fn report(&self) -> LineReport {
        *self.report.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Takes the place of the last report.
    pub fn set_report(&self, report: LineReport) {
        *self.report.lock().unwrap_or_else(PoisonError::into_inner) = report;
    }

    /// Whether the line's thread was found not to come round.
    #[must_use]
    pub fn hangs(&self) -> bool {
        self.hangs.load(Ordering::Relaxed)
    }

    /// The line's thread was found to come round or not.
    pub fn set_hangs(&self, hangs: bool) {
        self.hangs.store(hangs, Ordering::Relaxed);
    }

    /// The line's thread has come round once more.
    pub fn count_round(&self) {
        self.rounds.fetch_add(1, Ordering::Relaxed);
    }

    /// How often the line's thread came round, wrapping.
    #[must_use]
    pub fn rounds(&self) -> u64 {
        self.rounds.load(Ordering::Relaxed)
    }
}

/// What is shared at present: all at once another one when the configuration changes.
#[derive(Clone, Debug)]
pub struct Current(Arc<ArcSwap<Shared>>);

impl Current {
    /// A look that costs next to nothing; not to be kept.
    #[must_use]
    pub fn load(&self) -> Guard<Arc<Shared>> {
        self.0.load()
    }

    /// The same to be kept.
    #[must_use]
    pub fn get(&self) -> Arc<Shared> {
        self.0.load_full()
    }

    /// Puts `shared` in the place of what was there.
    pub fn set(&self, shared: Arc<Shared>) {
        self.0.store(shared);
    }
}

impl From<Arc<Shared>> for Current {
    fn from(shared: Arc<Shared>) -> Self {
        Self(Arc::new(ArcSwap::new(shared)))
    }
}
