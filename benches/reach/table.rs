//! The table: one row per figure.

use std::time::Duration;

/// One line of the table.
pub struct Row {
    what: String,
    wanted: String,
    measured: String,
    reached: bool,
}

impl Row {
    pub fn at_least(what: impl Into<String>, wanted: f64, measured: f64) -> Self {
        let what = what.into();
        let reached = measured >= wanted;
        Self {
            what,
            wanted: format!(">= {wanted}"),
            measured: format!("{measured:.3}"),
            reached,
        }
    }

    pub fn at_most(what: impl Into<String>, wanted: f64, measured: f64) -> Self {
        let what = what.into();
        let reached = measured <= wanted;
        Self {
            what,
            wanted: format!("<= {wanted:.4}")
                .trim_end_matches('0')
                .trim_end_matches('.')
                .to_owned(),
            measured: format!("{measured:.3}"),
            reached,
        }
    }

    pub fn rate(what: impl Into<String>, wanted: f64, measured: f64) -> Self {
        Self {
            measured: format!("{measured:.0}"),
            ..Self::at_least(what, wanted, measured)
        }
    }

    pub fn none(what: impl Into<String>, measured: u64) -> Self {
        Self {
            what: what.into(),
            wanted: "0".into(),
            measured: measured.to_string(),
            reached: measured == 0,
        }
    }

    pub fn all(what: impl Into<String>, wanted: usize, measured: usize) -> Self {
        let (wanted, reached) = (wanted.to_string(), measured == wanted);
        Self {
            what: what.into(),
            wanted,
            measured: measured.to_string(),
            reached,
        }
    }

    pub fn told(what: impl Into<String>, measured: impl Into<String>) -> Self {
        Self {
            what: what.into(),
            wanted: String::new(),
            measured: measured.into(),
            reached: true,
        }
    }

    pub fn print(&self) {
        let reached = if self.wanted.is_empty() {
            ""
        } else if self.reached {
            "yes"
        } else {
            "NO"
        };
        println!(
            "{:<76} {:>10} {:>26}  {reached}",
            self.what, self.wanted, self.measured
        );
    }
}

/// The heading of the table.
pub fn print_heading() {
    println!(
        "{:<76} {:>10} {:>26}  reached",
        "what", "wanted", "measured"
    );
}

/// Times in ms, sorted.
#[derive(Default)]
pub struct Times(Vec<f64>);

impl Times {
    pub fn new(spans: impl IntoIterator<Item = Duration>) -> Self {
        let mut times: Vec<f64> = spans
            .into_iter()
            .map(|span| span.as_secs_f64() * 1e3)
            .collect();
        times.sort_by(f64::total_cmp);
        Self(times)
    }

    pub fn len(&self) -> usize {
        self.0.len()
    }

    /// The time that this part of all does not exceed; NaN if there is none.
    pub fn at(&self, part: f64) -> f64 {
        if self.0.is_empty() {
            f64::NAN
        } else {
            part_of(&self.0, part)
        }
    }

    /// p50 / p99 / max.
    pub fn shown(&self) -> String {
        format!(
            "{:.3} / {:.3} / {:.3}",
            self.at(0.5),
            self.at(0.99),
            self.at(1.0)
        )
    }
}

/// The medians of both sides of what was measured in turn.
pub fn medians(pairs: &[(f64, f64)]) -> (f64, f64) {
    let median = |of: fn(&(f64, f64)) -> f64| {
        let mut rates: Vec<f64> = pairs.iter().map(of).collect();
        rates.sort_by(f64::total_cmp);
        part_of(&rates, 0.5)
    };
    (median(|pair| pair.0), median(|pair| pair.1))
}

pub fn part_of(sorted: &[f64], part: f64) -> f64 {
    sorted[((sorted.len() - 1) as f64 * part) as usize]
}
