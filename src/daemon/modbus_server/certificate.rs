//! The name and the role of a client, from its certificate.

use crate::domain::ids::CommanderName;
use ring::digest::{SHA256, digest};
use std::fmt::Write as _;
use x509_parser::asn1_rs::{FromDer, Oid, Utf8String, oid};
use x509_parser::certificate::X509Certificate;
use x509_parser::oid_registry::OID_X509_COMMON_NAME;
use x509_parser::x509::X509Name;

/// The role extension of Modbus/TCP Security v2.1.
const ROLE: Oid<'static> = oid!(1.3.6.1.4.1.50316.802.1);
/// Digits of the digest in a name that is derived from a subject.
const DIGEST_DIGITS: usize = 16;

/// What a client's certificate says about it.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct CertifiedClient {
    /// A name for the subject. The same for all certificates with that subject, and for no others.
    pub name: CommanderName,
    /// The role; empty if there is none.
    pub role: Box<str>,
}

/// Why a certificate cannot be used although its authority is trusted.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub(super) enum UnusableCertificate {
    /// The certificate cannot be read.
    #[error("its certificate cannot be read")]
    Unreadable,
    /// The certificate has no subject.
    #[error("its certificate has no subject")]
    NoSubject,
    /// The certificate has more than one role.
    #[error("its certificate has more than one role extension (1.3.6.1.4.1.50316.802.1)")]
    Roles,
    /// The role is not text.
    #[error(
        "the role extension of its certificate (1.3.6.1.4.1.50316.802.1) does not hold exactly one UTF8String"
    )]
    RoleType,
}

impl CertifiedClient {
    /// Reads the certificate `der`, which must have been verified before.
    ///
    /// # Errors
    /// Why it cannot be used.
    pub fn read(der: &[u8]) -> Result<Self, UnusableCertificate> {
        let (_, certificate) =
            X509Certificate::from_der(der).map_err(|_| UnusableCertificate::Unreadable)?;
        let mut roles = certificate
            .extensions()
            .iter()
            .filter(|extension| extension.oid == ROLE);
        let role = match (roles.next(), roles.next()) {
            (None, _) => "".into(),
            (Some(role), None) => text(role.value).ok_or(UnusableCertificate::RoleType)?,
            (Some(_), Some(_)) => return Err(UnusableCertificate::Roles),
        };
        Ok(Self {
            name: name(certificate.subject())?,
            role,
        })
    }
}

/// The text of a UTF8String with no trailing bytes.
fn text(der: &[u8]) -> Option<Box<str>> {
    let (rest, text) = Utf8String::from_der(der).ok()?;
    rest.is_empty().then(|| text.as_ref().into())
}

/// If the subject is only a common name that is a valid name, it is used as is. Any other subject gets a name with a
/// digest of it.
fn name(subject: &X509Name<'_>) -> Result<CommanderName, UnusableCertificate> {
    let mut attributes = subject.iter_attributes();
    let first = attributes.next().ok_or(UnusableCertificate::NoSubject)?;
    let is_all = attributes.next().is_none() && *first.attr_type() == OID_X509_COMMON_NAME;
    let plain = first
        .as_str()
        .ok()
        .filter(|text| is_all && !has_digest(text))
        .and_then(CommanderName::new);
    if let Some(plain) = plain {
        return Ok(plain);
    }
    let fits = |c: &char| c.is_ascii_alphanumeric() || matches!(c, '-' | '_' | '.');
    let common = subject
        .iter_common_name()
        .find_map(|name| name.as_str().ok())
        .unwrap_or_default();
    let room = CommanderName::MAX_CHARS - DIGEST_DIGITS - 1;
    let mut made: String = common.chars().filter(fits).take(room).collect();
    made.push('.');
    for byte in digest(&SHA256, subject.as_raw())
        .as_ref()
        .iter()
        .take(DIGEST_DIGITS / 2)
    {
        // Writing into a text never fails.
        let _ = write!(made, "{byte:02x}");
    }
    CommanderName::new(&made).ok_or(UnusableCertificate::Unreadable)
}

/// Whether a name looks like one with a digest: such a common name must not pass for another subject.
fn has_digest(text: &str) -> bool {
    let digits = text.rsplit_once('.').map(|(_, digits)| digits);
    digits.is_some_and(|digits| {
        digits.len() == DIGEST_DIGITS && digits.bytes().all(|byte| byte.is_ascii_hexdigit())
    })
}

