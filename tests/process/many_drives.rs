//! The page with many drives, in a real browser: no stop moves, problems come first, and drives are found.

use super::chromium::{Browser, Window};
use super::looking::{CARD, PASSWORD, Shop, browser_at, in_card, run, sign_in};
use super::mosquitto::free_port;
use super::rig::{Place, program};
use super::started::{PATIENCE, Started, until};
use serde_json::Value;
use std::fmt::Write as _;
use std::io::{Read, Write};
use std::net::{Ipv4Addr, SocketAddr, TcpStream};
use std::path::Path;
use std::time::{Duration, Instant};

/// Beside the real one.
const DRIVES: usize = 8;
/// A row that is higher needs more of a phone than it is worth, in CSS pixels.
const ROW_MAX: f64 = 72.0;

/// A page of one real drive, with many more that are drawn by the page's own code.
fn crowd(shop: &Shop) -> Browser {
    let browser = shop.browser();
    sign_in(&browser, PASSWORD);
    browser.wait("document.querySelector('#drive-pump-1 .stop').checkVisibility()");
    crowded(&browser);
    browser
}

/// Fills the page of a signed-in user.
pub fn crowded(browser: &Browser) {
    browser.wait("document.querySelector('#drive-pump-1').dataset.state === 'stopped'");
    let script = include_str!("crowd.js");
    browser.script(&format!(
        "return (async () => {{ {script}\n crowd({DRIVES}); return true; }})()"
    ));
}

fn resize(browser: &Browser, window: Window) {
    browser.resize(window);
    browser.wait(&format!("innerWidth === {}", window.width));
    browser.script("scrollTo(0, 0)");
}

fn assert_no_stop_moves(browser: &Browser, layout: &str, stops_wanted: usize) {
    let result = browser.script(&format!("return window.crowd.moved({DRIVES})"));
    let stops: Vec<_> = result["stops"]
        .as_array()
        .unwrap()
        .iter()
        .map(|it| it.as_str().unwrap())
        .collect();
    assert_eq!(stops.len(), stops_wanted, "{layout}: {stops:?}");
    assert_eq!(result["moved"], serde_json::json!([]), "{layout}");
    println!(
        "{layout}: {} stops stay through {} states",
        stops.len(),
        result["states"]
    );
}

#[test]
fn no_stop_moves_whatever_the_drives_and_the_advice_do() {
    let shop = Shop::open(true);
    assert_no_stop_moves_in_any_layout(&crowd(&shop));
}

/// For a desktop, in the language of the page.
pub fn assert_no_stop_moves_in_any_layout(browser: &Browser) {
    // One for each drive, and the one for all.
    let all = DRIVES + 2;
    assert_no_stop_moves(browser, "cards on a desktop", all);
    let open = "document.querySelectorAll('.drive .opener').forEach((it) => it.click())";
    browser.script(open);
    browser.wait("document.querySelector('#drive-d-1 .controls').checkVisibility()");
    browser.wait("document.querySelector('#drive-d-1 .values').checkVisibility()");
    assert_no_stop_moves(browser, "cards with all of them open", all);
    browser.script(open);
    browser.click("#layout button");
    browser.wait("document.querySelector('#drives.rows') !== null");
    assert_no_stop_moves(browser, "rows on a desktop", all);
    for window in [Window::PHONE, Window::NARROW] {
        resize(browser, window);
        assert_no_stop_moves(browser, "rows on a phone", all);
        browser.click("#drive-d-1 a.open");
        browser.wait("document.querySelector('#drive-d-1.whole') !== null");
        assert_no_stop_moves(browser, "an open drive on a phone", all);
        browser.key("\u{E00C}", 0);
        browser.wait("document.querySelector('.whole') === null");
    }
    assert_eq!(browser.complaints(), Vec::<String>::new());
}

