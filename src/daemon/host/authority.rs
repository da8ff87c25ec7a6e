//! A local authority and the certificate that it issues for the page.
//!
//! The authority can only sign for the names that it was made for, for names in `.local`, and for private addresses: its
//! key is no danger to other hosts of those who trust it.

use crate::domain::calendar;
use crate::domain::time::WallTime;
use ipnet::IpNet;
use rcgen::{
    BasicConstraints, CertificateParams, CidrSubnet, DistinguishedName, DnType,
    ExtendedKeyUsagePurpose, GeneralSubtree, IsCa, Issuer, KeyPair, KeyUsagePurpose,
    NameConstraints, SanType, date_time_ymd,
};
use rustls::pki_types::CertificateDer;
use std::net::IpAddr;
use x509_parser::extensions::GeneralName;
use x509_parser::parse_x509_certificate;
use x509_parser::prelude::X509Certificate;

/// Days for which an authority is valid: ten years, as it is installed by hand.
const AUTHORITY_DAYS: i64 = 3652;
/// Most days for which iOS accepts a certificate of an authority that its owner has installed.
pub const CERTIFICATE_DAYS_MAX: i64 = 825;
/// Networks whose addresses every authority may sign for: private, link-local and loopback ones.
const PRIVATE: [&str; 8] = [
    "10.0.0.0/8",
    "172.16.0.0/12",
    "192.168.0.0/16",
    "169.254.0.0/16",
    "127.0.0.0/8",
    "fc00::/7",
    "fe80::/10",
    "::1/128",
];
/// Domains whose names every authority may sign for.
const LOCAL: [&str; 2] = ["local", "localhost"];

/// What is wrong with an authority, a certificate, or the names for one.
#[derive(Debug, thiserror::Error)]
pub enum Error {
    /// A name is no host name.
    #[error("`{0}` is neither a host name nor an address")]
    Name(String),
    /// The authority was made for other names.
    #[error("this authority cannot sign for {0}: it was made for other names")]
    NotPermitted(String),
    /// A file does not hold what it should.
    #[error("it is no certificate in PEM")]
    NoCertificate,
    /// The library's.
    #[error("{0}")]
    Library(#[from] rcgen::Error),
}

/// A certificate with its key, in PEM.
pub struct IssuedCertificate {
    /// The certificate.
    pub certificate: String,
    /// The key of the certificate.
    pub key: String,
}

/// An authority that can sign.
pub struct CertificateAuthority {
    issuer: Issuer<'static, KeyPair>,
}

impl CertificateAuthority {
    /// A new authority called `title` for `names`, valid from a day before `now`.
    ///
    /// # Errors
    /// A name is no host name; the library's.
    pub fn generate(
        title: &str,
        names: &[String],
        now: WallTime,
    ) -> Result<(Self, IssuedCertificate), Error> {
        let mut params = CertificateParams::default();
        params.is_ca = IsCa::Ca(BasicConstraints::Constrained(0));
        params.key_usages = vec![KeyUsagePurpose::KeyCertSign, KeyUsagePurpose::CrlSign];
        params.distinguished_name = distinguished_name(title);
        params.name_constraints = Some(NameConstraints {
            permitted_subtrees: permitted(names),
            excluded_subtrees: Vec::new(),
        });
        valid_for(&mut params, now, AUTHORITY_DAYS);
        let key = KeyPair::generate()?;
        let issued = IssuedCertificate {
            certificate: params.self_signed(&key)?.pem(),
            key: key.serialize_pem(),
        };
        Ok((
            Self {
                issuer: Issuer::new(params, key),
            },
            issued,
        ))
    }

    /// The authority with this certificate and key, in PEM.
    ///
    /// # Errors
    /// They cannot be used.
    pub fn from_pem(certificate: &str, key: &str) -> Result<Self, Error> {
        Ok(Self {
            issuer: Issuer::from_ca_cert_pem(certificate, KeyPair::from_pem(key)?)?,
        })
    }

    /// A certificate of a server with these names, valid for `days` from now.
    ///
    /// # Errors
    /// A name is no host name; the library's.
    pub fn issue(
        &self,
        names: &[String],
        now: WallTime,
        days: i64,
    ) -> Result<IssuedCertificate, Error> {
        let mut params = CertificateParams::default();
        params.subject_alt_names = names
            .iter()
            .map(|name| subject(name))
            .collect::<Result<_, _>>()?;
        params.distinguished_name =
            distinguished_name(names.first().map_or("vfd-gateway", String::as_str));
        params.key_usages = vec![KeyUsagePurpose::DigitalSignature];
        params.extended_key_usages = vec![ExtendedKeyUsagePurpose::ServerAuth];
        params.use_authority_key_identifier_extension = true;
        valid_for(&mut params, now, days);
        let key = KeyPair::generate()?;
        Ok(IssuedCertificate {
            certificate: params.signed_by(&key, &self.issuer)?.pem(),
            key: key.serialize_pem(),
        })
    }
}

/// What people want to know of a certificate.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct CertificateFacts {
    /// The names and addresses that it is valid for.
    pub names: Vec<String>,
    /// The end of its validity.
    pub until: WallTime,
    /// SHA-256 of the certificate in hexadecimal, with colons.
    pub fingerprint: String,
}

