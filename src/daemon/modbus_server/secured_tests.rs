//! Modbus Security over real sockets, with certificates of every kind and the test in the place of the lines.

use super::handshake::{HANDSHAKES_MAX, shake};
use super::issuing::{Authority, Files, Issued, role, role_holding};
use super::tests::{EVERY_LINE, Kept, Plant, answer, ask, send, shared};
use super::*;
use crate::config::{ListenerSettings, ListenerTls};
use crate::daemon::exchange::router::UniformUnits;
use crate::domain::command::{Outcome, Reason, Report};
use crate::domain::ids::CommanderName;
use crate::wire::mbap;
use rcgen::{DnType, ExtendedKeyUsagePurpose};
use rustls::crypto::ring;
use rustls::pki_types::{PrivateKeyDer, ServerName};
use rustls::sign::{CertifiedKey, SingleCertAndKey};
use rustls::{
    ClientConfig, ClientConnection, HandshakeKind, RootCertStore, SupportedProtocolVersion, version,
};
use std::io::{Read, Write};
use tokio::io::{AsyncReadExt, AsyncWriteExt};
use tokio::net::{TcpListener, TcpStream};
use tokio::task::LocalSet;
use tokio_rustls::TlsConnector;
use tokio_rustls::client::TlsStream;

/// The first word of a uniform unit: 1, the state of the drive is known.
const READ: [u8; 5] = [3, 0, 0, 0, 1];
const RUN: [u8; 5] = [6, 1, 0, 0, 1];
const EVERY_VERSION: &[&SupportedProtocolVersion] = &[&version::TLS12, &version::TLS13];

/// A plant behind a listener with TLS, at which operators may do everything and viewers may read.
struct Secured {
    plant: Plant,
    /// Issues the gateway's certificate.
    own: Authority,
    /// Issues those of the clients.
    clients: Authority,
    files: Files,
    settings: ListenerSettings,
    listener: Rc<ModbusListener>,
    server: Rc<ModbusServer>,
    totals: Arc<ModbusTotals>,
    kept: Arc<Kept>,
}

fn play<F: Future<Output = ()>>(test: impl FnOnce(Secured) -> F) {
    let runtime = tokio::runtime::Builder::new_current_thread()
        .enable_all()
        .build()
        .unwrap();
    runtime.block_on(LocalSet::new().run_until(async { test(Secured::new().await).await }));
}

impl Secured {
    async fn new() -> Self {
        let own = Authority::new();
        let clients = Authority::new();
        let files = Files::new();
        let tls = files.listener(&own, &clients);
        let security = ListenerSecurity::read(&tls).unwrap();
        let write = vec!["127.0.0.0/8".parse().unwrap()];
        let settings = ListenerSettings {
            write,
            tls: Some(tls),
            ..EVERY_LINE
        };
        let socket = TcpListener::bind(settings.listen).await.unwrap();
        let shared = shared();
        let answers = Arc::<AnswerBox>::default();
        let address = socket.local_addr().unwrap();
        let listener =
            ModbusListener::new(settings.clone(), router(&settings, &shared), Some(security));
        let totals = Arc::<ModbusTotals>::default();
        let kept = Arc::<Kept>::default();
        let server = Rc::new(ModbusServer::new(
            Arc::clone(&totals),
            Some(Arc::clone(&kept) as _),
        ));
        tokio::task::spawn_local(Rc::clone(&server).listen(socket, Rc::clone(&listener)));
        tokio::task::spawn_local(Rc::clone(&server).distribute(Arc::clone(&answers)));
        let plant = Plant {
            shared,
            answers,
            address,
        };
        Self {
            plant,
            own,
            clients,
            files,
            settings,
            listener,
            server,
            totals,
            kept,
        }
    }

    fn tls(&self) -> &ListenerTls {
        self.settings.tls.as_ref().unwrap()
    }