#[test]
fn on_a_phone_each_drive_is_a_row_that_opens_with_its_stop_at_the_thumb() {
    let shop = Shop::open(true);
    let browser = crowd(&shop);
    resize(&browser, Window::PHONE);
    let rows = browser.script(
        "return [...document.querySelectorAll('.drive')].map((row) => ({ height: row.getBoundingClientRect().height, \
         seen: ['.state', '.output', '.stop'].every((css) => row.querySelector(css).checkVisibility()) }))",
    );
    for row in rows.as_array().unwrap() {
        assert!(
            row["height"].as_f64().unwrap() < ROW_MAX && row["seen"] == true,
            "{row}"
        );
    }
    let sent = "return performance.getEntriesByType('resource').filter((it) => it.name.includes('/command')).length";
    browser.click(&in_card("a.open"));
    browser.wait(&format!("document.querySelector('{CARD}.whole') !== null"));
    browser.wait_for_text(&in_card(".age"), "values up to");
    let middle = "const { top, height } = document.querySelector('#drive-pump-1 .stop').getBoundingClientRect(); \
                  return (top + height / 2) / innerHeight";
    let middle = browser.script(middle).as_f64().unwrap();
    assert!((0.8..1.0).contains(&middle), "{middle}");
    let covers = "const { left, top, width, height } = document.querySelector('#drive-pump-1').getBoundingClientRect(); \
                  return [left, top, width - innerWidth, height - innerHeight]";
    assert_eq!(browser.script(covers), serde_json::json!([0, 0, 0, 0]));
    browser.key("\u{E00C}", 0);
    browser.wait("document.querySelector('.whole') === null");
    assert_eq!(browser.script(sent), 0, "Escape sends nothing");
    assert_eq!(
        browser.script("return document.activeElement.textContent"),
        "pump-1"
    );
}

#[test]
fn drives_are_found_by_state_line_group_and_name() {
    let shop = Shop::open(true);
    let browser = crowd(&shop);
    let seen = || -> Vec<String> {
        let names = browser.script(
            "return [...document.querySelectorAll('.drive')].filter((it) => it.checkVisibility()).map((it) => it.id.slice(6))",
        );
        names
            .as_array()
            .unwrap()
            .iter()
            .map(|name| name.as_str().unwrap().to_owned())
            .collect()
    };
    assert_eq!(seen().len(), DRIVES + 1);
    browser.fill("#filter input", "D-3");
    assert_eq!(seen(), ["d-3"]);
    browser.script(
        "const input = document.querySelector('#filter input'); input.value = ''; input.dispatchEvent(new Event('input'))",
    );
    let choose = |value: &str| {
        browser.script(&format!(
            "const part = document.querySelector('#filter select'); part.value = {value:?}; \
             part.dispatchEvent(new Event('change'))"
        ));
    };
    choose("line:hall-2");
    assert_eq!(seen(), ["d-2", "d-4", "d-6", "d-8"]);
    choose("group:water");
    assert_eq!(seen(), ["d-1", "d-4", "d-7"]);
    choose("");
    browser.script(
        "window.crowd.drives.update([window.crowd.in_state('d-5', 'tripped')]); \
         const { drives } = window.crowd; return import('/assets/filter.js').then((it) => it.count(drives.all()))",
    );
    browser.click("#counts [data-state='tripped']");
    assert_eq!(seen(), ["d-5"]);
    browser.click("#counts [data-state='tripped']");
    browser.script(
        "const order = document.querySelector('#layout select'); order.value = 'state'; \
         order.dispatchEvent(new Event('change'))",
    );
    assert_eq!(seen()[0], "d-5", "the worst is the first");
    browser.script("window.crowd.drives.update([window.crowd.in_state('d-6', 'tripped')])");
    assert_ne!(seen()[1], "d-6", "none moves by itself");
}

#[test]
fn problems_come_first_in_one_row_for_equal_ones_and_in_the_title() {
    let mut shop = Shop::open(true);
    let browser = crowd(&shop);
    browser.wait("document.title === 'shop · VFD gateway'");
    browser.script(
        "window.crowd.problems.advise(['d-1', 'd-2', 'd-3', 'd-4', 'd-5'].map((drive) => ({ severity: 'hint', sign: 'watchdog', \
         line: 'hall-1', drive, text: 'its watchdog is off; `vfd-gateway enable ' + drive + '`' })))",
    );
    let rows = browser.script("return document.querySelectorAll('#advice .advice li').length");
    assert_eq!(rows, 1);
    let row = browser.text("#advice .advice li");
    assert!(row.contains("d-1, d-2, d-3, d-4 and 1 more"), "{row}");
    shop.drive.type_line("");
    browser.wait_for_text(&in_card(".state"), "TRIPPED");
    browser.wait("document.title.startsWith('(1!) shop')");
    browser.wait("document.getElementById('icon').href.endsWith('icon-problem.svg')");
    let first: Value = browser
        .script("return document.querySelector('#advice .advice li a').getAttribute('href')");
    assert_eq!(first, "#drive-pump-1");
}

/// How much of a window may be coloured while all drives stand, and beside the one that has tripped.
const CALM_MAX: f64 = 0.01;
const BESIDE_MAX: f64 = 0.001;

