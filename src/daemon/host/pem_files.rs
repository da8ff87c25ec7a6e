//! Certificates and keys in PEM files.

use crate::daemon::host::user_files;
use rustls::pki_types::pem::{self, PemObject};
use rustls::pki_types::{CertificateDer, PrivateKeyDer};
use std::path::{Path, PathBuf};

/// A PEM file cannot be read or does not hold what is needed.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("{}: {what}", file.display())]
pub struct FileError {
    /// The file.
    pub file: PathBuf,
    /// What is wrong with it.
    pub what: String,
}

/// All certificates of `file`, at least one.
///
/// # Errors
/// It cannot be read, is not valid PEM, or has no certificate.
pub fn certificates(file: &Path) -> Result<Vec<CertificateDer<'static>>, FileError> {
    let bytes = read(file)?;
    let read = CertificateDer::pem_slice_iter(&bytes).collect::<Result<Vec<_>, _>>();
    let found = read.and_then(|found| {
        if found.is_empty() {
            Err(pem::Error::NoItemsFound)
        } else {
            Ok(found)
        }
    });
    found.map_err(|error| pem_error(file, error, "it contains no certificate"))
}

/// The first key of `file`.
///
/// # Errors
/// It cannot be read, or has no unencrypted key.
pub fn key(file: &Path) -> Result<PrivateKeyDer<'static>, FileError> {
    PrivateKeyDer::from_pem_slice(&read(file)?).map_err(|error| {
        pem_error(
            file,
            error,
            "it contains no private key, or an encrypted one",
        )
    })
}

fn read(file: &Path) -> Result<Vec<u8>, FileError> {
    user_files::bytes(file, user_files::BYTES_MAX).map_err(|error| FileError {
        file: file.to_path_buf(),
        what: error.to_string(),
    })
}

fn pem_error(file: &Path, error: pem::Error, nothing: &str) -> FileError {
    let what = match error {
        pem::Error::NoItemsFound => nothing.to_owned(),
        pem::Error::Io(error) => error.to_string(),
        error => error.to_string(),
    };
    FileError {
        file: file.to_path_buf(),
        what,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::daemon::testing::Dir;

    #[test]
    fn a_file_that_is_much_too_long_is_not_read() {
        let dir = Dir::new();
        let long = dir.join("long.pem");
        std::fs::File::create(&long)
            .unwrap()
            .set_len(user_files::BYTES_MAX + 1)
            .unwrap();
        for error in [certificates(&long).err(), key(&long).err()] {
            assert!(
                error
                    .unwrap()
                    .to_string()
                    .ends_with("1048576 bytes are the most")
            );
        }
    }
}