    fn config(
        &self,
        client: Option<&Issued>,
        versions: &[&'static SupportedProtocolVersion],
    ) -> Arc<ClientConfig> {
        let mut roots = RootCertStore::empty();
        roots.add(self.own.certificate.der().clone()).unwrap();
        let builder = ClientConfig::builder_with_provider(Arc::new(ring::default_provider()));
        let builder = builder
            .with_protocol_versions(versions)
            .unwrap()
            .with_root_certificates(roots);
        Arc::new(match client {
            None => builder.with_no_client_auth(),
            Some(client) => {
                let key = PrivateKeyDer::try_from(client.key.serialize_der()).unwrap();
                let key = ring::sign::any_supported_type(&key).unwrap();
                // Not checked on this side, whatever is wrong with it.
                let shown = CertifiedKey::new(vec![client.certificate.der().clone()], key);
                builder.with_client_cert_resolver(Arc::new(SingleCertAndKey::from(shown)))
            }
        })
    }

    async fn connect(&self, config: &Arc<ClientConfig>) -> TlsStream<TcpStream> {
        let stream = TcpStream::connect(self.plant.address).await.unwrap();
        TlsConnector::from(Arc::clone(config))
            .connect(name(), stream)
            .await
            .unwrap()
    }

    async fn client(&self, name: &str, role: &str) -> TlsStream<TcpStream> {
        self.connect(&self.config(Some(&self.clients.client(name, role)), EVERY_VERSION))
            .await
    }

    /// Changes the listener as a reload does.
    fn change(&self, settings: ListenerSettings) {
        let security = settings
            .tls
            .as_ref()
            .map(|tls| ListenerSecurity::read(tls).unwrap());
        let router = router(&settings, &self.plant.shared);
        self.listener.change(settings, router, security);
        self.server.review();
    }

    /// Why the gateway refuses this client.
    async fn refusal(&self, config: &Arc<ClientConfig>) -> String {
        let security = ListenerSecurity::read(self.tls()).unwrap();
        let socket = TcpListener::bind(EVERY_LINE.listen).await.unwrap();
        let stream = TcpStream::connect(socket.local_addr().unwrap())
            .await
            .unwrap();
        let (accepted, _) = socket.accept().await.unwrap();
        let (source, sink) = accepted.into_split();
        let gateway = async { shake(source, sink, &security).await.err().unwrap() };
        let client = async {
            let mut stream = TlsConnector::from(Arc::clone(config))
                .connect(name(), stream)
                .await?;
            stream.read(&mut [0]).await
        };
        let (reason, client) = tokio::join!(gateway, client);
        assert!(client.is_err(), "the client is notified: {client:?}");
        reason
    }
}

fn router(
    settings: &ListenerSettings,
    shared: &Arc<crate::daemon::exchange::shared::SharedPlant>,
) -> UnitRouter {
    UnitRouter::new(settings, UniformUnits::new(shared))
}

fn name() -> ServerName<'static> {
    ServerName::try_from("localhost").unwrap()
}

async fn is_closed(stream: &mut (impl AsyncRead + Unpin)) -> bool {
    matches!(stream.read(&mut [0]).await, Ok(0) | Err(_))
}

#[test]
fn the_role_says_what_the_owner_may() {
    play(async |secured: Secured| {
        let all = Rights {
            write: true,
            stop: true,
        };
        for (name, role, rights) in [
            ("scada", "operator", all),
            ("panel", "viewer", Rights::NONE),
        ] {
            let mut stream = secured.client(name, role).await;
            assert_eq!(ask(&mut stream, 101, &READ).await, [3, 2, 0, 1], "{role}");
            send(&mut stream, &[(9, 101, &RUN)]).await;
            let command = secured.plant.commands(0, 1).await.remove(0);
            let owner = Owner::ModbusSecurity(CommanderName::new(name).unwrap());
            assert_eq!(
                command.origin,
                Origin {
                    owner,
                    rights,
                    manner: OrderManner::Cyclic
                },
                "{role}"
            );
            secured.plant.tell(
                &command,
                Report::new(Outcome::Acknowledged, Reason::None),
                true,
            );
            assert_eq!(answer(&mut stream).await, (9, 101, RUN.to_vec()));
        }
    });
}

