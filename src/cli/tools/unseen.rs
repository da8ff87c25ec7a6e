//! What is said of a drive that may run unseen.

use super::{WordTone, toned};
use crate::north::api::{DriveHealthDocument, LastSeenDocument};
use crate::north::titles::{PlantTitles, labelled};
use std::fmt::Write;

/// A drive that may run unseen, as a line of text. It is shown before all others.
pub fn unseen_row(drive: &DriveHealthDocument, titles: &PlantTitles) -> String {
    let seen = drive.last_seen.as_ref().map(last_seen).unwrap_or_default();
    let label = labelled(&drive.name, titles.drives.get(&*drive.name));
    format!(
        "{}{seen}; go to the drive\n",
        toned(WordTone::Problem, &format!("drive {label} MAY STILL RUN"))
    )
}

fn last_seen(seen: &LastSeenDocument) -> String {
    let mut text = format!(": last seen {}", seen.run_state);
    if let Some(hertz) = seen.output_hz {
        let _ = write!(text, " at {hertz:.2} Hz");
    }
    if let Some(at) = &seen.at {
        let _ = write!(text, ", {at}");
    }
    text
}
