//! The report that the owner of a drive may send to the project: what was found, and nothing that tells where.

use crate::cli::tools::{CommandFailure, print};
use crate::north::api::TrialDocument;
use serde_json::{Value, json};
use std::fs::OpenOptions;
use std::io::Write;
use std::path::Path;

/// Writes the report of the drive in `document` to a new `file`.
pub(super) fn write(file: &Path, document: &TrialDocument) -> Result<(), CommandFailure> {
    let failure =
        |error: std::io::Error| CommandFailure::failed(format!("{}: {error}", file.display()));
    let mut new = OpenOptions::new()
        .write(true)
        .create_new(true)
        .open(file)
        .map_err(failure)?;
    new.write_all(format!("{:#}\n", report(document)).as_bytes())
        .and_then(|()| new.sync_all())
        .map_err(failure)?;
    print(&format!(
        "{}: written; read it before you send it\n",
        file.display()
    ))
}

/// Only what is named here goes into it: no name of a drive, line, host or person, no address and no time.
fn report(document: &TrialDocument) -> Value {
    let facts = document.actions.iter().map(|it| {
        let result = match &it.result {
            Some(result) if document.void.is_none() => result,
            _ => "not_tried",
        };
        json!({ "action": it.action, "rests_on": it.rests_on, "result": result })
    });
    json!({
        "version": 1,
        "program": document.version,
        "model": document.model,
        "model_digest": document.model_digest,
        "identity": document.identity,
        "firmware": document.firmware,
        "facts": facts.collect::<Vec<_>>(),
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn nothing_in_it_tells_where_or_who() {
        let action = json!({
            "action": "basic", "rests_on": ["stop (sibling)"], "result": "confirmed", "by": "SECRET", "at": "SECRET",
            "counts": true,
        });
        let document = json!({
            "drive": "SECRET", "line": "SECRET", "model": "acme-1", "model_digest": "07", "version": "1.2.3",
            "identity": 9, "firmware": 102, "void": null, "actions": [action], "host": "SECRET",
            "orders": { "stop": [{ "frame": "SECRET" }] }, "state": { "presence": "SECRET" },
        });
        let document: TrialDocument = serde_json::from_value(document).unwrap();
        let shown = report(&document);
        assert!(!shown.to_string().contains("SECRET"), "{shown}");
        assert_eq!(
            (&shown["model"], &shown["facts"][0]["result"]),
            (&json!("acme-1"), &json!("confirmed"))
        );
        let mut void = document;
        void.void = Some("the model file has changed since".to_owned());
        assert_eq!(report(&void)["facts"][0]["result"], "not_tried");
    }
}
