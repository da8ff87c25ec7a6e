//! A request to reload the configuration, and its outcome.

use crate::config::change::ChangeNote;
use crate::domain::problem::Problem;
use std::fmt;
use tokio::sync::{mpsc, oneshot};

/// Reloads that may wait; a person asks for one.
const WAITING_MAX: usize = 4;

/// The outcome of a reload.
pub type Reloaded = Result<AppliedReload, ReloadRefusal>;

/// A configuration that was reloaded.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct AppliedReload {
    /// What has changed.
    pub changes: Vec<ChangeNote>,
    /// Parts of the file without effect.
    pub warnings: Vec<Problem>,
}

/// Why nothing has changed.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum ReloadRefusal {
    /// The file has problems.
    #[error("{0}")]
    Configuration(String),
    /// Drives that would be removed are in use.
    #[error(
        "{} in use: stop what would be removed or have its line restarted, or set `on_removal = \"stop\"` in [gateway]",
        NamesWithVerb(.0)
    )]
    InUse(Vec<String>),
    /// Drives were stopped before their removal, without effect so far.
    #[error("{} being stopped without effect so far: nothing is removed, and the stop continues", NamesWithVerb(.0))]
    NoEffect(Vec<String>),
    /// Only a restart changes this.
    #[error("{} cannot be changed while the gateway runs; restart it", .0.join(" and "))]
    NeedsRestart(Vec<&'static str>),
    /// A resource of the new configuration is not available.
    #[error("{0}")]
    System(String),
    /// Too many reloads are waiting.
    #[error("too many reloads are waiting already")]
    Busy,
    /// The gateway has no configuration file.
    #[error("this gateway runs without a configuration file")]
    NoFile,
    /// The gateway shuts down.
    #[error("the gateway is ending")]
    Ending,
}

impl ReloadRefusal {
    /// A machine-readable word.
    #[must_use]
    pub const fn keyword(&self) -> &'static str {
        match self {
            Self::Configuration(_) => "configuration",
            Self::InUse(_) => "in_use",
            Self::NoEffect(_) => "not_effective",
            Self::NeedsRestart(_) => "needs_restart",
            Self::System(_) => "system",
            Self::Busy => "queue_full",
            Self::NoFile => "no_file",
            Self::Ending => "shutting_down",
        }
    }

    /// The drives that it concerns.
    #[must_use]
    pub fn drives(&self) -> &[String] {
        match self {
            Self::InUse(drives) | Self::NoEffect(drives) => drives,
            _ => &[],
        }
    }
}

/// Names with their verb.
struct NamesWithVerb<'n>(&'n [String]);

impl fmt::Display for NamesWithVerb<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let (noun, verb) = if self.0.len() == 1 {
            ("drive", "is")
        } else {
            ("drives", "are")
        };
        write!(f, "{noun} {} {verb}", self.0.join(", "))
    }
}

/// A handle to request reloads.
#[derive(Clone, Debug)]
pub struct ReloadRequests(mpsc::Sender<oneshot::Sender<Reloaded>>);

impl ReloadRequests {
    /// A handle, and the receiver of its requests.
    #[must_use]
    pub fn channel() -> (Self, mpsc::Receiver<oneshot::Sender<Reloaded>>) {
        let (ask, asked) = mpsc::channel(WAITING_MAX);
        (Self(ask), asked)
    }

    /// Requests a reload, and waits for the outcome.
    ///
    /// # Errors
    /// Why nothing has changed.
    pub async fn ask(&self) -> Reloaded {
        let (tell, outcome) = oneshot::channel();
        self.0.try_send(tell).map_err(|error| match error {
            mpsc::error::TrySendError::Full(_) => ReloadRefusal::Busy,
            mpsc::error::TrySendError::Closed(_) => ReloadRefusal::Ending,
        })?;
        outcome.await.unwrap_or(Err(ReloadRefusal::Ending))
    }
}
