//! Findings about a line as a whole.

use super::Observed;
use super::rules::{ENOUGH, FindingText, SIGNS};
use crate::domain::suspicion::Suspicion;
use crate::north::finding::{Severity, over_full_text, suspended_text};

/// The line's own suspicion: wiring, speed, parity, a duplicate station number, an echo, a jam.
pub(super) fn suspicion(seen: &Observed) -> FindingText {
    Some((Severity::Problem, seen.line.suspicion?.to_string()))
}

pub(super) fn down(seen: &Observed) -> FindingText {
    if seen.is_up() || seen.line.suspicion.is_some() {
        return None;
    }
    let reason = seen.line.down_reason()?;
    Some((Severity::Problem, format!("the line is down: {reason}")))
}

pub(super) fn port_lost(seen: &Observed) -> FindingText {
    let text = || {
        format!(
            "the port was lost {} times: look at the adapter's cable, hub and power, and at what switches nearby",
            seen.port_downs
        )
    };
    (seen.port_downs > 0).then(|| (Severity::Problem, text()))
}

pub(super) fn suspended(seen: &Observed) -> FindingText {
    let bad = seen.line.quality.bad_per_cent.unwrap_or_default();
    (seen.is_up() && seen.line.quality.is_suspended).then(|| (Severity::Problem, suspended_text(bad)))
}

pub(super) fn other_master(seen: &Observed) -> FindingText {
    let is_told = seen.line.suspicion == Some(Suspicion::OtherMaster);
    let text = || {
        format!(
            "another master sent {} requests on this line: a serial line takes one master only; disconnect the other one",
            seen.other_master
        )
    };
    (seen.other_master >= SIGNS && !is_told).then(|| (Severity::Problem, text()))
}

pub(super) fn stranger(seen: &Observed) -> FindingText {
    let known = seen.sum(|drive| drive.damage.late + drive.damage.doubled);
    let strangers = (seen.strays + seen.foreign).saturating_sub(known);
    let text = || {
        format!(
            "{strangers} frames came from stations that are not configured here: another device, or a drive whose number \
             was changed; list it under the line, or find out whom it answers"
        )
    };
    (strangers >= SIGNS).then(|| (Severity::Problem, text()))
}

/// Bytes when the line should be silent. A few are caused by the adapter's own change of direction.
pub(super) fn floating(seen: &Observed) -> FindingText {
    let led = seen.sum(|drive| drive.damage.led);
    let between = seen.noise_between;
    let text = || {
        format!(
            "bytes that belong to no frame came {led} times in front of replies and {between} times between exchanges: \
             the line floats while no device sends; it needs bias resistors at one place, its termination (120 ohm) at both \
             ends and nowhere else, and a common ground"
        )
    };
    let severity = if (led + between) * 50 >= seen.exchanges() { Severity::Problem } else { Severity::Hint };
    (led + between >= SIGNS).then(|| (severity, text()))
}

pub(super) fn over_full(seen: &Observed) -> FindingText {
    let planned = seen.line.planned_use_per_mille;
    (planned > 1000).then(|| (Severity::Hint, over_full_text(planned)))
}

pub(super) fn echo_stripped(seen: &Observed) -> FindingText {
    let is_told = seen.line.suspicion == Some(Suspicion::Echo);
    let text = "the adapter sends back what is sent, and that is taken out, as configured".to_owned();
    (seen.is_up() && seen.echoes >= SIGNS && !is_told).then_some((Severity::Good, text))
}

pub(super) fn few_exchanges(seen: &Observed) -> FindingText {
    let exchanges = seen.exchanges();
    let text = || format!("{exchanges} exchanges in {} s are too few to judge: watch longer", seen.time.as_secs());
    (seen.is_up() && exchanges < ENOUGH).then(|| (Severity::Hint, text()))
}
