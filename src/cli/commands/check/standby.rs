//! The part of `check` about a second gateway on a line: what a take-over takes at most.

use super::text::{list, ms};
use crate::config::line_plan::{TakeOver, take_over};
use crate::config::{LineSettings, line_plan};
use crate::domain::standby::{OnGatewayLost, StandbyPair};
use crate::line::standby::{RANK_STEP, SIGNAL_AFTER};
use std::fmt::{Result, Write};
use std::time::Duration;

/// One row on a line with a second gateway; `None` without one.
pub(super) fn summary(line: &LineSettings) -> Option<String> {
    let pair = line.standby.as_ref()?;
    let TakeOver {
        times,
        first_stop,
        fresh,
        ..
    } = take_over(line, pair);
    let stop = if stops(line).next().is_some() {
        format!("first STOP after {}, ", ms(first_stop))
    } else {
        String::new()
    };
    Some(format!(
        "standby on {} ({}, rank {}; the other one is {}): T1 {}, T2 {}, T3 {}; if {} is lost, at most: {stop}fresh values and \
         commands after {}",
        line.name,
        pair.half,
        pair.rank,
        pair.partner,
        ms(SIGNAL_AFTER),
        ms(times.silent_at_most),
        ms(times.take_over_after),
        pair.partner,
        ms(fresh),
    ))
}

/// Drives that are stopped or cut off by a take-over, with the action.
fn stops(line: &LineSettings) -> impl Iterator<Item = (&str, OnGatewayLost)> {
    let controlled = line
        .drives
        .iter()
        .filter_map(|drive| Some((drive.name.as_str(), drive.control.as_ref()?)));
    let lost = controlled.filter_map(|(name, control)| Some((name, control.on_gateway_lost?)));
    lost.filter(|(_, lost)| matches!(lost, OnGatewayLost::Stop | OnGatewayLost::Coast))
}

/// Appends the times of the rule on `line`, the worst times of a take-over, and what these consist of.
pub(super) fn describe(text: &mut String, line: &LineSettings) -> Result {
    let Some(pair) = &line.standby else {
        return Ok(());
    };
    let longest = take_over(line, pair);
    rule(text, line, pair, &longest)?;
    writeln!(text, "    if {} is lost, at most after that:", pair.partner)?;
    first_signal(text, pair, &longest)?;
    let stopped: Vec<_> = stops(line)
        .map(|(name, lost)| format!("{name} ({})", lost.keyword()))
        .collect();
    first_and_last_stop(text, &stopped, &longest)?;
    fresh_values(text, line, stopped.is_empty(), &longest)
}

/// Who sends, who listens, and when this gateway takes `line` over.
fn rule(text: &mut String, line: &LineSettings, pair: &StandbyPair, longest: &TakeOver) -> Result {
    let TakeOver {
        times, exchange, ..
    } = *longest;
    let (half, partner) = (&pair.half, &pair.partner);
    writeln!(
        text,
        "  standby: this gateway is {half} with rank {}, the other one is {partner}",
        pair.rank
    )?;
    writeln!(
        text,
        "    who is active sends at least every {} (T1),",
        ms(SIGNAL_AFTER)
    )?;
    let silent = ms(times.silent_at_most);
    writeln!(
        text,
        "    and listens first if it has not sent for {silent} (T2; the longest exchange is {})",
        ms(exchange)
    )?;
    writeln!(
        text,
        "    {half} takes the line over after {} of silence (T3{})",
        ms(times.take_over_after),
        made_of(line)
    )
}

/// When this gateway sends for the first time.
fn first_signal(text: &mut String, pair: &StandbyPair, longest: &TakeOver) -> Result {
    let TakeOver {
        times,
        exchange,
        begins,
        ..
    } = *longest;
    writeln!(
        text,
        "      {}: {} has said that it sends (a last reply {}, T3, up to {} if both gave the line up, a signal)",
        ms(begins),
        pair.half,
        ms(exchange),
        ms(times
            .worst_take_over()
            .saturating_sub(times.take_over_after)),
    )
}

/// When the drives in `stopped` are stopped.
fn first_and_last_stop(text: &mut String, stopped: &[String], longest: &TakeOver) -> Result {
    if stopped.is_empty() {
        return writeln!(
            text,
            "      no STOP: `on_gateway_lost` stops no drive of the line"
        );
    }
    writeln!(
        text,
        "      {}: the first STOP starts (and the bound of a stop on the line)",
        ms(longest.first_stop)
    )?;
    if stopped.len() > 1 {
        writeln!(
            text,
            "      {}: the last of {} STOPs starts",
            ms(longest.last_stop),
            stopped.len()
        )?;
    }
    writeln!(
        text,
        "        for those that were ordered to run: {}",
        list(stopped)
    )
}

