//! What was tried at drives on the site: the text of `qualified.json`, and what it proves for one drive.
//!
//! A result belongs to a drive as it was: its line and station, its model with the content of the model's file, and the
//! word of its identity register. Whatever of these changes, its results no longer count.

use crate::domain::address::Address;
use crate::domain::control::{ControlAction, SiteEvidence};
use crate::domain::ids::Station;
use crate::profile::model::Model;
use serde_json::{Map, Value, json};
use std::fmt;

/// Name of the file, in the data directory.
pub const FILE_NAME: &str = "qualified.json";
/// Longest file in bytes.
pub const BYTES_MAX: u64 = 1024 * 1024;
/// Most drives in it.
pub const DRIVES_MAX: usize = 1024;
/// Most characters of a text in it.
const CHARS_MAX: usize = 64;
/// The version of its form.
const VERSION: u64 = 1;

/// The drive that a result is for, as it was then.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct QualifiedDrive {
    /// The line's name.
    pub line: String,
    /// The station on the line.
    pub station: u8,
    /// The model's identifier.
    pub model: String,
    /// The digest of the model's file.
    pub digest: u64,
    /// The address of its identity register and the word in it, if the model has one.
    pub identity: Option<(u16, u16)>,
}

/// What came of a trial.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum TrialFinding {
    /// The drive did what the model says, and the person saw it.
    Confirmed,
    /// The drive did something else than the model says.
    Contradicted,
    /// The trial was not made.
    Skipped,
}

impl TrialFinding {
    /// All of them.
    pub const ALL: [Self; 3] = [Self::Confirmed, Self::Contradicted, Self::Skipped];

    /// The word in the file.
    #[must_use]
    pub const fn keyword(self) -> &'static str {
        match self {
            Self::Confirmed => "confirmed",
            Self::Contradicted => "contradicted",
            Self::Skipped => "skipped",
        }
    }

    /// The finding with this word.
    #[must_use]
    pub fn of(word: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|it| it.keyword() == word)
    }
}

/// The result for one action.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct QualifiedFact {
    /// The action.
    pub action: ControlAction,
    /// What came of it.
    pub result: TrialFinding,
    /// Who tried it.
    pub by: String,
    /// When.
    pub at: String,
}

/// All results of one drive.
#[derive(Clone, Debug, PartialEq, Eq)]
struct QualifiedEntry {
    drive: QualifiedDrive,
    facts: Vec<QualifiedFact>,
}

/// The content of the file.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct QualifiedResults {
    entries: Vec<QualifiedEntry>,
}

/// Why the results of a drive do not count any more.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum VoidReason {
    /// It is of another model now.
    Model,
    /// The file of the model has changed.
    ModelFile,
    /// The identity register that was read is not that of the model.
    Identity,
}

impl fmt::Display for VoidReason {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Model => "the drive is of another model now",
            Self::ModelFile => "the model file has changed since",
            Self::Identity => "the identity register is another one now",
        })
    }
}

/// What the file says of one drive.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub enum QualifiedStanding {
    /// Nothing.
    #[default]
    Never,
    /// These unproven actions were confirmed.
    Counts(SiteEvidence),
    /// These unproven actions were confirmed, and no longer count.
    Void(Vec<ControlAction>, VoidReason),
    /// Nobody knows: the file cannot be used.
    Unreadable,
}

impl QualifiedStanding {
    /// The actions that were confirmed and count.
    #[must_use]
    pub fn actions(&self) -> &[ControlAction] {
        match self {
            Self::Counts(evidence) => &evidence.actions,
            Self::Never | Self::Void(..) | Self::Unreadable => &[],
        }
    }
}

impl QualifiedResults {
    /// Parses the text of the file.
    ///
    /// # Errors
    /// What is wrong with it.
    pub fn parse(text: &str) -> Result<Self, String> {
        let value: Value = serde_json::from_str(text).map_err(|error| error.to_string())?;
        let version = value["version"].as_u64().ok_or("it has no version")?;
        if version != VERSION {
            return Err(format!(
                "it is of version {version}; this program reads {VERSION}"
            ));
        }
        let drives = value["drives"]
            .as_array()
            .ok_or("it has no list of drives")?;
        if drives.len() > DRIVES_MAX {
            return Err(format!(
                "it has {} drives; {DRIVES_MAX} are the most",
                drives.len()
            ));
        }
        let entry =
            |(at, value)| entry_of(value).ok_or_else(|| format!("drive {at} cannot be understood"));
        Ok(Self {
            entries: (1..)
                .zip(drives)
                .map(entry)
                .collect::<Result<_, String>>()?,
        })
    }

