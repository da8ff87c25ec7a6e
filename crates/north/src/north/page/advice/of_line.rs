//! Advice on one line.

use super::SubjectAdvice;
use crate::domain::report::{LineFault, LineState};
use crate::domain::standby::LineRole;
use crate::north::finding::{Finding, FindingSign, down_reason, over_full, suspended, suspicion};
use crate::north::page::line::PageLine;
use crate::north::texts::Sentence;

impl PageLine<'_> {
    /// The advice on it.
    #[must_use]
    pub fn advice(&self) -> Vec<Finding> {
        let mut said = SubjectAdvice {
            line: Some(self.name.clone()),
            ..SubjectAdvice::default()
        };
        let report = self.report;
        if self.hangs {
            said.say(FindingSign::LineHangs, Sentence::new("finding.line_hangs"));
        }
        match (down_reason(report), report.suspicion.map(suspicion)) {
            (None, Some(suspicion)) => said.say(FindingSign::Suspicion, suspicion),
            (Some(_), Some(suspicion)) => {
                said.say(FindingSign::Suspicion, down("finding.line_down", suspicion))
            }
            (Some(reason), None) => said.say(FindingSign::LineDown, self.down(reason)),
            (None, None) => {}
        }
        let bad = match report.quality.bad_per_cent {
            Some(bad) if report.state == LineState::Up => bad,
            _ => 0,
        };
        if report.quality.is_suspended {
            said.say(FindingSign::Suspended, suspended(bad));
        } else if bad > 0 {
            said.say(
                FindingSign::BadExchanges,
                Sentence::new("finding.bad_exchanges").with("bad", u64::from(bad)),
            );
        }
        if let Some(standby) = report.standby {
            let is_deaf = report.state == LineState::Down;
            if standby.role == LineRole::Listening && !standby.hears_other && !is_deaf {
                said.say(
                    FindingSign::NoGatewayActive,
                    Sentence::new("finding.no_gateway_active"),
                );
            }
            if standby.listener == Some(false) {
                said.say(
                    FindingSign::NoListener,
                    Sentence::new("finding.no_listener"),
                );
            }
            if standby.trouble.is_deaf {
                said.say(FindingSign::LineDeaf, Sentence::new("finding.line_deaf"));
            }
            if standby.trouble.files_differ {
                said.say(
                    FindingSign::FilesDiffer,
                    Sentence::new("finding.files_differ"),
                );
            }
            if let Some(station) = standby.trouble.unknown_station {
                let sentence =
                    Sentence::new("finding.unknown_station").with("station", u64::from(station.0));
                said.say(FindingSign::Stranger, sentence);
            }
            if standby.rivals > 0 {
                said.say(
                    FindingSign::RivalOnLine,
                    Sentence::new("finding.rival_on_line").with("times", standby.rivals),
                );
            }
        }
        if report.planned_use_per_mille > 1000 {
            said.say(
                FindingSign::OverFull,
                over_full(report.planned_use_per_mille),
            );
        }
        said.all
    }

    /// Reports that it is down, with what to check if the reason does not say so itself.
    fn down(&self, reason: Sentence) -> Sentence {
        if self.report.open_error.is_some() {
            return down("finding.line_down", reason);
        }
        let key = match self.report.fault {
            None | Some(LineFault::Gone | LineFault::Failed) => "finding.line_down_port",
            Some(LineFault::Stuck) => "finding.line_down_stuck",
            Some(LineFault::Jammed) => "finding.line_down_jammed",
            Some(LineFault::Mute) if self.wiring.characters().is_none() => {
                "finding.line_down_mute_server"
            }
            Some(LineFault::Mute) => "finding.line_down_mute",
            Some(LineFault::Echo | LineFault::OutOfStep) => "finding.line_down",
        };
        down(key, reason).with("port", self.wiring.port.as_str())
    }
}

fn down(key: &'static str, reason: Sentence) -> Sentence {
    Sentence::new(key).with("reason", reason)
}