#[test]
fn a_role_that_is_not_listed_gets_01_for_everything() {
    play(async |secured: Secured| {
        let mut connected = Vec::new();
        for role in ["intern", "Operator", ""] {
            let mut stream = secured.client("somebody", role).await;
            for (unit, pdu) in [
                (101, &READ[..]),
                (1, &[3, 1, 1, 0, 1]),
                (255, &[0x2B, 0x0E, 4, 0]),
                (101, &RUN),
            ] {
                assert_eq!(
                    ask(&mut stream, unit, pdu).await,
                    [pdu[0] | 0x80, 1],
                    "{role} {unit} {pdu:?}"
                );
            }
            let kept = secured.kept.take();
            let [(_, attempt)] = &kept[..] else {
                panic!("{kept:?}")
            };
            assert_eq!(attempt.owner.to_string(), "modbus-security somebody");
            assert_eq!(attempt.report, Some(Report::refused(Reason::NotAllowed)));
            connected.push(stream);
        }
        secured.plant.assert_untouched();
    });
}

#[test]
fn what_an_address_may_not_its_role_does_not_grant() {
    play(async |secured: Secured| {
        let mut stream = secured.client("scada", "operator").await;
        secured.change(ListenerSettings {
            write: Vec::new(),
            ..secured.settings.clone()
        });
        send(&mut stream, &[(9, 101, &RUN)]).await;
        assert_eq!(
            secured.plant.commands(0, 1).await.remove(0).origin.rights,
            Rights::NONE
        );
    });
}

#[test]
fn both_versions_are_served_and_nothing_is_resumed() {
    play(async |secured: Secured| {
        let client = secured.clients.client("scada", "viewer");
        for version in EVERY_VERSION {
            let config = secured.config(Some(&client), &[version]);
            for _ in 0..2 {
                let mut stream = secured.connect(&config).await;
                assert_eq!(ask(&mut stream, 101, &READ).await, [3, 2, 0, 1]);
                let session = stream.get_ref().1;
                assert_eq!(session.protocol_version(), Some(version.version));
                assert_eq!(
                    session.handshake_kind(),
                    Some(HandshakeKind::Full),
                    "its certificate is looked at each time"
                );
            }
        }
        assert_eq!(secured.totals.handshakes_failed(), 0);
    });
}

#[test]
fn anyone_who_does_not_prove_itself_gets_the_reason() {
    play(async |secured: Secured| {
        let common = |params: &mut rcgen::CertificateParams| {
            params.distinguished_name.push(DnType::CommonName, "x")
        };
        let issue = |edit: &dyn Fn(&mut rcgen::CertificateParams)| {
            secured.clients.issue(|params| {
                common(params);
                edit(params);
            })
        };
        let day = |year| rcgen::date_time_ymd(year, 1, 1);
        let mut critical = role("operator");
        critical.set_criticality(true);
        let purpose = ExtendedKeyUsagePurpose::ServerAuth;
        for (client, right) in [
            (None, "the client presented no certificate"),
            (
                Some(Authority::new().client("scada", "operator")),
                "not signed by an authority in `client_ca_file`",
            ),
            (
                Some(issue(&|it| {
                    (it.not_before, it.not_after) = (day(2019), day(2020))
                })),
                "has expired",
            ),
            (
                Some(issue(&|it| {
                    (it.not_before, it.not_after) = (day(2090), day(2091))
                })),
                "is not valid yet",
            ),
            (
                Some(issue(&|it| it.extended_key_usages = vec![purpose.clone()])),
                "is not for clients",
            ),
            (
                Some(issue(&|it| it.custom_extensions = vec![critical.clone()])),
                "the role extension must not be critical",
            ),
            (
                Some(issue(&|it| {
                    it.custom_extensions = vec![role("a"), role("b")]
                })),
                "more than one role extension",
            ),
            (
                Some(issue(&|it| {
                    it.custom_extensions = vec![role_holding(b"a".to_vec())]
                })),
                "exactly one UTF8String",
            ),
            (
                Some(secured.clients.issue(|_| {})),
                "its certificate has no subject",
            ),
        ] {
            for version in EVERY_VERSION {
                let reason = secured
                    .refusal(&secured.config(client.as_ref(), &[version]))
                    .await;
                assert!(reason.contains(right), "{reason} / {right}");
            }
        }
    });
}

