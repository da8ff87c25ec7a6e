//! The report of one drive on its line.

use super::core::LineCore;
use super::drive::DriveOnLine;
use crate::domain::ids::DriveIndex;
use crate::domain::report::StationReport;
use crate::domain::time::MonoTime;
use crate::line::quality::ExchangeQuality;
use crate::line::timeouts::RequestClass;

impl LineCore {
    /// The next report due at `now`, if any.
    pub fn next_station(&mut self, now: MonoTime) -> Option<(DriveIndex, StationReport)> {
        let place = self.measured.report_due(self.drives.len(), now)?;
        let drive = DriveIndex(u16::try_from(place).ok()?);
        Some((drive, self.station(drive)?))
    }

    /// The current report of the drive at `drive`; `None` if there is no such drive.
    #[must_use]
    pub fn station(&self, drive: DriveIndex) -> Option<StationReport> {
        let DriveOnLine {
            setup, measured, ..
        } = self.drives.get(drive)?;
        let place = drive.get();
        Some(StationReport {
            replies: RequestClass::ALL.map(|class| measured.replies(class, setup)),
            oldest_age: measured.oldest_age(),
            planned_age: measured.planned_age,
            exchanges: measured.exchanges,
            damage: self.health.damage.of(place),
            reply_counts: measured.reply_counts,
            commands: self.effects.commands(drive),
            bad_per_cent: self
                .health
                .quality
                .station(place)
                .and_then(ExchangeQuality::bad_per_cent),
            is_suspended: self.health.quality.is_suspended(place),
        })
    }
}
