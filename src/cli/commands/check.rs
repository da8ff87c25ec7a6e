//! `check`: reports all problems of a configuration at once, or what it means, on one page or in full. Opens nothing.

mod drive;
mod standby;
mod summary;
mod text;
mod warnings;

use crate::cli::tools::input::FileFindings;
use crate::cli::tools::log::complain;
use crate::cli::tools::{CommandFailure, input, print};
use crate::config::words::LEASES;
use crate::config::{
    Config, DriveSettings, HttpSettings, LineSettings, ListenerSettings, MqttSettings, PortAddress,
    SerialMasterSettings, SparkplugSettings, line_plan,
};
use crate::domain::command::Rights;
use crate::domain::link::{DirectionControl, EchoPolicy, Framing, Interface};
use crate::domain::problem::Problem;
use crate::domain::report::StopBounds;
use crate::line::budget::{ASSUMED_TURNAROUND, RefreshCost};
use crate::toml_file::words::{FRAMINGS, INTERFACES, word_for};
use ipnet::IpNet;
use serde_json::{Value, json};
use std::fmt::Write;
use std::path::PathBuf;
use std::time::Duration;
use text::{list, ms};

/// Arguments of `check`.
#[derive(Debug, clap::Args)]
pub struct Args {
    /// The configuration file
    #[arg(short, long, value_name = "FILE")]
    config: PathBuf,
    /// Print what it means in full: polls, times, orders, and what must be set at each drive
    #[arg(short, long, conflicts_with = "json")]
    verbose: bool,
    /// Print problems and warnings as JSON only
    #[arg(long)]
    json: bool,
}

/// Checks the configuration and prints its meaning, after warnings about what has no effect.
pub fn check(args: &Args) -> Result<(), CommandFailure> {
    let (loaded, text) = input::looked_through(&args.config)?;
    let of_this = |problems| FileFindings {
        path: args.config.clone(),
        text,
        problems,
    };
    let (config, found) = match loaded {
        Ok(config) => {
            let warnings = config.warnings.clone();
            (Ok(config), vec![of_this(warnings)])
        }
        Err(found) => (Err(CommandFailure::wrong(input::drawn(&found))), found),
    };
    if args.json {
        print(&format!("{}\n", findings_json(&found, config.is_ok())))?;
        return config
            .map(drop)
            .map_err(|_| CommandFailure::wrong("the configuration cannot be used"));
    }
    let config = config?;
    if !config.warnings.is_empty() {
        complain(format!("{}\n\n", input::drawn(&found)).as_bytes());
    }
    if args.verbose {
        return print(&report(&config));
    }
    print(&format!(
        "{}: OK\n{}",
        args.config.display(),
        summary::summary(&config)
    ))
}

/// The findings, for programs.
fn findings_json(found: &[FileFindings], is_usable: bool) -> Value {
    let problem = |of: &FileFindings, problem: &Problem| {
        let (line, column) = problem.place_in(&of.text);
        json!({
            "severity": if problem.is_warning { "warning" } else { "error" },
            "file": of.path.display().to_string(),
            "line": line,
            "column": column,
            "key": problem.key,
            "what": problem.what,
            "right": problem.right,
        })
    };
    let problems = found
        .iter()
        .flat_map(|of| of.problems.iter().map(move |it| problem(of, it)));
    json!({ "usable": is_usable, "problems": problems.collect::<Vec<_>>() })
}

/// The meaning of a valid configuration, line by line.
fn report(config: &Config) -> String {
    let mut text = String::new();
    for line in &config.lines {
        let _ = describe_line(&mut text, line, config.mqtt.as_ref());
    }
    for listener in &config.listeners {
        let _ = writeln!(text, "{}", of_listener(listener));
        if let Some((networks, warning)) = warnings::behind_a_bridge(listener) {
            let _ = writeln!(text, "  warning: {networks}: {warning}");
        }
    }
    text + &beside_modbus(config)
}

