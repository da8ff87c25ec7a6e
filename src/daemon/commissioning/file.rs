//! The configuration file: what a change would make of it, and the change itself. The old file is kept beside the new one,
//! and comes back if the gateway does not take the new one over.

use super::wanted::{WantedAddition, WantedDrive};
use super::{Commissioning, CommissioningRefusal, JudgedConfig};
use crate::config::edit::{EditedText, with_control, with_line};
use crate::config::line_plan;
use crate::config::units::UNIFORM_ABOVE;
use crate::config::written::{NewDrive, NewLine};
use crate::config::{Config, LineSettings};
use crate::daemon::exchange::reload_request::AppliedReload;
use crate::daemon::host::whole_files::{self, FileReaders};
use crate::daemon::host::{clock, user_files};
use crate::domain::calendar::rfc3339;
use crate::domain::ids::UnitId;
use crate::domain::link::Framing;
use crate::domain::problem::Problem;
use ring::digest::{SHA256, digest};
use rustix::fs::{Access, access};
use std::collections::BTreeSet;
use std::fs;
use std::io;
use std::os::unix::fs::PermissionsExt;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use tokio::task::spawn_blocking;

/// What a change would make of the file.
#[derive(Debug)]
pub struct ConfigProposal {
    /// The digest of the file as it is.
    pub digest: String,
    /// The file as it would be.
    pub edited: EditedText,
    /// The configuration that it would be, or its problems.
    pub config: Result<Config, Vec<Problem>>,
}

impl ConfigProposal {
    /// What would be added.
    #[must_use]
    pub fn added(&self) -> &str {
        self.edited
            .text
            .get(self.edited.added.clone())
            .unwrap_or_default()
            .trim_start_matches(['\r', '\n'])
    }

    /// Problems or, if there are none, warnings.
    #[must_use]
    pub fn problems(&self) -> &[Problem] {
        match &self.config {
            Ok(config) => &config.warnings,
            Err(problems) => problems,
        }
    }

    /// The cost of each line, in a sentence.
    #[must_use]
    pub fn summary(&self) -> Vec<String> {
        let lines = self
            .config
            .as_ref()
            .map(|config| config.lines.as_slice())
            .unwrap_or_default();
        lines.iter().map(cost).collect()
    }
}

/// A change that is in force.
#[derive(Debug)]
pub struct AppliedChange {
    /// Where the old file is.
    pub kept_as: PathBuf,
    /// What has changed.
    pub applied: AppliedReload,
}

/// Why a change is not in force. The file is as it was.
#[derive(Debug)]
pub enum NotDone {
    /// The change was refused.
    Refused(CommissioningRefusal),
    /// The file would have problems.
    Problems(Box<ConfigProposal>),
}

impl From<CommissioningRefusal> for NotDone {
    fn from(refused: CommissioningRefusal) -> Self {
        Self::Refused(refused)
    }
}

impl Commissioning {
    /// The file, without links.
    fn file(&self) -> PathBuf {
        fs::canonicalize(&self.site.file).unwrap_or_else(|_| self.site.file.clone())
    }

    /// The path of the file as the program was started with it.
    #[must_use]
    pub fn path(&self) -> &Path {
        &self.site.file
    }

    /// The content of the file.
    pub(super) async fn text(&self) -> Result<String, String> {
        let file = self.file();
        let read = move || {
            user_files::text(&file, user_files::BYTES_MAX)
                .map_err(|error| format!("{}: {error}", file.display()))
        };
        spawn_blocking(read)
            .await
            .unwrap_or_else(|error| Err(error.to_string()))
    }

    /// What `text` would be as the file.
    pub(super) async fn judged(&self, text: String) -> Result<JudgedConfig, String> {
        let judge = Arc::clone(&self.site.judge);
        spawn_blocking(move || judge(&text))
            .await
            .unwrap_or_else(|error| Err(error.to_string()))
    }

    /// The configuration in the file with the digest of the file.
    ///
    /// # Errors
    /// The file cannot be read, or has problems.
    pub async fn present(&self) -> Result<(Config, String), CommissioningRefusal> {
        let text = self.text().await.map_err(CommissioningRefusal::InTheWay)?;
        let digest = digest_of(&text);
        let judged = self
            .judged(text)
            .await
            .map_err(CommissioningRefusal::InTheWay)?;
        let wrong = |_| {
            let file = self.path().display();
            CommissioningRefusal::InTheWay(format!(
                "{file} has problems: see `vfd-gateway check -c {file}`"
            ))
        };
        Ok((judged.config.map_err(wrong)?, digest))
    }

