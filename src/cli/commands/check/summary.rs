//! `check` on one page: each line with its use and its slowest stop, each way in, and the warnings, equal ones once.

use super::drive::settings;
use super::text::ms;
use super::{beside_modbus, link_text, of_listener, standby, warnings};
use crate::cli::tools::output::few;
use crate::config::{Config, LineSettings, line_plan};
use crate::domain::report::StopBounds;
use std::fmt::Write;

/// Most drives that a folded warning names.
const NAMES_MAX: usize = 4;

/// A summary of `config`, which has no problems.
pub(super) fn summary(config: &Config) -> String {
    let mut text = String::new();
    for line in &config.lines {
        let _ = writeln!(text, "{}", of_line(line));
        if let Some(standby) = standby::summary(line) {
            let _ = writeln!(text, "{standby}");
        }
    }
    for listener in &config.listeners {
        let _ = writeln!(text, "{}", of_listener(listener));
    }
    text.push_str(&beside_modbus(config));
    for (of, warning) in folded(config) {
        let _ = writeln!(text, "warning: {}: {warning}", few(&of, NAMES_MAX));
    }
    if let Some(drives) = to_be_set(config) {
        let _ = writeln!(text, "to be set at the drives: {drives}");
    }
    text.push_str(
        "`check --verbose` shows the polls, the orders and what must be set at each drive\n",
    );
    text
}

fn of_line(line: &LineSettings) -> String {
    let controlled = line
        .drives
        .iter()
        .filter(|drive| drive.control.is_some())
        .count();
    let drives = match line.drives.len() {
        1 => "1 drive".to_owned(),
        drives => format!("{drives} drives"),
    };
    let StopBounds {
        all_healthy,
        one_silent,
        ..
    } = line_plan::stop_bounds(line);
    let stop = if controlled == 0 {
        String::new()
    } else {
        format!(
            "; slowest STOP {}, {} beside a silent drive",
            ms(all_healthy),
            ms(one_silent)
        )
    };
    format!(
        "line {} ({}, {}): {drives}, {controlled} controlled; polls use {:.1} %{stop}",
        line.name,
        line.port,
        link_text(line),
        line_plan::budget(line).use_of_line * 100.0
    )
}

/// Each warning once, with what it is about, in the order of the file.
fn folded(config: &Config) -> Vec<(Vec<String>, String)> {
    let of_lines = config.lines.iter().flat_map(|line| {
        let own = warnings::over_full(line).map(|text| (format!("line {}", line.name), text));
        let drives = line.drives.iter();
        let drives = drives.flat_map(|drive| {
            warnings::of_drive(line, drive).map(|text| (drive.name.to_string(), text))
        });
        own.into_iter().chain(drives).collect::<Vec<_>>()
    });
    let bridged = config
        .listeners
        .iter()
        .filter_map(warnings::behind_a_bridge);
    let bridged = bridged.map(|(networks, text)| (networks, text.to_owned()));
    let mut folded: Vec<(Vec<String>, String)> = Vec::new();
    for (of, text) in of_lines.chain(bridged) {
        match folded.iter_mut().find(|(_, known)| *known == text) {
            Some((all, _)) => all.push(of),
            None => folded.push((vec![of], text)),
        }
    }
    folded
}

/// The controlled drives with settings that must be made at them, each with their number.
fn to_be_set(config: &Config) -> Option<String> {
    let drives = config
        .lines
        .iter()
        .flat_map(|line| line.drives.iter().map(move |drive| (line, drive)));
    let counts = drives.filter_map(|(line, drive)| {
        let bus = drive.control.as_ref()?.bus;
        let settings = settings(&drive.model, line, bus).count();
        (settings > 0).then(|| format!("{} ({settings})", drive.name))
    });
    let counts: Vec<_> = counts.collect();
    (!counts.is_empty()).then(|| few(&counts, NAMES_MAX))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{config, vendors};

    fn shown(text: &str) -> String {
        summary(&config::load(text, &vendors::catalog()).unwrap())
    }

    #[test]
    fn a_line_of_several_vendors_is_one_row() {
        let found = shown(include_str!(
            "../../../../tests/golden/config/several_vendors.toml"
        ));
        let row = "line hall-1 (/dev/ttyUSB0, 9600 8N1): 4 drives, 1 controlled; polls use 68.8 %; slowest STOP 1060 ms, \
                   1292 ms beside a silent drive\n";
        assert!(found.contains(row), "{found}");
        assert!(
            found.contains("warning: line hall-2: the plan is over-full"),
            "{found}"
        );
        assert!(found.contains("pump-1 (2)"), "{found}");
        assert!(!found.contains("a read of"), "{found}");
    }

    #[test]
    fn thirty_two_equal_warnings_are_one_row() {
        let drive = |station: u32| {
            format!(
                "[[line.drive]]\nname = \"pump-{station}\"\nmodel = \"toshiba-vf-as1\"\nstation = {station}\n\
                 [line.drive.control]\nfrom = [\"modbus-tcp\"]\nfrequency_hz = {{ min = 5.0, max = 50.0 }}\n\
                 lost_after = \"60s\"\non_commander_lost = \"stop\"\non_shutdown = \"stop\"\n\
                 accept_unverified = [\"basic\"]\n"
            )
        };
        let text = format!(
            "[[line]]\nname = \"hall\"\nport = \"/dev/ttyUSB0\"\nbaud = 38400\n{}[[modbus_tcp]]\nlisten = \"127.0.0.1:1502\"\n\
             write = [\"127.0.0.1/32\"]\n",
            (1..=32).map(drive).collect::<String>()
        );
        let found = shown(&text);
        let rows: Vec<_> = found
            .lines()
            .filter(|row| row.contains("takes control from panel"))
            .collect();
        assert_eq!(rows.len(), 1, "{found}");
        assert!(
            rows[0]
                .starts_with("warning: pump-1, pump-2, pump-3, pump-4 and 28 more: every command"),
            "{rows:?}"
        );
        assert!(found.lines().count() < 10, "{found}");
    }
}
