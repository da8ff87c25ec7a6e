//! What the tools get over the socket, from a drive whose line is played by the test.

use super::own_routes;
use super::tests::{answer, on_a_runtime, state};
use crate::daemon::exchange::answers::{AnswerBox, LineNews};
use crate::daemon::exchange::inbox::LineMessage;
use crate::daemon::exchange::shared::{SharedDrive, SharedPlant};
use crate::daemon::local::{LocalSide, TOOLS_MAX};
use crate::domain::command::{CommandAnswer, Order, Outcome, Reason, Report};
use crate::domain::ids::Name;
use crate::domain::link::Interface;
use crate::domain::native::{NativeAnswer, NativeAsk, NativeOutcome};
use crate::drive::description::DriveDescription;
use crate::profile::model::{
    CodeText, Confidence, Fact, Model, ModelIdentity, ModelWatchdog, RunForm,
};
use serde_json::{Value, json};
use std::collections::BTreeMap;
use std::sync::{Arc, Mutex};
use std::time::Duration;

/// Frequency source, run source, acceleration time. Typed from the manual.
const F010: u16 = 0x0211;
const F011: u16 = 0x0212;
const F007: u16 = 0x020C;

/// The tools' side of one drive on a line of `interface`, whose model is changed by `change`.
fn side(interface: Interface, change: impl FnOnce(&mut Model)) -> Arc<LocalSide> {
    let shared = state(false).shared.get();
    let SharedDrive { description, .. } = shared.drives[0].as_ref();
    let mut model = (*description.model).clone();
    change(&mut model);
    let description = DriveDescription {
        model: Arc::new(model),
        ..description.clone()
    };
    let line = (Name::new("hall-1").unwrap(), interface);
    Arc::new(LocalSide::new(
        Arc::new(SharedPlant::new(vec![line], vec![description])),
        None,
    ))
}

/// The registers of the drive, and the orders to it. Every order is executed.
#[derive(Clone, Default)]
struct Drive {
    /// The exception with which it answers reads, if it does.
    refuses: Option<(u8, Reason)>,
    words: Arc<Mutex<BTreeMap<u16, u16>>>,
    orders: Arc<Mutex<Vec<Order>>>,
}

impl Drive {
    fn holding(words: &[(u16, u16)]) -> Self {
        Self {
            words: Arc::new(Mutex::new(words.iter().copied().collect())),
            ..Self::default()
        }
    }

    fn hear(&self, message: LineMessage) -> LineNews {
        match message {
            LineMessage::Native(request) => {
                let NativeAsk::Read { address, count: 1 } = request.ask else {
                    panic!("{request:?}")
                };
                let held = self.words.lock().unwrap().get(&address.number()).copied();
                let outcome = match (self.refuses, held) {
                    (Some((code, reason)), _) => NativeOutcome::DriveException { code, reason },
                    (None, held) => held.map_or(NativeOutcome::NoReply, |word| {
                        NativeOutcome::Words(vec![word].into())
                    }),
                };
                LineNews::Native(NativeAnswer {
                    asker: request.asker,
                    ticket: request.ticket,
                    outcome,
                })
            }
            LineMessage::Command(command) => {
                if let Order::Setup(addresses) = &command.order {
                    self.words
                        .lock()
                        .unwrap()
                        .extend(addresses.iter().map(|address| (address.number(), 3)));
                }
                self.orders.lock().unwrap().push(command.order);
                let report = Report::new(Outcome::Confirmed, Reason::None);
                let asker = command.asker;
                let ticket = command.ticket;
                let drive = command.drive;
                LineNews::Command(CommandAnswer {
                    asker,
                    ticket,
                    drive,
                    report,
                    is_final: true,
                })
            }
            other => panic!("{other:?}"),
        }
    }

    /// Answers on the line of `side` until the test is over.
    fn play(&self, side: &Arc<LocalSide>) {
        let answers = Arc::<AnswerBox>::default();
        let drive = self.clone();
        let side = Arc::clone(side);
        tokio::task::spawn_local(Arc::clone(&side).distribute(Arc::clone(&answers)));
        tokio::task::spawn_local(async move {
            let mut batch = Vec::new();
            loop {
                side.shared().lines[0].inbox.take(&mut batch);
                answers.put(&mut batch.drain(..).map(|message| drive.hear(message)).collect());
                tokio::time::sleep(Duration::from_millis(1)).await;
            }
        });
    }
}

