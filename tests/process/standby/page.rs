//! A person hands a line over from the page, in a real browser.

use super::super::chromium::{Browser, Window};
use super::super::languages::choose;
use super::super::looking::{PASSWORD, assert_nothing_sticks_out, browser_at, sign_in};
use super::super::mosquitto::{Mosquitto, free_port};
use super::super::page_control::hash;
use super::super::rig::{Place, assert_says, vfd_gateway};
use super::A_WHILE;
use super::pair::{A, B, Pair};
use std::net::{Ipv4Addr, SocketAddr};

const BUTTON: &str = "#line-hall-1 .yield button";
const RESULT: &str = "#line-hall-1 .yield .result";
const MISSING: &str = "das andere Gateway des Paars fehlt";
const STATE: &str = "#line-hall-1 .state";

/// A pair at `broker` with a page on each half, for anna who maintains and bob who operates. `a` is active and runs both
/// drives.
fn pair(broker: &Mosquitto) -> (Pair, [SocketAddr; 2]) {
    let mut pair = Pair::new(9_600);
    let pages = [(); 2].map(|()| SocketAddr::from((Ipv4Addr::LOCALHOST, free_port())));
    for (half, page) in pair.halves.iter().zip(pages) {
        let text = std::fs::read_to_string(&half.file).unwrap();
        let text = text.replace(
            "from = [\"modbus-tcp\"]",
            "from = [\"modbus-tcp\", \"page\"]",
        );
        let user = |name: &str, role: &str| {
            format!(
                "\n[[http.users]]\nname = \"{name}\"\nrole = \"{role}\"\npassword_hash = \"{}\"\n",
                hash()
            )
        };
        let users = user("anna", "maintain") + &user("bob", "operate");
        let mqtt = format!("\n[mqtt]\nbroker = \"mqtt://{}\"\n", broker.address());
        std::fs::write(
            &half.file,
            format!("{text}{mqtt}\n[http]\nlisten = \"{page}\"\n{users}"),
        )
        .unwrap();
    }
    pair.start_one_behind_the_other();
    pair.run(A, 1);
    pair.run(A, 2);
    (pair, pages)
}

/// anna, signed in at a page.
fn anna(page: SocketAddr) -> Browser {
    let browser = browser_at(page);
    sign_in(&browser, PASSWORD);
    browser.wait_for_text(".session .who", "anna");
    browser
}

fn assert_is_active(pair: &Pair, end: usize) {
    let health = vfd_gateway(&[
        "health",
        "--active",
        "-c",
        pair.half(end).file.to_str().unwrap(),
    ]);
    assert_says(&health, 0, &["active on hall-1"]);
}

#[test]
fn who_maintains_hands_a_line_over_from_the_page_and_no_motor_stops() {
    let place = Place::new();
    let broker = Mosquitto::start(&place.file(""));
    let (mut pair, [at_a, at_b]) = pair(&broker);
    let bob = browser_at(at_a);
    bob.wait_for_text(STATE, "active");
    assert!(!bob.is_seen(BUTTON), "no user is signed in");
    bob.click("[aria-controls='sign-in']");
    bob.fill("#sign-in [name='user']", "bob");
    bob.fill("#sign-in [name='password']", PASSWORD);
    bob.click("#sign-in [name='go']");
    bob.wait("document.querySelector('#drive-pump-1 .stop').checkVisibility()");
    assert!(!bob.is_seen(BUTTON), "one who operates does not hand over");
    // There is one browser at a time.
    drop(bob);

    let browser = anna(at_a);
    browser.wait(&format!(
        "document.querySelector('{BUTTON}').checkVisibility()"
    ));
    browser.wait_for_text(BUTTON, "Hand over to b");
    let title = browser.script(&format!("return document.querySelector('{BUTTON}').title"));
    assert!(
        title
            .as_str()
            .unwrap()
            .contains("Nothing changes unless b answers."),
        "{title}"
    );
    browser.click(BUTTON);
    browser.wait_for_text(BUTTON, "Again: Hand over to b");
    assert_is_active(&pair, A);
    let seen = pair.hub.count();
    browser.hold(BUTTON);
    browser.wait_for_text(RESULT, "handed over: another gateway sends here now");
    browser.wait_for_text(STATE, "listening");
    browser.wait(&format!(
        "!document.querySelector('{BUTTON}').checkVisibility()"
    ));
    assert_is_active(&pair, B);
    pair.wait_for_requests(B, A_WHILE, seen);
    let writes: Vec<_> = pair
        .orders(seen)
        .into_iter()
        .filter(|order| (1..=2).contains(&order.1))
        .collect();
    assert_eq!(writes, [], "no motor is ordered anything");
    pair.assert_turns(1);
    pair.assert_turns(2);
    assert_eq!(browser.complaints(), Vec::<String>::new());
    drop(browser);

    // The other one is gone, and a reader of German is told so.
    let browser = anna(at_b);
    choose(&browser, "de");
    browser.wait_for_text(BUTTON, "An a übergeben");
    browser.wait(&format!("!document.body.textContent.includes('{MISSING}')"));
    pair.kill(A);
    browser.wait_for_text("#advice", MISSING);
    browser.hold(BUTTON);
    browser.wait_for_text(RESULT, "kein anderes Gateway antwortet: nichts geändert");
    browser.wait(&format!(
        "document.querySelector('{BUTTON}').checkVisibility()"
    ));
    browser.resize(Window::PHONE);
    assert_nothing_sticks_out(&browser);
    assert_is_active(&pair, B);
    pair.assert_one_master();
}
