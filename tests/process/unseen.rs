//! The page in a real browser: what it tells of a motor that may still run where the gateway does not see it, and whose
//! stop it is that a hand is on.

use super::chromium::{Browser, Window};
use super::looking::{
    LOST_AFTER, PASSWORD, Shop, assert_no_program_words, in_card, mark, sign_in, start_forward,
};
use super::rig::vfd_gateway;
use super::started::{PATIENCE, until};
use serde_json::{Value, json};

/// As long as a name may be.
const LONG: &str = "Umwaelzpumpe-Heizkreis-Sued-Gebaeude-7-Keller-Raum-012-Anlage-0A";
const WIDE: Window = Window {
    width: 1440,
    height: 900,
    is_dark: false,
};

fn control(shop: &Shop) -> Value {
    let state: Value = serde_json::from_str(&shop.get("/api/v1/state").unwrap()).unwrap();
    state["drives"][0]["control"].clone()
}

#[test]
fn a_motor_whose_cable_is_pulled_may_still_run_until_a_person_has_looked() {
    let mut shop = Shop::open(true);
    let browser = shop.browser();
    sign_in(&browser, PASSWORD);
    browser.wait("document.querySelector('#drive-pump-1 .stop').checkVisibility()");
    start_forward(&browser, "10");
    let output = "document.querySelector('#drive-pump-1 .output .number').textContent === '10.00'";
    browser.wait(output);
    shop.drive.kill();
    browser.wait_for_text(&in_card(".unseen-run"), "MAY STILL RUN");
    // The tab is there, and shows that it is refused for as long as its lease lasts.
    browser.wait_for_text(&in_card(".owner"), "its renewals are refused");
    let owner = browser.text(&in_card(".owner"));
    assert!(
        !owner.contains("order") && !owner.contains("renewed every"),
        "{owner}"
    );
    let told = browser.text(&in_card(".unseen-run"));
    assert!(
        told.contains("forward 10.00 Hz") && told.contains("Go to the drive"),
        "{told}"
    );
    let largest = "const card = document.querySelector('#drive-pump-1'); const size = (it) => parseFloat(getComputedStyle(it).fontSize); \
                   const all = [...card.querySelectorAll('*')].filter((it) => it.checkVisibility({ visibilityProperty: true }) && [...it.childNodes].some((part) => \
                   part.nodeType === 3 && part.data.trim() !== '')); all.sort((one, other) => size(other) - size(one)); \
                   return [all[0].textContent, size(all[0]) > size(all[1])]";
    assert_eq!(browser.script(largest), json!(["May still run", true]));
    browser.wait_for_text("#advice li:first-child", "MAY STILL RUN");
    // That is no lost commander, and nothing could be sent.
    until("what is declared is due", LOST_AFTER * 2 + PATIENCE, || {
        (control(&shop)["failsafe"]["stage"] == "due").then_some(())
    });
    assert_eq!(control(&shop)["failsafe"]["cause"], "out_of_reach");
    browser.wait("document.querySelector('#advice').textContent.includes('nothing was sent yet')");
    let advice = browser.text("#advice");
    assert!(
        !advice.contains("commander was lost") && !advice.contains("carried out"),
        "{advice}"
    );
    browser.wait_for_text(&in_card(".unseen-run"), "fail-safe action due, not sent");
    browser.wait_for_text("#counts [data-state='may_still_run']", "1 may still run");
    assert_no_program_words(&browser);
    let health = vfd_gateway(&["health", "-c", shop.file.to_str().unwrap()]);
    let health = String::from_utf8_lossy(&health.stdout).into_owned();
    assert!(
        health.contains("drive pump-1 MAY STILL RUN: last seen forward at 10.00 Hz, "),
        "{health}"
    );
    assert!(
        health.contains("the declared action (stop) is due"),
        "{health}"
    );
    assert_ne!(
        vfd_gateway(&["health", "-c", shop.file.to_str().unwrap()])
            .status
            .code(),
        Some(0)
    );
    for (window, is_there) in [
        (Window::PHONE, "innerWidth === 390"),
        (WIDE, "innerWidth > 1000"),
    ] {
        browser.resize(window);
        browser.wait(is_there);
        assert_fits(&browser, ".unseen-run");
        let is_whole = format!(
            "(({{ scrollHeight, clientHeight }}) => scrollHeight <= clientHeight)(document.querySelector({:?}))",
            in_card(".unseen-run")
        );
        browser.wait(&is_whole);
        assert_each_problem_is_reached(&browser);
    }
    a_pending_stop_is_told_until_it_has_acted(&browser);
    browser.hold(&mark(&browser, "I checked"));
    browser.wait("!document.querySelector('#drive-pump-1 .unseen-run').checkVisibility()");
    assert_eq!(control(&shop)["stop_pending"], true, "it cancels nothing");
    until("the audit has it", PATIENCE, || {
        let audit = vfd_gateway(&[
            "journal",
            "audit",
            "-c",
            shop.file.to_str().unwrap(),
            "--json",
        ]);
        let audit = String::from_utf8_lossy(&audit.stdout).into_owned();
        let is_there = |words: &[&str]| {
            audit
                .lines()
                .any(|row| words.iter().all(|word| row.contains(word)))
        };
        (is_there(&["standstill_confirmed", "page anna"])
            && is_there(&["failsafe", "out_of_reach", "due"]))
        .then_some(())
    });
    // The browser tells of each renewal that is refused.
    let others: Vec<_> = browser
        .complaints()
        .into_iter()
        .filter(|it| !it.contains("/lease - "))
        .collect();
    assert_eq!(others, Vec::<String>::new());
}

