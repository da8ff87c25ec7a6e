//! The settings of the HTTP listener.

use crate::domain::ids::CommanderName;
use crate::north::operator::password::StoredHash;
use crate::north::operator::rights::UserRights;
use ipnet::IpNet;
use std::net::SocketAddr;
use std::path::PathBuf;

/// The HTTP listener.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct HttpSettings {
    /// Address and port. No other listener has the same.
    pub listen: SocketAddr,
    /// Networks that may connect. `None`: every client that can, which is this host only (other listeners have a list).
    pub allow: Option<Vec<IpNet>>,
    /// Additional host names for browsers, besides addresses and the host's own name, in lower case.
    pub hosts: Vec<String>,
    /// Who sees the drives.
    pub view: PageViewers,
    /// Users with the role for it change the configuration in the page.
    pub setup: bool,
    /// Users that may sign in and command. Empty: the page is read-only. Only on loopback or with TLS.
    pub users: Vec<UserSettings>,
    /// TLS settings. `None`: connections are not encrypted.
    pub tls: Option<HttpTls>,
}

/// Who sees the drives on the page and below `/api/v1/`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum PageViewers {
    /// Every client that may connect.
    Anyone,
    /// Users who have signed in.
    SignedIn,
}

/// A user who may sign in on the page.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct UserSettings {
    /// Unique among the users; the owner of their commands.
    pub name: CommanderName,
    /// The password as a hash.
    pub hash: HashSource,
    /// What they may do.
    pub rights: UserRights,
}

/// The source of a password's hash.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum HashSource {
    /// In the configuration.
    Text(StoredHash),
    /// The content of the file at this absolute path.
    File(PathBuf),
}

/// TLS of the HTTP listener. Absolute paths.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct HttpTls {
    /// The gateway's certificate with its chain.
    pub cert_file: PathBuf,
    /// The key of the gateway's certificate.
    pub key_file: PathBuf,
}
