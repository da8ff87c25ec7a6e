//! The line as the north sides show it.

use super::core::LineCore;
use super::work::DriveWork;
use crate::domain::ids::DriveIndex;
use crate::domain::report::{LineCounters, LineReport, LineWaiting};

impl LineCore {
    /// The drives whose stop is not effective yet, and whether it was sent at all.
    pub fn open_stops(&self) -> impl Iterator<Item = (DriveIndex, bool)> + '_ {
        self.drives
            .iter()
            .filter_map(|drive| Some((drive.index, drive.work.open_stop()?)))
    }

    /// The line's state and counters.
    #[must_use]
    pub fn report(&self) -> LineReport {
        LineReport {
            state: self.state,
            fault: self.fault,
            open_error: self.open_error.clone(),
            counters: LineCounters {
                noise_between: self.health.damage.between(),
                ..self.counters
            },
            stop: self.stop,
            planned_use_per_mille: self.planned_use_per_mille,
            measured: self.measured.line,
            quality: self.health.report(),
            suspicion: self.health.suspicion(),
            waiting: self.waiting(),
            standby: self.standby_report(),
        }
    }

    fn waiting(&self) -> LineWaiting {
        let stops = self.drives.works().filter(|work| work.has_stop()).count();
        let commands = self.drives.works().map(DriveWork::commands_open).sum();
        LineWaiting {
            requests: self.natives.len(),
            commands,
            stops,
        }
    }
}
