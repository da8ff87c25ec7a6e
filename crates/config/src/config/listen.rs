//! Listeners: the lines that each serves, conflicts between addresses, networks that may connect, and their rights to
//! write.

use super::file::{ConfigFile, ListenerFile};
use super::listener_tls;
use super::units::DriveUnits;
use super::words::RoleRight;
use crate::domain::ids::UnitId;
use crate::domain::problem::{Problem, nearest};
use crate::toml_file::{KeyLocation, LocatedValue, OptionalKey, RequiredKey};
use ipnet::IpNet;
use std::collections::BTreeSet;
use std::net::{IpAddr, SocketAddr};
use std::time::Duration;

/// Shorter times are a mistake, except 0, which means none.
const TIMEOUT_LEAST: Duration = Duration::from_secs(1);

/// The indices of the lines that each listener serves; empty if its list is unusable.
pub(super) fn settle(file: &ConfigFile, problems: &mut Vec<Problem>) -> Vec<BTreeSet<usize>> {
    apart(file, problems);
    for listener in &file.listeners {
        guarded(
            &listener.listen,
            &listener.allow,
            &listener.location,
            problems,
        );
        rights(listener, problems);
        listener_tls::check(listener, problems);
        times(listener, problems);
    }
    file.units_servers()
        .iter()
        .map(|listener| served(file, listener, problems))
        .collect()
}

fn served(
    file: &ConfigFile,
    listener: &ListenerFile,
    problems: &mut Vec<Problem>,
) -> BTreeSet<usize> {
    let names = match &listener.lines {
        OptionalKey::Absent => return (0..file.lines.len()).collect(),
        OptionalKey::Invalid => return BTreeSet::new(),
        OptionalKey::Valid(names) => names,
    };
    if names.value.is_empty() {
        let problem = names
            .location
            .problem("an empty list of lines serves nothing");
        problems.push(problem.right("names of lines, or leave it out to serve all"));
    }
    let mut lines = BTreeSet::new();
    for name in &names.value {
        match line_called(file, name) {
            Ok(line) if lines.insert(line) => {}
            Ok(_) => {
                let problem = name
                    .location
                    .problem(format!("line `{}` is listed twice", name.value));
                problems.push(problem.right("each once").warning());
            }
            Err(problem) => problems.push(problem),
        }
    }
    lines
}

fn line_called(file: &ConfigFile, name: &LocatedValue<String>) -> Result<usize, Problem> {
    let names: Vec<Option<&str>> = file
        .lines
        .iter()
        .map(|line| line.name.as_ref().map(|name| name.value.as_str()))
        .collect();
    names
        .iter()
        .position(|it| *it == Some(name.value.as_str()))
        .ok_or_else(|| {
            let names: Vec<&str> = names.iter().copied().flatten().collect();
            let problem = name
                .location
                .problem(format!("there is no line `{}`", name.value));
            match nearest(&name.value, names.iter().copied()) {
                Some(near) => problem.right(format!("\"{near}\"")),
                None => problem.right(format!("names of lines of this file: {}", names.join(", "))),
            }
        })
}

/// No two listeners use the same address; a wildcard address covers every other.
fn apart(file: &ConfigFile, problems: &mut Vec<Problem>) {
    let http = file
        .http
        .valid()
        .and_then(|http| http.value.listen.as_ref());
    let modbus = file.listeners.iter().filter_map(|it| it.listen.as_ref());
    let addresses: Vec<&LocatedValue<SocketAddr>> = modbus.chain(http).collect();
    for (index, later) in addresses.iter().enumerate() {
        if let Some(earlier) = addresses
            .iter()
            .take(index)
            .find(|earlier| collide(earlier.value, later.value))
        {
            let what = format!("{} is taken by the listener {}", later.value, earlier.value);
            problems.push(
                later
                    .location
                    .problem(what)
                    .right("a different address or port"),
            );
        }
    }
}

/// Port 0 is chosen by the system, so it never conflicts.
fn collide(one: SocketAddr, other: SocketAddr) -> bool {
    one.port() == other.port()
        && one.port() != 0
        && (covers(one.ip(), other.ip()) || covers(other.ip(), one.ip()))
}

/// Whether a socket on `wide` accepts connections to `narrow`: `::` accepts both families.
fn covers(wide: IpAddr, narrow: IpAddr) -> bool {
    wide == narrow || (wide.is_unspecified() && (wide.is_ipv6() || narrow.is_ipv4()))
}

/// A listener that other hosts can reach must state who may connect.
pub(super) fn guarded(
    listen: &RequiredKey<SocketAddr>,
    allow: &OptionalKey<Vec<IpNet>>,
    location: &KeyLocation,
    problems: &mut Vec<Problem>,
) {
    let Some(listen) = listen else { return };
    if matches!(allow, OptionalKey::Absent) && !is_loopback(listen.value.ip()) {
        let what = format!(
            "{} can be reached from other hosts, and `allow` does not restrict them",
            listen.value
        );
        let problem = location.missing("allow").problem(what);
        problems.push(
            problem
                .right("allow = [\"10.0.0.0/24\"] with your own networks, or a loopback address"),
        );
    }
}