#[test]
fn of_128_drives_that_stand_none_has_a_colour_and_one_that_trips_has() {
    let shop = Shop::open(true);
    let browser = crowd(&shop);
    browser.script("window.crowd.crowd(127)");
    let desktop = Window::DESKTOP;
    for window in [desktop, desktop.dark()] {
        resize(&browser, window);
        // On a busy machine a value of the real drive may be stale for a moment.
        let (calm, calm_beside) = until("nothing has a colour", PATIENCE, || {
            browser.wait("document.querySelectorAll('.drive.stands').length === 128");
            browser.wait("document.body.classList.contains('all-stand')");
            Some(browser.saturated("#drive-d-3")).filter(|(calm, _)| *calm < CALM_MAX)
        });
        browser.script("window.crowd.drives.update([window.crowd.in_state('d-3', 'tripped')])");
        let (all, beside) = browser.saturated("#drive-d-3");
        println!(
            "of all pixels {calm:.5} are saturated, with a trip {all:.5}, {beside:.5} of them beside it"
        );
        assert!(beside < calm_beside + BESIDE_MAX, "{beside} {calm_beside}");
        assert!(all > 2.0 * calm, "{all} {calm}");
        browser.script("window.crowd.drives.update([window.crowd.in_state('d-3', 'stopped')])");
    }
}

#[test]
fn stop_is_filled_unless_the_motor_is_known_to_stand() {
    let shop = Shop::open(true);
    let browser = crowd(&shop);
    let outlined = |state: &str| {
        browser.script(&format!(
            "window.crowd.drives.update([window.crowd.in_state('d-1', {state:?})]); \
             const stop = getComputedStyle(document.querySelector('#drive-d-1 .stop')); \
             return stop.backgroundColor !== stop.borderTopColor"
        ))
    };
    for state in ["stopped", "tripped", "inhibited", "tripped before"] {
        until("the motor has shown rest for long", PATIENCE, || {
            (outlined(state) == true).then_some(())
        });
    }
    for state in [
        "running",
        "running in reverse",
        "stopping",
        "pending",
        "not effective",
        "warned",
        "offline",
        "unknown",
    ] {
        assert_eq!(outlined(state), false, "{state}");
    }
    // What is old says nothing of now.
    let old = "const drive = window.crowd.in_state('d-1', 'stopped'); drive.values = drive.values.map((it) => ({ ...it, \
               quality: 'stale' })); window.crowd.drives.update([drive]); const lost = [...document.querySelectorAll('.stands')]; \
               window.crowd.drives.redraw(false); \
               return [lost.some((it) => it.id === 'drive-d-1'), document.querySelectorAll('.stands').length]";
    assert_eq!(browser.script(old), serde_json::json!([false, 0]));
}

/// Gives the page what [`barriers`] needs.
pub fn load_axe(browser: &Browser) {
    let axe = Path::new(env!("CARGO_MANIFEST_DIR"))
        .join("tests/process/npm/node_modules/axe-core/axe.min.js");
    browser.script(&std::fs::read_to_string(axe).expect("axe-core, which tests/run installs"));
}

/// What axe finds: barriers for people who do not see or do not point.
pub fn barriers(browser: &Browser) -> Value {
    let run = "return axe.run(document, { resultTypes: ['violations'] }).then((it) => it.violations.map((one) => \
               `${one.id}: ${one.nodes.map((node) => node.html).slice(0, 3).join(' | ')}`))";
    browser.script(run)
}

#[test]
fn axe_finds_no_barrier_in_any_state_layout_and_scheme_of_colours() {
    let shop = Shop::open(true);
    assert_no_barrier_in_any_state(&crowd(&shop));
}

