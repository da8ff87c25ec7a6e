//! What is known of one line over a span of time: how its exchanges ended, how long replies take, what is probably
//! wrong with it and what to do. For the page and for `vfd-gateway doctor`.

mod document;
mod drive_rules;
mod line_rules;
mod rules;
#[cfg(test)]
mod testing;

pub use document::document;
pub use rules::{FindingRule, RULES, verdict};

use crate::domain::counts::{DamageCounts, ExchangeCounts};
use crate::domain::ids::{Name, Station};
use crate::domain::report::{LineReport, LineState, StationReport};
use crate::domain::time::MonoTime;
use crate::drive::snapshot::DrivePresence;
use std::sync::Arc;
use std::time::Duration;

/// A line as it is at one moment.
#[derive(Clone, Debug)]
pub struct LineSeen {
    /// When.
    pub at: MonoTime,
    /// The line.
    pub report: LineReport,
    /// Its drives, in order.
    pub drives: Vec<DriveSeen>,
}

/// A drive as it is at one moment.
#[derive(Clone, Debug)]
pub struct DriveSeen {
    /// Its name.
    pub name: Name,
    /// Its station number on the line.
    pub station: Station,
    /// Whether it answers, as last known.
    pub presence: DrivePresence,
    /// What it warns of, as last known.
    pub warning: Option<String>,
    /// Its line's record of it.
    pub report: Arc<StationReport>,
}

/// What happened on a line in a span of time.
#[derive(Clone, Debug)]
pub struct LineObserved {
    /// How long the span is.
    pub time: Duration,
    /// The line at its end.
    pub line: LineReport,
    /// Valid frames that answered nothing, of any station.
    pub strays: u64,
    /// Valid frames of stations that were not addressed.
    pub foreign: u64,
    /// Requests of another master.
    pub other_master: u64,
    /// Our own frames that came back.
    pub echoes: u64,
    /// Bytes that made no frame.
    pub noise_bytes: u64,
    /// How often such bytes arrived while no reply was awaited.
    pub noise_between: u64,
    /// Times the port was lost.
    pub port_downs: u64,
    /// Its drives.
    pub drives: Vec<DriveObserved>,
}

/// What happened to one drive in that span.
#[derive(Clone, Debug)]
pub struct DriveObserved {
    /// The drive at its end.
    pub now: DriveSeen,
    /// How the exchanges with it ended.
    pub exchanges: ExchangeCounts,
    /// What was wrong with what it sent.
    pub damage: DamageCounts,
}

impl LineObserved {
    /// What happened between `before` and `now`; since the start, at `started`, if `before` is `None`.
    #[must_use]
    pub fn between(before: Option<&LineSeen>, now: LineSeen, started: MonoTime) -> Self {
        let was = before
            .map(|before| before.report.counters)
            .unwrap_or_default();
        let is = now.report.counters;
        let drives = now.drives.into_iter().map(|drive| {
            let old =
                before.and_then(|before| before.drives.iter().find(|old| old.name == drive.name));
            let old = old.map(|old| *old.report).unwrap_or_default();
            DriveObserved {
                exchanges: drive.report.exchanges.since(&old.exchanges),
                damage: drive.report.damage.since(&old.damage),
                now: drive,
            }
        });
        Self {
            time: now.at.since(before.map_or(started, |before| before.at)),
            line: now.report,
            strays: is.strays.saturating_sub(was.strays),
            foreign: is.foreign.saturating_sub(was.foreign),
            other_master: is.other_master.saturating_sub(was.other_master),
            echoes: is.echoes.saturating_sub(was.echoes),
            noise_bytes: is.noise_bytes.saturating_sub(was.noise_bytes),
            noise_between: is.noise_between.saturating_sub(was.noise_between),
            port_downs: is.port_downs.saturating_sub(was.port_downs),
            drives: drives.collect(),
        }
    }

    /// Exchanges of all drives.
    #[must_use]
    pub fn exchanges(&self) -> u64 {
        self.sum(|drive| drive.exchanges.total())
    }

    fn sum(&self, of: impl Fn(&DriveObserved) -> u64) -> u64 {
        self.drives.iter().map(of).sum()
    }

    fn is_up(&self) -> bool {
        self.line.state == LineState::Up
    }
}

impl DriveObserved {
    /// Time-outs without a single byte.
    #[must_use]
    pub const fn silent(&self) -> u64 {
        let with_bytes = self.damage.damaged.saturating_sub(self.exchanges.garbled);
        self.exchanges.silent.saturating_sub(with_bytes)
    }
}