/// Sends a request over a connection of its own, and returns the status with the JSON.
pub(super) async fn ask(
    side: &Arc<LocalSide>,
    method: &str,
    path: &str,
    body: &str,
) -> (u16, Value) {
    let (client, server) = tokio::io::duplex(64 * 1024);
    let router = own_routes::router(Arc::clone(side));
    tokio::task::spawn_local(super::connections::converse(
        server,
        router,
        super::ConnectionPatience::default(),
        super::lasting::places(),
    ));
    let (status, text) = answer(client, method, path, body).await;
    (status, serde_json::from_str(&text).unwrap_or(Value::Null))
}

const PATH: &str = "/api/v1/drives/pump-1/setup";

fn look_at(side: &Arc<LocalSide>, drive: &Drive) -> Value {
    on_a_runtime(async {
        drive.play(side);
        let (status, setup) = ask(side, "GET", PATH, "").await;
        assert_eq!(status, 200, "{setup}");
        setup
    })
}

/// `what` and `result` of all items.
fn results(setup: &Value) -> Vec<(&str, &str)> {
    let items = setup["items"].as_array().unwrap();
    items
        .iter()
        .map(|item| {
            (
                item["what"].as_str().unwrap(),
                item["result"].as_str().unwrap(),
            )
        })
        .collect()
}

#[test]
fn each_register_is_read_and_judged() {
    let side = side(Interface::Rs485, |_| {});
    let setup = look_at(&side, &Drive::holding(&[(F010, 3), (F011, 2)]));
    let (at_the_drive, judged): (Vec<_>, Vec<_>) = results(&setup)
        .into_iter()
        .partition(|(_, result)| *result == "at_the_drive");
    assert_eq!(judged, [("F010", "right"), ("F011", "wrong")]);
    let at_the_drive: Vec<_> = at_the_drive.into_iter().map(|(what, _)| what).collect();
    assert_eq!(
        at_the_drive,
        ["SW2", "JP2", "b038", "b039", "b040", "b041", "b042", "b037"],
        "b037 locks the panel"
    );
    let wrong = &setup["items"][8];
    assert_eq!(
        wrong["found"],
        json!({ "raw": 2, "text": "operator panel" })
    );
    assert_eq!(
        wrong["wanted"],
        json!([{ "raw": 3, "text": "communication" }])
    );
    assert_eq!(
        (&setup["right"], &setup["watchdog"], &wrong["address"]),
        (&json!(false), &Value::Null, &json!(F011))
    );
    let setup = look_at(&side, &Drive::holding(&[(F010, 3), (F011, 3)]));
    assert_eq!(
        setup["right"], true,
        "what is set at the drive itself is never wrong: {setup}"
    );
}

#[test]
fn what_is_not_answered_is_not_right() {
    let setup = look_at(
        &side(Interface::Rs485, |_| {}),
        &Drive::holding(&[(F010, 3)]),
    );
    assert_eq!(results(&setup)[8], ("F011", "not_answered"));
    assert_eq!(
        (&setup["items"][8]["reason"], &setup["right"]),
        (&json!("no_reply"), &json!(false))
    );
}