#[test]
fn handshakes_that_stall_hold_up_nobody_and_give_way() {
    play(async |secured: Secured| {
        let mut stalled = Vec::new();
        for _ in 0..HANDSHAKES_MAX {
            stalled.push(TcpStream::connect(secured.plant.address).await.unwrap());
        }
        let mut stream = secured.client("scada", "viewer").await;
        assert_eq!(ask(&mut stream, 101, &READ).await, [3, 2, 0, 1]);
        assert!(is_closed(&mut stalled[0]).await);
        assert_eq!(secured.totals.handshakes_failed(), 1);
        assert!(secured.server.handshakes.len() < HANDSHAKES_MAX);
    });
}

#[test]
fn a_client_in_the_middle_of_its_handshake_gives_way_as_any_other() {
    play(async |secured: Secured| {
        secured.change(ListenerSettings {
            connections_max: Some(2),
            ..secured.settings.clone()
        });
        let mut half = TcpStream::connect(secured.plant.address).await.unwrap();
        half.write_all(&[22, 3, 1, 2, 0, 1]).await.unwrap();
        while secured.server.handshakes.len() < 1 {
            tokio::task::yield_now().await;
        }
        let mut second = secured.client("scada", "viewer").await;
        assert_eq!(ask(&mut second, 101, &READ).await, [3, 2, 0, 1]);
        let mut third = secured.client("panel", "viewer").await;
        assert_eq!(ask(&mut third, 101, &READ).await, [3, 2, 0, 1]);
        assert!(is_closed(&mut half).await, "it was silent for longest");
        assert_eq!(ask(&mut second, 101, &READ).await, [3, 2, 0, 1]);
        assert_eq!(
            (secured.totals.connections(), secured.totals.dismissed()),
            (2, 1)
        );
        assert_eq!(secured.server.handshakes.len(), 0);
    });
}

#[test]
fn a_handshake_ends_in_time() {
    play(async |secured: Secured| {
        let mut stalled = TcpStream::connect(secured.plant.address).await.unwrap();
        let mut half = TcpStream::connect(secured.plant.address).await.unwrap();
        // The header of a record that never arrives.
        half.write_all(&[22, 3, 1, 2, 0, 1]).await.unwrap();
        while secured.server.handshakes.len() < 2 {
            tokio::task::yield_now().await;
        }
        tokio::time::pause();
        assert!(is_closed(&mut stalled).await && is_closed(&mut half).await);
        assert_eq!(
            (
                secured.totals.handshakes_failed(),
                secured.server.handshakes.len()
            ),
            (2, 0)
        );
    });
}

#[test]
fn what_is_no_tls_is_closed() {
    play(async |secured: Secured| {
        let mut plain = TcpStream::connect(secured.plant.address).await.unwrap();
        send(&mut plain, &[(1, 101, &READ)]).await;
        let mut answer = Vec::new();
        // An alert may arrive before the end; an answer does not.
        let _ = plain.read_to_end(&mut answer).await;
        assert!(answer.len() < 9, "{answer:?}");
        assert_eq!(secured.totals.handshakes_failed(), 1);
    });
}

#[test]
fn a_client_that_reads_late_gets_everything_in_order() {
    const REQUESTS: u16 = 20_000;
    play(async |secured: Secured| {
        let stream = secured.client("scada", "viewer").await;
        let (mut source, mut sink) = tokio::io::split(stream);
        let ask = async {
            for first in (0..REQUESTS).step_by(100) {
                let requests: Vec<(u16, u8, &[u8])> = (first..first + 100)
                    .map(|number| (number, 101, &[3, 0, 0, 0, 16][..]))
                    .collect();
                send(&mut sink, &requests).await;
            }
        };
        let read = async {
            tokio::time::sleep(Duration::from_millis(200)).await;
            for number in 0..REQUESTS {
                let (transaction, unit, pdu) = answer(&mut source).await;
                assert_eq!(
                    (transaction, unit, &pdu[..4]),
                    (number, 101, &[3, 32, 0, 1][..])
                );
            }
        };
        tokio::join!(ask, read);
    });
}