/// Networks that may write can connect and may stop, networks with priority can connect, and `reads_renew` requires a
/// right to write.
fn rights(listener: &ListenerFile, problems: &mut Vec<Problem>) {
    for list in [&listener.write, &listener.stop, &listener.priority]
        .into_iter()
        .filter_map(OptionalKey::valid)
    {
        for network in &list.value {
            can_connect(listener, network, problems);
        }
    }
    if let (OptionalKey::Valid(write), OptionalKey::Valid(stop)) = (&listener.write, &listener.stop)
    {
        for network in write
            .value
            .iter()
            .filter(|it| !stop.value.iter().any(|stop| stop.value.contains(&it.value)))
        {
            let what = format!(
                "{} may write and is not in `stop`: a client that may start must be allowed to stop",
                network.value
            );
            problems.push(
                network
                    .location
                    .problem(what)
                    .right(format!("\"{}\" in `stop` as well", network.value)),
            );
        }
    }
    if let Some(renew) = listener
        .reads_renew
        .valid()
        .filter(|renew| renew.value && !may_be_written(listener))
    {
        let problem = renew
            .location
            .problem("has no effect: no client may write here, so there is no lease to renew");
        problems.push(
            problem
                .right("`write` with the networks that may, or leave it out")
                .warning(),
        );
    }
}

/// Whether any client may write here, according to `write` and the roles.
pub(super) fn may_be_written(listener: &ListenerFile) -> bool {
    match &listener.write {
        OptionalKey::Absent => listener_tls::may(listener, RoleRight::Write),
        OptionalKey::Invalid => true,
        OptionalKey::Valid(write) => !write.value.is_empty(),
    }
}

/// Keep-alive is in whole seconds, and other times must not be shorter than a second; 0 means none.
fn times(listener: &ListenerFile, problems: &mut Vec<Problem>) {
    if let Some(written) = listener
        .keep_alive
        .valid()
        .filter(|written| written.value.subsec_nanos() != 0)
    {
        let problem = written
            .location
            .problem("the system uses whole seconds for this time");
        problems.push(problem.right(format!("\"{}s\"", written.value.as_secs().max(1))));
    }
    let timeout = listener.idle_timeout.valid();
    if let Some(written) = timeout.filter(|it| !it.value.is_zero() && it.value < TIMEOUT_LEAST) {
        let problem = written
            .location
            .problem("clients that ask once a second would be closed in between");
        problems.push(problem.right("at least \"1s\", or \"0s\" for none"));
    }
}

/// Each listed unit belongs to a drive that the listener serves.
pub(super) fn units_exist(
    file: &ConfigFile,
    served: &[BTreeSet<usize>],
    units: &[Vec<DriveUnits>],
    problems: &mut Vec<Problem>,
) {
    for (listener, lines) in file.units_servers().iter().zip(served) {
        let Some(listed) = listener.units.valid() else {
            continue;
        };
        if listed.value.is_empty() {
            let problem = listed
                .location
                .problem("an empty list of units serves no drive");
            problems.push(problem.right("units of drives, or leave it out to serve all"));
        }
        let drives = lines.iter().filter_map(|line| units.get(*line)).flatten();
        let known: Option<BTreeSet<UnitId>> =
            drives.flat_map(|it| [it.native, it.uniform]).collect();
        // An unknown unit is reported as another problem.
        let Some(known) = known else {
            continue;
        };
        if lines.is_empty() {
            continue;
        }
        let mut seen = BTreeSet::new();
        for unit in &listed.value {
            if !seen.insert(unit.value) {
                let problem = unit
                    .location
                    .problem(format!("unit {} is listed twice", unit.value));
                problems.push(problem.right("each once").warning());
            } else if !known.contains(&unit.value) {
                let there: Vec<_> = known.iter().map(UnitId::to_string).collect();
                let what = format!(
                    "has no effect: no drive that is served here has unit {}",
                    unit.value
                );
                let right = format!("of {}; 255 is always served", there.join(", "));
                problems.push(unit.location.problem(what).right(right).warning());
            }
        }
    }
}

/// Clients of `network` can reach the listener. Two networks are either nested or disjoint.
fn can_connect(
    listener: &ListenerFile,
    network: &LocatedValue<IpNet>,
    problems: &mut Vec<Problem>,
) {
    let (what, right) = match (&listener.allow, &listener.listen) {
        (OptionalKey::Valid(allow), _)
            if !allow
                .value
                .iter()
                .any(|allow| allow.contains(&network.value)) =>
        {
            let allowed: Vec<_> = allow
                .value
                .iter()
                .map(|allow| format!("\"{allow}\""))
                .collect();
            (
                format!("{} is in no network of `allow`", network.value),
                format!("a network inside {}", allowed.join(", ")),
            )
        }
        (OptionalKey::Absent, Some(listen))
            if is_loopback(listen.value.ip()) && !is_loopback(network.value.addr()) =>
        {
            let here = IpNet::from(listen.value.ip());
            (
                format!(
                    "{} cannot reach {}, which is this host only",
                    network.value, listen.value
                ),
                format!("\"{here}\""),
            )
        }
        _ => return,
    };
    problems.push(network.location.problem(what).right(right));
}

/// Whether only this host can reach the address.
pub(super) fn is_loopback(ip: IpAddr) -> bool {
    ip.to_canonical().is_loopback()
}