/// Facts of `certificate`.
///
/// # Errors
/// It is not an X.509 certificate.
pub fn facts(certificate: &CertificateDer<'_>) -> Result<CertificateFacts, Error> {
    let (_, parsed) = parse_x509_certificate(certificate).map_err(|_| Error::NoCertificate)?;
    let digest = ring::digest::digest(&ring::digest::SHA256, certificate);
    let pairs: Vec<_> = digest
        .as_ref()
        .iter()
        .map(|byte| format!("{byte:02X}"))
        .collect();
    let unix_ms = parsed.validity().not_after.timestamp().saturating_mul(1000);
    Ok(CertificateFacts {
        names: names(&parsed),
        until: WallTime { unix_ms },
        fingerprint: pairs.join(":"),
    })
}

/// The authority at the end of `chain`, if the chain has one: the certificate that signed itself.
#[must_use]
pub fn authority_of<'c>(
    chain: &'c [CertificateDer<'static>],
) -> Option<&'c CertificateDer<'static>> {
    let last = chain.last()?;
    let (_, parsed) = parse_x509_certificate(last).ok()?;
    (parsed.is_ca() && parsed.subject() == parsed.issuer()).then_some(last)
}

/// Whether an authority with this certificate may sign for all of `names`.
///
/// # Errors
/// The first name that it may not sign for; it is not an X.509 certificate.
pub fn may_sign(authority: &CertificateDer<'_>, names: &[String]) -> Result<(), Error> {
    let (_, parsed) = parse_x509_certificate(authority).map_err(|_| Error::NoCertificate)?;
    let limits = parsed
        .name_constraints()
        .ok()
        .flatten()
        .and_then(|limits| limits.value.permitted_subtrees.as_ref());
    let Some(permitted) = limits else {
        return Ok(());
    };
    let fits = |name: &String| {
        permitted
            .iter()
            .any(|subtree| is_within(name, &subtree.base))
    };
    match names.iter().find(|name| !fits(name)) {
        Some(name) => Err(Error::NotPermitted(name.clone())),
        None => Ok(()),
    }
}

fn is_within(name: &str, subtree: &GeneralName<'_>) -> bool {
    match (name.parse::<IpAddr>(), subtree) {
        (Ok(address), GeneralName::IPAddress(bytes)) => {
            network(bytes).is_some_and(|net| net.contains(&address))
        }
        (Err(_), GeneralName::DNSName(domain)) => {
            let before = name.strip_suffix(domain);
            before.is_some_and(|before| before.is_empty() || before.ends_with('.'))
        }
        _ => false,
    }
}

/// An address followed by its mask.
fn network(bytes: &[u8]) -> Option<IpNet> {
    let (first, mask) = bytes.split_at_checked(bytes.len() / 2)?;
    IpNet::with_netmask(address(first)?, address(mask)?).ok()
}

fn address(bytes: &[u8]) -> Option<IpAddr> {
    let v4 = <[u8; 4]>::try_from(bytes).map(IpAddr::from);
    v4.or_else(|_| <[u8; 16]>::try_from(bytes).map(IpAddr::from))
        .ok()
}

fn names(certificate: &X509Certificate<'_>) -> Vec<String> {
    let Ok(Some(list)) = certificate.subject_alternative_name() else {
        return Vec::new();
    };
    let text = |name: &GeneralName<'_>| match name {
        GeneralName::DNSName(name) => Some((*name).to_owned()),
        GeneralName::IPAddress(bytes) => address(bytes).map(|address| address.to_string()),
        _ => None,
    };
    list.value.general_names.iter().filter_map(text).collect()
}

fn distinguished_name(title: &str) -> DistinguishedName {
    let mut name = DistinguishedName::new();
    name.push(DnType::CommonName, title);
    name
}

fn subject(name: &str) -> Result<SanType, Error> {
    match name.parse() {
        Ok(address) => Ok(SanType::IpAddress(address)),
        Err(_) if is_host_name(name) => Ok(SanType::DnsName(name.try_into()?)),
        Err(_) => Err(Error::Name(name.to_owned())),
    }
}

