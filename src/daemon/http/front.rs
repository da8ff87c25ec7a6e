//! What the HTTP listener requires of clients, ready to use: networks, host names, users and a certificate.

use crate::config::{HashSource, HttpSettings, HttpTls, PageViewers, UserSettings};
use crate::daemon::host::authority;
use crate::daemon::host::pem_files::{certificates, key};
use crate::daemon::host::secret_files;
use crate::domain::ids::CommanderName;
use crate::guard::access::is_in;
use crate::north::operator::password::StoredHash;
use crate::north::operator::rights::UserRights;
use ipnet::IpNet;
use rustix::system::uname;
use rustls::ServerConfig;
use rustls::crypto::ring;
use rustls::pki_types::CertificateDer;
use std::net::IpAddr;
use std::path::Path;
use std::sync::Arc;

/// What the listener requires of clients. Empty without a listener.
#[derive(Debug, Default)]
pub struct ClientRequirements {
    allow: Option<Vec<IpNet>>,
    hosts: Vec<String>,
    users: Vec<HttpUser>,
    /// Only users who have signed in see the drives.
    is_private: bool,
    /// Users with the right to may set up.
    sets_up: bool,
    tls: Option<FrontTls>,
}

/// How connections are encrypted.
#[derive(Clone, Debug)]
pub(super) struct FrontTls {
    /// For the library.
    pub config: Arc<ServerConfig>,
    /// The certificate of the authority, where the configured chain ends with one.
    pub authority: Option<CertificateDer<'static>>,
}

/// A user who may sign in.
#[derive(Clone, Debug)]
pub struct HttpUser {
    /// The user's name.
    pub name: CommanderName,
    /// The password.
    pub hash: StoredHash,
    /// What the user may do.
    pub rights: UserRights,
}

impl ClientRequirements {
    /// Reads the files that `settings` name. May block.
    ///
    /// # Errors
    /// Everything that is wrong with them, as text.
    pub fn read(settings: &HttpSettings) -> Result<Self, String> {
        let mut problems = Vec::new();
        let users = settings
            .users
            .iter()
            .filter_map(|user| read_user(user).map_err(|why| problems.push(why)).ok());
        let users = users.collect();
        let tls = settings
            .tls
            .as_ref()
            .and_then(|tls| read_tls(tls).map_err(|why| problems.push(why)).ok());
        if problems.is_empty() {
            let is_private = settings.view == PageViewers::SignedIn;
            let (allow, hosts, sets_up) = (
                settings.allow.clone(),
                hosts(&settings.hosts),
                settings.setup,
            );
            Ok(Self {
                allow,
                hosts,
                users,
                is_private,
                sets_up,
                tls,
            })
        } else {
            Err(problems.join("; "))
        }
    }

    /// Whether `peer` may connect.
    pub(super) fn allows(&self, peer: IpAddr) -> bool {
        self.allow.as_ref().is_none_or(|allow| is_in(peer, allow))
    }

    /// The host names of the gateway.
    pub(super) fn hosts(&self) -> impl Iterator<Item = &str> {
        self.hosts.iter().map(String::as_str)
    }

    /// How connections are encrypted, if they are.
    pub(super) const fn tls(&self) -> Option<&FrontTls> {
        self.tls.as_ref()
    }

    /// Who may sign in.
    pub(super) fn users(&self) -> &[HttpUser] {
        &self.users
    }

    /// What `user` may do; `None` if there is no such user.
    pub(super) fn rights(&self, user: CommanderName) -> Option<&UserRights> {
        self.users
            .iter()
            .find(|it| it.name == user)
            .map(|it| &it.rights)
    }

    /// Whether only users who have signed in see the drives.
    pub(super) const fn is_private(&self) -> bool {
        self.is_private
    }

    /// Whether users with the right to may set up.
    pub(super) const fn sets_up(&self) -> bool {
        self.sets_up
    }

    /// Whether `user` has the same password as in `other`.
    pub(super) fn knows_as(&self, other: &Self, user: CommanderName) -> bool {
        let hash = |front: &Self| {
            front
                .users
                .iter()
                .find(|it| it.name == user)
                .map(|it| it.hash.clone())
        };
        hash(self).is_some_and(|known| hash(other) == Some(known))
    }
}

/// The configured names, and the host's own name with and without its domain.
fn hosts(configured: &[String]) -> Vec<String> {
    let own = uname().nodename().to_string_lossy().to_ascii_lowercase();
    let first = own.split('.').next().unwrap_or_default().to_owned();
    let local = format!("{first}.local");
    let own = [own, first, local]
        .into_iter()
        .filter(|name| !name.is_empty() && name != ".local");
    configured.iter().cloned().chain(own).collect()
}

fn read_user(user: &UserSettings) -> Result<HttpUser, String> {
    let hash = match &user.hash {
        HashSource::Text(hash) => hash.clone(),
        HashSource::File(path) => {
            read_hash(path).map_err(|why| format!("{}: {why}", path.display()))?
        }
    };
    Ok(HttpUser {
        name: user.name,
        hash,
        rights: user.rights.clone(),
    })
}

fn read_hash(path: &Path) -> Result<StoredHash, String> {
    let text = secret_files::read(path).map_err(|error| error.to_string());
    let hash =
        text.and_then(|text| StoredHash::parse(&text).map_err(|why| format!("the text {why}")));
    hash.map_err(|why| format!("{why}; help: the line that `vfd-gateway password` prints"))
}

fn read_tls(tls: &HttpTls) -> Result<FrontTls, String> {
    let (chain, key) = match (certificates(&tls.cert_file), key(&tls.key_file)) {
        (Ok(chain), Ok(key)) => (chain, key),
        (chain, key) => {
            let problems = [chain.err(), key.err()];
            let problems: Vec<_> = problems
                .into_iter()
                .flatten()
                .map(|problem| problem.to_string())
                .collect();
            return Err(problems.join("; "));
        }
    };
    let authority = authority::authority_of(&chain).cloned();
    // The provider is named, so that it does not matter what other parts of the process install.
    let builder = ServerConfig::builder_with_provider(Arc::new(ring::default_provider()));
    let builder = builder
        .with_safe_default_protocol_versions()
        .map_err(|error| error.to_string())?;
    let mut config = builder
        .with_no_client_auth()
        .with_single_cert(chain, key)
        .map_err(|error| match error {
            rustls::Error::InconsistentKeys(_) => {
                format!(
                    "{}: it does not match the key {}",
                    tls.cert_file.display(),
                    tls.key_file.display()
                )
            }
            error => format!("{}: {error}", tls.cert_file.display()),
        })?;
    config.alpn_protocols = vec![b"http/1.1".to_vec()];
    Ok(FrontTls {
        config: Arc::new(config),
        authority,
    })
}
