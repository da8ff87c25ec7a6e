//! The settings of the HTTP listener.

use crate::domain::ids::CommanderName;
use crate::north::operator::password::StoredHash;
use ipnet::IpNet;
use std::net::SocketAddr;
use std::path::PathBuf;

/// The HTTP listener.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct HttpSettings {
    /// Address and port. No other listener has the same.
    pub listen: SocketAddr,
    /// Who may connect; `None`: everyone who can, which is this host only (a listener elsewhere has a list).
    pub allow: Option<Vec<IpNet>>,
    /// Names by which browsers may call the gateway besides addresses and the host's own, in lower case.
    pub hosts: Vec<String>,
    /// Who may sign in and command; nobody: the page only shows. Only on loopback or with TLS.
    pub users: Vec<UserSettings>,
    /// How connections are encrypted; nothing: they are not.
    pub tls: Option<HttpTls>,
}

/// A user who may sign in on the page.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct UserSettings {
    /// Unique among the users; the owner of what is commanded.
    pub name: CommanderName,
    /// The password as a hash.
    pub hash: HashSource,
}

/// Where the hash of a password is.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum HashSource {
    /// In the configuration.
    Text(StoredHash),
    /// It is the text of the file at this absolute path.
    File(PathBuf),
}

/// TLS of the HTTP listener. Absolute paths.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct HttpTls {
    /// The gateway's certificate with its chain.
    pub cert_file: PathBuf,
    /// Its key.
    pub key_file: PathBuf,
}
