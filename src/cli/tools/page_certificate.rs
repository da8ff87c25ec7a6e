//! The certificate of the page: a local authority, and what it issues.

use super::CommandFailure;
pub use crate::daemon::host::authority::CERTIFICATE_DAYS_MAX;
use crate::daemon::host::authority::{
    self, CertificateAuthority, CertificateFacts, IssuedCertificate,
};
use crate::daemon::host::user_files::{self, BYTES_MAX};
use crate::daemon::host::whole_files::{self, FileReaders};
use crate::daemon::host::{clock, pem_files};
use crate::domain::calendar;
use crate::domain::time::WallTime;
use qrcode::QrCode;
use qrcode::render::unicode::Dense1x2;
use rustix::system::uname;
use std::fmt::{Display, Write};
use std::io;
use std::net::{IpAddr, Ipv4Addr, UdpSocket};
use std::os::unix::fs::DirBuilderExt;
use std::path::Path;

/// The certificate of the authority, which clients install.
const AUTHORITY: &str = "authority.crt";
/// The key of the authority, which only renewals need.
const AUTHORITY_KEY: &str = "authority.key";
/// The key and the certificate of the page, with the authority behind it. One file, so that a renewal replaces all of it
/// at once.
pub const PAGE: &str = "page.pem";

/// Makes a certificate for this host in `dir`, for a page on `port`, and returns what is to be done with it.
pub fn make_certificate(dir: &Path, names: &[String], port: u16) -> Result<String, CommandFailure> {
    let now = clock::wall();
    let names = if names.is_empty() {
        own_names()
    } else {
        names.to_vec()
    };
    renewed(dir, &names, now, CERTIFICATE_DAYS_MAX, port)
}

/// The certificate for `names`, with what is to be done with it.
pub fn renewed(
    dir: &Path,
    names: &[String],
    now: WallTime,
    days: i64,
    port: u16,
) -> Result<String, CommandFailure> {
    make_directory(dir)?;
    let (authority, own) = open_or_generate(dir, names, now)?;
    let page = issue(&authority, &own, names, now, days)?;
    let file = dir.join(PAGE);
    whole_files::replace(&file, page.as_bytes(), FileReaders::Group)
        .map_err(|error| at(&file, error))?;
    report(dir, port, names, last_or_fail(&file)?.until)
}

/// Facts of the certificate in `file`; `None` if there is no such file.
pub fn last(file: &Path) -> Result<Option<CertificateFacts>, CommandFailure> {
    if !file.try_exists().map_err(|error| at(file, error))? {
        Ok(None)
    } else {
        last_or_fail(file).map(Some)
    }
}

fn last_or_fail(file: &Path) -> Result<CertificateFacts, CommandFailure> {
    let chain = pem_files::certificates(file).map_err(CommandFailure::failed)?;
    let leaf = chain
        .first()
        .ok_or_else(|| at(file, "it contains no certificate"))?;
    authority::facts(leaf).map_err(|error| at(file, error))
}

fn make_directory(dir: &Path) -> Result<(), CommandFailure> {
    match std::fs::DirBuilder::new().mode(0o750).create(dir) {
        Err(error) if error.kind() == io::ErrorKind::AlreadyExists => Ok(()),
        Err(error) if error.kind() == io::ErrorKind::NotFound => {
            let parent = dir.parent().unwrap_or(Path::new("/")).display();
            Err(at(
                dir,
                format!("its parent does not exist; make it: install -d -m 750 {parent}"),
            ))
        }
        done => done.map_err(|error| at(dir, error)),
    }
}

/// The authority in `dir`, and its certificate in PEM. A new one can sign for `names`.
fn open_or_generate(
    dir: &Path,
    names: &[String],
    now: WallTime,
) -> Result<(CertificateAuthority, String), CommandFailure> {
    let file = dir.join(AUTHORITY);
    let key_file = dir.join(AUTHORITY_KEY);
    let certificate = match user_files::text(&file, BYTES_MAX) {
        Err(error) if error.kind() == io::ErrorKind::NotFound => return generate(dir, names, now),
        read => read.map_err(|error| at(&file, error))?,
    };
    let own = pem_files::certificates(&file).map_err(CommandFailure::failed)?;
    let own = own
        .first()
        .ok_or_else(|| at(&file, "it contains no certificate"))?;
    authority::may_sign(own, names).map_err(|error| {
        let right = "use another `--dir`, whose authority the clients then have to install";
        at(&file, format!("{error}; {right}"))
    })?;
    let key = user_files::text(&key_file, BYTES_MAX).map_err(|error| {
        at(
            &key_file,
            format!("{error}; it is needed for a renewal: run this where it is kept"),
        )
    })?;
    let authority =
        CertificateAuthority::from_pem(&certificate, &key).map_err(|error| at(&key_file, error))?;
    Ok((authority, certificate))
}