fn of_master(master: &SerialMasterSettings) -> String {
    let framing = word_for(&FRAMINGS, &master.framing);
    let may = match (
        master.serving.write.is_empty(),
        master.serving.stop.as_ref(),
    ) {
        (false, _) => "may write",
        (true, Some(stop)) if !stop.is_empty() => "may read and stop",
        _ => "may read",
    };
    format!(
        "serial master {} at {} ({} {framing}): {may}; answered within {} ms{}",
        master.name,
        master.port,
        master.link,
        master.answer_within.as_millis(),
        of_memory(&master.serving)
    )
}

const fn of_memory(listener: &ListenerSettings) -> &'static str {
    if listener.cached {
        "; native reads may be answered from memory"
    } else {
        ""
    }
}

/// The ways in beside Modbus TCP, a row each.
fn beside_modbus(config: &Config) -> String {
    let mut text = String::new();
    for master in &config.serial_masters {
        let _ = writeln!(text, "{}", of_master(master));
    }
    if let Some(mqtt) = &config.mqtt {
        let _ = writeln!(text, "{}", of_mqtt(mqtt, config));
        if let Some(sparkplug) = &mqtt.sparkplug {
            let _ = writeln!(text, "{}", of_sparkplug(sparkplug, config));
        }
    }
    if let Some(http) = &config.http {
        let _ = writeln!(text, "{}", of_http(http));
    }
    text
}

fn of_listener(listener: &ListenerSettings) -> String {
    // A right that no role grants is granted to no client, from whatever address.
    let is_granted = |is: fn(&Rights) -> bool| {
        listener
            .tls
            .as_ref()
            .is_none_or(|tls| tls.roles.values().any(is))
    };
    let networks = |networks: &[IpNet], is| {
        if is_granted(is) {
            list(networks)
        } else {
            String::new()
        }
    };
    let write = networks(&listener.write, |rights| rights.write);
    let stop = networks(
        listener.stop.as_ref().unwrap_or(&listener.write),
        |rights| rights.stop,
    );
    let rights = match (write.is_empty(), stop.is_empty()) {
        (true, true) => "read-only".to_owned(),
        (true, false) => format!("read-only, except that {stop} may stop"),
        (false, _) if write == stop => format!("{write} may write and stop"),
        (false, _) => format!("{write} may write, {stop} may stop"),
    };
    let roles = listener.tls.as_ref().map_or(
        "",
        |_| ", each as far as the role in its certificate grants it",
    );
    let renew = if listener.reads_renew {
        "; reads renew a lease"
    } else {
        ""
    };
    let cached = of_memory(listener);
    let units = listener
        .units
        .as_ref()
        .map_or_else(String::new, |units| format!("; units {} only", list(units)));
    let most = listener
        .connections_max
        .map_or_else(String::new, |most| format!("; at most {most} clients"));
    let priority = match &listener.priority[..] {
        [] => String::new(),
        networks => format!("; {} never give way to others", list(networks)),
    };
    format!(
        "Modbus TCP on {}: {rights}{roles}{renew}{cached}{units}{most}{priority}",
        listener.listen
    )
}

fn of_http(http: &HttpSettings) -> String {
    let scheme = if http.tls.is_some() { "HTTPS" } else { "HTTP" };
    let names: Vec<_> = http.users.iter().map(|user| user.name).collect();
    let rights = if names.is_empty() {
        "read-only".to_owned()
    } else {
        format!("{} may sign in and command", list(&names))
    };
    format!("{scheme} on {}: {rights}", http.listen)
}

fn of_sparkplug(sparkplug: &SparkplugSettings, config: &Config) -> String {
    let gateway = config
        .gateway
        .name
        .as_ref()
        .map_or("(name of this host)", |name| name.as_str());
    let host = sparkplug.primary_host.as_ref().map_or_else(
        || "no primary host is waited for".to_owned(),
        |host| format!("births wait for the primary host {host}"),
    );
    format!(
        "Sparkplug B at the same broker: edge node {gateway} of group {}; {host}",
        sparkplug.group
    )
}

fn of_mqtt(mqtt: &MqttSettings, config: &Config) -> String {
    let gateway = config
        .gateway
        .name
        .as_ref()
        .map_or("(name of this host)", |name| name.as_str());
    format!(
        "MQTT at {}: topics under {}/{gateway}, {} leases",
        mqtt.broker,
        mqtt.session.prefix,
        word_for(&LEASES, &mqtt.session.lease)
    )
}

