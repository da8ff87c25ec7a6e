//! The parameters of a drive as they are now: asked of the gateway that serves it, over its socket.

use super::file::{Dump, Parameter, Unreadable};
use crate::cli::Failure;
use crate::cli::progress::Bar;
use crate::cli::setup::{outcome, unknown};
use crate::cli::socket::{Question, ask};
use crate::daemon::clock;
use crate::domain::calendar;
use crate::domain::ids::Name;
use axum::http::{Method, StatusCode};
use serde_json::{Value, json};
use std::path::PathBuf;
use std::time::Duration;

/// Longest time for one question: longer than the gateway waits for a drive.
const PATIENCE: Duration = Duration::from_secs(30);

/// A drive behind a gateway.
#[derive(Clone, Debug)]
pub struct Live {
    /// The gateway's socket.
    pub socket: PathBuf,
    /// The drive's name there.
    pub drive: Name,
    /// Its number on the line, where that is known.
    pub station: Option<u8>,
}

/// A parameter that the model of a drive knows.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Known {
    /// The vendor's code.
    pub code: String,
    /// What it is.
    pub title: String,
    /// Its address on the wire.
    pub address: u16,
    /// What a tool may do with it, in the gateway's word.
    pub kind: String,
    /// Why nobody may write it, where that is so.
    pub reason: Option<String>,
    /// Whether writing it wears a memory.
    pub is_stored: bool,
}

/// What the model of a drive knows.
#[derive(Clone, Debug)]
pub struct Catalogue {
    /// The model.
    pub model: String,
    /// Whether anything may be written to this drive at all.
    pub may_be_written: bool,
    /// Its parameters.
    pub parameters: Vec<Known>,
}

impl Live {
    /// What the gateway knows of the drive's parameters. It asks nothing of the drive.
    ///
    /// # Errors
    /// There is no such drive, or no answer.
    pub async fn catalogue(&self) -> Result<Catalogue, Failure> {
        let list = self.ask(Question::look(&self.path(None))).await?;
        let text = |value: &Value, key: &str| value[key].as_str().unwrap_or_default().to_owned();
        let known = |one: &Value| {
            Some(Known {
                code: text(one, "code"),
                title: text(one, "title"),
                address: u16::try_from(one["address"].as_u64()?).ok()?,
                kind: text(one, "kind"),
                reason: one["reason"].as_str().map(str::to_owned),
                is_stored: one["is_stored"] != false,
            })
        };
        let parameters = list["parameters"].as_array().into_iter().flatten().filter_map(known).collect();
        Ok(Catalogue { model: text(&list, "model"), may_be_written: list["may_be_written"] == true, parameters })
    }

    /// Reads one parameter; nothing but the reason if the drive does not show it.
    ///
    /// # Errors
    /// The gateway does not answer.
    pub async fn read(&self, known: &Known) -> Result<Result<Parameter, Unreadable>, Failure> {
        let seen = self.ask(Question::look(&self.path(Some(known.address)))).await?;
        let found = &seen["found"];
        let Some(raw) = found["raw"].as_u64().and_then(|raw| u16::try_from(raw).ok()) else {
            let exception = seen["exception"].as_u64().map(|code| format!(" (exception {code:02X})"));
            let reason = format!("{}{}", seen["message"].as_str().unwrap_or("?"), exception.unwrap_or_default());
            return Ok(Err(Unreadable { code: known.code.clone(), address: known.address, reason }));
        };
        let text = found["text"].as_str().map(str::to_owned);
        let (code, title, address) = (known.code.clone(), known.title.clone(), known.address);
        Ok(Ok(Parameter { code, address, raw, text, title }))
    }

    /// Reads all of `wanted`, showing how far it has come.
    ///
    /// # Errors
    /// The gateway does not answer.
    pub async fn dump(&self, model: &str, wanted: &[Known]) -> Result<Dump, Failure> {
        let mut dump = Dump {
            drive: self.drive.to_string(),
            model: model.to_owned(),
            station: self.station,
            at: calendar::rfc3339(clock::wall()),
            ..Dump::default()
        };
        let mut bar = Bar::new(wanted.len());
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

    /// Writes one parameter. Nothing means that the drive holds it now; else why not.
    ///
    /// # Errors
    /// The gateway does not answer: what became of it is not known.
    pub async fn write(&self, address: u16, raw: u16) -> Result<Option<String>, Failure> {
        let (path, body) = (self.path(Some(address)), json!({ "raw": raw }));
        let done = self.ask(Question { method: Method::POST, path: &path, body: Some(&body) }).await?;
        Ok(if done["outcome"] == "confirmed" { None } else { Some(outcome(&done)) })
    }

    fn path(&self, address: Option<u16>) -> String {
        let of = format!("/api/v1/drives/{}/params", self.drive);
        address.map_or(of.clone(), |address| format!("{of}/{address}"))
    }

    async fn ask(&self, question: Question<'_>) -> Result<Value, Failure> {
        let at = self.socket.display();
        match ask(&self.socket, question, PATIENCE).await {
            Ok((StatusCode::OK, answer)) => Ok(answer),
            Ok((StatusCode::NOT_FOUND, answer)) => Err(Failure::wrong(unknown(&answer))),
            Ok((_, answer)) => Err(Failure::failed(format!("gateway at {at}: {}", outcome(&answer)))),
            Err(reason) => Err(Failure::failed(format!("gateway at {at}: {reason}"))),
        }
    }
}
