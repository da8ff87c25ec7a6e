//! Why there is no connection, as text for the person who configures it.

use rustls::{AlertDescription as Alert, CertificateError as Flaw, Error as RustlsError};
use std::io;

/// The broker does not accept our credentials.
pub const CREDENTIALS: &str = "the broker refuses our user or password";
/// The broker does not accept our client identifier.
pub const CLIENT_ID: &str =
    "the broker refuses our client identifier; another one is set with `client_id` in [mqtt]";

/// The cause of an error of a stream that may be encrypted; `None` if its own text has to do.
pub fn of_io(error: &io::Error) -> Option<String> {
    of_rustls(error.get_ref()?.downcast_ref()?)
}

fn of_rustls(error: &RustlsError) -> Option<String> {
    let plain = match error {
        RustlsError::InvalidCertificate(flaw) => match flaw {
            Flaw::UnknownIssuer => {
                "the broker's certificate is not signed by an authority that is trusted (`ca_file` in [mqtt])"
            }
            Flaw::Expired | Flaw::ExpiredContext { .. } => "the broker's certificate has expired",
            Flaw::NotValidYet | Flaw::NotValidYetContext { .. } => {
                "the broker's certificate is not valid yet, or the clock of this host is wrong"
            }
            Flaw::NotValidForName | Flaw::NotValidForNameContext { .. } => {
                "the broker's certificate is for another name than the one in `broker`"
            }
            _ => "the broker's certificate is not valid",
        },
        RustlsError::AlertReceived(Alert::CertificateRequired | Alert::HandshakeFailure) => {
            "the broker ended the handshake; it may require a client certificate (`client_cert_file` in [mqtt])"
        }
        RustlsError::AlertReceived(
            Alert::BadCertificate
            | Alert::UnsupportedCertificate
            | Alert::CertificateRevoked
            | Alert::CertificateExpired
            | Alert::CertificateUnknown
            | Alert::UnknownCA,
        ) => "the broker does not accept our certificate (`client_cert_file` in [mqtt])",
        RustlsError::InvalidMessage(_) => "the server at this port does not speak TLS",
        _ => return None,
    };
    Some(format!("{plain}: {error}"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_wrong_with_a_certificate_is_said_in_words() {
        let cases = [
            (
                RustlsError::InvalidCertificate(Flaw::UnknownIssuer),
                "ca_file",
            ),
            (RustlsError::InvalidCertificate(Flaw::Expired), "expired"),
            (RustlsError::InvalidCertificate(Flaw::NotValidYet), "clock"),
            (
                RustlsError::InvalidCertificate(Flaw::NotValidForName),
                "another name",
            ),
            (
                RustlsError::AlertReceived(Alert::CertificateRequired),
                "require a client certificate",
            ),
            (
                RustlsError::AlertReceived(Alert::UnknownCA),
                "does not accept our certificate",
            ),
        ];
        for (error, part) in cases {
            let said = of_io(&io::Error::new(io::ErrorKind::InvalidData, error.clone())).unwrap();
            assert!(said.contains(part), "{error:?}: {said}");
        }
        assert_eq!(
            of_io(&io::Error::from(io::ErrorKind::ConnectionRefused)),
            None
        );
    }
}