fn describe_line(
    text: &mut String,
    line: &LineSettings,
    mqtt: Option<&MqttSettings>,
) -> std::fmt::Result {
    let (timing, needs_virtual) = line_plan::timing(line);
    let budget = line_plan::budget(line);
    let framing = if line.framing == Framing::Ascii {
        ", ASCII frames"
    } else {
        ""
    };
    writeln!(
        text,
        "line {} on {}: {}{framing}",
        line.name,
        line.port,
        link_text(line)
    )?;
    writeln!(text, "  {}", of_port(line))?;
    if line.framing.has_characters() {
        serial_line(text, line, timing.silence, needs_virtual)?;
    } else if timing.silence > Duration::ZERO {
        writeln!(
            text,
            "  at least {} between a reply and the next request",
            ms(timing.silence)
        )?;
    }
    writeln!(
        text,
        "  polls use {:.1} % of the line, at an assumed turnaround of {} where a model documents none",
        budget.use_of_line * 100.0,
        ms(ASSUMED_TURNAROUND)
    )?;
    if budget.use_if_delayed > budget.use_of_line {
        let percent = budget.use_if_delayed * 100.0;
        writeln!(
            text,
            "  and {percent:.1} % where each drive is set to its longest delay of replies"
        )?;
    }
    refresh(text, line)?;
    if let Some(over_full) = warnings::over_full(line) {
        writeln!(text, "  warning: {over_full}")?;
    }
    stops(text, line)?;
    neighbours(text, line)?;
    standby::describe(text, line)?;
    for place in 0..line.drives.len() {
        drive::describe(text, line, place, &budget, mqtt)?;
    }
    writeln!(text)
}

/// `9600 8N1`, or that there is none.
fn link_text(line: &LineSettings) -> String {
    if line.framing.has_characters() {
        line.link.to_string()
    } else {
        "Modbus TCP".to_owned()
    }
}

/// The silence of a serial line, and its echo.
fn serial_line(
    text: &mut String,
    line: &LineSettings,
    silence: Duration,
    needs_virtual: bool,
) -> std::fmt::Result {
    let shorter = if needs_virtual {
        " (shorter than the drives need: pseudo-terminal or tcp:// only)"
    } else {
        ""
    };
    writeln!(text, "  silence before each frame {}{shorter}", ms(silence))?;
    let echo = match line.echo {
        EchoPolicy::Refuse => "an echo of the adapter puts the line out of use",
        EchoPolicy::Strip => "an echo of the adapter is removed",
    };
    writeln!(text, "  {echo}")
}

/// How long it takes to read everything once, beside the shortest way that the models allow.
fn refresh(text: &mut String, line: &LineSettings) -> std::fmt::Result {
    let RefreshCost {
        reads,
        time,
        shortest_reads,
        shortest_time,
    } = line_plan::refresh(line);
    if reads == 0 {
        return Ok(());
    }
    let beside = match time == shortest_time {
        true => "the shortest that the models allow".to_owned(),
        false => format!(
            "the models allow {shortest_reads} reads of {}",
            ms(shortest_time)
        ),
    };
    writeln!(
        text,
        "  all polled registers once take {reads} reads and {}: {beside}",
        ms(time)
    )
}

/// What each drive costs the stops of the others, where it is the one that sets their bound.
fn neighbours(text: &mut String, line: &LineSettings) -> std::fmt::Result {
    let StopBounds {
        all_healthy,
        one_silent,
        ..
    } = line_plan::stop_bounds(line);
    if line.drives.len() < 2 {
        return Ok(());
    }
    for (place, drive) in line.drives.iter().enumerate() {
        let without = line_plan::stop_bounds_without(line, place);
        if without.all_healthy < all_healthy || without.one_silent < one_silent {
            let [all, one] = [without.all_healthy, without.one_silent].map(ms);
            writeln!(
                text,
                "  without {} on this line these bounds would be {all} and {one}",
                drive.name
            )?;
        }
    }
    Ok(())
}

