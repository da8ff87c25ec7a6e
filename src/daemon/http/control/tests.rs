//! Sign-in, orders and places over real sockets, with a line that the test plays.

use super::super::front::ClientRequirements;
use super::super::tests::{on_a_runtime, state};
use super::HttpControl;
use crate::config::{HashSource, HttpSettings, HttpTls, PageViewers, UserSettings};
use crate::daemon::exchange::answers::{AnswerBox, LineNews};
use crate::daemon::exchange::inbox::LineMessage;
use crate::daemon::exchange::shared::SharedPlant;
use crate::daemon::host::clock;
use crate::daemon::http::{self, CONNECTIONS_MAX, HttpState};
use crate::daemon::local::LocalSide;
use crate::daemon::testing::Dir;
use crate::domain::command::{
    CommandAnswer, CommandRequest, Order, Outcome, Owner, Reason, Report,
};
use crate::domain::control::{ControlSettings, FailSafe};
use crate::domain::frequency::Hertz;
use crate::domain::ids::{CommanderName, Name};
use crate::guard::COMMAND_DEADLINE;
use crate::north::operator::moments::{AGE_MAX, SealedMoments};
use crate::north::operator::password::StoredHash;
use crate::north::operator::rights::{UserRights, UserRole};
use serde_json::{Value, json};
use std::cell::{Cell, RefCell};
use std::net::SocketAddr;
use std::rc::Rc;
use std::sync::{Arc, OnceLock};
use std::time::Duration;
use tokio::io::{AsyncReadExt, AsyncWriteExt};
use tokio::net::{TcpListener, TcpStream};
use tokio::task::AbortHandle;

const PASSWORD: &str = "correct horse";

fn hash() -> StoredHash {
    static HASH: OnceLock<StoredHash> = OnceLock::new();
    HASH.get_or_init(|| StoredHash::make(PASSWORD, &[7; 16]).unwrap())
        .clone()
}

fn settings(users: &[&str]) -> HttpSettings {
    let rights = UserRights {
        role: UserRole::Maintain,
        groups: None,
    };
    let user = |name: &&str| UserSettings {
        name: CommanderName::new(name).unwrap(),
        hash: HashSource::Text(hash()),
        rights: rights.clone(),
    };
    HttpSettings {
        listen: "127.0.0.1:0".parse().unwrap(),
        allow: None,
        hosts: vec!["gw.example".to_owned()],
        view: PageViewers::Anyone,
        setup: false,
        users: users.iter().map(user).collect(),
        tls: None,
    }
}

/// Two drives, of which the page may command the first, on a line that confirms every order.
struct House {
    address: SocketAddr,
    control: Arc<HttpControl>,
    heard: Rc<RefCell<Vec<(Owner, Order)>>>,
    /// The line grants control, but only after longer than an order may wait.
    gives_late: Rc<Cell<bool>>,
    listener: AbortHandle,
}

fn house_of(users: &[&str]) -> House {
    let listener = std::net::TcpListener::bind("127.0.0.1:0").unwrap();
    listener.set_nonblocking(true).unwrap();
    let address = listener.local_addr().unwrap();
    let plain = state(false);
    let shared = plain.shared.get();
    let lost = (FailSafe::Stop, Duration::from_secs(3));
    let control = ControlSettings::new(
        (Hertz::ZERO, Hertz::from_millihertz(50_000)),
        lost,
        FailSafe::Stop,
    );
    let drive = |name: &str, index, from_page| {
        let mut description = shared.drives[0].description.clone();
        description.name = crate::domain::ids::Name::new(name).unwrap();
        description.place.drive = crate::domain::ids::DriveIndex(index);
        description.control = Some(Arc::new(ControlSettings {
            from_page,
            ..control.clone()
        }));
        description
    };
    let line = (shared.lines[0].name.clone(), shared.lines[0].interface);
    let shared = Arc::new(SharedPlant::new(
        vec![line],
        vec![drive("pump-1", 0, true), drive("pump-2", 1, false)],
    ));
    let state = HttpState {
        shared: Arc::clone(&shared).into(),
        mqtt: None.into(),
        ..Arc::into_inner(plain).unwrap()
    };
    let answers = Arc::<AnswerBox>::default();
    let heard = Rc::<RefCell<Vec<_>>>::default();
    let side = Arc::new(LocalSide::new(Arc::clone(&shared), None));
    tokio::task::spawn_local(Arc::clone(&side).distribute(Arc::clone(&answers)));
    let gives_late = Rc::<Cell<bool>>::default();
    tokio::task::spawn_local(play(
        shared,
        answers,
        Rc::clone(&heard),
        Rc::clone(&gives_late),
    ));
    let documents = http::RouteDocuments::new(Arc::new(state));
    let control = Arc::new(HttpControl::new(
        side,
        documents.live.moments().clone(),
        ClientRequirements::read(&settings(users)).unwrap(),
        None,
    ));
    let listener = TcpListener::from_std(listener).unwrap();
    let served = tokio::task::spawn_local(http::serve(listener, documents, Arc::clone(&control)));
    House {
        address,
        control,
        heard,
        gives_late,
        listener: served.abort_handle(),
    }
}