    /// Why this process cannot change the file; `None` if it can.
    #[must_use]
    pub fn why_not_written(&self) -> Option<String> {
        let file = self.file();
        let directory = file.parent().unwrap_or(Path::new("/"));
        let refused = access(directory, Access::WRITE_OK).err()?;
        let (directory, refused) = (directory.display(), io::Error::from(refused));
        Some(format!(
            "the gateway cannot write in {directory} ({refused}): give its user the right to, and as a systemd service \
             `ReadWritePaths={directory}` in a drop-in"
        ))
    }

    /// What `wanted` would make of the file. Writes nothing.
    ///
    /// # Errors
    /// Why that cannot be said.
    pub async fn proposal(
        &self,
        wanted: &WantedAddition,
    ) -> Result<ConfigProposal, CommissioningRefusal> {
        let text = self.text().await.map_err(CommissioningRefusal::InTheWay)?;
        let digest = digest_of(&text);
        let edited = match wanted {
            WantedAddition::Line { name, drives } => {
                let present = self
                    .judged(text.clone())
                    .await
                    .map_err(CommissioningRefusal::InTheWay)?
                    .config
                    .ok();
                with_line(
                    &text,
                    &with_units(self.line(name, drives)?, present.as_ref()),
                )
            }
            WantedAddition::Control { drive, control } => with_control(&text, drive, control),
        };
        let edited = edited.map_err(|error| CommissioningRefusal::InTheWay(error.to_string()))?;
        let judged = self
            .judged(edited.text.clone())
            .await
            .map_err(CommissioningRefusal::InTheWay)?;
        Ok(ConfigProposal {
            digest,
            edited,
            config: judged.config,
        })
    }

    /// Changes the file as `wanted` if its digest is still `digest`, and has the gateway take it over.
    ///
    /// # Errors
    /// Why nothing has changed.
    pub async fn apply(
        &self,
        wanted: &WantedAddition,
        digest: &str,
    ) -> Result<AppliedChange, NotDone> {
        let _writing = self.writing.lock().await;
        let proposal = self.proposal(wanted).await?;
        if proposal.digest != digest {
            let file = self.path().display();
            return Err(CommissioningRefusal::InTheWay(format!(
                "{file} has changed since it was checked: check again"
            ))
            .into());
        }
        if proposal.config.is_err() {
            return Err(NotDone::Problems(Box::new(proposal)));
        }
        let file = self.file();
        let new = proposal.edited.text;
        let written = spawn_blocking(move || replaced(&file, &new))
            .await
            .map_err(io::Error::other);
        let (kept_as, old, readers) = written.and_then(|written| written).map_err(|error| {
            let why = self.why_not_written().unwrap_or_else(|| error.to_string());
            CommissioningRefusal::InTheWay(format!("{}: {why}", self.path().display()))
        })?;
        match self.side.reload().await {
            Ok(applied) => {
                // Its drives are on a line now.
                if matches!(wanted, WantedAddition::Line { .. }) {
                    self.forget().await;
                }
                Ok(AppliedChange { kept_as, applied })
            }
            Err(refusal) => {
                let file = self.file();
                let back = move || {
                    whole_files::replace(&file, &old, readers)
                        .and_then(|()| fs::remove_file(&kept_as))
                };
                let back = spawn_blocking(back)
                    .await
                    .map_err(io::Error::other)
                    .and_then(|back| back);
                let file = self.path().display();
                let end = match back {
                    Ok(()) => format!("{file} is as it was"),
                    Err(error) => format!(
                        "and {file} could not be put back ({error}): do it before the next reload"
                    ),
                };
                Err(CommissioningRefusal::InTheWay(format!(
                    "the gateway did not take it over: {refusal}; {end}"
                ))
                .into())
            }
        }
    }