#[cfg(test)]
mod tests {
    use super::super::issuing::{Authority, role, role_holding};
    use super::*;
    use rcgen::{CertificateParams, DnType, DnValue};

    fn read(
        edit: impl FnOnce(&mut CertificateParams),
    ) -> Result<CertifiedClient, UnusableCertificate> {
        CertifiedClient::read(Authority::new().issue(edit).certificate.der())
    }

    fn name_of_certificate(attributes: &[(DnType, &str)]) -> String {
        let certificate = read(|params| {
            for (kind, value) in attributes {
                params.distinguished_name.push(kind.clone(), *value);
            }
        });
        certificate.unwrap().name.to_string()
    }

    const COMMON: DnType = DnType::CommonName;

    #[test]
    fn a_role_is_one_utf8_string() {
        let with = |extensions: &[rcgen::CustomExtension]| {
            read(|params| {
                params.distinguished_name.push(COMMON, "scada");
                params.custom_extensions = extensions.to_vec();
            })
        };
        let role_of = |extensions: &[_]| with(extensions).map(|it| it.role.into_string());
        assert_eq!(role_of(&[]), Ok(String::new()));
        assert_eq!(role_of(&[role("operator")]), Ok("operator".to_owned()));
        assert_eq!(role_of(&[role("Zähler 1")]), Ok("Zähler 1".to_owned()));
        assert_eq!(role_of(&[role("")]), Ok(String::new()));
        assert_eq!(
            role_of(&[role("viewer"), role("operator")]),
            Err(UnusableCertificate::Roles)
        );
        assert_eq!(
            role_of(&[role("viewer"), role("viewer")]),
            Err(UnusableCertificate::Roles)
        );
        for bytes in [
            &b""[..],
            b"operator",
            b"\x13\x08operator",         // PrintableString
            b"\x16\x08operator",         // IA5String
            b"\x04\x08operator",         // OCTET STRING
            b"\x30\x0a\x0c\x08operator", // a SEQUENCE of it
            b"\x0c\x08operator\x00",     // trailing bytes
            b"\x0c\x09operator",         // cut off
            b"\x0c\x02\xff\xff",         // no UTF-8
        ] {
            assert_eq!(
                role_of(&[role_holding(bytes.to_vec())]),
                Err(UnusableCertificate::RoleType),
                "{bytes:02x?}"
            );
        }
    }

    #[test]
    fn a_common_name_alone_is_the_name() {
        for name in ["scada", "plc-2.hall_1", "10.0.0.7", &"x".repeat(32)] {
            assert_eq!(name_of_certificate(&[(COMMON, name)]), name);
        }
        let printable = read(|params| {
            let name = DnValue::PrintableString("scada".try_into().unwrap());
            params.distinguished_name.push(COMMON, name);
        });
        assert_eq!(
            printable.unwrap().name.as_str(),
            "scada",
            "a renewed certificate may write it otherwise"
        );
    }

    #[test]
    fn another_subject_gets_a_name_of_its_own() {
        let organized =
            name_of_certificate(&[(DnType::OrganizationName, "acme"), (COMMON, "scada")]);
        let (common, digits) = organized.rsplit_once('.').unwrap();
        assert_eq!((common, digits.len()), ("scada", 16), "{organized}");
        let subjects = [
            vec![(COMMON, "scada")],
            vec![(DnType::OrganizationName, "acme"), (COMMON, "scada")],
            vec![(DnType::OrganizationName, "other"), (COMMON, "scada")],
            // A common name that looks like the name of another subject.
            vec![(COMMON, organized.as_str())],
            vec![(COMMON, "a common name with blanks in it")],
            vec![(COMMON, "a common name with blanks at it")],
            vec![(COMMON, "Zähler")],
            vec![(COMMON, "")],
            vec![(DnType::OrganizationName, "scada")],
        ];
        let names: std::collections::BTreeSet<_> = subjects
            .iter()
            .map(|subject| name_of_certificate(subject))
            .collect();
        assert_eq!(names.len(), subjects.len(), "{names:?}");
        assert_eq!(
            name_of_certificate(&subjects[1]),
            organized,
            "the same each time"
        );
    }

    #[test]
    fn what_says_nothing_is_refused() {
        assert_eq!(read(|_| {}), Err(UnusableCertificate::NoSubject));
        for bytes in [&b""[..], b"\x30\x00", b"no certificate"] {
            assert_eq!(
                CertifiedClient::read(bytes),
                Err(UnusableCertificate::Unreadable)
            );
        }
    }
}