async fn play(
    shared: Arc<SharedPlant>,
    answers: Arc<AnswerBox>,
    heard: Rc<RefCell<Vec<(Owner, Order)>>>,
    gives_late: Rc<Cell<bool>>,
) {
    let mut batch = Vec::new();
    loop {
        shared.lines[0].inbox.take(&mut batch);
        let mut news = Vec::new();
        for message in batch.drain(..) {
            let LineMessage::Command(CommandRequest {
                asker,
                ticket,
                drive,
                origin,
                order,
                ..
            }) = message
            else {
                panic!("{message:?}")
            };
            let report = match &order {
                Order::Renew => Report::new(Outcome::Acknowledged, Reason::Unchanged),
                Order::Take if gives_late.get() => {
                    tokio::time::sleep(COMMAND_DEADLINE + Duration::from_millis(100)).await;
                    Report::new(Outcome::Acknowledged, Reason::None)
                }
                Order::Take => Report::held_by(Owner::Mqtt),
                _ => Report::new(Outcome::Confirmed, Reason::None),
            };
            heard.borrow_mut().push((origin.owner, order));
            news.push(LineNews::Command(CommandAnswer {
                asker,
                ticket,
                drive,
                report,
                is_final: true,
            }));
        }
        answers.put(&mut news);
        tokio::time::sleep(Duration::from_millis(1)).await;
    }
}

impl House {
    /// A connection that has received an answer, or its beginning, and stays open.
    async fn open(&self, path: &str) -> TcpStream {
        let mut stream = TcpStream::connect(self.address).await.unwrap();
        again(&mut stream, path).await;
        stream
    }

    /// Sends a request as a client that has received the present moment.
    async fn ask(&self, method: &str, path: &str, head: &str, body: &str) -> (u16, String, Value) {
        let head = format!(
            "{head}Vfd-Moment: {}\r\n",
            self.control.moments.at(clock::now())
        );
        self.ask_as(method, path, &head, body).await
    }

    /// Sends a request with this head alone.
    async fn ask_as(
        &self,
        method: &str,
        path: &str,
        head: &str,
        body: &str,
    ) -> (u16, String, Value) {
        let stream = TcpStream::connect(self.address).await.unwrap();
        self.ask_on(stream, method, path, head, body).await
    }

    async fn ask_on(
        &self,
        mut stream: TcpStream,
        method: &str,
        path: &str,
        head: &str,
        body: &str,
    ) -> (u16, String, Value) {
        let request = format!(
            "{method} {path} HTTP/1.1\r\nHost: localhost\r\nConnection: close\r\n{head}Content-Type: application/json\r\n\
             Content-Length: {}\r\n\r\n{body}",
            body.len()
        );
        stream.write_all(request.as_bytes()).await.unwrap();
        let mut text = String::new();
        stream.read_to_string(&mut text).await.unwrap();
        let (head, body) = text.split_once("\r\n\r\n").unwrap();
        let status = head.split(' ').nth(1).unwrap().parse().unwrap();
        (
            status,
            head.to_owned(),
            serde_json::from_str(body).unwrap_or(Value::Null),
        )
    }

    /// The headers of a client that has signed in as `user`.
    async fn sign_in(&self, user: &str) -> String {
        let body = json!({ "user": user, "password": PASSWORD }).to_string();
        let (status, head, body) = self.ask("POST", "/api/v1/session", "", &body).await;
        assert_eq!(status, 200, "{body}");
        let cookie = head
            .lines()
            .find_map(|line| line.strip_prefix("set-cookie: "))
            .unwrap();
        let (cookie, _) = cookie.split_once(';').unwrap();
        format!(
            "Cookie: {cookie}\r\nX-CSRF-Token: {}\r\n",
            body["token"].as_str().unwrap()
        )
    }
}