/// When everything has been read again, and commands are accepted.
fn fresh_values(
    text: &mut String,
    line: &LineSettings,
    stops_none: bool,
    longest: &TakeOver,
) -> Result {
    let TakeOver {
        last_stop,
        settled,
        fresh,
        ..
    } = *longest;
    let refresh = ms(line_plan::refresh(line).time);
    let waits = if settled > last_stop {
        format!("no late reply is possible after {}, ", ms(settled))
    } else {
        String::new()
    };
    let effect = if stops_none {
        ""
    } else {
        "the effect of each STOP is read, "
    };
    writeln!(
        text,
        "      {}: all values are fresh ({waits}{effect}and one full refresh, {refresh}),",
        ms(fresh)
    )?;
    writeln!(text, "        and commands are accepted{}", delayed(line))
}

/// What T3 consists of.
fn made_of(line: &LineSettings) -> String {
    let Some(pair) = &line.standby else {
        return String::new();
    };
    let shortest = line_plan::shortest_standby_times(line).take_over_after;
    let base = pair.take_over_after.unwrap_or_default().max(shortest);
    let rank = RANK_STEP * u32::from(pair.rank);
    let of_rank = if rank > Duration::ZERO {
        format!(", and {} for its rank", ms(rank))
    } else {
        String::new()
    };
    match pair.take_over_after {
        Some(_) => format!(
            ": `take_over_after` {}, of at least {}{of_rank}",
            ms(base),
            ms(shortest)
        ),
        None => format!(": {} as the line needs{of_rank}", ms(base)),
    }
}

/// Until when plain RUN waits besides.
fn delayed(line: &LineSettings) -> String {
    let controls = line
        .drives
        .iter()
        .filter_map(|drive| drive.control.as_ref());
    let plain =
        controls.filter(|control| control.from_mqtt || control.from_page || control.from_sparkplug);
    let delay = plain
        .map(|control| control.restart_delay)
        .max()
        .unwrap_or_default();
    if delay.is_zero() {
        return String::new();
    }
    format!(
        "; RUN without `epoch` or `issued_at` up to {} (`restart_delay`) after a stop",
        ms(delay)
    )
}

#[cfg(test)]
mod tests {
    use crate::cli::commands::check::{report, summary};
    use crate::{config, vendors};

    /// Several vendors on line hall-1, of which `lines` of `standby` are shared, with `control` for its controlled drive.
    fn loaded(pair: &str, line: &str, control: &str) -> config::Config {
        let text = include_str!("../../../../tests/golden/config/several_vendors.toml");
        let text = text.replacen(
            "[[line]]\n",
            &format!("[standby]\nhalf = \"a\"\npartner = \"b\"\n{pair}\n[[line]]\n{line}\n"),
            1,
        );
        let text = text.replacen(
            "on_commander_lost",
            &format!("{control}\non_commander_lost"),
            1,
        );
        config::load(&text, &vendors::catalog()).unwrap_or_else(|problems| panic!("{problems:?}"))
    }

    /// Two commanded pumps on one line.
    fn pumps(lost: [&str; 2]) -> config::Config {
        let pump = |station: usize, lost: &str| {
            format!(
                "[[line.drive]]\nname = \"pump-{station}\"\nmodel = \"hyundai-n700\"\nstation = {station}\n[line.drive.control]\n\
                 from = [\"page\", \"modbus-tcp\"]\nfrequency_hz = {{ min = 5.0, max = 50.0 }}\nlost_after = \"60s\"\n\
                 on_commander_lost = \"stop\"\non_shutdown = \"stop\"\non_gateway_lost = \"{lost}\"\n"
            )
        };
        let text = format!(
            "[standby]\nhalf = \"a\"\npartner = \"b\"\nrank = 1\n[[line]]\nname = \"hall\"\nport = \"/dev/ttyUSB0\"\n\
             standby = true\n{}{}[[modbus_tcp]]\nlisten = \"127.0.0.1:1502\"\nwrite = [\"127.0.0.1/32\"]\n[http]\n\
             listen = \"127.0.0.1:8080\"\n[[http.users]]\nname = \"anna\"\npassword_hash_file = \"/anna.hash\"\n",
            pump(1, lost[0]),
            pump(2, lost[1])
        );
        config::load(&text, &vendors::catalog()).unwrap_or_else(|problems| panic!("{problems:?}"))
    }