fn stops(text: &mut String, line: &LineSettings) -> std::fmt::Result {
    let StopBounds {
        all_healthy,
        one_silent,
        each_further,
    } = line_plan::stop_bounds(line);
    writeln!(
        text,
        "  a stop starts at most {} after it is accepted while every drive answers,",
        ms(all_healthy)
    )?;
    let beside = if line.framing.has_characters() {
        ""
    } else {
        "; the network and a converter add their own time"
    };
    writeln!(
        text,
        "  and at most {} after it with a drive that does not{beside}",
        ms(one_silent)
    )?;
    let deaf = |drive: &DriveSettings| {
        let deaf = drive
            .control
            .as_ref()
            .map(|_| drive.model.longest_deafness())?;
        (deaf > Duration::ZERO).then(|| format!("{} for {}", drive.name, ms(deaf)))
    };
    let deaf: Vec<_> = line.drives.iter().filter_map(deaf).collect();
    if !deaf.is_empty() {
        writeln!(
            text,
            "  a drive that hears nothing after a write gets it again as soon as it can hear: {}",
            list(deaf)
        )?;
    }
    match line_plan::missing_reply_costs(line) {
        Duration::ZERO => writeln!(
            text,
            "  a missing reply does not delay its confirmation: replies are numbered"
        )?,
        costs => writeln!(
            text,
            "  its confirmation takes at most {} longer if a reply is missing or damaged",
            ms(costs)
        )?,
    }
    if line.drives.len() > 1 {
        writeln!(
            text,
            "  each further stop at the same time adds up to {}",
            ms(each_further)
        )?;
    }
    Ok(())
}

/// How the line is connected.
fn of_port(line: &LineSettings) -> String {
    match line.port {
        PortAddress::Device(_) => {}
        PortAddress::Tcp { .. } => {
            let lateness_s = line.port.max_lateness().as_secs();
            return format!(
                "network: frames go to a serial device server, whose line is set to {}; a reply may be {lateness_s} s late",
                line.link
            );
        }
        PortAddress::ModbusTcp { .. } => {
            return "network: one connection, with one request at a time; each reply carries the number of its request"
                .to_owned();
        }
    }
    let interface = word_for(&INTERFACES, &line.interface);
    let direction = match (line.interface, line.direction) {
        (Interface::Rs232, _) => "",
        (_, DirectionControl::Adapter) => ", direction turned by the adapter",
        (_, DirectionControl::Kernel) => ", direction turned by the driver (TIOCSRS485)",
        (_, DirectionControl::Rts) => ", direction turned by the gateway with RTS",
    };
    let latency = if line.low_latency {
        "asked for"
    } else {
        "left as it is"
    };
    format!("serial device: {interface}{direction}; low latency {latency}")
}

#[cfg(test)]
mod tests {
    use crate::config;
    use crate::profile::catalog::Catalog;
    use crate::vendors;

    #[test]
    fn a_line_of_several_vendors_is_reported_with_what_it_costs() {
        let catalog = vendors::catalog();
        let text = include_str!("../../../tests/golden/config/several_vendors.toml");
        let found = super::report(&config::load(text, &catalog).unwrap());
        let path = format!(
            "{}/tests/golden/config/several_vendors.txt",
            env!("CARGO_MANIFEST_DIR")
        );
        if std::env::var_os("UPDATE_GOLDEN").is_some() {
            std::fs::write(&path, &found).unwrap();
        }
        assert_eq!(found, std::fs::read_to_string(&path).unwrap(), "{path}");
    }

    #[test]
    fn a_drive_that_a_stop_does_not_reach_at_once_is_named() {
        let text = include_str!("../../../tests/golden/models/exchange.toml");
        let control = "[line.drive.control]\nfrom = [\"modbus-tcp\"]\nfrequency_hz = { min = 5.0, max = 50.0 }\n\
                       lost_after = \"10s\"\non_commander_lost = \"stop\"\non_shutdown = \"stop\"\n\
                       [[modbus_tcp]]\nlisten = \"127.0.0.1:1502\"\nwrite = [\"127.0.0.1/32\"]\n";
        let line = "[[line]]\nname = \"hall\"\nport = \"/dev/ttyUSB0\"\n\
                    [[line.drive]]\nname = \"pump\"\nmodel = \"acme-exchange\"\nstation = 1\n";
        let reported = |model: &str| {
            let catalog = Catalog::from_texts([("exchange.toml", model)]).unwrap();
            super::report(&config::load(&format!("{line}{control}"), &catalog).unwrap())
        };
        let found = reported(text);
        let deaf = "  a drive that hears nothing after a write gets it again as soon as it can hear: pump for 1000 ms\n";
        assert!(found.contains(deaf), "{found}");
        // A stored write with an assumed processing time of 10 ms, and the pause after it.
        let starts =
            "  a stop starts at most 230 ms after it is accepted while every drive answers,\n";
        assert!(found.contains(starts), "{found}");
        assert!(!reported(&text.replace("deaf_after = \"1s\"", "")).contains("hears nothing"));
    }