fn owner(name: &str) -> Owner {
    Owner::Page(CommanderName::new(name).unwrap())
}

#[test]
fn orders_go_to_the_line_under_the_name_of_anyone_who_is_signed_in() {
    on_a_runtime(async {
        let house = house_of(&["anna"]);
        let head = house.sign_in("anna").await;
        let (status, _, answer) = house
            .ask(
                "POST",
                "/api/v1/drives/pump-1/command",
                &head,
                r#"{"reset": true}"#,
            )
            .await;
        assert_eq!(
            (status, &answer["drive"], &answer["outcome"]),
            (200, &"pump-1".into(), &"confirmed".into())
        );
        let (status, _, _) = house
            .ask("POST", "/api/v1/drives/pump-1/lease", &head, "{}")
            .await;
        assert_eq!(status, 204);
        let body = r#"{"take": true, "run": "forward"}"#;
        let (_, _, answer) = house
            .ask("POST", "/api/v1/drives/pump-1/command", &head, body)
            .await;
        assert_eq!(
            answer["holder"], "mqtt",
            "what cannot be taken is not commanded: {answer}"
        );
        let (status, _, answer) = house.ask("POST", "/api/v1/stop", &head, "").await;
        let names: Vec<_> = answer["drives"]
            .as_array()
            .unwrap()
            .iter()
            .map(|it| it["drive"].clone())
            .collect();
        assert_eq!(
            (status, names),
            (200, vec!["pump-1".into()]),
            "only what the page may command"
        );
        let stop = Order::Stop { setpoint: None };
        let right =
            [Order::Reset, Order::Renew, Order::Take, stop].map(|order| (owner("anna"), order));
        assert_eq!(*house.heard.borrow(), right);
    });
}

