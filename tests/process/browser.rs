//! Somebody with a browser: keeps the cookie and the token, and says where each request comes from.

use super::started::PATIENCE;
use rustls::pki_types::pem::PemObject;
use rustls::pki_types::{CertificateDer, ServerName};
use rustls::{ClientConfig, ClientConnection, RootCertStore, StreamOwned};
use serde_json::{Value, json};
use std::io::{Read, Write};
use std::net::{SocketAddr, TcpStream};
use std::path::Path;
use std::sync::Arc;

/// A browser on the page of one gateway.
#[derive(Clone)]
pub struct Browser {
    address: SocketAddr,
    tls: Option<Arc<ClientConfig>>,
    pub cookie: String,
    pub token: String,
    /// What it sends beside that, or instead of it.
    pub host: String,
    pub origin: Option<String>,
    pub content_type: String,
    /// The moment that its orders name; without one, the newest there is.
    pub moment: Option<String>,
}

/// What was answered.
pub struct Answer {
    pub status: u16,
    pub head: String,
    pub body: String,
    /// The body as it was sent.
    pub bytes: Vec<u8>,
}

impl Answer {
    pub fn json(&self) -> Value {
        serde_json::from_str(&self.body)
            .unwrap_or_else(|error| panic!("{error}: {} {}", self.head, self.body))
    }

    /// The value of a header, whose name is in lower case.
    pub fn header(&self, name: &str) -> Option<&str> {
        self.head
            .lines()
            .find_map(|line| {
                line.split_once(": ")
                    .filter(|(it, _)| it.eq_ignore_ascii_case(name))
            })
            .map(|it| it.1)
    }
}

impl Browser {
    pub fn new(address: SocketAddr) -> Self {
        Self {
            address,
            tls: None,
            cookie: String::new(),
            token: String::new(),
            host: address.to_string(),
            origin: Some(format!("http://{address}")),
            content_type: "application/json".to_owned(),
            moment: None,
        }
    }

    /// The same browser through TLS from now on, trusting the authority in the file `ca`.
    pub fn through_tls(self, ca: &Path) -> Self {
        let mut roots = RootCertStore::empty();
        roots
            .add(CertificateDer::from_pem_file(ca).unwrap())
            .unwrap();
        let provider = Arc::new(rustls::crypto::ring::default_provider());
        let config = ClientConfig::builder_with_provider(provider)
            .with_safe_default_protocol_versions()
            .unwrap();
        let config = config.with_root_certificates(roots).with_no_client_auth();
        let origin = Some(format!("https://{}", self.address));
        Self {
            tls: Some(Arc::new(config)),
            origin,
            ..self
        }
    }

    /// Signs in, and keeps what that gives.
    pub fn sign_in(&mut self, user: &str, password: &str) -> Answer {
        let answer = self.post(
            "/api/v1/session",
            &json!({ "user": user, "password": password }),
        );
        if answer.status == 200 {
            let cookie = answer.header("set-cookie").expect("a cookie");
            self.cookie = cookie.split(';').next().unwrap().to_owned();
            self.token = answer.json()["token"].as_str().expect("a token").to_owned();
        }
        answer
    }

    pub fn get(&self, path: &str) -> Answer {
        self.ask("GET", path, "")
    }

    pub fn post(&self, path: &str, body: &Value) -> Answer {
        self.ask("POST", path, &body.to_string())
    }

    /// Orders something of the usual drive.
    pub fn command(&self, body: &Value) -> Answer {
        self.post("/api/v1/drives/pump-1/command", body)
    }

    /// The present moment, as the gateway calls it; none if it does not answer.
    pub fn newest_moment(&self) -> Option<String> {
        let session: Value = serde_json::from_str(&self.get("/api/v1/session").body).ok()?;
        session["moment"].as_str().map(str::to_owned)
    }

    pub fn ask(&self, method: &str, path: &str, body: &str) -> Answer {
        let mut request = format!(
            "{method} {path} HTTP/1.1\r\nHost: {}\r\nConnection: close\r\n",
            self.host
        );
        let mut add = |name: &str, value: &str| request += &format!("{name}: {value}\r\n");
        if !self.cookie.is_empty() {
            add("Cookie", &self.cookie);
        }
        if method != "GET" {
            add("Content-Length", &body.len().to_string());
            add("Content-Type", &self.content_type);
            self.origin.iter().for_each(|origin| add("Origin", origin));
            if !self.token.is_empty() {
                add("X-CSRF-Token", &self.token);
            }
            if let Some(moment) = self.moment.clone().or_else(|| self.newest_moment()) {
                add("Vfd-Moment", &moment);
            }
        }
        request += &format!("\r\n{body}");
        let stream = TcpStream::connect(self.address).unwrap();
        stream.set_read_timeout(Some(PATIENCE)).unwrap();
        let bytes = match &self.tls {
            None => exchange(stream, &request),
            Some(tls) => {
                let name = ServerName::IpAddress(self.address.ip().into());
                exchange(
                    StreamOwned::new(
                        ClientConnection::new(Arc::clone(tls), name).unwrap(),
                        stream,
                    ),
                    &request,
                )
            }
        };
        let end = bytes
            .windows(4)
            .position(|window| window == b"\r\n\r\n")
            .unwrap_or_else(|| panic!("no answer"));
        let head = String::from_utf8(bytes[..end].to_vec()).unwrap();
        let bytes = bytes[end + 4..].to_vec();
        let status = head.split(' ').nth(1).unwrap().parse().unwrap();
        Answer {
            status,
            head,
            body: String::from_utf8_lossy(&bytes).into_owned(),
            bytes,
        }
    }
}

fn exchange(mut stream: impl Read + Write, request: &str) -> Vec<u8> {
    stream.write_all(request.as_bytes()).unwrap();
    let mut bytes = Vec::new();
    stream.read_to_end(&mut bytes).unwrap();
    bytes
}
