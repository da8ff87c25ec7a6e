//! The metrics of the edge node itself: the gateway and its lines.

use super::payload::{PayloadMetric, PayloadType, PayloadValue, PropertyScalar, PropertySet};
use crate::domain::version::PROGRAM_VERSION;
use crate::north::broker::SessionLine;

/// The name of the metric that identifies a session; it has no alias.
pub(super) const BDSEQ: &str = "bdSeq";
/// The name of the metric that requests all births again; it has no alias.
pub(super) const REBIRTH: &str = "Node Control/Rebirth";
/// The name of the metric that stops all drives.
pub(super) const STOP_ALL: &str = "all/run/set";

/// The first aliases: version, then STOP for all, then the lines.
const VERSION_ALIAS: u64 = 1;
const STOP_ALL_ALIAS: u64 = 2;
const FIRST_LINE_ALIAS: u64 = 3;

/// The metrics of the edge node.
#[derive(Debug, Default)]
pub(super) struct EdgeNode {
    /// The last published state of each line.
    published: Vec<String>,
}

/// What a metric of a command for the edge node requests.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum NodeCommand<'m> {
    /// All births again, or not.
    Rebirth(Option<&'m PayloadValue>),
    /// STOP for all.
    All(Option<&'m PayloadValue>),
    /// Unknown here.
    Unknown,
}

/// What `metric` requests.
pub(super) fn asked(metric: &PayloadMetric) -> NodeCommand<'_> {
    let value = metric.value.as_ref();
    match (metric.name.as_deref(), metric.alias) {
        (Some(REBIRTH), _) => NodeCommand::Rebirth(value),
        (Some(STOP_ALL), _) | (None, Some(STOP_ALL_ALIAS)) => NodeCommand::All(value),
        _ => NodeCommand::Unknown,
    }
}

/// The first alias that a device may have, of a gateway with this many lines.
pub(super) const fn next_alias(lines: usize) -> u64 {
    FIRST_LINE_ALIAS + lines as u64
}

/// The metric that identifies a session.
pub(super) fn bdseq(number: u8, at_ms: u64) -> PayloadMetric {
    PayloadMetric {
        name: Some(BDSEQ.to_owned()),
        timestamp: Some(at_ms),
        datatype: Some(PayloadType::Int64 as u32),
        value: Some(PayloadValue::of_i64(number.into())),
        ..PayloadMetric::default()
    }
}

impl EdgeNode {
    /// All metrics of the edge node. `stops`: there are drives that a host may stop.
    pub(super) fn birth(
        &mut self,
        bdseq: PayloadMetric,
        at_ms: u64,
        lines: &[SessionLine],
        stops: bool,
    ) -> Vec<PayloadMetric> {
        let metric = |name: &str,
                      alias: Option<u64>,
                      datatype: PayloadType,
                      value: PayloadValue| PayloadMetric {
            name: Some(name.to_owned()),
            alias,
            timestamp: Some(at_ms),
            datatype: Some(datatype as u32),
            properties: read_only(alias.is_some_and(|alias| alias != STOP_ALL_ALIAS)),
            value: Some(value),
            ..PayloadMetric::default()
        };
        let text = |text: &str| PayloadValue::Text(text.to_owned());
        let mut all = vec![
            bdseq,
            metric(
                REBIRTH,
                None,
                PayloadType::Boolean,
                PayloadValue::Boolean(false),
            ),
        ];
        let version = PROGRAM_VERSION;
        all.push(metric(
            "Properties/version",
            Some(VERSION_ALIAS),
            PayloadType::Text,
            text(version),
        ));
        if stops {
            all.push(metric(
                STOP_ALL,
                Some(STOP_ALL_ALIAS),
                PayloadType::Text,
                text(""),
            ));
        }
        self.published = lines.iter().map(status).collect();
        let of_lines = (FIRST_LINE_ALIAS..)
            .zip(lines.iter().zip(&self.published))
            .map(|(alias, (line, status))| {
                metric(
                    &format!("line/{}/status", line.name),
                    Some(alias),
                    PayloadType::Text,
                    text(status),
                )
            });
        all.extend(of_lines);
        all
    }

    /// What has changed since it was last published.
    pub(super) fn data(&mut self, at_ms: u64, lines: &[SessionLine]) -> Vec<PayloadMetric> {
        let mut changed = Vec::new();
        for ((alias, line), published) in (FIRST_LINE_ALIAS..).zip(lines).zip(&mut self.published) {
            let status = status(line);
            if status == *published {
                continue;
            }
            published.clone_from(&status);
            let value = Some(PayloadValue::Text(status));
            let timestamp = Some(at_ms);
            let datatype = Some(PayloadType::Text as u32);
            changed.push(PayloadMetric {
                alias: Some(alias),
                timestamp,
                datatype,
                value,
                ..PayloadMetric::default()
            });
        }
        changed
    }
}

fn status(line: &SessionLine) -> String {
    line.report
        .down_reason()
        .map_or_else(|| "up".to_owned(), |reason| format!("down: {reason}"))
}

fn read_only(is_read_only: bool) -> Option<PropertySet> {
    let set = PropertySet::default();
    Some(set.with(
        "readOnly",
        PayloadType::Boolean,
        PropertyScalar::Boolean(is_read_only),
    ))
}
