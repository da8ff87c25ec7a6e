//! The running gateway as `qualify` asks it: over the socket in its data directory.

use super::seen::{SeenState, state_of};
use crate::cli::tools::CommandFailure;
use crate::cli::tools::setup::{ask_drive, outcome};
use crate::cli::tools::socket::{SocketArgs, SocketRequest};
use crate::domain::ids::Name;
use crate::north::api::{FindingBody, OrderOutcomeDocument, PersonBody, TrialBody, TrialDocument};
use serde::Serialize;
use serde::de::DeserializeOwned;
use std::path::PathBuf;
use std::time::Duration;
use tokio::task::JoinHandle;
use tokio::time::sleep;

/// Shortest and longest time between two renewals of the lease.
const RENEW: (Duration, Duration) = (Duration::from_millis(100), Duration::from_secs(1));
/// How often the last stop is attempted, and the wait between.
const STOP_TRIES: u32 = 5;
const STOP_AGAIN: Duration = Duration::from_millis(200);

/// One drive behind the gateway's socket.
#[derive(Clone, Debug)]
pub(super) struct TrialDrive {
    path: String,
    socket: PathBuf,
}

/// The outcome of an order.
#[derive(Debug)]
pub(super) enum OrderOutcome {
    /// The drive acknowledged it.
    Acknowledged,
    /// The order was refused before anything was sent, for this reason.
    Refused(String),
    /// The drive refused it, or did not answer.
    Failed(String),
}

/// The lease of a motor that runs in a trial, renewed until this is dropped.
#[derive(Debug)]
pub(super) struct HeldLease(JoinHandle<()>);

impl Drop for HeldLease {
    fn drop(&mut self) {
        self.0.abort();
    }
}

impl TrialDrive {
    pub fn new(name: &str, place: &SocketArgs) -> Result<Self, CommandFailure> {
        let name = Name::new(name)
            .ok_or_else(|| CommandFailure::wrong(format!("`{name}` is not a valid drive name")))?;
        Ok(Self {
            path: format!("/api/v1/drives/{name}/qualify"),
            socket: place.path()?,
        })
    }

    /// Everything about the trials at this drive.
    pub async fn read_trials(&self) -> Result<TrialDocument, CommandFailure> {
        self.ask(SocketRequest::get(&self.path)).await
    }

    /// What the drive does.
    pub async fn state(&self) -> Result<SeenState, CommandFailure> {
        let path = format!("{}/state", self.path);
        self.ask(SocketRequest::get(&path)).await.map(state_of)
    }

    /// Sends one order of a trial; one that runs names the epoch as it was last seen.
    pub async fn order(
        &self,
        order: &str,
        epoch: Option<u64>,
    ) -> Result<OrderOutcome, CommandFailure> {
        let order = order.to_owned();
        let answer: OrderOutcomeDocument = self
            .ask(SocketRequest::post(&self.path).with(&TrialBody { order, epoch }))
            .await?;
        Ok(match &*answer.outcome {
            "acknowledged" | "confirmed" => OrderOutcome::Acknowledged,
            "refused" | "expired" | "superseded" => OrderOutcome::Refused(outcome(&answer)),
            _ => OrderOutcome::Failed(outcome(&answer)),
        })
    }

    /// Has the gateway keep a result.
    pub async fn keep(&self, action: &str, result: &str, by: &str) -> Result<(), CommandFailure> {
        let body = FindingBody {
            action: action.to_owned(),
            result: result.to_owned(),
            by: by.to_owned(),
        };
        self.done("result", &body).await
    }

    /// Has the gateway forget all results of this drive.
    pub async fn forget(&self, by: &str) -> Result<(), CommandFailure> {
        let by = by.to_owned();
        self.done("forget", &PersonBody { by }).await
    }

    /// Renews the lease from now on, often enough for one that ends after `lost_after`.
    pub fn hold(&self, lost_after: Duration) -> HeldLease {
        let gateway = self.clone();
        let every = (lost_after / 4).clamp(RENEW.0, RENEW.1);
        HeldLease(tokio::spawn(async move {
            loop {
                sleep(every).await;
                // If it fails, the lease ends, and the fail-safe action follows.
                let _ = gateway.order("renew", None).await;
            }
        }))
    }

    /// Stops the motor, with some patience.
    pub async fn stop_at_last(&self) -> Result<(), CommandFailure> {
        let mut last = CommandFailure::failed("it was not tried");
        for _ in 0..STOP_TRIES {
            match self.order("stop", None).await {
                Ok(OrderOutcome::Acknowledged) => return Ok(()),
                Ok(OrderOutcome::Refused(why) | OrderOutcome::Failed(why)) => {
                    last = CommandFailure::failed(why)
                }
                Err(failure) => last = failure,
            }
            sleep(STOP_AGAIN).await;
        }
        Err(last)
    }

    async fn done(&self, what: &str, body: &impl Serialize) -> Result<(), CommandFailure> {
        let path = format!("{}/{what}", self.path);
        let answer: OrderOutcomeDocument = self.ask(SocketRequest::post(&path).with(body)).await?;
        if answer.outcome == "confirmed" {
            Ok(())
        } else {
            Err(CommandFailure::failed(outcome(&answer)))
        }
    }

    async fn ask<T: DeserializeOwned>(
        &self,
        question: SocketRequest<'_>,
    ) -> Result<T, CommandFailure> {
        ask_drive(&self.socket, question).await
    }
}
