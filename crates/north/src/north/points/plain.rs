//! The points that are no registers, one row each: what it holds, its name, its group, how it is read, and what Home
//! Assistant makes of its topic. The name is a topic of MQTT below the drive's, and a metric of Sparkplug.

use super::content::{PointContent, PointContext};
use crate::drive::description::DriveDescription;
use crate::drive::warnings;
use crate::journal::trip;
use crate::profile::model::{Model, Register};

/// Makes [`PLAIN_POINTS`] of its rows. A reading ends with `?` where there may be none.
macro_rules! plain_points {
    ($($form:ident $name:literal $group:ident |$now:ident| $value:expr $(, $look:ident $key:literal $title:literal)?;)+) => {
        /// All of them, in the order in which they are shown.
        pub static PLAIN_POINTS: [PlainPoint; [$($name),+].len()] = [$(PlainPoint {
            name: $name,
            form: PointForm::$form,
            group: PointGroup::$group,
            entity: plain_points!(@entity $($look $key $title)?),
            read: |$now| Some(PointContent::$form($value.into())),
        }),+];
    };
    (@entity) => { None };
    (@entity $look:ident $key:literal $title:literal) => {
        Some(PointEntity { look: PointLook::$look, key: $key, title: $title })
    };
}

plain_points! {
    Text "control/owner" Control |now| now.view.control.as_ref()?.lease?.0.to_string();
    Flag "trip/active" Trip |now| now.trip()?.active?, Problem "tripped" "Tripped";
    Number "trip/code" Trip |now| trip_code(now)?, Text "trip_code" "Trip code";
    Text "trip/text" Trip |now| trip_text(now)?, Text "trip_text" "Trip text";
    Number "trip/count" Trip |now| now.trip().and(now.view.trip_kept.count)?, TripCount "trip_count" "Trips";
    Text "trip/last" TripRecord |now| last_trip(now)?;
    Flag "warning/active" Warning |now| now.warning()? != 0, Notice "warning" "Warning";
    Number "warning/code" Warning |now| warnings::code(&now.drive.model, now.warning()?), Text "warning_code" "Warning code";
    Text "warning/text" Warning |now| warnings::text(&now.drive.model, now.warning()?)?, Text "warning_text" "Warning text";
}

/// One point.
#[derive(Debug)]
pub struct PlainPoint {
    /// What it is called.
    pub name: &'static str,
    /// What it holds.
    pub form: PointForm,
    /// What it is about.
    pub group: PointGroup,
    /// The entity of Home Assistant that shows it.
    pub entity: Option<PointEntity>,
    read: fn(&PointContext<'_>) -> Option<PointContent>,
}

/// What a point holds.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum PointForm {
    /// A yes or no.
    Flag,
    /// A code or a count.
    Number,
    /// Words.
    Text,
}

/// What a point is about.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum PointGroup {
    /// Control, of drives with a control section. Where nothing is read, there is none.
    Control,
    /// Trips, which are known as long as the register that shows them is fresh.
    Trip,
    /// A trip in the past. What an earlier process published of one is true while there is no newer one.
    TripRecord,
    /// Warnings, of models with a register of them, which decides as for trips.
    Warning,
}

/// An entity of Home Assistant.
#[derive(Debug)]
pub struct PointEntity {
    /// What it looks like.
    pub look: PointLook,
    /// What distinguishes it from others of its drive.
    pub key: &'static str,
    /// Its name for people.
    pub title: &'static str,
}

/// What an entity looks like.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum PointLook {
    /// Something is wrong, or not.
    Problem,
    /// The equipment reports something, or not.
    Notice,
    /// A text about the equipment.
    Text,
    /// Trips, of models that count them.
    TripCount,
}

impl PartialEq for PlainPoint {
    fn eq(&self, other: &Self) -> bool {
        self.name == other.name
    }
}

impl Eq for PlainPoint {}

impl PlainPoint {
    /// Whether `drive` has it.
    pub fn is_of(&self, drive: &DriveDescription) -> bool {
        match self.group {
            PointGroup::Control => drive.control.is_some(),
            PointGroup::Trip | PointGroup::TripRecord => true,
            PointGroup::Warning => drive.model.warning_register().is_some(),
        }
    }

    /// The register whose age decides whether it is known.
    pub fn rests_on<'m>(&self, model: &'m Model) -> Option<&'m Register> {
        match self.group {
            PointGroup::Trip => model.trip_register(),
            PointGroup::Warning => model.warning_register(),
            PointGroup::Control | PointGroup::TripRecord => None,
        }
    }

    /// Its content.
    pub fn content(&self, now: &PointContext<'_>) -> PointContent {
        (self.read)(now).unwrap_or(PointContent::Unknown)
    }
}

/// The number of the cause of the active trip, 0 if none is active.
fn trip_code(now: &PointContext<'_>) -> Option<u16> {
    let trip = now.trip()?;
    if trip.active? {
        trip.last.as_ref()?.code
    } else {
        Some(0)
    }
}

fn trip_text(now: &PointContext<'_>) -> Option<String> {
    now.trip()?;
    trip::active_text(now.drive, now.view)
}

/// The record of the newest trip that this process has seen and that is kept, as JSON.
fn last_trip(now: &PointContext<'_>) -> Option<String> {
    let last = now.view.trip_kept.last.as_ref()?;
    let record = trip::record(now.drive, &|at| now.clock.text(at), last);
    Some(serde_json::Value::Object(record).to_string())
}
