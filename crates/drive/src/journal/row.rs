//! A row of the journal: a moment, a kind, a name, a JSON body, and the CRC over all of them.

use crate::domain::report::{LineFault, LineState};
use crate::domain::time::WallTime;
use crate::drive::snapshot::DrivePresence;
use crc::{CRC_32_ISO_HDLC, Crc};
use serde_json::{Value, json};

const CRC: Crc<u32> = Crc::<u32>::new(&CRC_32_ISO_HDLC);

/// A table of rows.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum JournalTable {
    /// Attempts to write, and actions without a command.
    Audit,
    /// Availability of drives, lines and the gateway itself.
    Availability,
    /// Trips and their clearings.
    Event,
}

impl JournalTable {
    /// All of them, in the order in which they are cut when the journal is full.
    pub const ALL: [Self; 3] = [Self::Audit, Self::Availability, Self::Event];

    /// Its name in the database.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Audit => "audit",
            Self::Availability => "availability",
            Self::Event => "event",
        }
    }
}

/// One row.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct JournalRow {
    /// Its number in its table, rising.
    pub number: u64,
    /// When it happened, by the wall clock at that time.
    pub at: WallTime,
    /// What it is.
    pub kind: String,
    /// The drive or line that it is about; `None` for the gateway.
    pub name: Option<String>,
    /// Everything else: a JSON object.
    pub body: String,
}

impl JournalRow {
    /// The CRC stored with it in `table`. SQLite does not detect a flipped bit in a row.
    #[must_use]
    pub fn crc(&self, table: JournalTable) -> u32 {
        let mut digest = CRC.digest();
        digest.update(table.name().as_bytes());
        digest.update(&self.number.to_le_bytes());
        digest.update(&self.at.unix_ms.to_le_bytes());
        digest.update(&[u8::from(self.name.is_some())]);
        for text in [
            &self.kind,
            self.name.as_deref().unwrap_or_default(),
            &self.body,
        ] {
            // With its length, so that bytes cannot move from one text into the next unnoticed.
            digest.update(&(text.len() as u64).to_le_bytes());
            digest.update(text.as_bytes());
        }
        digest.finalize()
    }

    /// This row if `crc` matches; `None` if it is damaged.
    #[must_use]
    pub fn checked(self, table: JournalTable, crc: u32) -> Option<Self> {
        (self.crc(table) == crc).then_some(self)
    }

    /// A row of `kind` about `name`. It is numbered when it is put into its table.
    #[must_use]
    pub fn new(at: WallTime, kind: &str, name: Option<&str>, body: &Value) -> Self {
        Self {
            number: 0,
            at,
            kind: kind.to_owned(),
            name: name.map(str::to_owned),
            body: body.to_string(),
        }
    }
}

/// The CRC over the remembered state of the drive called `name`.
#[must_use]
pub fn memory_crc(name: &str, body: &str) -> u32 {
    let mut digest = CRC.digest();
    digest.update(name.as_bytes());
    // A separator that no name contains.
    digest.update(&[0]);
    digest.update(body.as_bytes());
    digest.finalize()
}

/// The CRC over what the drive called `name` used on `day`.
#[must_use]
pub fn day_crc(name: &str, day: i32, body: &str) -> u32 {
    let mut digest = CRC.digest();
    digest.update(&day.to_le_bytes());
    digest.update(name.as_bytes());
    digest.update(&[0]);
    digest.update(body.as_bytes());
    digest.finalize()
}

/// A drive went online or offline; `None` while that is not known.
#[must_use]
pub fn presence(at: WallTime, drive: &str, presence: DrivePresence) -> Option<JournalRow> {
    let word = match presence {
        DrivePresence::Unknown => return None,
        DrivePresence::Online => "online",
        DrivePresence::Offline => "offline",
    };
    Some(JournalRow::new(
        at,
        "drive",
        Some(drive),
        &json!({ "state": word }),
    ))
}

/// A line went up or down, and why.
#[must_use]
pub fn line(at: WallTime, line: &str, state: LineState, fault: Option<LineFault>) -> JournalRow {
    let body = match state {
        LineState::Up => json!({ "state": "up" }),
        LineState::Down => {
            json!({ "state": "down", "reason": fault.map(|fault| fault.to_string()) })
        }
    };
    JournalRow::new(at, "line", Some(line), &body)
}

/// The gateway has started.
#[must_use]
pub fn started(at: WallTime, version: &str, configuration: &str, has_changed: bool) -> JournalRow {
    let body = json!({ "state": "started", "version": version, "configuration": configuration, "changed": has_changed });
    JournalRow::new(at, "gateway", None, &body)
}

/// The gateway exits on purpose.
#[must_use]
pub fn ended(at: WallTime) -> JournalRow {
    JournalRow::new(at, "gateway", None, &json!({ "state": "ended" }))
}

/// The journal was recreated, and why; the old file may have been kept under another name.
#[must_use]
pub fn begun_anew(at: WallTime, reason: &str, kept_as: Option<&str>) -> JournalRow {
    JournalRow::new(
        at,
        "journal",
        None,
        &json!({ "state": "begun_anew", "reason": reason, "kept_as": kept_as }),
    )
}

/// Number of rows that could not be stored while the journal was broken.
#[must_use]
pub fn lost(at: WallTime, rows: u64) -> JournalRow {
    JournalRow::new(
        at,
        "journal",
        None,
        &json!({ "state": "lost", "rows": rows }),
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    fn row() -> JournalRow {
        let body = json!({ "by": "mqtt" });
        JournalRow {
            number: 7,
            ..JournalRow::new(
                WallTime {
                    unix_ms: 1_767_225_600_000,
                },
                "attempt",
                Some("pump-1"),
                &body,
            )
        }
    }

    #[test]
    fn what_is_kept_stays_readable() {
        // Literals: a change of the CRC computation would make every old row look damaged.
        assert_eq!(row().crc(JournalTable::Audit), 0x9EE8_53AD);
        assert_eq!(memory_crc("pump-1", "{}"), 0x80E0_B1A6);
    }

    #[test]
    fn whatever_changes_shows() {
        let crc = row().crc(JournalTable::Audit);
        assert_eq!(row().checked(JournalTable::Audit, crc), Some(row()));
        assert_eq!(row().checked(JournalTable::Event, crc), None);
        assert_eq!(row().checked(JournalTable::Audit, crc ^ 1), None);
        let at = WallTime {
            unix_ms: 1_767_225_600_001,
        };
        for other in [
            JournalRow { number: 8, ..row() },
            JournalRow { at, ..row() },
            JournalRow {
                kind: "attemps".into(),
                ..row()
            },
            JournalRow {
                name: Some("pump-2".into()),
                ..row()
            },
            JournalRow {
                name: None,
                ..row()
            },
            JournalRow {
                kind: "attemptp".into(),
                name: Some("ump-1".into()),
                ..row()
            },
            JournalRow {
                body: "{\"by\":\"mqtu\"}".into(),
                ..row()
            },
        ] {
            assert_eq!(
                other.clone().checked(JournalTable::Audit, crc),
                None,
                "{other:?}"
            );
        }
        assert_ne!(
            JournalRow {
                name: None,
                ..row()
            }
            .crc(JournalTable::Audit),
            JournalRow {
                name: Some(String::new()),
                ..row()
            }
            .crc(JournalTable::Audit)
        );
    }
}