    /// The text of the file.
    #[must_use]
    pub fn text(&self) -> String {
        let drives: Vec<_> = self.entries.iter().map(shown).collect();
        format!("{:#}\n", json!({ "version": VERSION, "drives": drives }))
    }

    /// What it says of the drive of `model` at `station` of `line`.
    #[must_use]
    pub fn standing(&self, line: &str, station: Station, model: &Model) -> QualifiedStanding {
        let Some(QualifiedEntry { drive, facts }) = self.entry(line, station) else {
            return QualifiedStanding::Never;
        };
        let confirmed: Vec<_> = facts
            .iter()
            .filter(|it| it.result == TrialFinding::Confirmed)
            .map(|it| it.action)
            .collect();
        if confirmed.is_empty() {
            return QualifiedStanding::Never;
        }
        let identity = model.identity.as_ref().map(|it| it.address);
        let voided = if drive.model != model.id {
            Some(VoidReason::Model)
        } else if drive.digest != model.digest {
            Some(VoidReason::ModelFile)
        } else if drive.identity.map(|(address, _)| address) != identity.map(Address::number) {
            Some(VoidReason::Identity)
        } else {
            None
        };
        match voided {
            Some(why) => QualifiedStanding::Void(confirmed, why),
            None => {
                let identity = identity
                    .zip(drive.identity)
                    .map(|(address, (_, word))| (address, word));
                QualifiedStanding::Counts(SiteEvidence {
                    actions: confirmed,
                    identity,
                })
            }
        }
    }

    /// The results of the drive at `station` of `line`, and the drive as it was.
    #[must_use]
    pub fn facts(
        &self,
        line: &str,
        station: Station,
    ) -> Option<(&QualifiedDrive, &[QualifiedFact])> {
        self.entry(line, station)
            .map(|entry| (&entry.drive, entry.facts.as_slice()))
    }

    /// Adds a result. One that says nothing does not end an earlier one. Those of another drive at the same place, or of the same one as it was before a change, end.
    ///
    /// # Errors
    /// There is no room for another drive.
    pub fn record(&mut self, drive: &QualifiedDrive, fact: QualifiedFact) -> Result<(), String> {
        let fact = QualifiedFact {
            by: shortened(&fact.by),
            at: shortened(&fact.at),
            ..fact
        };
        let is_here = |it: &QualifiedEntry| {
            (it.drive.line.as_str(), it.drive.station) == (drive.line.as_str(), drive.station)
        };
        self.entries.retain(|it| !is_here(it) || it.drive == *drive);
        if let Some(entry) = self.entries.iter_mut().find(|it| is_here(it)) {
            let is_known = entry.facts.iter().any(|it| it.action == fact.action);
            if is_known && fact.result == TrialFinding::Skipped {
                return Ok(());
            }
            entry.facts.retain(|it| it.action != fact.action);
            entry.facts.push(fact);
        } else if self.entries.len() < DRIVES_MAX {
            self.entries.push(QualifiedEntry {
                drive: drive.clone(),
                facts: vec![fact],
            });
        } else {
            return Err(format!(
                "{DRIVES_MAX} drives are the most; forget those that are gone"
            ));
        }
        Ok(())
    }

    /// Removes the results of the drive at `station` of `line`. Returns whether there were any.
    pub fn forget(&mut self, line: &str, station: Station) -> bool {
        let before = self.entries.len();
        self.entries
            .retain(|it| it.drive.line != line || it.drive.station != station.0);
        self.entries.len() < before
    }

    fn entry(&self, line: &str, station: Station) -> Option<&QualifiedEntry> {
        self.entries
            .iter()
            .find(|it| it.drive.line == line && it.drive.station == station.0)
    }
}

/// The action with the word `word`.
#[must_use]
pub fn action_of(word: &str) -> Option<ControlAction> {
    ControlAction::ALL
        .iter()
        .copied()
        .find(|it| it.keyword() == word)
}

