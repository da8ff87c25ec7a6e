//! Maps a unit on Modbus TCP to what answers for it: a drive on its line, a view, or the gateway itself.

use crate::config::ListenerSettings;
use crate::daemon::exchange::inbox::LineInbox;
use crate::daemon::exchange::shared::{SharedDrive, SharedPlant};
use crate::daemon::host::clock;
use crate::domain::ids::UnitId;
use crate::domain::report::LineReport;
use crate::domain::standby::LineRole;
use crate::domain::time::MonoTime;
use crate::drive::description::DriveRef;
use crate::drive::view::DriveView;
use crate::north::modbus::{ModbusRequest, UniformUnit, native, own};
use std::sync::Arc;

/// Units that a request can address.
const UNITS: usize = 256;

/// The uniform units of all drives, made ready once for all listeners.
#[derive(Clone, Debug)]
pub struct UniformUnits {
    shared: Arc<SharedPlant>,
    uniform: Arc<[UniformUnit]>,
    started: MonoTime,
}

impl UniformUnits {
    /// The units of the drives in `shared`. The gateway counts its time from here.
    #[must_use]
    pub fn new(shared: &Arc<SharedPlant>) -> Self {
        let uniform = shared
            .drives
            .iter()
            .map(|drive| UniformUnit::new(&drive.description))
            .collect();
        Self {
            shared: Arc::clone(shared),
            uniform,
            started: clock::now(),
        }
    }

    /// The units of the same gateway after a change of its configuration.
    #[must_use]
    pub fn changed_to(&self, shared: &Arc<SharedPlant>) -> Self {
        Self {
            started: self.started,
            ..Self::new(shared)
        }
    }
}

/// Where the units of one listener lead to.
#[derive(Debug)]
pub struct UnitRouter {
    units: UniformUnits,
    /// By unit.
    routes: [Option<UnitRoute>; UNITS],
    /// By line: whether this listener serves it.
    serves: Vec<bool>,
    /// By drive: whether one of its units answers here.
    serves_drive: Vec<bool>,
}

/// Where a unit leads to. The place is that of the drive in [`SharedPlant::drives`].
#[derive(Clone, Copy, Debug)]
enum UnitRoute {
    Native(usize),
    Uniform(usize),
    Own,
}

/// What answers for a unit.
#[derive(Clone, Copy, Debug)]
pub enum UnitTarget<'a> {
    /// A drive by its own registers.
    Native(UnitDrive<'a>),
    /// A drive by the uniform map: its place among all drives.
    Uniform(UnitDrive<'a>),
    /// The gateway itself.
    Own,
}

/// One drive behind a unit.
#[derive(Clone, Copy, Debug)]
pub struct UnitDrive<'a> {
    /// Its place among all drives.
    pub place: usize,
    /// Its unit.
    pub unit: &'a UniformUnit,
    /// Its view.
    pub shared: &'a SharedDrive,
    /// The way to it.
    pub inbox: &'a LineInbox,
}

impl UnitRouter {
    /// The routes of `listener`. If a native and a uniform unit have the same number, the native one wins.
    #[must_use]
    pub fn new(listener: &ListenerSettings, units: UniformUnits) -> Self {
        let serves: Vec<bool> = (0..units.shared.lines.len())
            .map(|line| listener.serves(line))
            .collect();
        let lines = serves.iter().zip(&units.shared.lines);
        let answers = |drive: &SharedDrive| {
            let drive = &drive.description;
            listener.answers_at(drive.unit) || listener.answers_at(drive.uniform_unit)
        };
        let drives = lines
            .flat_map(|(serves, line)| line.drives.iter().map(|drive| *serves && answers(drive)));
        let serves_drive: Vec<bool> = drives.collect();
        let mut routes = [None; UNITS];
        let drives = || {
            let all = units.shared.drives.iter().enumerate();
            all.filter(|(place, _)| serves_drive.get(*place) == Some(&true))
        };
        let mut lead = |unit: u8, route: UnitRoute| {
            let is_listed = UnitId::new(unit).is_none_or(|unit| listener.answers_at(unit));
            if is_listed && let Some(entry) = routes.get_mut(usize::from(unit)) {
                *entry = Some(route);
            }
        };
        drives().for_each(|(place, drive)| {
            lead(
                drive.description.uniform_unit.get(),
                UnitRoute::Uniform(place),
            )
        });
        drives().for_each(|(place, drive)| {
            lead(drive.description.unit.get(), UnitRoute::Native(place))
        });
        lead(own::UNIT, UnitRoute::Own);
        lead(own::BROADCAST, UnitRoute::Own);
        Self {
            units,
            routes,
            serves,
            serves_drive,
        }
    }

