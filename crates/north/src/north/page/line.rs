//! One line as a document.

use super::line_use::LineRates;
use crate::domain::ids::Name;
use crate::domain::link::{Interface, Wiring};
use crate::domain::report::{LineReport, LineState};
use crate::domain::standby::StandbyPair;
use crate::north::finding;
use crate::north::shown::{self, millis};
use crate::north::texts::Sentence;
use crate::toml_file::words::{INTERFACES, SHOWN_FRAMINGS, word_for};
use serde_json::{Value, json};

/// One line as of its last round.
#[derive(Clone, Copy, Debug)]
pub struct PageLine<'l> {
    /// Its name.
    pub name: &'l Name,
    /// Its physical interface.
    pub interface: Interface,
    /// Its wiring.
    pub wiring: &'l Wiring,
    /// The gateways on it; `None`: this one alone.
    pub pair: Option<&'l StandbyPair>,
    /// The report of its thread.
    pub report: &'l LineReport,
    /// Its thread was found to hang.
    pub hangs: bool,
    /// Recent measurements; `None` before there are enough.
    pub rates: Option<LineRates>,
    /// The names of its drives, in order.
    pub drives: &'l [&'l Name],
}

impl PageLine<'_> {
    /// The document.
    #[must_use]
    pub fn document(&self) -> Value {
        let LineReport {
            state,
            stop,
            measured,
            quality,
            suspicion,
            standby,
            ..
        } = self.report;
        let said = |sentence: Option<Sentence>| sentence.map(|it| it.document());
        json!({
            "name": self.name.as_str(),
            "port": self.wiring.port,
            "link": self.wiring.characters().map(|link| link.to_string()),
            "framing": word_for(&SHOWN_FRAMINGS, &self.wiring.framing),
            "interface": self.wiring.characters().map(|_| word_for(&INTERFACES, &self.interface)),
            "state": if *state == LineState::Up { "up" } else { "down" },
            "reason": self.report.down_reason(),
            "reason_said": said(finding::down_reason(self.report)),
            "hangs": self.hangs,
            "use_per_cent": self.rates.map(|rates| tenths(rates.use_per_cent)),
            "planned_use_per_cent": f64::from(self.report.planned_use_per_mille) / 10.0,
            "bad_per_cent": quality.bad_per_cent,
            "is_suspended": quality.is_suspended,
            "exchanges_per_s": self.rates.map(|rates| tenths(rates.exchanges_per_s)),
            "stop_ms": {
                "all_healthy": millis(stop.all_healthy),
                "one_silent": millis(stop.one_silent),
                "each_further": millis(stop.each_further),
                "longest_seen": millis(measured.longest_stop),
            },
            "suspicion": suspicion.map(|suspicion| suspicion.to_string()),
            "suspicion_said": said(suspicion.map(finding::suspicion)),
            "standby": shown::standby(standby.as_ref(), self.pair),
            "drives": self.drives.iter().map(|name| name.as_str()).collect::<Vec<_>>(),
        })
    }
}

/// With one decimal, so that a value that has hardly changed is the same.
fn tenths(value: f64) -> f64 {
    (value * 10.0).round() / 10.0
}