fn shortened(text: &str) -> String {
    text.chars()
        .filter(|c| !c.is_control())
        .take(CHARS_MAX)
        .collect()
}

fn shown(entry: &QualifiedEntry) -> Value {
    let QualifiedEntry { drive, facts } = entry;
    let facts = facts.iter().map(
        |fact| json!({ "action": fact.action.keyword(), "result": fact.result.keyword(), "by": fact.by, "at": fact.at }),
    );
    json!({
        "line": drive.line,
        "station": drive.station,
        "model": drive.model,
        "model_digest": format!("{:016x}", drive.digest),
        "identity": drive.identity.map(|(register, word)| json!({ "register": register, "word": word })),
        "facts": facts.collect::<Vec<_>>(),
    })
}

fn entry_of(value: &Value) -> Option<QualifiedEntry> {
    let of = value.as_object()?;
    let identity = match of.get("identity")? {
        Value::Null => None,
        identity => Some((
            parse_word(identity.get("register")?)?,
            parse_word(identity.get("word")?)?,
        )),
    };
    let drive = QualifiedDrive {
        line: text(of, "line")?,
        station: u8::try_from(of.get("station")?.as_u64()?).ok()?,
        model: text(of, "model")?,
        digest: u64::from_str_radix(of.get("model_digest")?.as_str()?, 16).ok()?,
        identity,
    };
    let facts = of
        .get("facts")?
        .as_array()
        .filter(|facts| facts.len() <= ControlAction::ALL.len())?;
    Some(QualifiedEntry {
        drive,
        facts: facts.iter().map(fact_of).collect::<Option<_>>()?,
    })
}

fn fact_of(value: &Value) -> Option<QualifiedFact> {
    let of = value.as_object()?;
    let action = action_of(of.get("action")?.as_str()?)?;
    let result = TrialFinding::of(of.get("result")?.as_str()?)?;
    Some(QualifiedFact {
        action,
        result,
        by: text(of, "by")?,
        at: text(of, "at")?,
    })
}

fn parse_word(value: &Value) -> Option<u16> {
    u16::try_from(value.as_u64()?).ok()
}

