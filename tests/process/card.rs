//! The card of a drive, in a real browser: it uses the window, says what matters most, and cuts no text.

use super::chromium::{Browser, Window};
use super::languages::choose;
use super::looking::{PASSWORD, Shop, assert_nothing_sticks_out, in_card, mark, sign_in};
use super::many_drives::crowded;
use serde_json::json;

/// As long as a name may be, of the widest letters and of usual ones.
const WIDE: &str = "WWWWWWWWWWWWWWWWWWWWWWWWWWWWWWWWWWWWWWWWWWWWWWWWWWWWWWWWWWWWWWWW";
const LONG: &str = "Umwaelzpumpe-Heizkreis-Sued-Gebaeude-7-Keller-Raum-012-Anlage-0A";

/// A desktop of this size.
const fn desktop(width: u32, height: u32) -> Window {
    Window {
        width,
        height,
        is_dark: false,
    }
}

/// Texts of drives that are seen, but for a part that is cut off or outside the window.
const CUT: &str = "const found = []; const walker = document.createTreeWalker(document.getElementById('drives'), NodeFilter.SHOW_TEXT); \
     while (walker.nextNode()) { const { currentNode: node } = walker; let box = node.parentElement; \
     if (node.data.trim() === '' || !box.checkVisibility({ visibilityProperty: true }) || getComputedStyle(box).clipPath !== 'none') continue; \
     const range = document.createRange(); range.selectNodeContents(node); const { left, right, top, bottom } = range.getBoundingClientRect(); \
     if (left < -1 || right > innerWidth + 1) found.push(`outside: ${node.data}`); \
     for (; box.id !== 'drives'; box = box.parentElement) { if (getComputedStyle(box).overflowY === 'visible') continue; \
     const outer = box.getBoundingClientRect(); \
     if (left < outer.left - 1 || right > outer.right + 1 || top < outer.top - 2 || bottom > outer.bottom + 2) \
     found.push(`${box.className}: ${node.data}`); } } return found";

fn signed_in(shop: &Shop) -> Browser {
    let browser = shop.browser();
    sign_in(&browser, PASSWORD);
    browser.wait("document.querySelector('.drive .stop').checkVisibility()");
    browser
}

fn resize(browser: &Browser, window: Window) {
    browser.resize(window);
    browser.wait(&format!("innerWidth === {}", window.width));
    // Letters are fitted in the next frame.
    browser.script("return new Promise((done) => requestAnimationFrame(() => requestAnimationFrame(() => done(0))))");
}

#[test]
fn four_drives_that_may_be_commanded_fit_a_desktop_and_no_text_is_cut() {
    let shop = Shop::of(true, &["pump-1", LONG, "fan-2", WIDE]);
    let browser = signed_in(&shop);
    resize(&browser, desktop(1440, 900));
    let below = "return [...document.querySelectorAll('.drive')].filter((it) => it.getBoundingClientRect().bottom > innerHeight).length";
    assert_eq!(browser.script(below), 0);
    let lines = format!(
        "const name = document.getElementById('drive-{LONG}-name'); return name.innerText === '{LONG}' && \
         name.getClientRects().length === 1 && name.clientHeight <= 2.5 * parseFloat(getComputedStyle(name).fontSize)"
    );
    assert_eq!(browser.script(&lines), true, "the name has two lines");
    for language in ["en", "de"] {
        if language == "de" {
            choose(&browser, language);
        }
        for (width, height) in [
            (1280, 900),
            (1440, 900),
            (1920, 1080),
            (390, 844),
            (360, 740),
            (320, 640),
        ] {
            resize(&browser, desktop(width, height));
            assert_eq!(browser.script(CUT), json!([]), "{language}, {width} wide");
            assert_nothing_sticks_out(&browser);
        }
    }
    assert_eq!(browser.complaints(), Vec::<String>::new());
}

