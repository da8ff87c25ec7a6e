//! The page in another language, in a real browser: all of it is translated, numbers mean what was typed, and no stop moves.

use super::chromium::Browser;
use super::looking::{CARD, PASSWORD, Shop, in_card, sign_in};
use super::many_drives::{
    assert_no_barrier_in_any_state, assert_no_stop_moves_in_any_layout, crowded,
};
use serde_json::json;

/// Chooses a language as a user does, and waits until the page is back in it.
pub fn choose(browser: &Browser, code: &str) {
    browser.script(&format!(
        "const select = document.querySelector('#language'); select.value = '{code}'; \
         select.dispatchEvent(new Event('change'))"
    ));
    wait_until_shown(browser, code);
}

/// Waits until the page has its language, and the card of the drive.
fn wait_until_shown(browser: &Browser, code: &str) {
    browser.wait(&format!(
        "document.documentElement.lang === '{code}' && document.querySelector('{CARD} .stop')?.checkVisibility() === true"
    ));
}

fn in_german(shop: &Shop) -> Browser {
    let browser = shop.browser();
    sign_in(&browser, PASSWORD);
    browser.wait(&format!(
        "document.querySelector('{CARD} .stop').checkVisibility()"
    ));
    choose(&browser, "de");
    browser
}

/// Sentences of the English catalogue that are in the page although the German one has others.
const LEFT_IN_ENGLISH: &str = "const [en, de] = await Promise.all(['page.en', 'page.de', 'gateway.en', 'gateway.de']\
     .reduce((all, name, index) => { all[index % 2].push(name); return all; }, [[], []])\
     .map((names) => Promise.all(names.map((name) => fetch(`assets/${name}.json`).then((it) => it.json())))\
     .then((all) => Object.assign({}, ...all)))); \
     const shown = [document.body.textContent, ...[...document.querySelectorAll('[aria-label], [title], [placeholder]')]\
     .flatMap((it) => ['aria-label', 'title', 'placeholder'].map((name) => it.getAttribute(name) ?? ''))].join('\\n'); \
     return Object.keys(en).filter((key) => en[key].includes(' ') && !en[key].includes('{') && en[key] !== de[key] \
     && shown.includes(en[key]))";

fn left_in_english(browser: &Browser) -> serde_json::Value {
    browser.script(&format!("return (async () => {{ {LEFT_IN_ENGLISH} }})()"))
}

#[test]
fn a_reader_of_german_is_told_everything_in_german_and_commands_with_a_comma() {
    let mut shop = Shop::open(true);
    let browser = in_german(&shop);
    browser.wait_for_text(&in_card(".state"), "STEHT");
    assert_eq!(browser.text(&in_card(".stop")), "STOPP");
    assert_eq!(browser.text("#session .stop"), "ALLE STOPPEN");
    for panel in ["trend", "journal", "traffic", "report"] {
        browser.click(&format!("#tab-{panel}"));
        browser.wait(&format!(
            "document.querySelector('#{panel}').textContent.length > 20"
        ));
    }
    assert_eq!(left_in_english(&browser), json!([]));
    browser.fill(&in_card("input"), "12,5");
    let forward = format!(
        "[...document.querySelectorAll('{CARD} .hold.run')].find((it) => it.textContent.startsWith('Vorwärts')).id = 'vor'"
    );
    browser.script(&forward);
    browser.wait_for_text("#vor", "Vorwärts mit 12,5 Hz");
    browser.hold("#vor");
    browser.wait_for_text(&in_card(".state"), "VORWÄRTS");
    browser.wait_for_text(&in_card(".output .number"), "12,50");
    browser.click(&in_card(".stop"));
    browser.wait_for_text(&in_card(".result"), "Stopp bestätigt");
    browser.wait_for_text(&in_card(".state"), "STEHT");
    shop.drive.type_line("");
    browser.wait_for_text(&in_card(".state"), "STÖRUNG");
    browser.wait_for_text("#advice", "der Antrieb hat eine Störung");
    browser.hold("#vor");
    browser.wait_for_text(&in_card(".result"), "abgelehnt: ");
    assert_eq!(left_in_english(&browser), json!([]));
    assert_eq!(browser.complaints(), Vec::<String>::new());
    // A browser that refuses to keep anything.
    let refused = "Storage.prototype.getItem = Storage.prototype.setItem = () => { throw new DOMException('no') }; \
                   return import('/assets/kept.js').then(({ keep, kept }) => \
                   [kept('x'), keep('x', '1'), kept('x')])";
    assert_eq!(browser.script(refused), json!([null, null, "1"]));
    // What was chosen stays, and can be taken back.
    browser.reload_past_the_cache();
    wait_until_shown(&browser, "de");
    browser.wait_for_text(&in_card(".state"), "STÖRUNG");
    choose(&browser, "en");
    browser.wait_for_text(&in_card(".state"), "TRIPPED");
}

#[test]
fn a_number_is_what_was_typed_in_every_language_or_none() {
    let shop = Shop::open(true);
    let browser = in_german(&shop);
    let typed = [
        ("12", json!(12)),
        ("12.5", json!(12.5)),
        ("12,5", json!(12.5)),
        (" 12,05 ", json!(12.05)),
        ("0", json!(0)),
        // In one language that is a thousand times what it is in another.
        ("1.234", json!(null)),
        ("1,234", json!(null)),
        ("1.234,5", json!(null)),
        ("1 234", json!(null)),
        ("1'234", json!(null)),
        ("-5", json!(null)),
        ("+5", json!(null)),
        ("5e1", json!(null)),
        ("0x10", json!(null)),
        ("5 Hz", json!(null)),
        ("5.", json!(null)),
        (".5", json!(null)),
        ("", json!(null)),
        ("१२", json!(null)),
        ("Infinity", json!(null)),
    ];
    let numbers: Vec<_> = typed.iter().map(|(typed, _)| *typed).collect();
    let read = format!(
        "return import('/assets/texts.js').then(({{ decimal }}) => {}.map(decimal))",
        json!(numbers)
    );
    let wanted: Vec<_> = typed.iter().map(|(_, wanted)| wanted.clone()).collect();
    assert_eq!(browser.script(&read), json!(wanted));
    browser.fill(&in_card("input"), "1.234");
    browser.wait_for_text(&in_card(".range"), "muss 5 bis 50 Hz sein");
    let is_off = format!(
        "document.querySelector('{CARD} .setpoint button').getAttribute('aria-disabled') === 'true'"
    );
    browser.wait(&is_off);
}

#[test]
fn no_stop_moves_and_axe_finds_no_barrier_in_german() {
    let shop = Shop::open(true);
    let browser = in_german(&shop);
    crowded(&browser);
    assert_no_stop_moves_in_any_layout(&browser);
    assert_no_barrier_in_any_state(&browser);
}
