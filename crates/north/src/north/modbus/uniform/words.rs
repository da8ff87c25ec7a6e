//! How the words of a uniform unit that are not measurements are read.

use super::super::taken::RequestContext;
use super::column::{ABSENT, unsigned};
use super::order::run_word;
use super::table::{CONTROL_LAST, PICTURE_WORDS, row_at};
use super::{UniformUnit, address, run, status};
use crate::domain::address::Address;
use crate::domain::command::Owner;
use crate::domain::time::MonoTime;
use crate::drive::view::{ControlView, DriveView};
use std::time::Duration;

/// One step of word 12.
const AGE_STEP_MS: u128 = 10;

/// What a word is read from.
pub(super) struct WordContext<'v> {
    pub(super) view: &'v DriveView,
    pub(super) present: &'v RequestContext,
}

impl UniformUnit {
    /// Whether the words up to `last` are those of the view, which input registers have as well.
    pub(super) const fn are_of_view(last: u16) -> bool {
        last < PICTURE_WORDS
    }

    /// Whether the words from `first` to `last` are those of control.
    pub(super) const fn are_of_control(first: u16, last: u16) -> bool {
        first >= address::RUN && last <= CONTROL_LAST
    }

    /// The holding register at `address`; `None` outside of the map.
    pub(in super::super) fn word(
        &self,
        address: u16,
        view: &DriveView,
        present: &RequestContext,
    ) -> Option<u16> {
        Some(row_at(address)?.read(address, self, &WordContext { view, present }))
    }

    /// Whether the word at `address` can ever hold anything but its mark of absence, with this drive.
    #[must_use]
    pub fn has(&self, address: u16) -> bool {
        row_at(address).is_none_or(|row| row.is_of(self))
    }

    /// The drive's own register in which the measurement in the word at `address` is read; `None` if there is none.
    #[must_use]
    pub fn register_of(&self, address: u16) -> Option<Address> {
        Some(row_at(address)?.column(self)?.address())
    }

    /// Word 1.
    pub(super) fn status_word(&self, look: &WordContext<'_>) -> u16 {
        status::status(&self.sources, look.view, look.present)
    }

    /// Word 12.
    pub(super) fn oldest_age(&self, look: &WordContext<'_>) -> u16 {
        age_word(self.sources.oldest_age(look.view, look.present.now))
    }

    /// Word 15.
    pub(super) fn status_mask(&self, look: &WordContext<'_>) -> u16 {
        self.reported | look.present.standby.map_or(0, |_| status::bit::STANDBY)
    }

    /// Word 256.
    pub(super) fn intent(&self, view: &DriveView) -> u16 {
        match &view.control {
            Some(control) if self.has_control() => run_word(control.intent),
            _ => run::STOP,
        }
    }

    /// The vendor's number while a trip is active, 0 without one; absent if the number or the trip is not known.
    pub(super) fn trip_code(&self, look: &WordContext<'_>) -> u16 {
        match status::is_tripped(look.view) {
            Some(false) => 0,
            Some(true) => {
                let code = look.view.trip.last.as_ref().and_then(|last| last.code);
                // 0 means that there is none.
                code.filter(|code| *code != 0).unwrap_or(ABSENT)
            }
            None => ABSENT,
        }
    }

    /// The count stays at 65534 rather than reading as absent or wrapping.
    pub(super) fn trips_kept(&self, look: &WordContext<'_>) -> u16 {
        if self.sources.has_trips {
            look.view.trip_kept.total.min(u32::from(ABSENT - 1)) as u16
        } else {
            ABSENT
        }
    }

    /// 0 without a trip; absent if its number could not be read.
    pub(super) fn last_trip(&self, look: &WordContext<'_>) -> u16 {
        match look.view.trip_kept.last_code {
            None if self.sources.has_trips && look.view.trip_kept.total == 0 => 0,
            last => last.unwrap_or(ABSENT),
        }
    }

    /// The owner of control, and the remaining time without a heartbeat.
    fn lease(&self, view: &DriveView, now: MonoTime) -> Option<(Owner, Duration)> {
        if !self.has_control() {
            return None;
        }
        let (owner, until) = view.control.as_ref()?.lease?;
        (now < until).then(|| (owner, until.since(now)))
    }

    /// Words 18 and 258.
    pub(super) fn lease_left(&self, look: &WordContext<'_>) -> u16 {
        self.lease(look.view, look.present.now)
            .map_or(0, |(_, left)| seconds_word(left))
    }

    /// Word 19.
    pub(super) fn lease_owner(&self, look: &WordContext<'_>) -> u16 {
        let lease = self.lease(look.view, look.present.now);
        lease.map_or(0, |(owner, _)| owner_class(owner, look.present.owner))
    }

    /// Word 257.
    pub(super) fn setpoint(&self, look: &WordContext<'_>) -> u16 {
        let setpoint = self.control_of(look).and_then(|control| control.setpoint);
        setpoint
            .and_then(|setpoint| setpoint.centihertz())
            .unwrap_or(ABSENT)
    }

    /// Word 259.
    pub(super) fn last_outcome(&self, look: &WordContext<'_>) -> u16 {
        let last = self
            .control_of(look)
            .and_then(|control| control.last.as_ref());
        last.map_or(0, |report| report.outcome.number())
    }

    /// Word 260.
    pub(super) fn commands(&self, look: &WordContext<'_>) -> u16 {
        self.control_of(look).map_or(0, |control| control.commands)
    }

    /// Word 261.
    pub(super) fn last_reason(&self, look: &WordContext<'_>) -> u16 {
        let last = self
            .control_of(look)
            .and_then(|control| control.last.as_ref());
        last.map_or(0, |report| report.reason.number())
    }

    fn control_of<'v>(&self, look: &WordContext<'v>) -> Option<&'v ControlView> {
        if self.has_control() {
            look.view.control.as_ref()
        } else {
            None
        }
    }
}

/// Word 16: seconds since start, wrapping, so that a client sees that the gateway is alive.
pub(super) const fn life(present: &RequestContext) -> u16 {
    (present.uptime_s & 0xFFFF) as u16
}

fn age_word(age: Option<Duration>) -> u16 {
    age.and_then(|age| u16::try_from(age.as_millis() / AGE_STEP_MS).ok())
        .unwrap_or(ABSENT)
}

/// Whole seconds; a lease that never ends reads 65534.
fn seconds_word(left: Duration) -> u16 {
    unsigned(
        i64::try_from(left.as_secs())
            .unwrap_or(i64::MAX)
            .min(i64::from(ABSENT - 1)),
    )
}

fn owner_class(owner: Owner, client: Owner) -> u16 {
    match owner {
        _ if owner == client => 3,
        Owner::Mqtt | Owner::MqttBy(_) => 1,
        Owner::ModbusTcp(_) | Owner::ModbusSecurity(_) | Owner::ModbusRtu(_) => 2,
        Owner::Local => 4,
        Owner::Page(_) => 5,
        Owner::Sparkplug => 6,
    }
}
