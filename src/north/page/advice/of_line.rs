//! Advice on one line.

use super::Advice;
use crate::domain::report::{LineFault, LineState};
use crate::north::finding::{Finding, Sign, over_full_text, suspended_text};
use crate::north::page::line::Line;

impl Line<'_> {
    /// The advice on it.
    #[must_use]
    pub fn advice(&self) -> Vec<Finding> {
        let mut said = Advice { line: Some(self.name.clone()), ..Advice::default() };
        let report = self.report;
        if self.hangs {
            said.say(Sign::LineHangs, "the line's thread hangs, so that no stop leaves there: restart the gateway");
        }
        match (report.down_reason(), report.suspicion) {
            (reason, Some(suspicion)) => {
                let down = reason.map(|_| "the line is down: ").unwrap_or_default();
                said.say(Sign::Suspicion, format!("{down}{suspicion}"));
            }
            (Some(reason), None) => said.say(Sign::LineDown, self.down(&reason)),
            (None, None) => {}
        }
        let bad = report.quality.bad_per_cent.filter(|_| report.state == LineState::Up).unwrap_or(0);
        if report.quality.is_suspended {
            said.say(Sign::Suspended, suspended_text(bad));
        } else if bad > 0 {
            let text = format!("{bad} % of the last exchanges failed: check wiring, termination and shield");
            said.say(Sign::BadExchanges, text);
        }
        if report.planned_use_per_mille > 1000 {
            said.say(Sign::OverFull, over_full_text(report.planned_use_per_mille));
        }
        said.all
    }

    /// Reports that it is down, with what to check if the reason does not say so itself.
    fn down(&self, reason: &str) -> String {
        let port = &self.wiring.port;
        if self.report.open_error.is_some() {
            return format!("the line is down: {reason}");
        }
        let hint = match self.report.fault {
            None | Some(LineFault::Gone | LineFault::Failed) => {
                format!(
                    "; check that {port} is there, that the gateway may open it, and that no other program has it open"
                )
            }
            Some(LineFault::Stuck) => format!("; unplug the adapter at {port} and plug it in again"),
            Some(LineFault::Jammed) => "; disconnect drives one by one until the line is silent".to_owned(),
            Some(LineFault::Mute) => {
                "; check the power, the wiring (A and B swapped?), speed, parity and the station numbers".to_owned()
            }
            Some(LineFault::Echo) => String::new(),
        };
        format!("the line is down: {reason}{hint}")
    }
}