#[test]
fn a_request_right_after_the_handshake_is_answered() {
    play(async |secured: Secured| {
        let config = secured.config(
            Some(&secured.clients.client("scada", "viewer")),
            &[&version::TLS13],
        );
        let mut session = ClientConnection::new(config, name()).unwrap();
        let mut stream = TcpStream::connect(secured.plant.address).await.unwrap();
        let mut buffer = [0; 4096];
        loop {
            if !session.is_handshaking() {
                let mut request = Vec::new();
                mbap::encode(&mut request, 7, 101, |out| out.extend_from_slice(&READ));
                session.writer().write_all(&request).unwrap();
            }
            let mut out = Vec::new();
            while session.wants_write() {
                session.write_tls(&mut out).unwrap();
            }
            stream.write_all(&out).await.unwrap();
            if !session.is_handshaking() {
                break;
            }
            let read = stream.read(&mut buffer).await.unwrap();
            session.read_tls(&mut &buffer[..read]).unwrap();
            session.process_new_packets().unwrap();
        }
        let mut reply = [0; 11];
        while session.reader().read(&mut reply).is_err() {
            let read = stream.read(&mut buffer).await.unwrap();
            assert!(read > 0);
            session.read_tls(&mut &buffer[..read]).unwrap();
            session.process_new_packets().unwrap();
        }
        assert_eq!(reply, [0, 7, 0, 0, 0, 5, 101, 3, 2, 0, 1]);
    });
}

#[test]
fn a_connection_stays_as_long_as_its_authority_is_trusted() {
    play(async |secured: Secured| {
        let mut stream = secured.client("scada", "operator").await;
        // New certificate of the gateway, same authorities.
        secured.files.listener(&secured.own, &secured.clients);
        secured.change(secured.settings.clone());
        assert_eq!(ask(&mut stream, 101, &READ).await, [3, 2, 0, 1]);
        // The role is gone.
        let mut settings = secured.settings.clone();
        settings.tls.as_mut().unwrap().roles.remove("operator");
        secured.change(settings);
        assert_eq!(ask(&mut stream, 101, &READ).await, [0x83, 1]);
        secured.change(secured.settings.clone());
        assert_eq!(ask(&mut stream, 101, &READ).await, [3, 2, 0, 1]);
        secured.files.listener(&secured.own, &Authority::new());
        secured.change(secured.settings.clone());
        assert!(is_closed(&mut stream).await);
    });
}

#[test]
fn who_came_with_tls_does_not_stay_without_and_the_other_way_round() {
    play(async |secured: Secured| {
        let mut stream = secured.client("scada", "operator").await;
        assert_eq!(ask(&mut stream, 101, &READ).await, [3, 2, 0, 1]);
        secured.change(ListenerSettings {
            tls: None,
            ..secured.settings.clone()
        });
        assert!(is_closed(&mut stream).await);
        let mut plain = TcpStream::connect(secured.plant.address).await.unwrap();
        assert_eq!(ask(&mut plain, 101, &READ).await, [3, 2, 0, 1]);
        secured.change(secured.settings.clone());
        assert!(is_closed(&mut plain).await);
    });
}

#[test]
fn files_that_cannot_be_used_are_named_all_at_once() {
    let files = Files::new();
    let own = Authority::new();
    let clients = Authority::new();
    let tls = files.listener(&own, &clients);
    let missing = ListenerTls {
        cert_file: "/nowhere/own.pem".into(),
        key_file: tls.cert_file.clone(),
        client_ca_file: files.write("empty.pem", ""),
        ..tls.clone()
    };
    let what = ListenerSecurity::read(&missing).unwrap_err();
    for part in [
        "/nowhere/own.pem: No such file".to_owned(),
        format!("{}: it contains no private key", tls.cert_file.display()),
        "empty.pem: it contains no certificate".to_owned(),
    ] {
        assert!(what.contains(&part), "{part} / {what}");
    }
    let foreign = files.write("foreign.key", &own.issue(|_| {}).key.serialize_pem());
    let what = ListenerSecurity::read(&ListenerTls {
        key_file: foreign,
        ..tls.clone()
    })
    .unwrap_err();
    assert!(what.contains("it does not match the key"), "{what}");
    assert!(ListenerSecurity::read(&tls).is_ok());
}