    /// Lines and drives.
    #[must_use]
    pub fn shared(&self) -> &SharedPlant {
        &self.units.shared
    }

    /// What answers for `unit`; `None` if there is no such unit.
    #[must_use]
    pub fn find(&self, unit: u8) -> Option<UnitTarget<'_>> {
        Some(match (*self.routes.get(usize::from(unit))?)? {
            UnitRoute::Native(place) => UnitTarget::Native(self.drive_at(place)?),
            UnitRoute::Uniform(place) => UnitTarget::Uniform(self.drive_at(place)?),
            UnitRoute::Own => UnitTarget::Own,
        })
    }

    /// The drive behind the uniform unit `unit`, if it is one.
    #[must_use]
    pub fn drive_of(&self, unit: u8) -> Option<DriveRef> {
        match self.routes.get(usize::from(unit)).copied().flatten()? {
            UnitRoute::Native(place) | UnitRoute::Uniform(place) => {
                Some(self.drive_at(place)?.shared.description.place)
            }
            UnitRoute::Own => None,
        }
    }

    /// Whether `ask` orders something to stop.
    #[must_use]
    pub fn is_stop(&self, unit: u8, ask: &ModbusRequest) -> bool {
        match self.routes.get(usize::from(unit)).copied().flatten() {
            Some(UnitRoute::Native(place)) => self
                .drive_at(place)
                .is_some_and(|drive| native::is_stop(&drive.shared.description.model, ask)),
            Some(UnitRoute::Uniform(place)) => self
                .drive_at(place)
                .is_some_and(|drive| drive.unit.is_stop(ask, &drive.shared.view.load())),
            Some(UnitRoute::Own) => own::is_stop(unit, ask),
            None => false,
        }
    }

    /// The drives that this listener serves and that have control.
    pub fn controlled(&self) -> impl Iterator<Item = UnitDrive<'_>> {
        let places = 0..self.units.shared.drives.len();
        places
            .filter(|place| self.serves_drive(*place))
            .filter_map(|place| self.drive_at(place))
            .filter(|drive| drive.unit.has_control())
    }

    /// Whole seconds since the start, wrapping.
    #[must_use]
    pub fn uptime_s(&self, now: MonoTime) -> u32 {
        (now.since(self.units.started).as_secs() & u64::from(u32::MAX)) as u32
    }

    /// The inboxes of all lines.
    pub fn inboxes(&self) -> impl Iterator<Item = &LineInbox> {
        self.units
            .shared
            .lines
            .iter()
            .map(|line| line.inbox.as_ref())
    }

    fn drive_at(&self, place: usize) -> Option<UnitDrive<'_>> {
        let shared = self.units.shared.drives.get(place)?;
        let unit = self.units.uniform.get(place)?;
        Some(UnitDrive {
            place,
            unit,
            shared,
            inbox: &shared.inbox,
        })
    }

    fn serves_drive(&self, place: usize) -> bool {
        self.serves_drive.get(place) == Some(&true)
    }
}

impl own::ServedGateway for UnitRouter {
    fn lines(&self) -> usize {
        self.units.shared.lines.len()
    }

    fn line(&self, place: usize) -> Option<LineReport> {
        if self.serves.get(place) != Some(&true) {
            return None;
        }
        Some(self.units.shared.lines.get(place)?.report())
    }

    fn drives(&self) -> usize {
        self.units.shared.drives.len()
    }

    fn drive(&self, place: usize) -> Option<(&UniformUnit, Arc<DriveView>)> {
        if !self.serves_drive(place) {
            return None;
        }
        let drive = self.drive_at(place)?;
        Some((drive.unit, drive.shared.view.load_full()))
    }

    fn standby(&self, place: usize) -> Option<LineRole> {
        self.units.shared.drives.get(place)?.role.get()
    }
}
