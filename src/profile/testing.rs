//! What the tests of this room share: a small sound model, and problems as text.

use crate::domain::problem::Problem;

/// A model file with one of everything that must be there.
pub(super) const MODEL: &str = r#"id = "acme-1"
vendor = "Acme"
title = "One"

[documents]
IM = "Interface manual"

[link]
default = { baud = 9600, data_bits = 8, parity = "none", stop_bits = 1, confidence = "manual", source = "IM 1" }
bauds = { value = [9600, 19200], confidence = "manual", source = "IM 1" }
parities = { value = ["none"], confidence = "manual", source = "IM 1" }
stop_bits = { value = [1], confidence = "manual", source = "IM 1" }
data_bits = { value = [8], confidence = "manual", source = "IM 1" }
framings = { value = ["rtu"], confidence = "manual", source = "IM 1" }
interfaces = { value = ["rs485"], confidence = "manual", source = "IM 1" }
stations = { from = 1, to = 247, confidence = "manual", source = "IM 1" }

[timing]
gap_chars = { value = 3.5, confidence = "manual", source = "IM 2" }
reply_timeout_cap = { value = "500ms", confidence = "default", source = "cautious" }
max_lateness = { value = "1s", confidence = "default", source = "cautious" }

[functions]
value = [3, 6]
confidence = "manual"
source = "IM 3"

[read]
max_words = { value = 4, confidence = "manual", source = "IM 3" }

[write]
refused = { value = "exception", confidence = "manual", source = "IM 3" }

[[register]]
name = "output_frequency"
title = "Output frequency"
code = "D001"
address = 0x0101
scale = 100
unit = "Hz"
access = "read"
role = "output-frequency"
poll = "fast"
confidence = "manual"
source = "IM 4"
"#;

/// A line for each problem: place, key, what is wrong, what would be right.
pub(super) fn told(problems: &[Problem], text: &str) -> String {
    let lines = problems.iter().map(|problem| {
        let (line, column) = problem.place_in(text);
        let right = problem.right.as_deref().unwrap_or("-");
        format!("{line}:{column} {}: {}\n    right: {right}\n", problem.key, problem.what)
    });
    lines.collect()
}
