//! The configuration ready to use: every default filled in, every rule kept. Only [`super::load`] makes one.

use crate::domain::ids::{Name, Station, UnitId};
use crate::domain::link::{Framing, Interface, LinkSettings};
use crate::profile::model::Model;
use ipnet::IpNet;
use std::net::SocketAddr;
use std::path::PathBuf;
use std::sync::Arc;
use std::time::Duration;

/// A whole configuration.
#[derive(Clone, Debug, PartialEq)]
pub struct Config {
    /// What concerns the gateway as a whole.
    pub gateway: GatewaySettings,
    /// The serial lines, in the order of the file; at least one.
    pub lines: Vec<LineSettings>,
    /// The Modbus TCP listeners, in the order of the file; may be none.
    pub listeners: Vec<ListenerSettings>,
}

/// What concerns the gateway as a whole.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct GatewaySettings {
    /// The gateway's name; nothing: the host's name, which only the daemon knows.
    pub name: Option<Name>,
}

/// One serial line.
#[derive(Clone, Debug, PartialEq)]
pub struct LineSettings {
    /// Unique among the lines.
    pub name: Name,
    /// The device. No other line has the same one, as far as the text tells.
    pub port: PathBuf,
    /// Speed and character format; every model of the line has them.
    pub link: LinkSettings,
    /// What the line is physically; every model of the line has it.
    pub interface: Interface,
    /// How frames are told apart; every model of the line has it.
    pub framing: Framing,
    /// Silence between frames.
    pub silence: Silence,
    /// Least time between the end of one exchange and the next request. 0 unless configured.
    pub min_request_gap: Duration,
    /// Reply time-out of drives that have none of their own, 1 ms to 60 s; nothing: from the models.
    pub reply_timeout: Option<Duration>,
    /// The drives, in the order of the file; at least one, and exactly one on RS-232.
    pub drives: Vec<DriveSettings>,
}

/// Silence between the frames of a line.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Silence {
    /// As the models of the line need it.
    Auto,
    /// This long. Shorter than the models need is for pseudo-terminals only: what a port is shows when it
    /// is opened, so the daemon checks it there.
    Fixed(Duration),
}

/// One drive.
#[derive(Clone, Debug, PartialEq)]
pub struct DriveSettings {
    /// Unique over the gateway.
    pub name: Name,
    /// The model, with the registers that the configuration adds to it.
    pub model: Arc<Model>,
    /// Number on the line; in the model's range, unique on the line.
    pub station: Station,
    /// Unit on Modbus TCP; unique among the drives that share a listener.
    pub unit: UnitId,
    /// Period of the fast polls, 10 ms to 1 h.
    pub poll: Duration,
    /// Reply time-out, 1 ms to 60 s: the drive's own or else the line's; nothing: from the model.
    pub reply_timeout: Option<Duration>,
    /// How long after a time-out a late reply may still come, 10 ms to 60 s: the drive's own or else the model's.
    pub max_lateness: Duration,
}

/// One Modbus TCP listener.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ListenerSettings {
    /// Address and port. No other listener has the same.
    pub listen: SocketAddr,
    /// Who may connect; nothing: whoever can, which is this host only (a listener elsewhere has a list).
    pub allow: Option<Vec<IpNet>>,
    /// The lines it serves, as indices into [`Config::lines`]; nothing: all.
    pub lines: Option<Vec<usize>>,
}

impl ListenerSettings {
    /// Whether the drives of the line at index `line` are reached through this listener.
    #[must_use]
    pub fn serves(&self, line: usize) -> bool {
        self.lines.as_ref().is_none_or(|lines| lines.contains(&line))
    }
}
