//! The present parameters of a drive, requested from the gateway that serves it, over its socket.

use super::file::{LeftOut, Parameter, ParameterDump, UnreadableParameter};
use super::walk::{GroupWalk, WalkOutcome};
use crate::cli::tools::CommandFailure;
use crate::cli::tools::progress::ProgressBar;
use crate::cli::tools::setup::{ask_drive, outcome};
use crate::cli::tools::socket::SocketRequest;
use crate::daemon::host::clock;
use crate::domain::calendar;
use crate::domain::ids::Name;
use crate::north::api::{
    NumberBody, OrderOutcomeDocument, ParameterDocument, ParameterListDocument, SeenWord,
    WordDocument,
};
use serde::de::DeserializeOwned;
use std::path::PathBuf;
use std::time::Duration;

/// How often a drive that counts as silent is asked whether it answers again, and how many times.
const BACK_EVERY: Duration = Duration::from_millis(500);
const BACK_WITHIN: usize = 20;

/// A drive behind a gateway.
#[derive(Clone, Debug)]
pub struct GatewayDrive {
    /// The gateway's socket.
    pub socket: PathBuf,
    /// The drive's name there.
    pub drive: Name,
    /// Its station number, if known.
    pub station: Option<u8>,
}

/// A parameter that the model of a drive knows.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct ListedParameter {
    /// The vendor's code.
    pub code: String,
    /// What it is.
    pub title: String,
    /// Its address on the wire.
    pub address: u16,
    /// What a tool may do with it, in the gateway's word.
    pub kind: String,
    /// Why it is never written, if so.
    pub reason: Option<String>,
    /// Whether writing it wears a memory.
    pub is_stored: bool,
}

/// What the model of a drive knows.
#[derive(Clone, Debug)]
pub struct ParameterCatalogue {
    /// The model.
    pub model: String,
    /// Whether anything may be written to this drive at all.
    pub may_be_written: bool,
    /// What follows the last parameter that is written; `None` if the drive needs nothing.
    pub commit: Option<CommitNeed>,
    /// Its parameters.
    pub parameters: Vec<ListedParameter>,
    /// The registers of the model that are not parameters.
    pub left_out: Vec<LeftOut>,
    /// The groups of the drive's parameters, where the model has a rule for them.
    pub groups: Vec<UnknownOf>,
}

/// A word after which the drive takes over or stores its parameters.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct CommitNeed {
    /// Whether it stores them; otherwise they act only after it.
    pub stores: bool,
    /// Its register.
    pub what: String,
    /// The gateway sends it; otherwise it is unproven.
    pub is_sent: bool,
}

/// The parameters of a group that the model does not describe: the drive may or may not have them.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct UnknownOf {
    /// The group.
    pub group: String,
    /// Their addresses, in order; at most 100.
    pub addresses: Vec<u16>,
}

impl ParameterCatalogue {
    /// Whether the drive may have a parameter at `address` that its model does not describe.
    #[must_use]
    pub fn may_have(&self, address: u16) -> bool {
        self.groups
            .iter()
            .any(|group| group.addresses.contains(&address))
    }
}

impl GatewayDrive {
    /// What the gateway knows of the drive's parameters. Causes no request to the drive.
    ///
    /// # Errors
    /// There is no such drive, or no answer.
    pub async fn catalogue(&self) -> Result<ParameterCatalogue, CommandFailure> {
        let list: ParameterListDocument = self.ask(SocketRequest::get(&self.path(None))).await?;
        let parameters = list.parameters.into_iter().map(|one| ListedParameter {
            code: one.code.to_string(),
            title: one.title.to_string(),
            address: one.address,
            kind: one.kind.to_string(),
            reason: one.reason,
            is_stored: one.is_stored,
        });
        let left_out = list.left_out.into_iter().map(|one| LeftOut {
            what: one.code.to_string(),
            reason: one.reason.to_string(),
        });
        let groups = list.groups.into_iter().map(|one| UnknownOf {
            group: one.name.to_string(),
            addresses: one.unknown,
        });
        Ok(ParameterCatalogue {
            model: list.model.to_string(),
            may_be_written: list.may_be_written,
            commit: list.commit.map(|commit| CommitNeed {
                stores: commit.does == "store",
                what: commit.what.unwrap_or_default(),
                is_sent: commit.is_sent,
            }),
            parameters: parameters.collect(),
            left_out: left_out.collect(),
            groups: groups.collect(),
        })
    }

    /// Reads one parameter; only the reason if the drive does not show it.
    ///
    /// # Errors
    /// The gateway does not answer.
    pub async fn read(
        &self,
        known: &ListedParameter,
    ) -> Result<Result<Parameter, UnreadableParameter>, CommandFailure> {
        let shown: ParameterDocument = self
            .ask(SocketRequest::get(&self.path(Some(known.address))))
            .await?;
        Ok(Self::parameter(known, shown.seen))
    }

