//! Trends that are kept: what was seen survives the end of the gateway without notice, and the page shows it.

use super::looking::{Shop, run};
use super::started::{PATIENCE, until};
use serde_json::Value;
use std::time::Duration;

/// A minute is kept when the next one begins.
const MINUTE_MAX: Duration = Duration::from_secs(90);

fn kept(shop: &Shop, query: &str) -> Option<Value> {
    serde_json::from_str(&shop.get(&format!("/api/v1/trend?drive=pump-1&{query}"))?).ok()
}

#[test]
fn a_minute_that_was_kept_is_there_after_a_kill_and_the_page_draws_it() {
    let mut shop = Shop::open(true);
    let has_rows = || {
        kept(&shop, "span=24h").filter(|it| {
            it["values"][0]
                .as_array()
                .is_some_and(|rows| !rows.is_empty())
        })
    };
    let before = until("a minute is kept", MINUTE_MAX + PATIENCE, has_rows);
    assert_eq!(before["columns"][0]["name"], "output_frequency");
    assert_eq!(before["step_s"], 60);
    shop.gateway.kill();
    shop.gateway = run(&shop.file);
    let after = until("it serves again", PATIENCE, || kept(&shop, "span=24h"));
    assert_eq!(after["values"][0][0], before["values"][0][0]);
    assert_eq!(kept(&shop, "span=30d").unwrap()["step_s"], 3600);
    let rows = kept(&shop, "span=1h&format=rows&values=output_frequency").unwrap();
    assert_eq!(rows[0]["output_frequency"], 0.0, "{rows}");
    let csv = shop
        .get("/api/v1/trend?drive=pump-1&span=7d&format=csv&values=output_frequency")
        .unwrap();
    assert!(
        csv.starts_with(
            "time,output_frequency_min (Hz),output_frequency_mean (Hz),output_frequency_max (Hz)\n2"
        ),
        "{csv}"
    );

    let browser = shop.browser();
    browser.click("#tab-trend");
    browser.wait("document.querySelector('#trend select') !== null");
    browser.script(
        "const span = document.querySelector('#trend select'); span.value = '24h'; span.dispatchEvent(new Event('change'))",
    );
    browser.wait("document.querySelector('#trend .chart')?.getAttribute('aria-label')?.includes('in 24 hours')");
    browser.wait("document.querySelectorAll('#trend .chart canvas').length > 0");
    browser.click("#trend .several:nth-of-type(2) summary");
    browser.wait("document.querySelectorAll('#trend .several:nth-of-type(2) input').length > 1");
    assert_eq!(browser.complaints(), Vec::<String>::new());
}
