//! The gateway as a document.

use crate::domain::version::PROGRAM_VERSION;
use crate::north::broker::OversizedPublication;
use serde_json::{Value, json};

/// The gateway as a whole.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct PageGateway {
    /// Its name.
    pub name: String,
    /// When it started, as RFC 3339.
    pub started_at: String,
    /// All lines are open, and the broker is connected if there is one.
    pub is_ready: bool,
    /// The path to the broker; `None` if none is configured.
    pub mqtt: Option<BrokerWay>,
    /// The journal; `None` if there is none.
    pub journal: Option<PageJournal>,
    /// Why the program's own commands do not reach it; `None` if they do.
    pub unreachable: Option<String>,
}

/// The path to the broker.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct BrokerWay {
    /// The connection to the broker is open.
    pub is_connected: bool,
    /// Another client uses the gateway's identifier.
    pub is_contested: bool,
    /// The other gateway of a pair does not say that it is there.
    pub is_partner_missing: bool,
    /// Why there is no connection, with the broker's address, as far as it is known.
    pub lost_reason: Option<String>,
    /// What is not published because it is larger than the broker takes.
    pub oversized: Vec<OversizedPublication>,
    /// The topic that says that the clients of the broker are gone; `None` if it does not.
    pub clients_gone: Option<String>,
}

impl BrokerWay {
    fn document(&self) -> Value {
        json!({ "connected": self.is_connected, "contested": self.is_contested, "reason": self.lost_reason })
    }
}

/// The state of the journal.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct PageJournal {
    /// The word for it.
    pub state: &'static str,
    /// Rows are being kept.
    pub is_ok: bool,
    /// Why they are not.
    pub reason: Option<String>,
    /// Where a damaged journal was moved to since the start.
    pub moved_aside: Option<String>,
    /// What happened to its file while it was open, if it was deleted or replaced.
    pub replaced: Option<String>,
    /// Rows that could not be kept since the start.
    pub lost: u64,
}

impl PageGateway {
    /// The document, `uptime_s` seconds after the start.
    #[must_use]
    pub fn document(&self, uptime_s: u64) -> Value {
        json!({
            "name": self.name,
            "version": PROGRAM_VERSION,
            "started_at": self.started_at,
            "uptime_s": uptime_s,
            "ready": self.is_ready,
            "mqtt": self.mqtt.as_ref().map(BrokerWay::document),
            "journal": self.journal.as_ref().map(|it| json!({ "state": it.state, "reason": it.reason })),
        })
    }
}
