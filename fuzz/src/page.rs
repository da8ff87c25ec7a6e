//! What a browser, or a client that imitates one, sends to the page: bodies, cookies, origins, host names.

use serde_json::{Value, json};
use vfd_model::domain::command::Order;
use vfd_north::north::api::{SignInBody, read_exactly};
use vfd_north::north::command_words::without_mark;
use vfd_north::north::operator::body::parse_command;
use vfd_north::north::operator::request::{is_own_page, key_text, may_be_called, session_id};

pub fn run(bytes: &[u8]) {
    bodies(bytes);
    let Ok(text) = std::str::from_utf8(bytes) else {
        return;
    };
    if let Some(id) = session_id(text) {
        assert!(
            text.to_ascii_lowercase()
                .contains(&format!("vfd_session={}", key_text(&id))),
            "{text}"
        );
    }
    if may_be_called(text, std::iter::once("gw.example")) {
        assert!(!text.contains(['/', '@', ' ', '%']), "{text}");
        assert!(is_own_page(&format!("http://{text}"), text));
    }
    if is_own_page(text, "localhost:8080") {
        assert!(
            text.to_ascii_lowercase().ends_with("://localhost:8080"),
            "{text}"
        );
    }
}

fn bodies(bytes: &[u8]) {
    let said =
        || serde_json::from_slice::<Value>(without_mark(bytes)).expect("what is taken is JSON");
    if let Ok(wish) = parse_command(bytes, None) {
        // A stop is accepted whatever accompanies it, JSON or not.
        if wish.beside.is_some() {
            assert!(
                wish.order.is_some_and(|order| order.is_stop()) && !wish.takes,
                "{bytes:?}"
            );
            return;
        }
        let said = said();
        let is_stop = said["run"]
            .as_str()
            .is_some_and(|run| run.trim().eq_ignore_ascii_case("stop"));
        assert_eq!(
            is_stop,
            wish.order == Some(Order::Stop { setpoint: None }),
            "{said}"
        );
        assert!(wish.order.is_some() || wish.takes, "{said}");
        assert!(!wish.takes || said["take"] == true, "{said}");
        assert_eq!(
            wish.order == Some(Order::Reset),
            said["reset"] == true && said["run"].is_null(),
            "{said}"
        );
    }
    if let Some(SignInBody { user, password }) = read_exactly(bytes) {
        assert_eq!(said(), json!({ "user": user, "password": password }));
    }
}
