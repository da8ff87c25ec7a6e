//! Lists and times as `check` prints them.

use std::fmt::Display;
use std::time::Duration;

/// The values, separated by commas.
pub(super) fn list<T: Display>(values: impl IntoIterator<Item = T>) -> String {
    values
        .into_iter()
        .map(|value| value.to_string())
        .collect::<Vec<_>>()
        .join(", ")
}

/// Milliseconds with as many decimals as matter; seconds from 10 s on.
pub(super) fn ms(time: Duration) -> String {
    let millis = time.as_secs_f64() * 1000.0;
    if time >= Duration::from_secs(10) {
        format!("{:.0} s", time.as_secs_f64())
    } else if millis >= 100.0 {
        format!("{millis:.0} ms")
    } else {
        format!("{millis:.2} ms")
    }
}