#[test]
fn an_exception_is_told_in_the_vendors_words() {
    let side = side(Interface::Rs485, |model| {
        let text = "parameters are locked by password".to_owned();
        model.exceptions.push(CodeText {
            code: 7,
            text,
            confidence: Confidence::Manual,
            source: "test".to_owned(),
        });
    });
    let drive = Drive {
        refuses: Some((7, Reason::DriveLocked)),
        ..Drive::default()
    };
    let message =
        "the drive answered that it is locked against this: parameters are locked by password";
    let item = look_at(&side, &drive)["items"][8].clone();
    assert_eq!(
        (&item["reason"], &item["message"], &item["exception"]),
        (&json!("drive_locked"), &json!(message), &json!(7))
    );
    on_a_runtime(async {
        drive.play(&side);
        let path = format!("/api/v1/drives/pump-1/params/{F007}");
        let (_, seen) = ask(&side, "GET", &path, "").await;
        assert_eq!(
            (&seen["reason"], &seen["message"]),
            (&json!("drive_locked"), &json!(message)),
            "{seen}"
        );
        let (_, refused) = ask(&side, "POST", &path, r#"{"raw": 5}"#).await;
        assert_eq!(
            (&refused["reason"], &refused["message"]),
            (&json!("drive_locked"), &json!(message)),
            "{refused}"
        );
    });
}

#[test]
fn an_item_of_the_other_interface_is_left_out() {
    let setup = look_at(
        &side(Interface::Rs232, |_| {}),
        &Drive::holding(&[(F010, 3), (F011, 3)]),
    );
    let texts: Vec<_> = setup["items"]
        .as_array()
        .unwrap()
        .iter()
        .map(|item| item["text"].to_string())
        .collect();
    assert!(
        texts.iter().any(|text| text.contains("4, RS232")),
        "{texts:?}"
    );
    assert!(
        !texts.iter().any(|text| text.contains("RS485")),
        "{texts:?}"
    );
}

fn watched(model: &mut Model) {
    let off = Fact {
        value: 0,
        confidence: Confidence::Manual,
        source: "test".to_owned(),
    };
    model.watchdog = Some(ModelWatchdog {
        time: (F007).into(),
        off,
        action: Some((F010).into()),
        action_digit: None,
        keeps_running: Vec::new(),
        stops: vec![0, 1, 2, 3],
    });
}

#[test]
fn the_drives_own_watchdog_is_read() {
    let side = side(Interface::Rs485, watched);
    let sources = [(F010, 3), (F011, 3)];
    let setup = look_at(
        &side,
        &Drive::holding(&[&sources[..], &[(F007, 0)]].concat()),
    );
    assert_eq!(
        (&setup["watchdog"]["state"], &setup["right"]),
        (&json!("off"), &json!(true)),
        "{setup}"
    );
    let setup = look_at(
        &side,
        &Drive::holding(&[&sources[..], &[(F007, 25)]].concat()),
    );
    let watchdog = &setup["watchdog"];
    assert_eq!(
        (&watchdog["state"], &watchdog["what"]),
        (&json!("on"), &json!("F007"))
    );
    assert_eq!(watchdog["found"], json!({ "raw": 25, "text": "2.5 s" }));
    assert_eq!(
        watchdog["action"],
        json!({ "raw": 3, "text": "communication" })
    );
    let setup = look_at(&side, &Drive::holding(&sources));
    assert_eq!(
        (&setup["watchdog"]["state"], &setup["right"]),
        (&json!("not_answered"), &json!(false)),
        "{setup}"
    );
}

/// The upper byte of F007 tells which drive it is.
fn identified(model: &mut Model) {
    let values = Fact {
        value: vec![0x0100],
        confidence: Confidence::Manual,
        source: "test".to_owned(),
    };
    let others = vec![(0x0200, "Acme 2".to_owned())];
    model.identity = Some(ModelIdentity {
        address: (F007).into(),
        mask: 0xFF00,
        values,
        others,
    });
}

#[test]
fn the_drive_that_answers_is_the_one_that_is_named_or_wrong() {
    let side = side(Interface::Rs485, identified);
    let sources = [(F010, 3), (F011, 3)];
    let seen = |word: Option<u16>| {
        let held: Vec<_> = sources
            .into_iter()
            .chain(word.map(|word| (F007, word)))
            .collect();
        let setup = look_at(&side, &Drive::holding(&held));
        let identity = &setup["identity"];
        (
            identity["result"].clone(),
            identity["other"].clone(),
            setup["right"].clone(),
        )
    };
    assert_eq!(
        seen(Some(0x0117)),
        (json!("right"), Value::Null, json!(true))
    );
    assert_eq!(
        seen(Some(0x0217)),
        (json!("wrong"), json!("Acme 2"), json!(false))
    );
    assert_eq!(
        seen(Some(0x0317)),
        (json!("wrong"), Value::Null, json!(false))
    );
    assert_eq!(
        seen(None),
        (json!("not_answered"), Value::Null, json!(false))
    );
    let setup = look_at(&side, &Drive::holding(&[(F007, 0x0117)]));
    let identity = &setup["identity"];
    assert_eq!(
        (&identity["what"], &identity["mask"]),
        (&json!("F007"), &json!(0xFF00)),
        "{setup}"
    );
    assert_eq!(
        (&identity["wanted"], &identity["found"]["raw"]),
        (&json!([0x0100]), &json!(0x0117)),
        "{setup}"
    );
    let none = look_at(
        &self::side(Interface::Rs485, |_| {}),
        &Drive::holding(&sources),
    );
    assert_eq!(
        (&none["identity"], &none["right"]),
        (&Value::Null, &json!(true))
    );
}

#[test]
fn a_drive_that_the_bus_overrules_says_so() {
    let drive = Drive::holding(&[(F010, 3), (F011, 3)]);
    assert_eq!(
        look_at(&side(Interface::Rs485, |_| {}), &drive)["takes_priority"],
        false
    );
    let with = |priority| {
        side(Interface::Rs485, move |model| {
            model.run.as_mut().unwrap().form = RunForm::Bits {
                bits: Vec::new(),
                fields: Vec::new(),
                priority,
            };
        })
    };
    assert_eq!(look_at(&with(0), &drive)["takes_priority"], false);
    assert_eq!(look_at(&with(0x8000), &drive)["takes_priority"], true);
}

#[test]
fn exactly_what_is_named_is_ordered_and_reported_with_old_and_new() {
    let side = side(Interface::Rs485, |_| {});
    let drive = Drive::holding(&[(F010, 3), (F011, 2)]);
    let (status, answer) = on_a_runtime(async {
        drive.play(&side);
        ask(
            &side,
            "POST",
            PATH,
            &json!({ "addresses": [F011] }).to_string(),
        )
        .await
    });
    assert_eq!(
        (status, &answer["outcome"]),
        (200, &json!("confirmed")),
        "{answer}"
    );
    assert_eq!(
        answer["changes"],
        json!([{ "what": "F011", "address": F011, "old": 2, "new": 3 }])
    );
    assert_eq!(
        *drive.orders.lock().unwrap(),
        [Order::Setup(vec![(F011).into()])]
    );
}

#[test]
fn what_the_model_does_not_ask_to_be_set_is_never_ordered() {
    let side = side(Interface::Rs485, |_| {});
    let drive = Drive::holding(&[(F010, 2)]);
    on_a_runtime(async {
        drive.play(&side);
        let body = json!({ "addresses": [F010, F007] }).to_string();
        let (status, answer) = ask(&side, "POST", PATH, &body).await;
        assert_eq!(
            (status, &answer["reason"]),
            (200, &json!("not_capable")),
            "{answer}"
        );
        let (status, answer) = ask(&side, "POST", PATH, "529").await;
        assert_eq!(
            (status, &answer["reason"]),
            (400, &json!("not_understood")),
            "{answer}"
        );
        assert_eq!(ask(&side, "POST", PATH, &" ".repeat(5000)).await.0, 413);
        assert_eq!(ask(&side, "DELETE", PATH, "").await.0, 405);
    });
    assert_eq!(*drive.orders.lock().unwrap(), []);
}

#[test]
fn an_unknown_drive_is_reported_with_the_known_ones() {
    let side = side(Interface::Rs485, |_| {});
    on_a_runtime(async {
        for (method, body) in [("GET", ""), ("POST", r#"{"addresses": [529]}"#)] {
            let (status, answer) = ask(&side, method, "/api/v1/drives/pump-2/setup", body).await;
            assert_eq!(
                (status, &answer["reason"]),
                (404, &json!("unknown_drive")),
                "{answer}"
            );
            assert_eq!(answer["drives"], json!(["pump-1"]));
        }
    });
}

#[test]
fn no_more_than_a_few_are_served_at_once() {
    let side = side(Interface::Rs485, |_| {});
    let _held: Vec<_> = (0..TOOLS_MAX).map(|_| side.place().unwrap()).collect();
    on_a_runtime(async {
        for (method, body) in [("GET", ""), ("POST", r#"{"addresses": [529]}"#)] {
            let (status, answer) = ask(&side, method, PATH, body).await;
            assert_eq!(
                (status, &answer["reason"]),
                (503, &json!("queue_full")),
                "{answer}"
            );
        }
    });
}