    /// Reads what the drive may have at `address`.
    async fn try_at(&self, address: u16) -> Result<WalkOutcome, CommandFailure> {
        let ParameterDocument { code, seen, .. } = self
            .ask(SocketRequest::get(&self.path(Some(address))))
            .await?;
        let code = code.to_string();
        let is_refused = seen.exception.is_some();
        let known = ListedParameter {
            code: code.clone(),
            address,
            ..ListedParameter::default()
        };
        Ok(match Self::parameter(&known, seen) {
            Ok(parameter) => WalkOutcome::Shown(parameter),
            Err(_) if is_refused => WalkOutcome::Refused(code),
            Err(unreadable) => WalkOutcome::Silent(code, unreadable.reason),
        })
    }

    /// Reads the parameters of `groups` that the drive has beyond its model into `dump`. `there` is a parameter that it
    /// is known to answer: it is read after one was not answered, so that the drive does not count as silent.
    ///
    /// # Errors
    /// The gateway does not answer.
    pub async fn dump_groups(
        &self,
        groups: &[UnknownOf],
        there: Option<&ListedParameter>,
        dump: &mut ParameterDump,
    ) -> Result<(), CommandFailure> {
        let mut bar = ProgressBar::new(groups.iter().map(|group| group.addresses.len()).sum());
        let mut done = 0;
        for group in groups {
            let mut walk = GroupWalk::default();
            for (at, address) in group.addresses.iter().enumerate() {
                bar.to(done + at, &group.group);
                let tried = self.try_at(*address).await?;
                if let (WalkOutcome::Silent(..), Some(there)) = (&tried, there) {
                    self.wait_for(there).await?;
                }
                if !walk.goes_on_after(tried, dump) {
                    break;
                }
            }
            done += group.addresses.len();
            walk.end(&group.group, dump);
        }
        bar.end();
        dump.parameters.sort_by_key(|parameter| parameter.address);
        Ok(())
    }

    /// Waits until the drive answers again, if it counts as silent.
    async fn wait_for(&self, there: &ListedParameter) -> Result<(), CommandFailure> {
        for _ in 0..BACK_WITHIN {
            if self.read(there).await?.is_ok() {
                return Ok(());
            }
            tokio::time::sleep(BACK_EVERY).await;
        }
        Ok(())
    }

    fn parameter(
        known: &ListedParameter,
        seen: SeenWord,
    ) -> Result<Parameter, UnreadableParameter> {
        let ListedParameter {
            code,
            title,
            address,
            ..
        } = known.clone();
        match seen.found {
            Some(WordDocument { raw, text }) => Ok(Parameter {
                code,
                address,
                raw,
                text,
                title,
            }),
            None => {
                let exception = seen.exception;
                let exception = exception.map(|code| format!(" (exception {code:02X})"));
                Err(UnreadableParameter {
                    code,
                    address,
                    reason: format!(
                        "{}{}",
                        seen.message.as_deref().unwrap_or("?"),
                        exception.unwrap_or_default()
                    ),
                })
            }
        }
    }

    /// Reads all of `wanted`, showing the progress.
    ///
    /// # Errors
    /// The gateway does not answer.
    pub async fn dump(
        &self,
        model: &str,
        wanted: &[ListedParameter],
    ) -> Result<ParameterDump, CommandFailure> {
        let mut dump = ParameterDump {
            drive: self.drive.to_string(),
            model: model.to_owned(),
            station: self.station,
            at: calendar::rfc3339(clock::wall()),
            ..ParameterDump::default()
        };
        let mut bar = ProgressBar::new(wanted.len());
        for (at, known) in wanted.iter().enumerate() {
            bar.to(at, &known.code);
            match self.read(known).await? {
                Ok(parameter) => dump.parameters.push(parameter),
                Err(unreadable) => dump.unreadable.push(unreadable),
            }
        }
        bar.end();
        Ok(dump)
    }

    /// Writes one parameter. `None` means that the drive holds it now; else why not.
    ///
    /// # Errors
    /// The gateway does not answer: the outcome is unknown.
    pub async fn write(&self, address: u16, raw: u32) -> Result<Option<String>, CommandFailure> {
        let path = self.path(Some(address));
        let done: OrderOutcomeDocument = self
            .ask(SocketRequest::post(&path).with(&NumberBody { raw }))
            .await?;
        Ok(if done.outcome == "confirmed" {
            None
        } else {
            Some(outcome(&done))
        })
    }

    /// Lets the drive take over or store what was written. `None` means that it has acknowledged that; else why not.
    ///
    /// # Errors
    /// The gateway does not answer: the outcome is unknown.
    pub async fn commit(&self) -> Result<Option<String>, CommandFailure> {
        let path = format!("{}/commit", self.path(None));
        let done: OrderOutcomeDocument = self.ask(SocketRequest::post(&path)).await?;
        let is_taken = done.outcome == "acknowledged" || done.outcome == "confirmed";
        Ok(if is_taken { None } else { Some(outcome(&done)) })
    }

    fn path(&self, address: Option<u16>) -> String {
        let of = format!("/api/v1/drives/{}/params", self.drive);
        address.map_or(of.clone(), |address| format!("{of}/{address}"))
    }

    async fn ask<T: DeserializeOwned>(
        &self,
        question: SocketRequest<'_>,
    ) -> Result<T, CommandFailure> {
        ask_drive(&self.socket, question).await
    }
}
