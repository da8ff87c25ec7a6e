//! What the north sides read and the lines write: one picture of each drive, one report of each line.

use super::inbox::Inbox;
use crate::domain::command::Owner;
use crate::domain::ids::Name;
use crate::domain::link::Interface;
use crate::domain::report::{LineReport, StationReport};
use crate::drive::description::{DriveDescription, DriveRef};
use crate::drive::view::DriveView;
use arc_swap::ArcSwap;
use std::sync::{Arc, Mutex, PoisonError};
use tokio::sync::Notify;

/// Everything that north sides and lines share.
#[derive(Debug)]
pub struct Shared {
    /// The drives of all lines, in the order of the configuration.
    pub drives: Vec<SharedDrive>,
    /// The lines, in the order of the configuration.
    pub lines: Vec<SharedLine>,
    /// Rung whenever a picture or a line's state has changed. One task waits for it: the MQTT side.
    pub changed: Notify,
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
}

impl SharedDrive {
    /// Who holds control, as of the newest picture.
    #[must_use]
    pub fn holder(&self) -> Option<Owner> {
        self.view.load().control.as_ref()?.lease.map(|(owner, _)| owner)
    }
}

/// One line.
#[derive(Debug)]
pub struct SharedLine {
    /// Its name.
    pub name: Name,
    /// What it is physically.
    pub interface: Interface,
    /// The way in.
    pub inbox: Arc<Inbox>,
    report: Mutex<LineReport>,
}

impl Shared {
    /// Drives that nobody has looked at yet, and lines that are down. `lines` names the lines in order.
    #[must_use]
    pub fn new(lines: Vec<(Name, Interface)>, drives: Vec<DriveDescription>) -> Self {
        let line = |(name, interface)| SharedLine { name, interface, inbox: Arc::default(), report: Mutex::default() };
        let drive = |description| SharedDrive { description, view: ArcSwap::default(), station: ArcSwap::default() };
        Self {
            drives: drives.into_iter().map(drive).collect(),
            lines: lines.into_iter().map(line).collect(),
            changed: Notify::new(),
        }
    }

    /// How their line sees the drives of the line at `place`, in order.
    pub fn stations(&self, place: usize) -> impl Iterator<Item = Arc<StationReport>> + '_ {
        let on_line = self.drives.iter().filter(move |drive| usize::from(drive.description.place.line) == place);
        on_line.map(|drive| drive.station.load_full())
    }

    /// The line that the drive at `place` hangs on.
    #[must_use]
    pub fn line(&self, place: DriveRef) -> Option<&SharedLine> {
        self.lines.get(usize::from(place.line))
    }

    /// The inbox of the line that the drive at `place` hangs on.
    #[must_use]
    pub fn inbox(&self, place: DriveRef) -> Option<&Inbox> {
        self.line(place).map(|line| line.inbox.as_ref())
    }
}

impl SharedLine {
    /// The line as of its last round.
    #[must_use]
    pub fn report(&self) -> LineReport {
        *self.report.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Takes the place of the last report.
    pub fn set_report(&self, report: LineReport) {
        *self.report.lock().unwrap_or_else(PoisonError::into_inner) = report;
    }
}
