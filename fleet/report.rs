//! The result of a simulation, as text and as JSON.

use super::specimen::{Specimen, Volume};
use crate::books::Mark;
use crate::play::{Outcome, Plan};
use serde_json::{Value, json};
use std::fmt::Write;
use std::time::Duration;
use vfd_gateway::north::broker::Qos;

/// Share of due updates that must have been sent for the rate to count as held: one that is due at the very end may be
/// sent just after it.
const HELD: f64 = 0.999;

/// The plan of a simulation and its result.
#[derive(Debug)]
pub struct Report<'a> {
    pub plan: &'a Plan,
    pub specimen: &'a Specimen,
    pub outcome: &'a Outcome,
}

impl Report<'_> {
    /// Why the command fails; `None` if it does not.
    pub fn complaint(&self) -> Option<String> {
        let missing = self.outcome.at_end.acknowledged_missing;
        let is_checked = self.plan.qos == Qos::AtLeastOnce && !self.plan.consumers.is_empty();
        (is_checked && missing > 0)
            .then(|| format!("{missing} messages that the broker had acknowledged did not arrive"))
    }

    fn a_second(&self, count: u64) -> f64 {
        count as f64 / self.outcome.seconds.max(f64::EPSILON)
    }

    /// Whether updates were sent as fast as they were due.
    fn is_held(&self) -> bool {
        self.outcome.at_last.sent as f64 >= self.outcome.due as f64 * HELD
    }

    fn payload_bytes(&self) -> usize {
        let mark = Mark::new(
            self.plan.shape.updates,
            vfd_gateway::daemon::host::clock::now(),
        );
        mark.on(self.plan.shape.update, &self.plan.state).len()
    }

    fn topic_bytes(&self) -> usize {
        self.plan.shape.topic(0, 0).len()
    }

    /// As JSON.
    pub fn json(&self) -> Value {
        let Self {
            plan,
            specimen,
            outcome,
        } = self;
        let shape = &plan.shape;
        json!({
            "gateways": shape.gateways, "drives": shape.drives_of_all(), "model": specimen.model,
            "topic": shape.update.topic(), "payload_bytes": self.payload_bytes(), "topic_bytes": self.topic_bytes(),
            "qos": u8::from(plan.qos == Qos::AtLeastOnce), "retained": plan.retain, "consumers": plan.consumers.len(),
            "seconds": outcome.seconds, "is_cut": outcome.is_cut, "is_held": self.is_held(),
            "per_second": {
                "due": self.a_second(outcome.due), "sent": self.a_second(outcome.at_last.sent),
                "acknowledged": self.a_second(outcome.at_last.acknowledged),
                "received": self.a_second(outcome.at_last.received),
            },
            "due": outcome.due, "sent": outcome.at_end.sent, "acknowledged": outcome.at_end.acknowledged,
            "received": outcome.at_end.received, "acknowledged_missing": outcome.at_end.acknowledged_missing,
            "unacknowledged_missing": outcome.at_end.unacknowledged_missing, "received_messages": outcome.received,
            "again": outcome.again, "late": outcome.late, "foreign": outcome.foreign, "refused": outcome.refused,
            "repeated": outcome.repeated, "connections": outcome.connections, "broken": outcome.broken,
            "delay_ms": shares(&outcome.delays), "acknowledgement_ms": shares(&outcome.acknowledgements),
            "birth": {
                "all": volume(specimen.births[0]), "documents": volume(specimen.births[1]),
            },
            "processes": outcome.costs.iter().map(|(cost, processors)| json!({
                "pid": cost.process, "name": cost.name, "processors": processors, "resident_kb": cost.resident_kb,
            })).collect::<Vec<_>>(),
        })
    }

    /// As text.
    pub fn text(&self) -> String {
        let mut text = String::new();
        // Writing to a String cannot fail.
        let _ = self.write(&mut text);
        text
    }

    fn write(&self, to: &mut String) -> std::fmt::Result {
        self.write_plan(to)?;
        self.write_rates(to)?;
        self.write_delays(to)?;
        self.write_totals(to)?;
        self.write_costs(to)
    }

    fn write_plan(&self, to: &mut String) -> std::fmt::Result {
        let Self {
            plan,
            specimen,
            outcome,
        } = self;
        let shape = &plan.shape;
        let cut = if outcome.is_cut { ", cut short" } else { "" };
        writeln!(
            to,
            "{} gateways x {} drives ({}), {:.0} s{cut}; `{}`: topic {} bytes, payload {} bytes, QoS {}{}",
            shape.gateways,
            shape.drives,
            specimen.model,
            outcome.seconds,
            shape.update.topic(),
            self.topic_bytes(),
            self.payload_bytes(),
            u8::from(plan.qos == Qos::AtLeastOnce),
            if plan.retain { ", retained" } else { "" },
        )
    }

    /// How many messages passed in a second.
    fn write_rates(&self, to: &mut String) -> std::fmt::Result {
        let Self { plan, outcome, .. } = self;
        let at_last = &outcome.at_last;
        writeln!(to, "\nmessages a second")?;
        writeln!(to, "  due           {:>10.0}", self.a_second(outcome.due))?;
        let held = if self.is_held() {
            ""
        } else {
            "   the rate is not held"
        };
        writeln!(
            to,
            "  sent          {:>10.0}{held}",
            self.a_second(at_last.sent)
        )?;
        if plan.qos == Qos::AtLeastOnce {
            writeln!(
                to,
                "  acknowledged  {:>10.0}",
                self.a_second(at_last.acknowledged)
            )?;
        }
        writeln!(
            to,
            "  received      {:>10.0}",
            self.a_second(at_last.received)
        )
    }

    fn write_delays(&self, to: &mut String) -> std::fmt::Result {
        let Self { plan, outcome, .. } = self;
        writeln!(to, "\nlate by               half      99 %       all")?;
        if plan.qos == Qos::AtLeastOnce {
            writeln!(to, "  acknowledged  {}", row(&outcome.acknowledgements))?;
        }
        writeln!(to, "  received      {}", row(&outcome.delays))
    }

    /// The outcome of all messages.
    fn write_totals(&self, to: &mut String) -> std::fmt::Result {
        let Self { plan, outcome, .. } = self;
        let at_end = &outcome.at_end;
        writeln!(
            to,
            "\nin the end: {} due, {} sent, {} received",
            outcome.due, at_end.sent, at_end.received
        )?;
        if plan.qos == Qos::AtLeastOnce {
            writeln!(to, "  acknowledged  {:>10}", at_end.acknowledged)?;
            writeln!(to, "  of these lost {:>10}", at_end.acknowledged_missing)?;
            writeln!(to, "  sent again    {:>10}", outcome.repeated)?;
        }
        writeln!(
            to,
            "  not received  {:>10}",
            at_end.acknowledged_missing + at_end.unacknowledged_missing
        )?;
        writeln!(to, "  twice         {:>10}", outcome.again)?;
        writeln!(to, "  out of order  {:>10}", outcome.late)?;
        if outcome.refused + outcome.foreign > 0 {
            writeln!(
                to,
                "  refused       {:>10}\n  foreign       {:>10}",
                outcome.refused, outcome.foreign
            )?;
        }
        Ok(())
    }

    /// What the simulation and a real gateway cost.
    fn write_costs(&self, to: &mut String) -> std::fmt::Result {
        let Self {
            specimen, outcome, ..
        } = self;
        writeln!(
            to,
            "\nconnections {}, broken {}",
            outcome.connections, outcome.broken
        )?;
        let [all, documents] = specimen
            .births
            .map(|it| format!("{} messages, {} kB", it.messages, it.bytes / 1000));
        writeln!(
            to,
            "a real gateway is born with {all}; with publish = [\"state\"]: {documents}"
        )?;
        for (cost, processors) in &outcome.costs {
            let name = &cost.name;
            let process = cost.process;
            let megabytes = cost.resident_kb / 1000;
            writeln!(
                to,
                "{name} ({process}): {processors:.2} processors, {megabytes} MB"
            )?;
        }
        Ok(())
    }
}

fn millis(time: Duration) -> f64 {
    (time.as_secs_f64() * 1e6).round() / 1e3
}

fn row(times: &[Duration; 3]) -> String {
    times
        .iter()
        .map(|time| format!("{:>7.1} ms", millis(*time)))
        .collect()
}

fn shares(times: &[Duration; 3]) -> Value {
    json!({"p50": millis(times[0]), "p99": millis(times[1]), "max": millis(times[2])})
}

fn volume(volume: Volume) -> Value {
    json!({"messages": volume.messages, "bytes": volume.bytes})
}