fn generate(
    dir: &Path,
    names: &[String],
    now: WallTime,
) -> Result<(CertificateAuthority, String), CommandFailure> {
    let title = format!(
        "vfd-gateway authority of {}",
        names.first().map_or("this host", String::as_str)
    );
    let (authority, issued) =
        CertificateAuthority::generate(&title, names, now).map_err(CommandFailure::wrong)?;
    // A name that cannot be certified leaves nothing behind.
    authority
        .issue(names, now, 1)
        .map_err(CommandFailure::wrong)?;
    let key_file = dir.join(AUTHORITY_KEY);
    let file = dir.join(AUTHORITY);
    // The key first: an authority without one could never renew.
    whole_files::create(&key_file, issued.key.as_bytes(), FileReaders::Owner)
        .map_err(|error| at(&key_file, error))?;
    whole_files::create(&file, issued.certificate.as_bytes(), FileReaders::All)
        .map_err(|error| at(&file, error))?;
    Ok((authority, issued.certificate))
}

/// The file of the page.
fn issue(
    authority: &CertificateAuthority,
    own: &str,
    names: &[String],
    now: WallTime,
    days: i64,
) -> Result<String, CommandFailure> {
    let IssuedCertificate { certificate, key } = authority
        .issue(names, now, days)
        .map_err(CommandFailure::wrong)?;
    Ok(format!("{key}{certificate}{own}"))
}

/// The names of this host, and the address that it uses towards other networks.
pub fn own_names() -> Vec<String> {
    let host = uname().nodename().to_string_lossy().to_ascii_lowercase();
    let first = host.split('.').next().unwrap_or_default().to_owned();
    let mut names = vec![format!("{first}.local"), host];
    names.extend(own_address().map(|address| address.to_string()));
    names.extend(["localhost".to_owned(), Ipv4Addr::LOCALHOST.to_string()]);
    names.retain(|name| name != ".local" && !name.is_empty());
    let mut known = std::collections::BTreeSet::new();
    names.retain(|name| known.insert(name.clone()));
    names
}

/// The address of this host on the way to other networks. Sends nothing: connecting a UDP socket only chooses a route.
fn own_address() -> Option<IpAddr> {
    let socket = UdpSocket::bind((Ipv4Addr::UNSPECIFIED, 0)).ok()?;
    // A documentation address (RFC 5737).
    socket.connect((Ipv4Addr::new(192, 0, 2, 1), 9)).ok()?;
    socket
        .local_addr()
        .ok()
        .map(|address| address.ip())
        .filter(|address| !address.is_loopback())
}

fn report(
    dir: &Path,
    port: u16,
    names: &[String],
    until: WallTime,
) -> Result<String, CommandFailure> {
    let dir = dir.canonicalize().unwrap_or_else(|_| dir.to_path_buf());
    let file = dir.join(PAGE);
    let own = last_or_fail(&dir.join(AUTHORITY))?;
    let url = format!("https://{}:{port}/authority.crt", host(names));
    let mut text = String::new();
    let _ = write!(
        text,
        "The certificate in {file} is valid for {names} until {until}.\n\n\
         [http.tls]\ncert_file = \"{file}\"\nkey_file = \"{file}\"\n\n\
         Reload the gateway after that, and after each renewal. Then install the authority on phones and computers, once,\n\
         until {authority}: {url}\n\n{code}\n\
         Install it only if its SHA-256 fingerprint is\n{fingerprint}\n\n\
         {key} signs renewals. Keep it from others.\n",
        file = file.display(),
        names = names.join(", "),
        until = calendar::day(until),
        authority = calendar::day(own.until),
        code = code(&url)?,
        fingerprint = own.fingerprint,
        key = dir.join(AUTHORITY_KEY).display(),
    );
    Ok(text)
}

/// The name that other hosts can use most likely, as part of a URL.
fn host(names: &[String]) -> String {
    let is_local = |name: &str| {
        name == "localhost"
            || name
                .parse::<IpAddr>()
                .is_ok_and(|address| address.is_loopback())
    };
    let name = names
        .iter()
        .find(|name| !is_local(name))
        .or(names.first())
        .map_or("localhost", String::as_str);
    match name.parse() {
        Ok(IpAddr::V6(address)) => format!("[{address}]"),
        _ => name.to_owned(),
    }
}

/// `text` as a QR code of block characters, for a terminal with a dark background. Phones read both.
fn code(text: &str) -> Result<String, CommandFailure> {
    let code = QrCode::new(text).map_err(CommandFailure::failed)?;
    Ok(code
        .render::<Dense1x2>()
        .dark_color(Dense1x2::Light)
        .light_color(Dense1x2::Dark)
        .build())
}

fn at(file: &Path, what: impl Display) -> CommandFailure {
    CommandFailure::failed(format!("{}: {what}", file.display()))
}
