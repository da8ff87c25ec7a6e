//! An authority for tests, the certificates that it issues, and their files.

use crate::config::ListenerTls;
use crate::daemon::testing::Dir;
use crate::domain::command::Rights;
use rcgen::{
    BasicConstraints, CertificateParams, CustomExtension, DnType, ExtendedKeyUsagePurpose, IsCa,
    Issuer, KeyPair,
};
use std::path::PathBuf;

/// The object identifier of the role, typed from the specification.
const ROLE: [u64; 9] = [1, 3, 6, 1, 4, 1, 50316, 802, 1];

/// An authority.
pub(super) struct Authority {
    issuer: Issuer<'static, KeyPair>,
    pub certificate: rcgen::Certificate,
}

/// A certificate with its key.
pub(super) struct Issued {
    pub certificate: rcgen::Certificate,
    pub key: KeyPair,
}

impl Authority {
    pub fn new() -> Self {
        let mut params = CertificateParams::default();
        params.is_ca = IsCa::Ca(BasicConstraints::Unconstrained);
        params
            .distinguished_name
            .push(DnType::CommonName, "authority");
        let key = KeyPair::generate().unwrap();
        let certificate = params.self_signed(&key).unwrap();
        Self {
            issuer: Issuer::new(params, key),
            certificate,
        }
    }

    /// Issues a certificate with the parameters as changed by `edit`.
    pub fn issue(&self, edit: impl FnOnce(&mut CertificateParams)) -> Issued {
        let mut params = CertificateParams::new(vec!["localhost".to_owned()]).unwrap();
        params.distinguished_name = rcgen::DistinguishedName::new();
        edit(&mut params);
        let key = KeyPair::generate().unwrap();
        Issued {
            certificate: params.signed_by(&key, &self.issuer).unwrap(),
            key,
        }
    }

    /// A client called `name` in `role`.
    pub fn client(&self, name: &str, role: &str) -> Issued {
        self.issue(|params| {
            params.distinguished_name.push(DnType::CommonName, name);
            params.extended_key_usages = vec![ExtendedKeyUsagePurpose::ClientAuth];
            params.custom_extensions = vec![self::role(role)];
        })
    }
}

/// A role extension with this text.
pub(super) fn role(text: &str) -> CustomExtension {
    const UTF8_STRING: u8 = 0x0C;
    role_holding(
        [
            &[UTF8_STRING, u8::try_from(text.len()).unwrap()],
            text.as_bytes(),
        ]
        .concat(),
    )
}

/// A role extension that holds these bytes.
pub(super) fn role_holding(der: Vec<u8>) -> CustomExtension {
    CustomExtension::from_oid_content(&ROLE, der)
}

/// Files of a listener. They are removed after the test.
pub(super) struct Files {
    directory: Dir,
}

impl Files {
    pub fn new() -> Self {
        Self {
            directory: Dir::new(),
        }
    }

    pub fn write(&self, name: &str, text: &str) -> PathBuf {
        let file = self.directory.join(name);
        std::fs::write(&file, text).unwrap();
        file
    }

    /// A listener with a certificate of `own` that trusts the clients of `clients`: an operator may do everything, a
    /// viewer may read.
    pub fn listener(&self, own: &Authority, clients: &Authority) -> ListenerTls {
        let gateway = own.issue(|params| {
            params
                .distinguished_name
                .push(DnType::CommonName, "gateway")
        });
        let roles = [
            (
                "operator",
                Rights {
                    write: true,
                    stop: true,
                },
            ),
            ("viewer", Rights::NONE),
        ];
        ListenerTls {
            cert_file: self.write("gateway.pem", &gateway.certificate.pem()),
            key_file: self.write("gateway.key", &gateway.key.serialize_pem()),
            client_ca_file: self.write("clients.pem", &clients.certificate.pem()),
            roles: roles
                .into_iter()
                .map(|(name, rights)| (name.to_owned(), rights))
                .collect(),
        }
    }
}
