//! What is said of a drive that may run unseen.

use super::{WordTone, toned};
use serde_json::Value;

/// A drive that may run unseen, as a line of text. It is shown before all others.
pub fn unseen_row(drive: &Value) -> String {
    let seen = &drive["last_seen"];
    let hertz = seen["output_hz"]
        .as_f64()
        .map(|hertz| format!(" at {hertz:.2} Hz"))
        .unwrap_or_default();
    let at = seen["at"]
        .as_str()
        .map(|at| format!(", {at}"))
        .unwrap_or_default();
    let seen = seen["run_state"]
        .as_str()
        .map(|state| format!(": last seen {state}{hertz}{at}"))
        .unwrap_or_default();
    let name = drive["name"].as_str().unwrap_or("?");
    format!(
        "{}{seen}; go to the drive\n",
        toned(WordTone::Problem, &format!("drive {name} MAY STILL RUN"))
    )
}
