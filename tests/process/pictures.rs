//! The pictures of the page in the documents, made from the demo:
//! `cargo test --test process pictures -- --ignored` writes them to `docs/`.

use super::chromium::{Browser, Window};
use super::demo::Demo;
use super::languages::choose;
use super::looking::{PASSWORD, Shop, sign_in};
use super::started::{PATIENCE, until};
use std::path::Path;

/// Largest picture that is kept, in bytes.
const BYTES_MAX: usize = 200_000;

/// As much of a desktop as stays small.
const DESKTOP: Window = Window {
    height: 720,
    ..Window::DESKTOP
};

#[test]
#[ignore = "it writes into docs/"]
fn pictures_of_the_page_for_the_readme() {
    let mut demo = Demo::new();
    let browser = Browser::start();
    browser.resize(DESKTOP);
    browser.open(&demo.page);
    browser.wait("document.body.dataset.connection === 'live'");
    browser.click("[aria-controls='sign-in']");
    browser.fill("#sign-in [name='user']", "demo");
    browser.fill("#sign-in [name='password']", "demo-demo");
    browser.click("#sign-in [name='go']");
    browser.wait("document.querySelector('.drive .stop').checkVisibility()");
    for (drive, hertz, label) in [
        ("fan-2", "42.5", "Forward"),
        ("mixer-3", "18", "Reverse"),
        ("belt-4", "30", "Forward"),
    ] {
        let card = format!("#drive-{drive}");
        browser.click(&format!("{card} .opener"));
        browser.fill(&format!("{card} input"), hertz);
        browser.script(&format!(
            "document.getElementById('wanted')?.removeAttribute('id'); \
             [...document.querySelectorAll('{card} .hold')].find((it) => it.textContent.includes('{label}')).id = 'wanted'"
        ));
        browser.hold("#wanted");
    }
    browser.script(
        "document.querySelectorAll('.opener[aria-expanded=true]').forEach((it) => it.click())",
    );
    for drive in ["fan-2", "belt-4"] {
        browser.wait_for_text(&format!("#drive-{drive} .state"), "FORWARD");
    }
    let turns = "return Number(document.querySelector('#drive-fan-2 .output .number').textContent)";
    until("the fan is fast", PATIENCE, || {
        (browser.script(turns).as_f64()? > 42.0).then_some(())
    });
    demo.program.type_line("");
    browser.wait_for_text("#drive-pump-1 .state", "TRIPPED");
    for (name, window) in [
        ("page-desktop", DESKTOP),
        ("page-desktop-dark", DESKTOP.dark()),
        ("page-phone", Window::PHONE),
        ("page-phone-dark", Window::PHONE.dark()),
    ] {
        take(&browser, name, window);
    }
    let crowd = include_str!("crowd.js");
    let states = "['running', 'running', 'stopping', 'tripped', 'running in reverse', 'offline', 'warned', 'stopped']";
    browser.script(&format!(
        "return (async () => {{ {crowd}\n crowd(31); const states = {states}; \
         drives.update(names(31).map((name, index) => in_state(name, states[index % states.length]))); \
         filter.count(drives.all()); return true; }})()"
    ));
    take(&browser, "page-32-desktop", DESKTOP);
    take(&browser, "page-32-phone", Window::PHONE);
}

#[test]
#[ignore = "it writes into docs/"]
fn pictures_of_one_drive_in_two_languages() {
    let shop = Shop::open(true);
    let browser = shop.browser();
    sign_in(&browser, PASSWORD);
    browser.wait("document.querySelector('#drive-pump-1 .stop').checkVisibility()");
    take(&browser, "page-1-desktop", DESKTOP);
    take(&browser, "page-1-phone", Window::PHONE);
    choose(&browser, "de");
    take(&browser, "page-german-desktop-dark", DESKTOP.dark());
    take(&browser, "page-german-phone", Window::PHONE);
}

/// Writes a picture of what the window shows into `docs/`.
fn take(browser: &Browser, name: &str, window: Window) {
    browser.resize(window);
    browser.script("scrollTo(0, 0)");
    browser.hide_scroll_bars();
    let picture = browser.picture();
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("docs");
    std::fs::write(folder.join(format!("{name}.png")), &picture).unwrap();
    assert!(picture.len() < BYTES_MAX, "{name}: {} bytes", picture.len());
}
