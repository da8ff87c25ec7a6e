//! Trips and their clearings, derived from two consecutive views of a drive.

use super::PageMoment;
use crate::drive::description::DriveDescription;
use crate::drive::view::DriveView;
use crate::journal::trip;
use serde_json::{Value, json};

/// What happened between two views of `drive`, in order. Of several trips between them the newest is reported.
#[must_use]
pub fn between(
    present: &PageMoment<'_>,
    drive: &DriveDescription,
    before: &DriveView,
    after: &DriveView,
) -> Vec<Value> {
    let has_tripped = after.trip.seen > before.trip.seen;
    let was_active = before.trip.active == Some(true) || has_tripped;
    let mut events = Vec::new();
    if has_tripped {
        let code = after.trip.last.as_ref().and_then(|last| last.code);
        let at = after.trip.last.as_ref().map_or(present.now, |last| last.at);
        events.push(json!({
            "drive": drive.name.as_str(),
            "kind": "tripped",
            "code": code,
            "text": after.trip.last.as_ref().and_then(|last| trip::text_of(drive, last)),
            "at": present.clock.text(at),
        }));
    }
    if was_active && after.trip.active == Some(false) {
        events.push(json!({
            "drive": drive.name.as_str(),
            "kind": "cleared",
            "code": null,
            "text": null,
            "at": present.text(),
        }));
    }
    events
}