#[test]
fn a_stop_is_carried_out_whatever_stands_beside_it() {
    on_a_runtime(async {
        let house = house_of(&["anna"]);
        let head = house.sign_in("anna").await;
        let stop = (owner("anna"), Order::Stop { setpoint: None });
        let large = format!(r#"{{"run": "stop", "x": "{}"}}"#, "x".repeat(10_000));
        let bodies = [
            r#"{"run": "stop", "speed": 3}"#,
            r#"{"run": "stop", "run": "forward"}"#,
            r#"{"run": "stop"} x"#,
            &large,
        ];
        for body in bodies {
            let (status, _, answer) = house
                .ask("POST", "/api/v1/drives/pump-1/command", &head, body)
                .await;
            assert_eq!(
                (status, &answer["outcome"]),
                (200, &"confirmed".into()),
                "{answer}"
            );
            assert!(
                answer["message"]
                    .as_str()
                    .unwrap()
                    .starts_with("the stop was taken all the same: "),
                "{answer}"
            );
            assert_eq!(
                house.heard.borrow_mut().drain(..).collect::<Vec<_>>(),
                std::slice::from_ref(&stop),
                "{answer}"
            );
        }
        let (status, _, answer) = house.ask("POST", "/api/v1/stop", &head, &large).await;
        assert_eq!(
            (status, &answer["drives"][0]["outcome"]),
            (200, &"confirmed".into()),
            "{answer}"
        );
        assert!(
            answer["message"]
                .as_str()
                .unwrap()
                .contains("an empty body is expected"),
            "{answer}"
        );
        house.heard.borrow_mut().clear();
        let large = format!(r#"{{"run": "forward", "x": "{}"}}"#, "x".repeat(10_000));
        assert_eq!(
            house
                .ask("POST", "/api/v1/drives/pump-1/command", &head, &large)
                .await
                .0,
            413
        );
        assert!(house.heard.borrow().is_empty());
    });
}

#[test]
fn an_order_whose_body_came_late_is_stale_and_a_stop_is_not() {
    on_a_runtime(async {
        let house = house_of(&["anna"]);
        let head = house.sign_in("anna").await;
        for (body, outcome, orders) in [
            (r#"{"run": "forward"}"#, "refused", 0),
            (r#"{"run": "stop"}"#, "confirmed", 1),
        ] {
            let mut stream = TcpStream::connect(house.address).await.unwrap();
            let request = format!(
                "POST /api/v1/drives/pump-1/command HTTP/1.1\r\nHost: localhost\r\nConnection: close\r\n{head}\
                 Content-Type: application/json\r\nContent-Length: {}\r\n\r\n",
                body.len()
            );
            stream.write_all(request.as_bytes()).await.unwrap();
            tokio::time::sleep(Duration::from_millis(1_500)).await;
            stream.write_all(body.as_bytes()).await.unwrap();
            let mut text = String::new();
            stream.read_to_string(&mut text).await.unwrap();
            assert!(
                text.contains(&format!(r#""outcome":"{outcome}""#)),
                "{text}"
            );
            assert_eq!(house.heard.borrow().len(), orders, "{text}");
        }
    });
}

#[test]
fn of_what_waited_as_a_whole_on_its_way_only_a_stop_is_carried_out() {
    on_a_runtime(async {
        let house = house_of(&["anna"]);
        let signed_in = house.sign_in("anna").await;
        let named = |moment: String| format!("{signed_in}Vfd-Moment: {moment}\r\n");
        let waited = house
            .control
            .moments
            .at(clock::now().before(AGE_MAX + Duration::from_millis(30_000)));
        let of_another_process = SealedMoments::new(1).at(clock::now());
        let guessed = house
            .control
            .moments
            .at(clock::now())
            .replace(char::is_alphabetic, "0");
        for (head, text) in [
            (
                named(waited),
                "the order may have waited for 31.5 s on its way",
            ),
            (named(of_another_process), "the gateway has restarted since"),
            (named(guessed), "the gateway has restarted since"),
            (
                signed_in.clone(),
                "the order does not say how old it may be",
            ),
        ] {
            for body in [
                r#"{"run": "forward"}"#,
                r#"{"frequency_hz": 30}"#,
                r#"{"reset": true}"#,
                r#"{"take": true}"#,
            ] {
                let (status, _, answer) = house
                    .ask_as("POST", "/api/v1/drives/pump-1/command", &head, body)
                    .await;
                let words = (status, &answer["outcome"], &answer["reason"]);
                assert_eq!(
                    words,
                    (200, &"refused".into(), &"stale".into()),
                    "{body}: {answer}"
                );
                assert!(
                    answer["message"].as_str().unwrap().starts_with(text),
                    "{body}: {answer}"
                );
            }
            let (status, _, answer) = house
                .ask_as("POST", "/api/v1/drives/pump-1/lease", &head, "{}")
                .await;
            assert_eq!(
                (status, &answer["reason"]),
                (409, &"stale".into()),
                "{answer}"
            );
            assert!(
                answer["error"].as_str().unwrap().starts_with(text),
                "{answer}"
            );
            assert_eq!(*house.heard.borrow(), [], "{text}");
            for (path, body) in [
                ("/api/v1/drives/pump-1/command", r#"{"run": "stop"}"#),
                ("/api/v1/drives/pump-1/command", r#"{"run": "coast"}"#),
                (
                    "/api/v1/drives/pump-1/command",
                    r#"{"run": "stop", "run": "forward", "x": 1}"#,
                ),
                ("/api/v1/stop", ""),
            ] {
                let (status, _, answer) = house.ask_as("POST", path, &head, body).await;
                assert_eq!(
                    (status, house.heard.borrow_mut().drain(..).count()),
                    (200, 1),
                    "{path} {body}: {answer}"
                );
            }
        }
    });
}

#[test]
fn a_role_and_groups_say_what_a_user_may_do_and_a_private_gateway_shows_nothing_before() {
    on_a_runtime(async {
        let house = house_of(&["anna", "bob", "carl"]);
        let mut next = settings(&["anna", "bob", "carl"]);
        next.view = PageViewers::SignedIn;
        next.users[1].rights.role = UserRole::View;
        next.users[2].rights = UserRights {
            role: UserRole::Operate,
            groups: Some([Name::new("water").unwrap()].into()),
        };
        house
            .control
            .change(ClientRequirements::read(&next).unwrap());
        for path in [
            "/api/v1/state",
            "/api/v1/events",
            "/api/v1/trend?drive=pump-1",
            "/api/v1/health",
        ] {
            let (status, _, body) = house.ask("GET", path, "", "").await;
            assert_eq!(status, 401, "{path}: {body}");
        }
        for path in [
            "/healthz",
            "/metrics",
            "/",
            "/assets/app.js",
            "/api/v1/session",
        ] {
            assert_eq!(house.ask("GET", path, "", "").await.0, 200, "{path}");
        }
        let stop = (r#"{"run":"stop"}"#, "/api/v1/drives/pump-1/command");
        let mut outcomes = Vec::new();
        for user in ["anna", "bob", "carl"] {
            let head = house.sign_in(user).await;
            assert_eq!(
                house.ask("GET", "/api/v1/state", &head, "").await.0,
                200,
                "{user} looks"
            );
            let (status, _, answer) = house.ask("POST", stop.1, &head, stop.0).await;
            let all = house.ask("POST", "/api/v1/stop", &head, "{}").await.0;
            outcomes.push((status, answer["reason"].as_str().unwrap().to_owned(), all));
            // Making the archive takes ten seconds, so only the refusal is looked at.
            if user != "anna" {
                assert_eq!(
                    house
                        .ask("POST", "/api/v1/diagnostics", &head, "{}")
                        .await
                        .0,
                    403,
                    "{user}"
                );
            }
            let (status, _, given) = house
                .ask("POST", "/api/v1/standby/yield", &head, "{}")
                .await;
            let nothing = json!({ "yielded": false, "lines": [] });
            let allowed = if user == "anna" {
                (200, nothing)
            } else {
                (403, given.clone())
            };
            assert_eq!((status, given), allowed, "{user}");
        }
        let outcome = |status, reason: &str, all| (status, reason.to_owned(), all);
        assert_eq!(
            outcomes,
            [
                outcome(200, "none", 200),
                outcome(403, "not_allowed", 409),
                outcome(200, "none", 200)
            ]
        );
        let carl = house.sign_in("carl").await;
        for body in [
            r#"{"run": "forward"}"#,
            r#"{"frequency_hz": 10.0}"#,
            r#"{"take": true}"#,
            r#"{"reset": true}"#,
        ] {
            let (status, _, answer) = house.ask("POST", stop.1, &carl, body).await;
            assert_eq!(
                (status, &answer["reason"]),
                (403, &json!("not_allowed")),
                "a drive of another group: {body}"
            );
        }
        assert_eq!(
            house
                .ask("POST", "/api/v1/drives/pump-1/lease", &carl, "{}")
                .await
                .0,
            403
        );
        assert!(
            house
                .heard
                .borrow()
                .iter()
                .all(|(_, order)| order.is_stop())
        );
        let (_, _, session) = house.ask("GET", "/api/v1/session", &carl, "").await;
        assert_eq!(
            (&session["role"], &session["groups"]),
            (&json!("operate"), &json!(["water"]))
        );
    });
}

#[test]
fn an_order_that_waited_until_control_was_taken_over_has_its_deadline_too() {
    on_a_runtime(async {
        let house = house_of(&["anna"]);
        let head = house.sign_in("anna").await;
        house.gives_late.set(true);
        let body = r#"{"take": true, "run": "forward"}"#;
        let (status, _, answer) = house
            .ask("POST", "/api/v1/drives/pump-1/command", &head, body)
            .await;
        let words = (status, &answer["outcome"], &answer["reason"]);
        assert_eq!(
            words,
            (200, &"expired".into(), &"too_late".into()),
            "{answer}"
        );
        assert_eq!(*house.heard.borrow(), [(owner("anna"), Order::Take)]);
    });
}

#[test]
fn a_session_and_the_events_hand_out_the_moment_that_an_order_names() {
    on_a_runtime(async {
        let house = house_of(&["anna"]);
        let head = house.sign_in("anna").await;
        let (_, _, session) = house.ask_as("GET", "/api/v1/session", &head, "").await;
        let mut events = TcpStream::connect(house.address).await.unwrap();
        events
            .write_all(b"GET /api/v1/events HTTP/1.1\r\nHost: localhost\r\n\r\n")
            .await
            .unwrap();
        let mut text = String::new();
        let alive = loop {
            let mut bytes = [0; 4096];
            let length = events.read(&mut bytes).await.unwrap();
            assert_ne!(length, 0, "{text}");
            text += &String::from_utf8_lossy(&bytes[..length]);
            let alive = text
                .split("event: alive\ndata: ")
                .nth(1)
                .and_then(|it| it.split_once("\n\n"));
            if let Some((data, _)) = alive {
                break serde_json::from_str::<Value>(data).unwrap();
            }
        };
        for moment in [&session["moment"], &alive["moment"]] {
            let moment = moment.as_str().unwrap().as_bytes();
            assert_eq!(
                house
                    .control
                    .moments
                    .review(Some(moment), clock::now(), clock::now()),
                Ok(())
            );
        }
    });
}

#[test]
fn a_new_front_signs_out_anyone_who_is_not_in_it_any_more() {
    on_a_runtime(async {
        let house = house_of(&["anna", "bob", "carl"]);
        let anna = house.sign_in("anna").await;
        let bob = house.sign_in("bob").await;
        let carl = house.sign_in("carl").await;
        let mut next = settings(&["bob", "carl"]);
        next.users[1].hash = HashSource::Text(StoredHash::make("another horse", &[8; 16]).unwrap());
        house
            .control
            .change(ClientRequirements::read(&next).unwrap());
        let user = async |head: &str| {
            house.ask("GET", "/api/v1/session", head, "").await.2["user"].clone()
        };
        assert_eq!(
            (user(&anna).await, user(&bob).await, user(&carl).await),
            (Value::Null, "bob".into(), Value::Null)
        );
        house
            .control
            .change(ClientRequirements::read(&settings(&[])).unwrap());
        assert_eq!(house.ask("POST", "/api/v1/stop", &bob, "{}").await.0, 403);
    });
}

/// Both an idle connection and one that listens.
#[test]
fn a_new_list_of_networks_ends_the_connections_that_it_would_not_let_in() {
    on_a_runtime(async {
        let house = house_of(&[]);
        let mut idle = house.open("/healthz").await;
        let mut listening = house.open("/api/v1/events").await;
        let of = |network: &str| HttpSettings {
            allow: Some(vec![network.parse().unwrap()]),
            ..settings(&[])
        };
        house
            .control
            .change(ClientRequirements::read(&of("127.0.0.0/8")).unwrap());
        assert_eq!(
            house.ask("GET", "/healthz", "", "").await.0,
            200,
            "the list is in force"
        );
        again(&mut idle, "/healthz").await;
        house
            .control
            .change(ClientRequirements::read(&of("10.0.0.0/8")).unwrap());
        ends(&mut idle).await;
        ends(&mut listening).await;
        let mut refused = TcpStream::connect(house.address).await.unwrap();
        assert_eq!(
            refused.read(&mut [0; 1]).await.unwrap_or(0),
            0,
            "new ones are closed"
        );
    });
}

/// Passwords would still be sent in plain text over an earlier connection.
#[test]
fn no_connection_stays_in_plain_view_once_there_is_a_certificate() {
    let place = Dir::new();
    let own = rcgen::generate_simple_self_signed(vec!["localhost".to_owned()]).unwrap();
    let tls = HttpTls {
        cert_file: place.join("gateway.pem"),
        key_file: place.join("gateway.key"),
    };
    std::fs::write(&tls.cert_file, own.cert.pem()).unwrap();
    std::fs::write(&tls.key_file, own.signing_key.serialize_pem()).unwrap();
    on_a_runtime(async {
        let house = house_of(&["anna"]);
        let mut idle = house.open("/healthz").await;
        house.control.change(
            ClientRequirements::read(&HttpSettings {
                tls: Some(tls),
                ..settings(&["anna"])
            })
            .unwrap(),
        );
        ends(&mut idle).await;
    });
}

#[test]
fn connections_end_with_their_listener() {
    on_a_runtime(async {
        let house = house_of(&[]);
        let mut idle = house.open("/healthz").await;
        let mut listening = house.open("/api/v1/events").await;
        house.listener.abort();
        ends(&mut idle).await;
        ends(&mut listening).await;
    });
}

/// Requests one more document.
async fn again(stream: &mut TcpStream, path: &str) {
    stream
        .write_all(format!("GET {path} HTTP/1.1\r\nHost: localhost\r\n\r\n").as_bytes())
        .await
        .unwrap();
    let mut answer = String::new();
    while !answer
        .split_once("\r\n\r\n")
        .is_some_and(|(_, body)| body.ends_with('\n'))
    {
        let mut bytes = [0; 4096];
        let length = stream.read(&mut bytes).await.unwrap();
        assert_ne!(length, 0, "{answer}");
        answer += &String::from_utf8_lossy(&bytes[..length]);
    }
    assert!(answer.starts_with("HTTP/1.1 200 "), "{answer}");
}

/// Waits until a connection closes; data under way may arrive before.
async fn ends(stream: &mut TcpStream) {
    let end = async {
        let mut rest = [0; 4096];
        while stream.read(&mut rest).await.is_ok_and(|length| length > 0) {}
    };
    tokio::time::timeout(Duration::from_secs(5), end)
        .await
        .expect("the connection goes on");
}

#[test]
fn names_that_are_not_ours_are_misdirected() {
    on_a_runtime(async {
        let house = house_of(&[]);
        for (host, status) in [
            ("Host: gw.example\r\n", 200),
            ("", 200),
            ("Host: evil.example\r\n", 421),
            ("Host: localhost\r\nHost: localhost\r\n", 421),
        ] {
            let mut stream = TcpStream::connect(house.address).await.unwrap();
            let request = format!("GET /healthz HTTP/1.1\r\n{host}Connection: close\r\n\r\n");
            stream.write_all(request.as_bytes()).await.unwrap();
            let mut text = String::new();
            stream.read_to_string(&mut text).await.unwrap();
            assert!(
                text.starts_with(&format!("HTTP/1.1 {status} ")),
                "{host}: {text}"
            );
            assert!(
                text.contains("content-security-policy: default-src 'self';"),
                "{text}"
            );
        }
    });
}

/// Such a page could take all places for listeners.
#[test]
fn pages_of_other_sites_get_no_answer_that_lasts() {
    on_a_runtime(async {
        let house = house_of(&[]);
        for (mode, status) in [("no-cors", 403), ("cors", 403), ("navigate", 200)] {
            let head = format!("Sec-Fetch-Site: cross-site\r\nSec-Fetch-Mode: {mode}\r\n");
            assert_eq!(house.ask("GET", "/", &head, "").await.0, status, "{mode}");
        }
        let head = "Sec-Fetch-Site: cross-site\r\nSec-Fetch-Mode: no-cors\r\n";
        assert_eq!(house.ask("GET", "/api/v1/events", head, "").await.0, 403);
        assert_eq!(
            house
                .ask(
                    "GET",
                    "/api/v1/state",
                    "Sec-Fetch-Site: same-origin\r\n",
                    ""
                )
                .await
                .0,
            200
        );
    });
}

#[test]
fn a_full_house_has_room_for_one_more() {
    on_a_runtime(async {
        let house = house_of(&["anna"]);
        let head = house.sign_in("anna").await;
        let mut held = Vec::new();
        for _ in 0..CONNECTIONS_MAX {
            held.push(TcpStream::connect(house.address).await.unwrap());
        }
        // The last client to connect has its place.
        let last = held.pop().unwrap();
        let (status, ..) = house.ask("POST", "/api/v1/stop", &head, "{}").await;
        assert_eq!(status, 200);
        let mut first = held.swap_remove(0);
        let closed = tokio::time::timeout(Duration::from_secs(5), first.read(&mut [0; 1]))
            .await
            .unwrap();
        assert_eq!(closed.unwrap_or(0), 0, "the one that came first gave way");
        assert_eq!(house.ask_on(last, "GET", "/healthz", "", "").await.0, 200);
    });
}

#[test]
fn files_that_cannot_be_used_are_all_reported() {
    let mut wrong = settings(&["anna"]);
    wrong.users[0].hash = HashSource::File("/nonexistent/anna.hash".into());
    let cert_file = "/nonexistent/cert.pem".into();
    let key_file = "/nonexistent/key.pem".into();
    wrong.tls = Some(HttpTls {
        cert_file,
        key_file,
    });
    let error = ClientRequirements::read(&wrong).unwrap_err();
    for part in [
        "/nonexistent/anna.hash: ",
        "/nonexistent/cert.pem: ",
        "/nonexistent/key.pem: ",
    ] {
        assert!(error.contains(part), "{error}");
    }
    wrong.users[0].hash = HashSource::File(file!().into());
    wrong.tls = None;
    let error = ClientRequirements::read(&wrong).unwrap_err();
    assert!(
        error.ends_with("help: the line that `vfd-gateway password` prints"),
        "{error}"
    );
}