/// The first of the problems is whole at once, and what is below is counted as long as there is some.
fn assert_each_problem_is_reached(browser: &Browser) {
    let below = "const box = document.querySelector('#advice'); const all = [...box.querySelectorAll('li')]; \
                 const end = box.getBoundingClientRect().bottom + 1; \
                 const below = all.filter((it) => it.getBoundingClientRect().bottom > end).length;";
    browser.script("document.querySelector('#advice').scrollTop = 0");
    let shown = format!(
        "(() => {{ {below} const more = document.querySelector('.below'); \
         return below < all.length && more.checkVisibility() === (below > 0) && (below === 0 || more.textContent.includes(below)); }})()"
    );
    browser.wait(&shown);
    while browser.script(&format!("{below} return below > 0")) == true {
        let before = browser.script("return document.querySelector('#advice').scrollTop");
        browser.click(".below");
        browser.wait(&format!(
            "document.querySelector('#advice').scrollTop > {before}"
        ));
    }
    browser.wait("!document.querySelector('.below').checkVisibility()");
}

/// The drive itself stays away: what the gateway would tell of it is put in its place.
fn a_pending_stop_is_told_until_it_has_acted(browser: &Browser) {
    browser.click(&in_card(".stop"));
    browser.wait_for_text(&in_card(".result"), "unknown");
    browser.wait_for_text(&in_card(".unseen-run"), "stop pending");
    let news = "import('/assets/drives.js').then(({ all, update }) => { const { name, control } = all()[0]; \
                const tell = (news) => update([{ name, ...news }]); \
                tell({ control: { ...control, stop_pending: true } }); \
                tell({ run_state: 'stopped', control: { ...control, stop_pending: false } }); \
                const result = document.querySelector('#drive-pump-1 .result').textContent; \
                tell({ may_still_run: false, output_frequency_hz: 60, control: { ...control, output_outside: true, stopped_elsewhere: true } }); \
                const marks = document.querySelector('#drive-pump-1 .marks').innerText; \
                tell({ may_still_run: true, run_state: 'offline', control }); return [result, marks]; })";
    let told = browser.script(&format!("return {news}"));
    let (result, marks) = (told[0].as_str().unwrap(), told[1].as_str().unwrap());
    assert!(result.contains("has taken effect"), "{told}");
    assert!(
        marks.contains("output 60.00 Hz is not as ordered, limits")
            && marks.contains("stopped elsewhere"),
        "{told}"
    );
}