fn text(of: &Map<String, Value>, key: &str) -> Option<String> {
    let text = of.get(key)?.as_str()?;
    (text.chars().count() <= CHARS_MAX).then(|| text.to_owned())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::profile::model::{Confidence, Fact, ModelIdentity};
    use crate::vendors::testing::model;

    const STATION: Station = Station(3);

    fn drive_of(model: &Model, word: Option<u16>) -> QualifiedDrive {
        let identity = model
            .identity
            .as_ref()
            .map(|it| it.address.number())
            .zip(word);
        let (line, station) = ("hall-1".to_owned(), STATION.0);
        QualifiedDrive {
            line,
            station,
            model: model.id.clone(),
            digest: model.digest,
            identity,
        }
    }

    fn fact(action: ControlAction, result: TrialFinding) -> QualifiedFact {
        QualifiedFact {
            action,
            result,
            by: "anna".to_owned(),
            at: "2026-01-01T00:00:00Z".to_owned(),
        }
    }

    fn identified() -> Model {
        let values = Fact {
            value: vec![7],
            confidence: Confidence::Manual,
            source: "IM 1".to_owned(),
        };
        let identity = ModelIdentity {
            address: 0x0700_u16.into(),
            mask: 0xFF,
            values,
            others: Vec::new(),
        };
        Model {
            identity: Some(identity),
            digest: 5,
            ..model()
        }
    }

    #[test]
    fn what_is_written_is_read_back() {
        let model = identified();
        let mut kept = QualifiedResults::default();
        for (action, result) in [
            (ControlAction::Basic, TrialFinding::Skipped),
            (ControlAction::Basic, TrialFinding::Confirmed),
            (ControlAction::Basic, TrialFinding::Skipped),
            (ControlAction::Coast, TrialFinding::Contradicted),
        ] {
            kept.record(&drive_of(&model, Some(7)), fact(action, result))
                .unwrap();
        }
        let read = QualifiedResults::parse(&kept.text()).unwrap();
        assert_eq!(read, kept);
        let evidence = SiteEvidence {
            actions: vec![ControlAction::Basic],
            identity: Some((0x0700_u16.into(), 7)),
        };
        assert_eq!(
            read.standing("hall-1", STATION, &model),
            QualifiedStanding::Counts(evidence)
        );
        for (line, station) in [("hall-2", STATION), ("hall-1", Station(4))] {
            assert_eq!(
                read.standing(line, station, &model),
                QualifiedStanding::Never
            );
        }
        assert!(kept.forget("hall-1", STATION) && !kept.forget("hall-1", STATION));
        assert_eq!(kept, QualifiedResults::default());
    }

    #[test]
    fn a_contradiction_ends_an_earlier_confirmation() {
        let model = model();
        let mut kept = QualifiedResults::default();
        kept.record(
            &drive_of(&model, None),
            fact(ControlAction::Basic, TrialFinding::Confirmed),
        )
        .unwrap();
        assert_eq!(
            kept.standing("hall-1", STATION, &model).actions(),
            [ControlAction::Basic]
        );
        kept.record(
            &drive_of(&model, None),
            fact(ControlAction::Basic, TrialFinding::Contradicted),
        )
        .unwrap();
        assert_eq!(
            kept.standing("hall-1", STATION, &model),
            QualifiedStanding::Never
        );
    }

    #[test]
    fn whatever_changes_at_the_drive_voids_it() {
        let model = identified();
        let mut kept = QualifiedResults::default();
        kept.record(
            &drive_of(&model, Some(7)),
            fact(ControlAction::Basic, TrialFinding::Confirmed),
        )
        .unwrap();
        let void = |changed: &Model, why| {
            let standing = kept.standing("hall-1", STATION, changed);
            assert_eq!(
                standing,
                QualifiedStanding::Void(vec![ControlAction::Basic], why)
            );
            assert!(standing.actions().is_empty());
        };
        void(
            &Model {
                id: "acme-two".to_owned(),
                ..model.clone()
            },
            VoidReason::Model,
        );
        void(
            &Model {
                digest: 6,
                ..model.clone()
            },
            VoidReason::ModelFile,
        );
        void(
            &Model {
                identity: None,
                ..model.clone()
            },
            VoidReason::Identity,
        );
        let changed = Model { digest: 6, ..model };
        let mut kept = kept.clone();
        kept.record(
            &drive_of(&changed, Some(7)),
            fact(ControlAction::Coast, TrialFinding::Confirmed),
        )
        .unwrap();
        assert_eq!(
            kept.standing("hall-1", STATION, &changed).actions(),
            [ControlAction::Coast],
            "the old ones are gone"
        );
    }

    #[test]
    fn a_damaged_file_is_reported_and_never_half_read() {
        let mut kept = QualifiedResults::default();
        kept.record(
            &drive_of(&model(), None),
            fact(ControlAction::Basic, TrialFinding::Confirmed),
        )
        .unwrap();
        let whole = kept.text();
        for wrong in [
            String::new(),
            "{}".to_owned(),
            whole.replace("\"version\": 1", "\"version\": 2"),
            whole.replace("confirmed", "sure"),
            whole.replace("\"station\": 3", "\"station\": 300"),
            whole.replace("\"basic\"", "\"anything\""),
            whole.replace("hall-1", &"x".repeat(65)),
            whole[..whole.len() / 2].to_owned(),
        ] {
            assert!(QualifiedResults::parse(&wrong).is_err(), "{wrong}");
        }
    }

    #[test]
    fn it_is_bounded() {
        let mut kept = QualifiedResults::default();
        let place = |number: usize| QualifiedDrive {
            line: format!("line-{number}"),
            ..drive_of(&model(), None)
        };
        let new = || QualifiedFact {
            by: "x\n".repeat(100),
            ..fact(ControlAction::Basic, TrialFinding::Confirmed)
        };
        for number in 0..DRIVES_MAX {
            kept.record(&place(number), new()).unwrap();
        }
        assert!(kept.record(&place(DRIVES_MAX), new()).is_err());
        assert!(u64::try_from(kept.text().len()).unwrap() < BYTES_MAX);
        assert_eq!(QualifiedResults::parse(&kept.text()).unwrap(), kept);
    }
}
