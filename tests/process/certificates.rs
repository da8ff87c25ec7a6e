//! The certificate of the page: OpenSSL and a client trust it, the gateway serves its authority, and renewals keep both.

use super::browser::Browser;
use super::mosquitto::free_port;
use super::outsiders::openssl_client;
use super::raw::Raw;
use super::rig::{Place, assert_says, program, simulate, start, vfd_gateway};
use super::started::{PATIENCE, Started, until};
use std::net::SocketAddr;
use std::os::unix::fs::PermissionsExt;
use std::path::Path;
use std::process::{Command, Output};

/// What `certificate` does with `dir` and `args`.
fn certificate(dir: &Path, args: &[&str]) -> Output {
    program()
        .arg("certificate")
        .arg("--dir")
        .arg(dir)
        .args(args)
        .output()
        .unwrap()
}

fn text(output: &Output) -> String {
    assert!(
        output.status.success(),
        "{}",
        String::from_utf8_lossy(&output.stderr)
    );
    String::from_utf8_lossy(&output.stdout).into_owned()
}

/// What `openssl` prints for `args`.
fn openssl(args: &[&str]) -> String {
    text(&Command::new("openssl").args(args).output().unwrap())
}

fn mode(file: &Path) -> u32 {
    std::fs::metadata(file).unwrap().permissions().mode() & 0o777
}

/// A gateway whose page has the certificate in `dir`.
fn gateway(place: &Place, dir: &Path, http: SocketAddr) -> Started {
    std::fs::create_dir(place.file("data")).unwrap();
    let page = dir.join("page.pem");
    let file = place.write(
        "gateway.toml",
        &format!(
            "[gateway]\nname = \"plant-a\"\ndata_dir = \"{data}\"\n\n\
             [[line]]\nname = \"hall-1\"\nport = \"{line}\"\n\n\
             [[line.drive]]\nname = \"pump-1\"\nstation = 1\nmodel = \"hyundai-n700\"\n\n\
             [http]\nlisten = \"{http}\"\n\n[http.tls]\ncert_file = \"{page}\"\nkey_file = \"{page}\"\n",
            data = place.file("data").display(),
            line = place.file("line").display(),
            page = page.display(),
        ),
    );
    let gateway = start(&["run", "-c", file.to_str().unwrap()]);
    until("it listens", PATIENCE, || Raw::try_connect(http));
    gateway
}

/// The certificate that the page at `http` presents, in PEM; verified by OpenSSL against the authority in `dir`.
fn presented(http: SocketAddr, dir: &Path) -> String {
    let authority = dir.join("authority.crt");
    let trust = [
        "-CAfile",
        authority.to_str().unwrap(),
        "-verify_return_error",
        "-verify_hostname",
        "localhost",
    ];
    let (is_trusted, said) = openssl_client(http, &trust);
    assert!(
        is_trusted && said.contains("Verify return code: 0 (ok)"),
        "{said}"
    );
    let (_, from) = said.split_once("-----BEGIN CERTIFICATE-----").unwrap();
    from.split_once("-----END CERTIFICATE-----")
        .unwrap()
        .0
        .to_owned()
}

#[test]
fn a_page_is_trusted_by_its_own_authority_over_renewals() {
    let place = Place::new();
    let dir = place.file("tls");
    let made = text(&certificate(
        &dir,
        &["--name", "localhost", "--name", "127.0.0.1"],
    ));
    let authority = dir.join("authority.crt");
    let print = openssl(&[
        "x509",
        "-in",
        authority.to_str().unwrap(),
        "-noout",
        "-fingerprint",
        "-sha256",
    ]);
    let (_, print) = print.trim().split_once('=').unwrap();
    assert!(made.contains(print), "{print} is not in {made}");
    assert!(
        made.contains("https://localhost:8443/authority.crt") && made.contains("[http.tls]"),
        "{made}"
    );
    assert_eq!(
        [
            mode(&dir),
            mode(&dir.join("authority.key")),
            mode(&dir.join("page.pem"))
        ],
        [0o750, 0o600, 0o640]
    );

    let _drive = simulate(&place.file("line"));
    let http = SocketAddr::from(([127, 0, 0, 1], free_port()));
    let gateway = gateway(&place, &dir, http);
    let first = presented(http, &dir);
    let served = place.file("served.der");
    let answer = Browser::new(http)
        .through_tls(&authority)
        .get("/authority.crt");
    assert_eq!(
        answer.header("content-type"),
        Some("application/x-x509-ca-cert")
    );
    std::fs::write(&served, &answer.bytes).unwrap();
    let again = openssl(&[
        "x509",
        "-inform",
        "der",
        "-in",
        served.to_str().unwrap(),
        "-noout",
        "-fingerprint",
        "-sha256",
    ]);
    assert!(again.contains(print), "{again}");

    let own = std::fs::read(&authority).unwrap();
    assert!(text(&certificate(&dir, &["--renew-within", "60"])).contains("not renewed"));
    let renewed = text(&certificate(&dir, &[]));
    assert!(
        renewed.contains("valid for localhost, 127.0.0.1"),
        "{renewed}"
    );
    assert_eq!(
        std::fs::read(&authority).unwrap(),
        own,
        "clients go on trusting it"
    );
    gateway.signal("HUP");
    until("the renewed certificate is presented", PATIENCE, || {
        (presented(http, &dir) != first).then_some(())
    });
}

#[test]
fn what_cannot_be_certified_leaves_nothing() {
    let place = Place::new();
    let dir = place.file("tls");
    assert_says(
        &certificate(&dir, &["--name", "no name"]),
        2,
        &["`no name` is neither a host name nor an address"],
    );
    assert!(!dir.join("authority.key").exists() && !dir.join("page.pem").exists());
    let missing = place.file("missing/tls");
    assert_says(
        &certificate(&missing, &[]),
        1,
        &["its parent does not exist", "install -d -m 750"],
    );

    text(&certificate(&dir, &["--name", "gateway.example.org"]));
    let before = std::fs::read(dir.join("page.pem")).unwrap();
    let foreign = certificate(&dir, &["--name", "bank.example"]);
    assert_says(
        &foreign,
        1,
        &["cannot sign for bank.example", "another `--dir`"],
    );
    std::fs::remove_file(dir.join("authority.key")).unwrap();
    assert_says(
        &certificate(&dir, &[]),
        1,
        &["authority.key", "it is needed for a renewal"],
    );
    assert_eq!(std::fs::read(dir.join("page.pem")).unwrap(), before);
}

#[test]
fn without_names_it_is_for_this_host() {
    let place = Place::new();
    let dir = place.file("tls");
    let made = text(&certificate(&dir, &["--port", "9443"]));
    assert!(
        made.contains("localhost, 127.0.0.1 until") && made.contains(":9443/authority.crt"),
        "{made}"
    );
    let help = text(&vfd_gateway(&["certificate", "--help"]));
    assert!(help.contains("--renew-within"), "{help}");
}