/// Each of these elements that is seen shows its text whole, inside the window.
fn assert_fits(browser: &Browser, css: &str) {
    let script = format!(
        "const all = [...document.querySelectorAll({css:?})].filter((it) => it.checkVisibility()); \
         const is_cut = (it) => {{ const {{ left, right }} = it.getBoundingClientRect(); \
         return it.scrollWidth > it.clientWidth || left < 0 || right > innerWidth; }}; \
         return [all.length > 0, all.filter(is_cut).map((it) => it.textContent)]"
    );
    assert_eq!(browser.script(&script), json!([true, []]), "{css}");
}

#[test]
fn the_whole_name_is_beside_what_acts_however_long_it_is() {
    let shop = Shop::of(true, &[LONG, "pump-2"]);
    let browser = shop.browser();
    sign_in(&browser, PASSWORD);
    browser.wait("document.querySelector('.drive .stop').checkVisibility()");
    // All that acts is there at once.
    browser.script("document.querySelectorAll('.opener').forEach((it) => it.click())");
    browser.wait("document.querySelector('.drive .hold.run').checkVisibility()");
    let id = format!("drive-{LONG}");
    let name = format!("document.getElementById('{id}').querySelector('h3')");
    let in_sight = format!(
        "const name = {name}; const {{ left, right, top, bottom }} = name.getBoundingClientRect(); const stop = \
         document.getElementById('{id}').querySelector('.stop').getBoundingClientRect(); return [name.innerText, \
         left >= 0 && right <= innerWidth && top >= 0 && bottom <= innerHeight, name.scrollWidth <= name.clientWidth, \
         name.scrollHeight <= name.clientHeight, stop.top >= 0 && stop.bottom <= innerHeight]"
    );
    let whole = json!([LONG, true, true, true, true]);
    for (window, is_there) in [
        (WIDE, "innerWidth > 1000"),
        (Window::PHONE, "innerWidth === 390"),
        (Window::NARROW, "innerWidth === 360"),
    ] {
        browser.resize(window);
        browser.wait(is_there);
        browser.script(&format!(
            "document.getElementById('{id}').scrollIntoView({{ block: 'center' }})"
        ));
        assert_eq!(browser.script(&in_sight), whole, "beside STOP");
        for part in [".drive h3", ".drive .state", ".stop", ".hold .face"] {
            assert_fits_if_seen(&browser, part);
        }
        super::looking::assert_nothing_sticks_out(&browser);
    }
    // On a phone a drive is opened over the page; its name stays however far that is scrolled.
    browser.script(&format!("location.hash = '#{id}'"));
    browser.wait(&format!(
        "document.getElementById('{id}').classList.contains('whole')"
    ));
    for scrolled in [0, 10_000] {
        browser.script(&format!(
            "document.getElementById('{id}').scrollTop = {scrolled}"
        ));
        assert_eq!(browser.script(&in_sight), whole, "in the dialog");
    }
    browser.script("location.hash = '#drives-title'");
    // What could not be stopped is told with its whole name.
    browser.script(&format!(
        "return import('/assets/problems.js').then(({{ stopped }}) => stopped([{{ drive: '{LONG}', outcome: 'unknown', \
         reason: 'no_reply', message: 'the drive did not answer in time' }}], 800) && 0)"
    ));
    browser.wait_for_text("#stop-results li", LONG);
    assert_fits(&browser, "#stop-results li");
}

fn assert_fits_if_seen(browser: &Browser, css: &str) {
    if browser.script(&format!(
        "return [...document.querySelectorAll({css:?})].some((it) => it.checkVisibility())"
    )) == true
    {
        assert_fits(browser, css);
    }
}