/// In each layout, in the language of the page. What a phone shows is as wide as the phone.
pub fn assert_no_barrier_in_any_state(browser: &Browser) {
    load_axe(browser);
    resize(browser, Window::DESKTOP);
    browser.script("if (document.querySelector('#drives.rows')) document.querySelector('#layout button').click()");
    browser.script(
        "const states = ['running', 'stopping', 'inhibited', 'pending', 'not effective', 'tripped', 'warned', 'offline']; \
         window.crowd.drives.update(states.map((state, index) => window.crowd.in_state(`d-${index + 1}`, state)))",
    );
    let desktop = Window::DESKTOP;
    for window in [desktop, desktop.dark(), Window::PHONE, Window::PHONE.dark()] {
        resize(browser, window);
        for panel in ["trend", "journal", "traffic", "report"] {
            browser.click(&format!("#tab-{panel}"));
            browser.wait(&format!(
                "document.getElementById('{panel}').checkVisibility()"
            ));
            assert_eq!(
                barriers(browser),
                serde_json::json!([]),
                "{panel}, {} wide",
                window.width
            );
            browser.wait(
                "document.documentElement.scrollWidth === document.documentElement.clientWidth",
            );
        }
    }
    browser.click("#drive-d-6 a.open");
    browser.wait("document.querySelector('#drive-d-6.whole') !== null");
    assert_eq!(barriers(browser), serde_json::json!([]), "an open drive");
    browser.key("\u{E00C}", 0);
    resize(browser, desktop);
    browser.click("#layout button");
    assert_eq!(
        barriers(browser),
        serde_json::json!([]),
        "rows on a desktop"
    );
}

/// How long the page of the large plant is watched.
const WATCHED: Duration = Duration::from_secs(20);
const LARGE: (usize, usize) = (8, 16);

/// Lines of simulated drives, all idle.
fn large_plant(place: &Place) -> (Vec<Started>, String) {
    let (lines, drives) = LARGE;
    let mut text = String::from("[gateway]\nname = \"works\"\n");
    let mut played = Vec::new();
    for line in 1..=lines {
        let port = place.file(&format!("line-{line}"));
        let mut simulate = program();
        simulate
            .args([
                "simulate",
                "--model",
                "frecon-fr500a",
                "--baud",
                "38400",
                "--link",
            ])
            .arg(&port);
        (1..=drives).for_each(|station| {
            simulate.args(["--station", &station.to_string()]);
        });
        let started = Started::new(simulate);
        started.wait_for("that it plays", |said| {
            said.contains("stations 1,").then_some(())
        });
        played.push(started);
        write!(
            text,
            "\n[[line]]\nname = \"hall-{line}\"\nport = \"{}\"\nbaud = 38400\nstop_bits = 2\n",
            port.display()
        )
        .unwrap();
        for station in 1..=drives {
            write!(
                text,
                "\n[[line.drive]]\nname = \"d-{line}-{station}\"\nmodel = \"frecon-fr500a\"\nstation = {station}\npoll = \"1s\"\n"
            )
            .unwrap();
        }
    }
    (played, text)
}

#[test]
#[ignore = "it measures for a while, and needs a quiet machine"]
fn the_cost_of_a_page_of_128_idle_drives() {
    let place = Place::new();
    let (_played, text) = large_plant(&place);
    let http = SocketAddr::from((Ipv4Addr::LOCALHOST, free_port()));
    let file = place.write(
        "gateway.toml",
        &format!("{text}\n[http]\nlisten = \"{http}\"\n"),
    );
    let _gateway = run(&file);
    let browser = browser_at(http);
    browser.wait("document.querySelectorAll('.drive[data-state=stopped]').length === 128");
    for view in ["rows", "cards"] {
        browser.script(&format!(
            "localStorage.setItem('vfd-gateway-layout', '{view}')"
        ));
        browser.reload();
        browser.wait("document.querySelectorAll('.drive[data-state=stopped]').length === 128");
        let busy = || browser.metric("TaskDuration");
        let (busy_s, begun) = (busy(), Instant::now());
        let bytes = event_bytes(http, WATCHED);
        let share = (busy() - busy_s) / begun.elapsed().as_secs_f64() * 100.0;
        println!(
            "{view}: the tab needs {share:.1} % of a core, the stream {:.1} kB/s",
            bytes / 1000.0
        );
    }
}

/// Bytes per second of the event stream after the state with which it begins.
fn event_bytes(http: SocketAddr, within: Duration) -> f64 {
    let mut stream = TcpStream::connect(http).unwrap();
    write!(
        stream,
        "GET /api/v1/events HTTP/1.1\r\nHost: {http}\r\n\r\n"
    )
    .unwrap();
    let mut buffer = vec![0; 1 << 20];
    let begun = Instant::now();
    let (mut first, mut bytes) = (None, 0);
    while begun.elapsed() < within {
        let read = stream.read(&mut buffer).unwrap();
        // The state is over when the first heartbeat has come.
        if first.is_none() && buffer[..read].windows(12).any(|it| it == b"event: alive") {
            first = Some(Instant::now());
        } else if first.is_some() {
            bytes += read;
        }
    }
    bytes as f64 / first.expect("a heartbeat").elapsed().as_secs_f64()
}
