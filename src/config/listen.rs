//! Modbus TCP listeners: which lines each serves, that no two want the same port, that none is open to all.

use super::file::{File, ListenerFile};
use crate::domain::problem::{Problem, nearest};
use crate::profile::reader::{Given, Written};
use std::collections::BTreeSet;
use std::net::{IpAddr, SocketAddr};

/// The indices of the lines that each listener serves; empty where its list cannot be used.
pub(super) fn settle(file: &File, problems: &mut Vec<Problem>) -> Vec<BTreeSet<usize>> {
    apart(&file.listeners, problems);
    for listener in &file.listeners {
        guarded(listener, problems);
    }
    file.listeners.iter().map(|listener| served(file, listener, problems)).collect()
}

fn served(file: &File, listener: &ListenerFile, problems: &mut Vec<Problem>) -> BTreeSet<usize> {
    let names = match &listener.lines {
        Given::LeftOut => return (0..file.lines.len()).collect(),
        Given::Unusable => return BTreeSet::new(),
        Given::Usable(names) => names,
    };
    if names.value.is_empty() {
        let problem = names.place.problem("an empty list of lines serves nothing");
        problems.push(problem.right("names of lines, or leave it out to serve all"));
    }
    let mut lines = BTreeSet::new();
    for name in &names.value {
        match line_called(file, name) {
            Ok(line) if lines.insert(line) => {}
            Ok(_) => problems.push(name.place.problem(format!("line `{}` is listed twice", name.value))),
            Err(problem) => problems.push(problem),
        }
    }
    lines
}

fn line_called(file: &File, name: &Written<String>) -> Result<usize, Problem> {
    let names: Vec<Option<&str>> =
        file.lines.iter().map(|line| line.name.as_ref().map(|name| name.value.as_str())).collect();
    names.iter().position(|it| *it == Some(name.value.as_str())).ok_or_else(|| {
        let names: Vec<&str> = names.iter().copied().flatten().collect();
        let problem = name.place.problem(format!("there is no line `{}`", name.value));
        match nearest(&name.value, names.iter().copied()) {
            Some(near) => problem.right(format!("\"{near}\"")),
            None => problem.right(format!("names of lines of this file: {}", names.join(", "))),
        }
    })
}

/// No two listeners on the same address, where an address that means all covers every other.
fn apart(listeners: &[ListenerFile], problems: &mut Vec<Problem>) {
    let addresses: Vec<&Written<SocketAddr>> = listeners.iter().filter_map(|it| it.listen.as_ref()).collect();
    for (index, later) in addresses.iter().enumerate() {
        if let Some(earlier) = addresses.iter().take(index).find(|earlier| collide(earlier.value, later.value)) {
            let what = format!("{} is taken by the listener {}", later.value, earlier.value);
            problems.push(later.place.problem(what).right("an address or a port of its own"));
        }
    }
}

/// Port 0 is a port that the system chooses, so it collides with nothing.
fn collide(one: SocketAddr, other: SocketAddr) -> bool {
    one.port() == other.port() && one.port() != 0 && (covers(one.ip(), other.ip()) || covers(other.ip(), one.ip()))
}

/// Whether a socket on `wide` takes connections to `narrow`: `::` takes those of both families.
fn covers(wide: IpAddr, narrow: IpAddr) -> bool {
    wide == narrow || (wide.is_unspecified() && (wide.is_ipv6() || narrow.is_ipv4()))
}

/// A listener that others can reach must say who may connect.
fn guarded(listener: &ListenerFile, problems: &mut Vec<Problem>) {
    let Some(listen) = &listener.listen else { return };
    if matches!(listener.allow, Given::LeftOut) && !listen.value.ip().to_canonical().is_loopback() {
        let what = format!("{} can be reached from other hosts, and `allow` does not say by whom", listen.value);
        let problem = listener.place.missing("allow").problem(what);
        problems.push(problem.right("allow = [\"10.0.0.0/24\"] with your own networks, or a loopback address"));
    }
}
