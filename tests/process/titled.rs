//! A title that a reload brings is shown in a real browser as the text that it is, and nothing else changes.

use super::chromium::Browser;
use super::looking::{CARD, PASSWORD, Shop, in_card, sign_in};
use super::rig::{assert_says, vfd_gateway};
use serde_json::json;

/// Right-to-left letters, marks of HTML, a formula and quotes.
const TITLE: &str = "=مضخة <b>\"1\"</b>";

fn attribute(browser: &Browser, css: &str, name: &str) -> String {
    let script = format!("return document.querySelector('{css}').getAttribute('{name}')");
    browser
        .script(&script)
        .as_str()
        .unwrap_or_default()
        .to_owned()
}

#[test]
fn a_title_of_a_reload_is_shown_as_text_and_the_drive_is_commanded_by_its_name() {
    let shop = Shop::open(true);
    let browser = shop.browser();
    sign_in(&browser, PASSWORD);
    browser.wait_for_text(&in_card("h3"), "pump-1");
    browser.wait(&format!(
        "document.querySelector('{CARD} .stop').checkVisibility()"
    ));
    let before = browser.script(&format!(
        "return document.querySelector('{CARD} .about').textContent"
    ));
    let written = std::fs::read_to_string(&shop.file).unwrap();
    let name = "name = \"pump-1\"\n";
    let titled = written.replacen(name, &format!("{name}title = '{TITLE}'\n"), 1);
    std::fs::write(&shop.file, titled).unwrap();
    let file = shop.file.to_str().unwrap();
    let reloaded = vfd_gateway(&["reload", "-c", file]);
    assert_says(&reloaded, 0, &["drive pump-1: changed"]);
    browser.wait_for_text(&in_card("h3"), TITLE);
    let isolated = format!("\u{2068}{TITLE}\u{2069}");
    assert_eq!(
        attribute(&browser, &in_card(".stop"), "aria-label"),
        format!("STOP {isolated}")
    );
    let about = browser.script(&format!(
        "return document.querySelector('{CARD} .about').textContent"
    ));
    assert_eq!(
        about,
        json!(format!("pump-1 · {}", before.as_str().unwrap()))
    );
    assert_eq!(
        browser.script(&format!("return document.querySelector('{CARD} h3 b')")),
        json!(null)
    );
    browser.click(&in_card(".stop"));
    browser.wait_for_text(&in_card(".result"), "stop confirmed");
    assert_eq!(browser.complaints(), Vec::<String>::new());
    // A quotation mark in it would end it early.
    let quoted = isolated.replace('"', "'");
    let label = format!("drive pump-1 \"{quoted}\" (hyundai-n700 on hall-1)");
    assert_says(&vfd_gateway(&["health", "-c", file]), 0, &[&label]);
    let csv = shop.get("/api/v1/journal?table=audit&format=csv").unwrap();
    let field = "\"'=مضخة <b>\"\"1\"\"</b>\"";
    assert!(
        csv.contains(",body,title\n") && csv.contains(field),
        "{csv}"
    );
}