    #[test]
    fn a_listener_is_reported_with_its_limits() {
        let catalog = vendors::catalog();
        let text = include_str!("../../../tests/golden/config/several_vendors.toml");
        let limits =
            "units = [1]\nconnections_max = 9\npriority = [\"127.0.0.1/32\"]\n[[modbus_tcp]]";
        let listener = format!("[[modbus_tcp]]\nlisten = \"127.0.0.1:1\"\n{limits}");
        let text = text.replacen("[[modbus_tcp]]", &listener, 1);
        let found = super::report(&config::load(&text, &catalog).unwrap());
        let expected = "127.0.0.1:1: read-only; units 1 only; at most 9 clients; 127.0.0.1/32 never give way to others\n";
        assert!(found.contains(expected), "{found}");
    }

    #[test]
    fn addresses_of_a_containers_bridge_are_warned_about() {
        let catalog = vendors::catalog();
        let text = include_str!("../../../tests/golden/config/several_vendors.toml");
        let reported = |allow: &str, write: &str| {
            let lists = format!("listen = \"0.0.0.0:1\"\nallow = [{allow}]\nwrite = [{write}]");
            let text = text.replacen(
                "[[modbus_tcp]]",
                &format!("[[modbus_tcp]]\n{lists}\n[[modbus_tcp]]"),
                1,
            );
            super::report(&config::load(&text, &catalog).unwrap())
        };
        for (allow, write, named) in [
            ("'172.17.0.1/32'", "'172.17.0.1/32'", "172.17.0.1/32"),
            (
                "'172.17.0.0/16', '10.0.0.0/24'",
                "'10.0.0.7/32'",
                "172.17.0.0/16",
            ),
            ("'10.0.0.0/8'", "'10.88.0.1/32'", "10.88.0.1/32"),
        ] {
            let found = reported(allow, write);
            assert!(
                found.contains(&format!(
                    "\n  warning: {named}: behind a container's bridge"
                )),
                "{found}"
            );
        }
        for (allow, write) in [
            ("'10.0.0.0/8'", "'10.0.0.7/32'"),
            ("'172.16.0.0/12'", "'172.18.0.0/24'"),
            ("'::/0'", ""),
        ] {
            assert!(!reported(allow, write).contains("bridge"), "{allow}");
        }
    }

    #[test]
    fn a_right_that_no_role_grants_is_nobodys() {
        let catalog = vendors::catalog();
        let text = include_str!("../../../tests/golden/config/several_vendors.toml");
        let reported = |roles: &str| {
            let tls = format!(
                "[[modbus_tcp]]\nlisten = \"127.0.0.1:802\"\n[modbus_tcp.tls]\n\
                 client_ca_file = \"/ca\"\ncert_file = \"/cert\"\nkey_file = \"/key\"\nroles = {{ {roles} }}\n[[modbus_tcp]]"
            );
            super::report(
                &config::load(&text.replacen("[[modbus_tcp]]", &tls, 1), &catalog).unwrap(),
            )
        };
        let found = reported("operator = [\"write\", \"stop\"]");
        assert!(
            found.contains("802: 0.0.0.0/0, ::/0 may write and stop, each as far as"),
            "{found}"
        );
        let found = reported("\"on call\" = [\"stop\"]");
        assert!(
            found.contains("802: read-only, except that 0.0.0.0/0, ::/0 may stop, each as far as"),
            "{found}"
        );
        let found = reported("watcher = []");
        assert!(found.contains("802: read-only, each as far as"), "{found}");
    }
}