    /// The line that the last scan found, with those of its drives that are wanted.
    fn line(&self, name: &str, drives: &[WantedDrive]) -> Result<NewLine, CommissioningRefusal> {
        let scan = self.done()?;
        let none = || {
            CommissioningRefusal::NotThere(
                "the scan found no drive whose model is known".to_owned(),
            )
        };
        let (number, setting) = scan.setting().ok_or_else(none)?;
        let progress = scan.progress();
        let new = |wanted: &WantedDrive| {
            let found = progress
                .findings
                .drives
                .iter()
                .find(|it| it.setting == number && it.station == wanted.station);
            let fit = found.and_then(|it| {
                it.verdict
                    .fits
                    .iter()
                    .find(|(model, _)| model.id == wanted.model)
            });
            let (model, why) = fit.ok_or_else(|| {
                let (station, model) = (wanted.station, &wanted.model);
                CommissioningRefusal::Wrong(format!(
                    "the scan found no drive at station {station} that may be {model}"
                ))
            })?;
            Ok(NewDrive {
                name: wanted.name.clone(),
                model: Arc::clone(model),
                station: wanted.station,
                unit: None,
                full_scale_hz: wanted.full_scale_hz,
                why: format!("{why}; compare it with the nameplate"),
                control: wanted.control.clone(),
            })
        };
        let mut drives = drives
            .iter()
            .map(new)
            .collect::<Result<Vec<_>, CommissioningRefusal>>()?;
        drives.sort_by_key(|drive| drive.station);
        Ok(NewLine {
            name: name.to_owned(),
            port: scan.port().address.clone(),
            link: setting.link,
            is_ascii: setting.framing == Framing::Ascii,
            echoes: progress.echoes,
            drives,
            notes: Vec::new(),
        })
    }
}

/// `line` with free units for its drives, where a Modbus TCP listener would serve a second line: there the station
/// is no default.
fn with_units(mut line: NewLine, present: Option<&Config>) -> NewLine {
    let Some(present) = present.filter(|it| !it.listeners.is_empty() && !it.lines.is_empty())
    else {
        return line;
    };
    let drives = present.lines.iter().flat_map(|line| &line.drives);
    let mut used: BTreeSet<u8> = drives
        .flat_map(|drive| [drive.unit.get(), drive.uniform_unit.get()])
        .collect();
    for drive in &mut line.drives {
        let is_free = |unit: &u8| !used.contains(unit) && !used.contains(&(unit + UNIFORM_ABOVE));
        let most = UnitId::MAX - UNIFORM_ABOVE;
        drive.unit = [drive.station]
            .into_iter()
            .filter(|unit| *unit <= most)
            .chain(1..=most)
            .find(is_free);
        used.extend(
            drive
                .unit
                .iter()
                .flat_map(|unit| [*unit, unit + UNIFORM_ABOVE]),
        );
    }
    line
}

fn cost(line: &LineSettings) -> String {
    let share = line_plan::budget(line).use_of_line * 100.0;
    let stop = line_plan::stop_bounds(line).all_healthy.as_secs_f64();
    match line.drives.iter().any(|drive| drive.control.is_some()) {
        true => format!(
            "line {}: the polls use {share:.0} % of it; slowest STOP {stop:.2} s",
            line.name
        ),
        false => format!("line {}: the polls use {share:.0} % of it", line.name),
    }
}

fn digest_of(text: &str) -> String {
    digest(&SHA256, text.as_bytes())
        .as_ref()
        .iter()
        .map(|byte| format!("{byte:02x}"))
        .collect()
}

/// Puts `new` in place of the file, and the old one beside it. Returns where that is, its content and its readers.
fn replaced(file: &Path, new: &str) -> io::Result<(PathBuf, Vec<u8>, FileReaders)> {
    let old = user_files::bytes(file, user_files::BYTES_MAX)?;
    let readers = match fs::metadata(file)?.permissions().mode() {
        mode if mode & 0o004 != 0 => FileReaders::All,
        mode if mode & 0o040 != 0 => FileReaders::Group,
        _ => FileReaders::Owner,
    };
    let kept_as = backup_path(file);
    whole_files::create(&kept_as, &old, readers)?;
    if let Err(error) = whole_files::replace(file, new.as_bytes(), readers) {
        // The failure that counts is the first one.
        let _ = fs::remove_file(&kept_as);
        return Err(error);
    }
    Ok((kept_as, old, readers))
}

/// `plant.toml.bak-20261124T061500.123Z`: one for each change.
fn backup_path(file: &Path) -> PathBuf {
    let at: String = rfc3339(clock::wall())
        .chars()
        .filter(|c| *c != '-' && *c != ':')
        .collect();
    let mut name = file.file_name().unwrap_or_default().to_owned();
    name.push(format!(".bak-{at}"));
    file.with_file_name(name)
}
