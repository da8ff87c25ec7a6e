//! Listeners: the lines that each serves, conflicts between addresses, networks that may connect, and their rights to
//! write.

use super::file::{ConfigFile, DriveUnits, LineFile, ListenerFile, ListenerTlsFile};
use super::listener_tls;
use super::lists;
use super::ready::ListenerSettings;
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
        let right = "names of lines, or leave it out to serve all";
        names.refuse("an empty list of lines serves nothing", right, problems);
    }
    let mut lines = BTreeSet::new();
    for name in &names.value {
        match line_called(file, name) {
            Ok(line) if lines.insert(line) => {}
            Ok(_) => {
                let what = format!("line `{}` is listed twice", name.value);
                name.warn(what, "each once", problems);
            }
            Err(problem) => problems.push(problem),
        }
    }
    lines
}

fn line_called(file: &ConfigFile, name: &LocatedValue<String>) -> Result<usize, Problem> {
    let known = |line: &LineFile| Some(line.name.as_ref()?.value.to_string());
    let names: Vec<Option<String>> = file.lines.iter().map(known).collect();
    if let Some(line) = names.iter().position(|it| it.as_ref() == Some(&name.value)) {
        return Ok(line);
    }
    let names: Vec<&str> = names.iter().flatten().map(String::as_str).collect();
    let what = format!("there is no line `{}`", name.value);
    let problem = name.location.problem(what);
    Err(match nearest(&name.value, names.iter().copied()) {
        Some(near) => problem.right(format!("\"{near}\"")),
        None => problem.right(format!("names of lines of this file: {}", names.join(", "))),
    })
}

/// The ready settings of `listener`, which serves the lines `served`; `None` if they are invalid, see `problems`.
pub(super) fn settings(
    listener: &ListenerFile,
    served: &BTreeSet<usize>,
) -> Option<ListenerSettings> {
    let lines = listener
        .lines
        .settle(|_names| Some(served.iter().copied().collect()))?;
    let allow = listener.allow.clone().optional()?;
    let tls = listener.tls.settle(ListenerTlsFile::settings)?;
    let write = match (&listener.write, &tls) {
        (OptionalKey::Absent, Some(tls)) => listener_tls::networks(allow.as_deref(), tls),
        (write, _) => lists::values(write)?,
    };
    listener.settings(lines, write, tls)
}

/// No two listeners use the same address; a wildcard address covers every other.
fn apart(file: &ConfigFile, problems: &mut Vec<Problem>) {
    let http = file.http.valid().and_then(|it| it.value.listen.as_ref());
    let modbus = file.listeners.iter().filter_map(|it| it.listen.as_ref());
    let addresses: Vec<&LocatedValue<SocketAddr>> = modbus.chain(http).collect();
    for (index, later) in addresses.iter().enumerate() {
        let mut earlier = addresses.iter().take(index);
        if let Some(earlier) = earlier.find(|earlier| collide(earlier.value, later.value)) {
            let what = format!("{} is taken by the listener {}", later.value, earlier.value);
            later.refuse(what, "a different address or port", problems);
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
    if allow.is_absent() && !is_loopback(listen.value.ip()) {
        let what = format!(
            "{} can be reached from other hosts, and `allow` does not restrict them",
            listen.value
        );
        let right = "allow = [\"10.0.0.0/24\"] with your own networks, or a loopback address";
        location.missing("allow").refuse(what, right, problems);
    }
}

/// Networks that may write can connect and may stop, networks with priority can connect, and `reads_renew` requires a
/// right to write.
fn rights(listener: &ListenerFile, problems: &mut Vec<Problem>) {
    let lists = [&listener.write, &listener.stop, &listener.priority];
    for network in lists
        .into_iter()
        .filter_map(OptionalKey::valid)
        .flat_map(|list| &list.value)
    {
        can_connect(listener, network, problems);
    }
    if let (OptionalKey::Valid(write), OptionalKey::Valid(stop)) = (&listener.write, &listener.stop)
    {
        let may_stop = |net: &IpNet| stop.value.iter().any(|stop| stop.value.contains(net));
        for network in write.value.iter().filter(|it| !may_stop(&it.value)) {
            let what = format!(
                "{} may write and is not in `stop`: a client that may start must be allowed to stop",
                network.value
            );
            let right = format!("\"{}\" in `stop` as well", network.value);
            network.refuse(what, right, problems);
        }
    }
    if let Some(renew) = listener.reads_renew.valid_as(&true)
        && !may_be_written(listener)
    {
        let what = "has no effect: no client may write here, so there is no lease to renew";
        let right = "`write` with the networks that may, or leave it out";
        renew.warn(what, right, problems);
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
    if let Some(written) = listener.keep_alive.valid()
        && written.value.subsec_nanos() != 0
    {
        let right = format!("\"{}s\"", written.value.as_secs().max(1));
        written.refuse(
            "the system uses whole seconds for this time",
            right,
            problems,
        );
    }
    if let Some(written) = listener.idle_timeout.valid()
        && !written.value.is_zero()
        && written.value < TIMEOUT_LEAST
    {
        let what = "clients that ask once a second would be closed in between";
        written.refuse(what, "at least \"1s\", or \"0s\" for none", problems);
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
            let right = "units of drives, or leave it out to serve all";
            listed.refuse("an empty list of units serves no drive", right, problems);
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
            let number = unit.value;
            if !seen.insert(number) {
                unit.warn(
                    format!("unit {number} is listed twice"),
                    "each once",
                    problems,
                );
            } else if !known.contains(&number) {
                let there: Vec<_> = known.iter().map(UnitId::to_string).collect();
                let what = format!("has no effect: no drive that is served here has unit {number}");
                let right = format!("of {}; 255 is always served", there.join(", "));
                unit.warn(what, right, problems);
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
    let net = network.value;
    match (&listener.allow, &listener.listen) {
        (OptionalKey::Valid(allow), _) if !allow.value.iter().any(|it| it.contains(&net)) => {
            let allowed = allow.value.iter().map(|allow| format!("\"{allow}\""));
            let right = format!(
                "a network inside {}",
                allowed.collect::<Vec<_>>().join(", ")
            );
            network.refuse(
                format!("{net} is in no network of `allow`"),
                right,
                problems,
            );
        }
        (OptionalKey::Absent, Some(listen))
            if is_loopback(listen.value.ip()) && !is_loopback(net.addr()) =>
        {
            let what = format!(
                "{net} cannot reach {}, which is this host only",
                listen.value
            );
            let here = IpNet::from(listen.value.ip());
            network.refuse(what, format!("\"{here}\""), problems);
        }
        _ => {}
    }
}

/// Whether only this host can reach the address.
pub(super) fn is_loopback(ip: IpAddr) -> bool {
    ip.to_canonical().is_loopback()
}