#[test]
fn one_drive_uses_the_window_and_many_use_all_columns() {
    let shop = Shop::open(true);
    let browser = signed_in(&shop);
    resize(&browser, desktop(1920, 1080));
    let unused = "const last = [...document.querySelectorAll('.drive')].reduce((most, it) => Math.max(most, it.getBoundingClientRect().right), 0); \
                  return document.querySelector('#drives').getBoundingClientRect().right - last \
                  + document.documentElement.clientWidth - document.querySelector('main').getBoundingClientRect().right";
    let unused = || browser.script(unused).as_f64().unwrap();
    assert!(unused() < 1.0, "one drive: {}", unused());
    for part in [".controls", ".values", ".owner"] {
        assert!(browser.is_seen(&in_card(part)), "{part}");
    }
    assert!(!browser.is_seen(&in_card(".opener")));
    browser.wait(
        "document.querySelector('#drive-pump-1 .spark path').getAttribute('d').startsWith('M')",
    );
    crowded(&browser);
    assert!(unused() < 1.0, "nine drives: {}", unused());
    let columns = "return getComputedStyle(document.querySelector('#drives')).gridTemplateColumns.split(' ').length";
    assert_eq!(browser.script(columns), 5);
}

#[test]
fn what_matters_most_is_said_and_the_rest_is_one_click_away() {
    let shop = Shop::open(true);
    let browser = signed_in(&shop);
    crowded(&browser);
    let said = |state: &str| {
        browser.script(&format!(
            "window.crowd.drives.update([window.crowd.in_state('d-1', {state:?})]); \
             return document.querySelector('#drive-d-1 .said').innerText"
        ))
    };
    for (state, wanted) in [
        ("running", "Commanded by page:"),
        ("tripped", "TRIP 9 overvoltage"),
        ("not effective", "stop not effective · 2 more"),
        ("offline", "does not answer"),
        ("warned", "local control · 3 more"),
        ("stopped", "Not commanded"),
    ] {
        let told = said(state);
        assert!(
            told.as_str().unwrap().starts_with(wanted),
            "{state}: {told}"
        );
    }
    let card = "#drive-d-1";
    for (part, opener) in [
        (".controls", ".opener:nth-child(1)"),
        (".values", ".opener:nth-child(2)"),
    ] {
        assert!(!browser.is_seen(&format!("{card} {part}")), "{part}");
        browser.click(&format!("{card} {opener}"));
        assert!(browser.is_seen(&format!("{card} {part}")), "{part}");
    }
    // How an order ended is told in the same place.
    let pump = in_card("");
    browser.click(&format!("{pump} .opener"));
    browser.fill(&in_card("input"), "30");
    browser.hold(&mark(&browser, "Forward"));
    browser.wait_for_text(&in_card(".said"), "forward acknowledged");
    browser.click(&in_card(".stop"));
    browser.wait_for_text(&in_card(".said"), "stop confirmed");
}

#[test]
fn a_search_without_a_hit_says_so_and_counts_agree_with_their_number() {
    let shop = Shop::open(true);
    let browser = signed_in(&shop);
    crowded(&browser);
    assert!(!browser.is_seen("#no-hit"));
    browser.fill("#filter input", "no such drive");
    browser.wait_for_text("#no-hit", "No drive matches");
    browser.click("#no-hit button");
    assert!(!browser.is_seen("#no-hit"));
    let seen = "return [...document.querySelectorAll('.drive')].filter((it) => it.checkVisibility()).length";
    assert_eq!(browser.script(seen), 9);
    choose(&browser, "de");
    browser.wait_for_text("#counts [data-state='stopped']", "1 steht");
    crowded(&browser);
    browser.wait_for_text("#counts [data-state='stopped']", "9 stehen");
}

#[test]
fn who_may_only_stop_a_drive_stops_it_and_lets_it_coast() {
    let shop = Shop::open(true);
    let browser = signed_in(&shop);
    browser.script(
        "return Promise.all(['session', 'drives'].map((name) => import(`/assets/${name}.js`))).then(([session, drives]) => { \
         session.current().groups = ['other']; drives.redraw(); return 0; })",
    );
    let seen = "return [...document.querySelectorAll('#drive-pump-1 :is(button, input)')].filter((it) => it.checkVisibility()).map((it) => it.innerText)";
    assert_eq!(browser.script(seen), json!(["STOP", "Coast"]));
    browser.click(&in_card(".coast"));
    browser.wait_for_text(&in_card(".said"), "coast ");
}
