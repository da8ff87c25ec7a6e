//! What is or is not so of a drive, one row each: its key in documents, how it is read, the help of its Prometheus metric,
//! its place among the metrics of a Sparkplug birth, its bit in uniform word 17, and its entity in Home Assistant.

use crate::drive::description::DriveDescription;
use crate::drive::view::DriveView;
use crate::profile::model::IndicatedState;
use serde_json::{Map, Value};

/// Makes [`FLAGS`] of its rows. A flag of the status may name the states of a model that show it.
macro_rules! flags {
    ($($group:ident $key:literal $(by $($state:ident)+)? |$of:ident| $value:expr
        $(, metric $help:literal)? $(, birth $place:literal)? $(, alarm $bit:ident)? $(, entity $look:ident $title:literal)?;)+) => {
        /// All of them, in the order in which Prometheus shows them.
        pub static FLAGS: [DriveFlag; [$($key),+].len()] = [$(DriveFlag {
            key: $key,
            group: FlagGroup::$group,
            read: flags!(@read $group $of $value),
            states: &[$($(IndicatedState::$state),+)?],
            metric: flags!(@some $((concat!("drive_", $key), $help))?),
            birth: flags!(@some $($place)?),
            alarm: 0 $(| alarm::$bit)?,
            entity: flags!(@some $((FlagLook::$look, $title))?),
        }),+];
    };
    (@read Drive $of:ident $value:expr) => { |$of| Some($value) };
    (@read Status $of:ident $value:expr) => { |view| { let $of = &view.status; $value } };
    (@read Control $of:ident $value:expr) => { |view| { let $of = view.control.as_ref()?; Some($value) } };
    (@some) => { None };
    (@some $value:expr) => { Some($value) };
}

flags! {
    Drive "online" |view| view.is_online(), metric "1 while the drive answers.";
    Drive "may_still_run" |view| view.sight.may_still_run,
        metric "1 while the drive is out of sight, and its motor was not seen at standstill before.",
        birth 0, alarm MAY_STILL_RUN;
    Status "local" by BusRun BusFrequency |status| status.is_local(), birth 1, entity Plain "Local control";
    Status "alarm" by Alarm |status| status.alarm, birth 2, entity Problem "Alarm of the drive";
    Status "ready" by Ready |status| status.ready, birth 3, entity Plain "Ready";
    Control "start_inhibited" |control| control.start_inhibited,
        metric "1 while RUN needs a stop and a new run command first.", birth 4, entity Plain "Start inhibited";
    Control "command_pending" |control| control.command_pending;
    Control "stop_pending" |control| control.stop_pending, metric "1 while a stop is not effective yet.", birth 5;
    Control "output_outside" |control| control.output_outside,
        metric "1 while the output was seen outside the limits or far from the setpoint, and not right since.",
        birth 7, alarm OUTPUT_OUTSIDE, entity Problem "Output outside limits";
    Control "stopped_elsewhere" |control| control.stopped_elsewhere,
        metric "1 while the drive was found stopped in spite of its order to run.",
        birth 8, alarm STOPPED_ELSEWHERE, entity Problem "Stopped elsewhere";
    Control "not_effective" |control| control.not_effective,
        metric "1 while a stop had no effect in time.",
        birth 6, alarm NOT_EFFECTIVE, entity Problem "Stop without effect";
    Control "failsafe" |control| control.failsafe.is_some(),
        metric "1 from the moment a fail-safe action falls due to the next RUN.",
        birth 9, alarm FAIL_SAFE, entity Problem "Fail-safe action";
}

/// One of them.
#[derive(Debug)]
pub struct DriveFlag {
    /// Its key in documents, and the last part of its other names.
    pub key: &'static str,
    /// What it is about.
    pub group: FlagGroup,
    /// Reads it; `None` while it is not known.
    pub read: fn(&DriveView) -> Option<bool>,
    /// The states of a model that show it; empty: every drive of its group has it.
    states: &'static [IndicatedState],
    /// The name and the help of its Prometheus metric.
    pub metric: Option<(&'static str, &'static str)>,
    /// Its place among those in a Sparkplug birth.
    pub birth: Option<u8>,
    /// Its bit in uniform word 17; 0 if it has none.
    pub alarm: u16,
    /// What its entity in Home Assistant looks like, and the name for people.
    pub entity: Option<(FlagLook, &'static str)>,
}

/// What a flag is about.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum FlagGroup {
    /// The drive as a whole.
    Drive,
    /// What its status registers show.
    Status,
    /// Control, of drives with a control section.
    Control,
}

/// What an entity looks like.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum FlagLook {
    /// On and off.
    Plain,
    /// Something is wrong, or not.
    Problem,
}

/// Alarm bits: uniform word 17.
pub mod alarm {
    /// A stop had no effect in time.
    pub const NOT_EFFECTIVE: u16 = 1;
    /// A fail-safe action fell due since the last RUN.
    pub const FAIL_SAFE: u16 = 1 << 1;
    /// A polled value is stale, or none was read yet.
    pub const STALE: u16 = 1 << 2;
    /// The line's port is closed.
    pub const LINE_DOWN: u16 = 1 << 3;
    /// The drive is out of sight and was not seen at standstill.
    pub const MAY_STILL_RUN: u16 = 1 << 4;
    /// The output is outside the limits, or far from the setpoint.
    pub const OUTPUT_OUTSIDE: u16 = 1 << 5;
    /// The drive has stopped following its order to run.
    pub const STOPPED_ELSEWHERE: u16 = 1 << 6;
}

impl DriveFlag {
    /// Whether `drive` has it.
    pub fn is_of(&self, drive: &DriveDescription) -> bool {
        if self.group == FlagGroup::Control {
            return drive.control.is_some();
        }
        let has = |state: &IndicatedState| drive.model.status_flag(*state).is_some();
        self.states.is_empty() || self.states.iter().any(has)
    }
}

/// The status flags by their keys.
pub fn status_flags(view: &DriveView) -> Map<String, Value> {
    in_group(FlagGroup::Status, |flag| (flag.read)(view).into())
}

/// The flags of control by their keys; without control none is set.
pub fn control_flags(view: &DriveView) -> Map<String, Value> {
    in_group(FlagGroup::Control, |flag| {
        (flag.read)(view).unwrap_or_default().into()
    })
}

fn in_group(group: FlagGroup, value: impl Fn(&DriveFlag) -> Value) -> Map<String, Value> {
    let flags = FLAGS.iter().filter(|flag| flag.group == group);
    flags
        .map(|flag| (flag.key.to_owned(), value(flag)))
        .collect()
}

/// `document` with `flags` beside its own keys, which stay as they are.
pub fn with_flags(document: Value, mut flags: Map<String, Value>) -> Value {
    if let Value::Object(own) = document {
        flags.extend(own);
    }
    Value::Object(flags)
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::collections::BTreeSet;

    #[test]
    fn no_two_flags_share_a_key_a_place_or_a_bit() {
        let keys: BTreeSet<_> = FLAGS.iter().map(|flag| flag.key).collect();
        assert_eq!(keys.len(), FLAGS.len());
        let places: Vec<_> = FLAGS.iter().filter_map(|flag| flag.birth).collect();
        assert_eq!(places.iter().collect::<BTreeSet<_>>().len(), places.len());
        let bits: Vec<_> = FLAGS.iter().map(|flag| flag.alarm).collect();
        let union = bits.iter().fold(0, |all, bit| all | bit);
        let others = alarm::STALE | alarm::LINE_DOWN;
        assert_eq!(bits.iter().sum::<u16>(), union);
        assert_eq!(union & others, 0);
    }
}