    #[test]
    fn a_shared_line_is_told_with_its_worst_times() {
        let config = pumps(["stop", "coast"]);
        let found = report(&config);
        let part: String = found
            .lines()
            .skip_while(|row| !row.starts_with("  standby: "))
            .take_while(|row| !row.starts_with("  drive "))
            .fold(String::new(), |text, row| text + row + "\n");
        let expected = "  standby: this gateway is a with rank 1, the other one is b
    who is active sends at least every 500 ms (T1),
    and listens first if it has not sent for 1500 ms (T2; the longest exchange is 561 ms)
    a takes the line over after 3000 ms of silence (T3: 2500 ms as the line needs, and 500 ms for its rank)
    if b is lost, at most after that:
      4074 ms: a has said that it sends (a last reply 561 ms, T3, up to 500 ms if both gave the line up, a signal)
      4636 ms: the first STOP starts (and the bound of a stop on the line)
      4930 ms: the last of 2 STOPs starts
        for those that were ordered to run: pump-1 (stop), pump-2 (coast)
      5525 ms: all values are fresh (the effect of each STOP is read, and one full refresh, 247 ms),
        and commands are accepted; RUN without `epoch` or `issued_at` up to 3000 ms (`restart_delay`) after a stop
";
        assert_eq!(part, expected);
        assert!(found.contains("; other gateway lost: coast\n"), "{found}");
        let row = "standby on hall (a, rank 1; the other one is b): T1 500 ms, T2 1500 ms, T3 3000 ms; if b is lost, at most: first \
                   STOP after 4636 ms, fresh values and commands after 5525 ms\n";
        let summary = summary::summary(&config);
        assert!(summary.contains(row), "{summary}");
    }

    #[test]
    fn what_stops_nothing_promises_no_stop() {
        let config = loaded("", "standby = true", "on_gateway_lost = \"hold\"");
        assert!(
            report(&config)
                .contains("      no STOP: `on_gateway_lost` stops no drive of the line\n")
        );
        assert!(!summary::summary(&config).contains("first STOP"));
    }

    #[test]
    fn a_longer_silence_is_told_beside_what_the_line_needs() {
        let config = loaded(
            "take_over_after = \"9s\"",
            "standby = true",
            "on_gateway_lost = \"stop\"",
        );
        let found = report(&config);
        assert!(
            found.contains(
                "takes the line over after 9000 ms of silence (T3: `take_over_after` 9000 ms, of at"
            ),
            "{found}"
        );
    }

    #[test]
    fn a_line_of_its_own_is_told_as_before() {
        let text = include_str!("../../../../tests/golden/config/several_vendors.toml");
        let config = config::load(text, &vendors::catalog()).unwrap();
        assert!(!report(&config).contains("standby"));
        assert!(!summary::summary(&config).contains("standby"));
    }

    #[test]
    fn a_watchdog_that_acts_before_is_warned_about() {
        let e510 = include_str!("../../../../crates/model/src/vendors/teco/e510.toml");
        let e510 = e510
            .replace("\"program\"", "\"manual\"")
            .replace("\"commissioning-sheet\"", "\"manual\"");
        let e510 = e510.replace("\"third-party\"", "\"second-source\"");
        let mut others = vendors::texts().to_vec();
        others.retain(|(name, _)| *name != "teco/e510.toml");
        let catalog = crate::profile::catalog::Catalog::of_sound(&others)
            .with_texts([("teco/e510.toml", e510)])
            .unwrap();
        let checked = |take_over: &str| {
            let text = format!(
                "[standby]\nhalf = \"a\"\npartner = \"b\"\ntake_over_after = \"{take_over}\"\n[[line]]\nname = \"hall\"\nport = \
                 \"/dev/ttyUSB0\"\nstandby = true\n[[line.drive]]\nname = \"pump\"\nmodel = \"teco-e510\"\nstation = 1\n\
                 [line.drive.control]\nfrom = [\"modbus-tcp\"]\nfrequency_hz = {{ min = 5.0, max = 50.0 }}\nlost_after = \
                 \"60s\"\non_commander_lost = \"stop\"\non_shutdown = \"stop\"\non_gateway_lost = \"adopt\"\nwatchdog = \
                 \"10s\"\n[[modbus_tcp]]\nlisten = \"127.0.0.1:1502\"\nwrite = [\"127.0.0.1/32\"]\n"
            );
            let config =
                config::load(&text, &catalog).unwrap_or_else(|problems| panic!("{problems:?}"));
            (report(&config), summary::summary(&config))
        };
        let warning = "its own watchdog of 10s may act before gateway a takes the line over";
        let (report, summary) = checked("10s");
        assert!(
            report.contains(warning) && summary.contains(&format!("warning: pump: {warning}")),
            "{report}{summary}"
        );
        let (report, summary) = checked("auto");
        assert!(
            !report.contains(warning) && !summary.contains(warning),
            "{report}{summary}"
        );
        assert!(
            report.contains("    its own watchdog does not act before the line is taken over\n"),
            "{report}"
        );
    }
}