/// Whether `name` is a host name: labels of letters, digits and hyphens (RFC 1123).
fn is_host_name(name: &str) -> bool {
    let is_label = |label: &str| {
        (1..=63).contains(&label.len())
            && label
                .bytes()
                .all(|byte| byte.is_ascii_alphanumeric() || byte == b'-')
            && !label.starts_with('-')
            && !label.ends_with('-')
    };
    name.len() <= 253 && name.split('.').all(is_label)
}

fn permitted(names: &[String]) -> Vec<GeneralSubtree> {
    let given = names.iter().map(|name| match name.parse::<IpAddr>() {
        Ok(address) => subnet(IpNet::from(address)),
        Err(_) => GeneralSubtree::DnsName(name.clone()),
    });
    let local = LOCAL
        .iter()
        .map(|domain| GeneralSubtree::DnsName((*domain).to_owned()));
    let private = PRIVATE
        .iter()
        .filter_map(|net| net.parse().ok())
        .map(subnet);
    given.chain(local).chain(private).collect()
}

fn subnet(net: IpNet) -> GeneralSubtree {
    GeneralSubtree::IpAddress(CidrSubnet::from_addr_prefix(net.addr(), net.prefix_len()))
}

/// From a day before `now`, because the clocks of clients differ.
fn valid_for(params: &mut CertificateParams, now: WallTime, days: i64) {
    let date = |days: i64| {
        let moment = WallTime {
            unix_ms: now
                .unix_ms
                .saturating_add(days.saturating_mul(calendar::DAY_MS)),
        };
        let (year, month, day) = calendar::date(moment);
        date_time_ymd(year, month, day)
    };
    params.not_before = date(-1);
    params.not_after = date(days - 1);
}

#[cfg(test)]
mod tests {
    use super::*;
    use rustls::pki_types::pem::PemObject;

    const NOW: WallTime = WallTime {
        unix_ms: 1_795_651_200_000,
    };

    fn der(pem: &str) -> CertificateDer<'static> {
        CertificateDer::from_pem_slice(pem.as_bytes()).unwrap()
    }

    fn list(names: &[&str]) -> Vec<String> {
        names.iter().map(|name| (*name).to_owned()).collect()
    }

    #[test]
    fn a_certificate_has_its_names_and_its_end() {
        let names = list(&["press-shop.local", "10.0.0.7", "fd00::7"]);
        let (authority, own) = CertificateAuthority::generate("plant", &names, NOW).unwrap();
        let issued = authority.issue(&names, NOW, CERTIFICATE_DAYS_MAX).unwrap();
        let facts = facts(&der(&issued.certificate)).unwrap();
        assert_eq!(facts.names, names);
        assert_eq!(calendar::rfc3339(facts.until), "2029-02-27T00:00:00.000Z");
        assert_eq!(facts.fingerprint.len(), 32 * 3 - 1);
        let again = CertificateAuthority::from_pem(&own.certificate, &own.key).unwrap();
        assert!(
            again.issue(&names, NOW, 30).is_ok(),
            "it can be used after a restart"
        );
        assert!(matches!(
            authority.issue(&list(&["no name"]), NOW, 30),
            Err(Error::Name(_))
        ));
    }

    #[test]
    fn an_authority_signs_for_its_names_and_private_ones_alone() {
        let (_, own) = CertificateAuthority::generate(
            "plant",
            &list(&["gateway.example.org", "203.0.113.7"]),
            NOW,
        )
        .unwrap();
        let own = der(&own.certificate);
        for fits in [
            "gateway.example.org",
            "203.0.113.7",
            "other.local",
            "localhost",
            "192.168.7.1",
            "fd00::1",
        ] {
            assert!(may_sign(&own, &list(&[fits])).is_ok(), "{fits}");
        }
        for other in [
            "example.org",
            "bank.example",
            "notlocal",
            "203.0.113.8",
            "2001:db8::1",
        ] {
            let refused = may_sign(&own, &list(&["localhost", other])).unwrap_err();
            assert!(refused.to_string().contains(other), "{refused}");
        }
    }

    #[test]
    fn only_an_authority_at_the_end_of_a_chain_is_one() {
        let names = list(&["localhost"]);
        let (authority, own) = CertificateAuthority::generate("plant", &names, NOW).unwrap();
        let own = der(&own.certificate);
        let leaf = der(&authority.issue(&names, NOW, 30).unwrap().certificate);
        assert_eq!(authority_of(&[leaf.clone(), own.clone()]), Some(&own));
        assert_eq!(authority_of(&[leaf]), None);
        assert_eq!(authority_of(&[]), None);
    }
}
