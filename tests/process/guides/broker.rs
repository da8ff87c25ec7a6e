//! The broker of the guides, on this machine: a mosquitto with a user for the gateway, with and without TLS.

use super::super::mosquitto::{Mosquitto, free_port};
use super::super::rig::Place;
use std::process::Command;

/// Of the user `vfd`. Whoever gives no name may connect as well, as in a network at home.
const PASSWORD: &str = "correct horse";

/// The broker, and what the guides name of it.
pub struct Broker {
    pub mosquitto: Mosquitto,
    /// The port for TLS, at the name `localhost`.
    pub tls_port: u16,
    /// The files with the gateway's password and with the broker's authority.
    pub password_file: String,
    pub authority: String,
}

impl Broker {
    /// Starts it with its files in `place`.
    pub fn start(place: &Place) -> Self {
        let path = |name: &str| place.file(name).to_str().unwrap().to_owned();
        let [authority, passwords] = [path("broker-ca.pem"), path("passwords")];
        let [certificate, key] = make_certificate(place, &authority);
        run(
            "mosquitto_passwd",
            &["-b", "-c", &passwords, "vfd", PASSWORD],
        );
        place.write("mqtt-password", PASSWORD);
        let tls_port = free_port();
        let more = format!(
            "password_file {passwords}\nlistener {tls_port} 127.0.0.1\ncafile {authority}\ncertfile {certificate}\n\
             keyfile {key}\n"
        );
        let mosquitto = Mosquitto::start_with(&place.file(""), &more);
        Self {
            mosquitto,
            tls_port,
            password_file: path("mqtt-password"),
            authority,
        }
    }

    /// Its port without TLS.
    pub fn port(&self) -> u16 {
        self.mosquitto.address().port()
    }
}

/// An authority, and a certificate by it for `localhost` with its key.
fn make_certificate(place: &Place, authority: &str) -> [String; 2] {
    let path = |name: &str| place.file(name).to_str().unwrap().to_owned();
    let [authority_key, request, certificate, key] =
        ["ca.key", "broker.csr", "broker.pem", "broker.key"].map(path);
    let extensions = place.write(
        "broker.ext",
        "subjectAltName=DNS:localhost\nbasicConstraints=CA:FALSE\n",
    );
    let new = [
        "req",
        "-newkey",
        "ec",
        "-pkeyopt",
        "ec_paramgen_curve:prime256v1",
        "-nodes",
    ];
    let of_authority = [
        "-x509",
        "-days",
        "30",
        "-subj",
        "/CN=authority",
        "-keyout",
        &authority_key,
        "-out",
        authority,
    ];
    run("openssl", &[&new[..], &of_authority].concat());
    run(
        "openssl",
        &[
            &new[..],
            &["-subj", "/CN=localhost", "-keyout", &key, "-out", &request],
        ]
        .concat(),
    );
    let by = [
        "-CA",
        authority,
        "-CAkey",
        &authority_key,
        "-CAcreateserial",
    ];
    let sign = [
        "x509",
        "-req",
        "-days",
        "30",
        "-in",
        &request,
        "-extfile",
        extensions.to_str().unwrap(),
    ];
    run(
        "openssl",
        &[&sign[..], &by, &["-out", &certificate]].concat(),
    );
    [certificate, key]
}

fn run(program: &str, args: &[&str]) {
    let output = Command::new(program).args(args).output();
    let output = output
        .unwrap_or_else(|error| panic!("{program}: {error}; run tests/run, which installs it"));
    assert!(
        output.status.success(),
        "{program} {args:?}: {}",
        String::from_utf8_lossy(&output.stderr)
    );
}
