//! The report of a line as a document.

use super::rules::verdict;
use super::{DriveObserved, LineObserved};
use crate::domain::ids::Name;
use crate::domain::link::Wiring;
use crate::domain::report::{LineState, REPLY_CLASSES, ReplyReport};
use crate::drive::snapshot::DrivePresence;
use crate::north::api::{
    DriveReportDocument, LineReportDocument, RatesDocument, ReplyTimesDocument,
};
use crate::north::finding::{self, Finding};
use std::time::Duration;

/// What was `observed` on the line called `name`, with its verdict.
#[must_use]
pub fn document(name: &Name, wiring: &Wiring, observed: &LineObserved) -> LineReportDocument {
    let line = &observed.line;
    let is_up = line.state == LineState::Up;
    let suspicion = line.suspicion.map(|suspicion| suspicion.keyword());
    LineReportDocument {
        line: name.to_string().into(),
        state: if is_up { "up" } else { "down" }.into(),
        reason: line.down_reason(),
        reason_said: finding::down_reason(line).map(|it| it.document()).into(),
        port: wiring.port.clone().into(),
        link: wiring.characters().map(|link| link.to_string().into()),
        observed_s: Some((observed.time.as_secs_f64() * 10.0).round() / 10.0),
        suspicion: suspicion.map(str::to_owned),
        verdict: verdict(name, observed)
            .iter()
            .map(Finding::document)
            .collect(),
        rates: rates(observed),
        drives: observed.drives.iter().map(|it| drive(it, is_up)).collect(),
    }
}

fn rates(observed: &LineObserved) -> RatesDocument {
    let all = observed.exchanges();
    let per_mille =
        |count: u64| (all > 0).then(|| (count as f64 * 10_000.0 / all as f64).round() / 10.0);
    RatesDocument {
        exchanges: Some(all),
        good_per_mille: per_mille(
            observed.sum(|drive| drive.exchanges.replies + drive.exchanges.exceptions),
        ),
        silent_per_mille: per_mille(observed.sum(DriveObserved::silent)),
        garbled_per_mille: per_mille(observed.sum(|drive| drive.damage.damaged)),
        stray_per_mille: per_mille(observed.strays),
        foreign: observed.foreign,
        other_master: observed.other_master,
        echoes: observed.echoes,
        noise_bytes: observed.noise_bytes,
        noise_between: observed.noise_between,
    }
}

fn drive(drive: &DriveObserved, line_is_up: bool) -> DriveReportDocument {
    let DriveObserved {
        now,
        exchanges,
        damage,
    } = drive;
    let replies = REPLY_CLASSES
        .into_iter()
        .zip(&now.report.replies)
        .filter(|(_, reply)| reply.count > 0);
    let presence = match now.presence {
        DrivePresence::Unknown => "unknown",
        DrivePresence::Online if line_is_up => "online",
        DrivePresence::Online | DrivePresence::Offline => "offline",
    };
    DriveReportDocument {
        name: now.name.to_string().into(),
        station: Some(now.station.0),
        presence: presence.into(),
        exchanges: Some(exchanges.total()),
        silent: Some(drive.silent()),
        damaged: Some(damage.damaged),
        first_characters_damaged: Some(damage.head),
        cut: Some(damage.cut),
        late: Some(damage.late),
        late_beyond_limit: Some(damage.beyond_limit),
        doubled: Some(damage.doubled),
        exceptions: Some(exchanges.exceptions),
        retries: Some(exchanges.retries),
        replies: replies.map(|(class, reply)| times(class, reply)).collect(),
    }
}

fn times(class: &'static str, reply: &ReplyReport) -> ReplyTimesDocument {
    ReplyTimesDocument {
        class: class.into(),
        count: Some(reply.count),
        p50_ms: Some(millis(reply.p50)),
        p90_ms: Some(millis(reply.p90)),
        p99_ms: Some(millis(reply.p99)),
        p999_ms: Some(millis(reply.p999)),
        max_ms: Some(millis(reply.max)),
        timeout_ms: Some(millis(reply.timeout)),
        suggested_timeout_ms: reply.suggested.map(millis),
    }
}

/// To a hundredth, rounded up.
fn millis(time: Duration) -> f64 {
    time.as_micros().div_ceil(10) as f64 / 100.0
}

#[cfg(test)]
mod tests {
    use super::super::testing::{good, idle, line_name};
    use super::*;
    use serde_json::Value;

    /// The document on the wire.
    fn document(name: &Name, wiring: &Wiring, observed: &LineObserved) -> Value {
        serde_json::to_value(super::document(name, wiring, observed)).unwrap()
    }

    #[test]
    fn a_good_line_is_reported_in_numbers() {
        let report = document(&line_name(), &Wiring::default(), &good());
        assert_eq!(report["link"], "9600 8N1");
        assert_eq!(
            (&report["state"], &report["reason"], &report["suspicion"]),
            (&"up".into(), &Value::Null, &Value::Null)
        );
        assert_eq!(report["observed_s"], 30.0);
        assert_eq!(report["rates"]["exchanges"], 2000);
        assert_eq!(report["rates"]["good_per_mille"], 1000.0);
        assert_eq!(
            report["verdict"].as_array().map(Vec::len),
            Some(1),
            "{report}"
        );
        let drive = &report["drives"][0];
        assert_eq!(
            (&drive["name"], &drive["station"], &drive["presence"]),
            (&"a".into(), &1.into(), &"online".into())
        );
        let replies = drive["replies"].as_array().unwrap();
        assert_eq!(replies.len(), 1, "of writes nothing is known");
        let read = |key: &str| replies[0][key].clone();
        assert_eq!(read("class"), "read");
        assert_eq!(
            (read("p50_ms"), read("suggested_timeout_ms")),
            (4.0.into(), 30.0.into())
        );
    }

    #[test]
    fn shares_are_of_all_exchanges_and_a_time_out_with_bytes_is_damage() {
        let mut observed = good();
        let drive = &mut observed.drives[0];
        drive.exchanges.replies = 980;
        drive.exchanges.exceptions = 5;
        drive.exchanges.silent = 8;
        drive.exchanges.garbled = 7;
        drive.damage.damaged = 10;
        observed.strays = 4;
        let rates = &document(&line_name(), &Wiring::default(), &observed)["rates"];
        for (key, per_mille) in [
            ("good", 992.5),
            ("silent", 2.5),
            ("garbled", 5.0),
            ("stray", 2.0),
        ] {
            assert_eq!(rates[format!("{key}_per_mille")], per_mille, "{key}");
        }
    }

    #[test]
    fn nothing_is_a_share_of_nothing() {
        let rates = &document(&line_name(), &Wiring::default(), &idle())["rates"];
        assert_eq!(
            (&rates["exchanges"], &rates["good_per_mille"]),
            (&0.into(), &Value::Null)
        );
    }
}
