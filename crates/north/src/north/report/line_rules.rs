//! Findings about a line as a whole.

use super::LineObserved;
use super::rules::{ENOUGH, FindingText, SIGNS};
use crate::domain::suspicion::LineSuspicion;
use crate::north::finding::{self, Severity};
use crate::north::texts::Sentence;

/// The line's own suspicion: wiring, speed, parity, a duplicate station number, an echo, a jam.
pub(super) fn suspicion(seen: &LineObserved) -> FindingText {
    Some((Severity::Problem, finding::suspicion(seen.line.suspicion?)))
}

pub(super) fn down(seen: &LineObserved) -> FindingText {
    if seen.is_up() || seen.line.suspicion.is_some() {
        return None;
    }
    let reason = finding::down_reason(&seen.line)?;
    Some((
        Severity::Problem,
        Sentence::new("finding.line_down").with("reason", reason),
    ))
}

pub(super) fn port_lost(seen: &LineObserved) -> FindingText {
    let text = || Sentence::new("finding.port_lost").with("times", seen.port_downs);
    (seen.port_downs > 0).then(|| (Severity::Problem, text()))
}

pub(super) fn suspended(seen: &LineObserved) -> FindingText {
    let bad = seen.line.quality.bad_per_cent.unwrap_or_default();
    (seen.is_up() && seen.line.quality.is_suspended)
        .then(|| (Severity::Problem, finding::suspended(bad)))
}

pub(super) fn other_master(seen: &LineObserved) -> FindingText {
    let is_suspected = seen.line.suspicion == Some(LineSuspicion::OtherMaster);
    let text = || Sentence::new("finding.other_master").with("requests", seen.other_master);
    (seen.other_master >= SIGNS && !is_suspected && !is_shared(seen))
        .then(|| (Severity::Problem, text()))
}

pub(super) fn stranger(seen: &LineObserved) -> FindingText {
    let known = seen.sum(|drive| drive.damage.late + drive.damage.doubled);
    let strangers = (seen.strays + seen.foreign).saturating_sub(known);
    let text = || Sentence::new("finding.stranger").with("frames", strangers);
    (strangers >= SIGNS && !is_shared(seen)).then(|| (Severity::Problem, text()))
}

/// Whether the line has several gateways: then requests of another one and their replies belong there.
const fn is_shared(seen: &LineObserved) -> bool {
    seen.line.standby.is_some()
}

/// Bytes when the line should be silent. A few are caused by the adapter's own change of direction.
pub(super) fn floating(seen: &LineObserved) -> FindingText {
    let led = seen.sum(|drive| drive.damage.led);
    let between = seen.noise_between;
    let text = || {
        Sentence::new("finding.floating")
            .with("before", led)
            .with("between", between)
    };
    let severity = if (led + between) * 50 >= seen.exchanges() {
        Severity::Problem
    } else {
        Severity::Hint
    };
    (led + between >= SIGNS).then(|| (severity, text()))
}

pub(super) fn over_full(seen: &LineObserved) -> FindingText {
    let planned = seen.line.planned_use_per_mille;
    (planned > 1000).then(|| (Severity::Hint, finding::over_full(planned)))
}

pub(super) fn echo_stripped(seen: &LineObserved) -> FindingText {
    let is_suspected = seen.line.suspicion == Some(LineSuspicion::Echo);
    let text = Sentence::new("finding.echo_stripped");
    (seen.is_up() && seen.echoes >= SIGNS && !is_suspected).then_some((Severity::Good, text))
}

pub(super) fn few_exchanges(seen: &LineObserved) -> FindingText {
    let exchanges = seen.exchanges();
    let few = || Sentence::new("finding.few_exchanges").with("exchanges", exchanges);
    let text = || few().with("seconds", seen.time.as_secs());
    (seen.is_up() && exchanges < ENOUGH).then(|| (Severity::Hint, text()))
}
