//! Modbus Security: a listener's certificate, and the authorities it trusts.

use super::certificate::CertifiedClient;
use crate::config::ListenerTls;
use crate::daemon::host::pem_files::{certificates, key};
use rustls::client::danger::HandshakeSignatureValid;
use rustls::crypto::ring;
use rustls::pki_types::{CertificateDer, UnixTime};
use rustls::server::danger::{ClientCertVerified, ClientCertVerifier};
use rustls::server::{NoServerSessionStorage, WebPkiClientVerifier};
use rustls::{
    CertificateError, DigitallySignedStruct, DistinguishedName, Error, OtherError, RootCertStore,
    ServerConfig, ServerConnection, SignatureScheme,
};
use std::sync::Arc;

/// Most bytes of answers that are encrypted and not sent. The rest waits unencrypted in its connection.
const ENCRYPTED_MAX: usize = 8 * 1024;

/// A listener's certificate, and the authorities it trusts.
#[derive(Debug)]
pub struct ListenerSecurity {
    config: Arc<ServerConfig>,
    authorities: Vec<CertificateDer<'static>>,
}

impl ListenerSecurity {
    /// Reads the files that `tls` names.
    ///
    /// # Errors
    /// Everything that is wrong with them, as text.
    pub fn read(tls: &ListenerTls) -> Result<Self, String> {
        let (chain, key, authorities) = (
            certificates(&tls.cert_file),
            key(&tls.key_file),
            certificates(&tls.client_ca_file),
        );
        match (chain, key, authorities) {
            (Ok(chain), Ok(key), Ok(authorities)) => {
                let verifier = ClientVerifier::trusting(&authorities)
                    .map_err(|error| format!("{}: {error}", tls.client_ca_file.display()))?;
                // The provider is named, so that it does not matter what other parts of the process install.
                let mut config =
                    ServerConfig::builder_with_provider(Arc::new(ring::default_provider()))
                        .with_safe_default_protocol_versions()
                        .map_err(|error| error.to_string())?
                        .with_client_cert_verifier(Arc::new(verifier))
                        .with_single_cert(chain, key)
                        .map_err(|error| own_certificate_error(tls, &error))?;
                // A resumed session would skip the client's certificate, which may have expired since, or whose
                // authority may no longer be trusted.
                config.session_storage = Arc::new(NoServerSessionStorage {});
                config.send_tls13_tickets = 0;
                Ok(Self {
                    config: Arc::new(config),
                    authorities,
                })
            }
            (chain, key, authorities) => {
                let problems = [chain.err(), key.err(), authorities.err()];
                let problems: Vec<_> = problems
                    .into_iter()
                    .flatten()
                    .map(|problem| problem.to_string())
                    .collect();
                Err(problems.join("; "))
            }
        }
    }

    /// Whether the same authorities are trusted.
    pub(super) fn trusts_as(&self, other: &Self) -> bool {
        self.authorities == other.authorities
    }

    /// The gateway's side of a new connection.
    pub(super) fn session(&self) -> Result<ServerConnection, Error> {
        let mut session = ServerConnection::new(Arc::clone(&self.config))?;
        session.set_buffer_limit(Some(ENCRYPTED_MAX));
        Ok(session)
    }
}

/// What is wrong with the gateway's own certificate.
fn own_certificate_error(tls: &ListenerTls, error: &Error) -> String {
    let file = tls.cert_file.display();
    match error {
        Error::InconsistentKeys(_) => format!(
            "{file}: it does not match the key {}",
            tls.key_file.display()
        ),
        error => format!("{file}: {error}"),
    }
}

/// Trusts the clients of some authorities, if their certificates identify them unambiguously.
#[derive(Debug)]
struct ClientVerifier(Arc<dyn ClientCertVerifier>);

impl ClientVerifier {
    fn trusting(authorities: &[CertificateDer<'static>]) -> Result<Self, String> {
        let mut roots = RootCertStore::empty();
        for authority in authorities {
            roots
                .add(authority.clone())
                .map_err(|error| error.to_string())?;
        }
        let builder = WebPkiClientVerifier::builder_with_provider(
            Arc::new(roots),
            Arc::new(ring::default_provider()),
        );
        builder.build().map(Self).map_err(|error| error.to_string())
    }
}

impl ClientCertVerifier for ClientVerifier {
    fn root_hint_subjects(&self) -> &[DistinguishedName] {
        self.0.root_hint_subjects()
    }

    fn verify_client_cert(
        &self,
        end_entity: &CertificateDer<'_>,
        intermediates: &[CertificateDer<'_>],
        now: UnixTime,
    ) -> Result<ClientCertVerified, Error> {
        let verified = self.0.verify_client_cert(end_entity, intermediates, now)?;
        // Here and not later, so that the client is refused in the handshake.
        match CertifiedClient::read(end_entity) {
            Ok(_) => Ok(verified),
            Err(unusable) => Err(Error::InvalidCertificate(CertificateError::Other(
                OtherError(Arc::new(unusable)),
            ))),
        }
    }

    fn verify_tls12_signature(
        &self,
        message: &[u8],
        certificate: &CertificateDer<'_>,
        signed: &DigitallySignedStruct,
    ) -> Result<HandshakeSignatureValid, Error> {
        self.0.verify_tls12_signature(message, certificate, signed)
    }

    fn verify_tls13_signature(
        &self,
        message: &[u8],
        certificate: &CertificateDer<'_>,
        signed: &DigitallySignedStruct,
    ) -> Result<HandshakeSignatureValid, Error> {
        self.0.verify_tls13_signature(message, certificate, signed)
    }

    fn supported_verify_schemes(&self) -> Vec<SignatureScheme> {
        self.0.supported_verify_schemes()
    }
}
