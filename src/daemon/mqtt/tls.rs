//! TLS to the broker: trusted authorities, and our own certificate.

use crate::config::TlsSettings;
use crate::daemon::host::pem_files::{FileError, certificates, key as key_of};
use rustls::crypto::ring;
use rustls::{ClientConfig, RootCertStore};
use std::path::Path;
use std::sync::Arc;

/// Why there is no TLS.
#[derive(Debug, thiserror::Error)]
pub enum TlsError {
    /// A PEM file cannot be read or does not hold what is needed.
    #[error(transparent)]
    File(#[from] FileError),
    /// No authority is trusted.
    #[error("{0}: no authority to trust is found")]
    NoAuthority(String),
    /// The certificates do not match, or this library rejects them.
    #[error("TLS: {0}")]
    Refused(#[from] rustls::Error),
}

/// Reads all files that `settings` names, to find mistakes at start and not later.
///
/// # Errors
/// What is wrong with them.
pub fn check(settings: &TlsSettings) -> Result<(), TlsError> {
    config(settings).map(|_| ())
}

/// Reads the files on another thread: they may be many and slow. `None` without settings.
pub async fn read(settings: Option<TlsSettings>) -> Result<Option<Arc<ClientConfig>>, String> {
    let Some(settings) = settings else {
        return Ok(None);
    };
    let read = tokio::task::spawn_blocking(move || config(&settings)).await;
    match read {
        Ok(Ok(config)) => Ok(Some(config)),
        Ok(Err(error)) => Err(error.to_string()),
        Err(error) => Err(error.to_string()),
    }
}

/// Reads the files. Done for every connection, so that renewed certificates are used without a restart.
pub fn config(settings: &TlsSettings) -> Result<Arc<ClientConfig>, TlsError> {
    let roots = roots(settings.ca_file.as_deref())?;
    // The provider is named, so that it does not matter what other parts of the process install.
    let config = ClientConfig::builder_with_provider(Arc::new(ring::default_provider()))
        .with_safe_default_protocol_versions()?
        .with_root_certificates(roots);
    let config = match &settings.client {
        None => config.with_no_client_auth(),
        Some(own) => {
            config.with_client_auth_cert(certificates(&own.cert_file)?, key_of(&own.key_file)?)?
        }
    };
    Ok(Arc::new(config))
}

fn roots(ca_file: Option<&Path>) -> Result<RootCertStore, TlsError> {
    let mut roots = RootCertStore::empty();
    match ca_file {
        Some(file) => {
            for certificate in certificates(file)? {
                roots.add(certificate)?;
            }
        }
        None => {
            // The system's store may contain a few that this library cannot use.
            roots.add_parsable_certificates(rustls_native_certs::load_native_certs().certs);
        }
    }
    if roots.is_empty() {
        let place = ca_file.map_or_else(
            || "the system's store".to_owned(),
            |file| file.display().to_string(),
        );
        return Err(TlsError::NoAuthority(place));
    }
    Ok(roots)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_missing_file_is_named() {
        let settings = TlsSettings {
            ca_file: Some("/nowhere/ca.pem".into()),
            client: None,
        };
        let error = check(&settings).unwrap_err().to_string();
        assert!(error.contains("/nowhere/ca.pem"), "{error}");
    }

    #[test]
    fn a_file_without_certificates_trusts_nobody() {
        let settings = TlsSettings {
            ca_file: Some("/dev/null".into()),
            client: None,
        };
        assert!(check(&settings).is_err());
    }
}
