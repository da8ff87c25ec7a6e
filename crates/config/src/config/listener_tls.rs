//! Modbus Security: the rights of a listener's roles.

use super::file::{ListenerFile, ListenerTlsFile, RoleFile};
use super::lists;
use super::ready::ListenerTls;
use super::words::RoleRight;
use crate::domain::command::Rights;
use crate::domain::problem::Problem;
use crate::toml_file::{LocatedValue, OptionalKey};
use ipnet::{IpNet, Ipv4Net, Ipv6Net};

/// Checks the roles, and the lists of networks against them.
pub(super) fn check(listener: &ListenerFile, problems: &mut Vec<Problem>) {
    let Some(LocatedValue {
        value: roles,
        location,
    }) = roles(listener)
    else {
        return;
    };
    if roles.is_empty() {
        let problem = location.problem("no role is listed, so no client is answered");
        problems.push(problem.right(
            "`roles = { operator = [\"write\", \"stop\"], viewer = [] }` with your own roles",
        ));
    }
    for RoleFile { name, rights } in roles {
        lists::once(&rights.value, problems);
        if has(rights, RoleRight::Write) && !has(rights, RoleRight::Stop) {
            let what = format!(
                "role `{name}` may write but not stop: a client that may start must be allowed to stop"
            );
            problems.push(rights.location.problem(what).right("[\"write\", \"stop\"]"));
        }
    }
    let lists = [
        (&listener.write, RoleRight::Write, "write"),
        (&listener.stop, RoleRight::Stop, "stop"),
    ];
    for (list, right, verb) in lists {
        if let Some(list) = list.valid()
            && !list.value.is_empty()
            && !roles.is_empty()
            && roles.iter().all(|role| !has(&role.rights, right))
        {
            let problem = list
                .location
                .problem(format!("has no effect: no role of `tls` may {verb}"));
            let right = format!("\"{verb}\" in the `roles` of those who may, or leave it out");
            problems.push(problem.right(right).warning());
        }
    }
    stops_whom_it_starts(listener, problems);
}

/// Without `write` every network that may connect may write, subject to roles, and must be in `stop`.
fn stops_whom_it_starts(listener: &ListenerFile, problems: &mut Vec<Problem>) {
    let (OptionalKey::Absent, OptionalKey::Valid(stop), true) = (
        &listener.write,
        &listener.stop,
        may(listener, RoleRight::Write),
    ) else {
        return;
    };
    let OptionalKey::Valid(allow) = &listener.allow else {
        return;
    };
    for network in allow
        .value
        .iter()
        .filter(|it| !stop.value.iter().any(|stop| stop.value.contains(*it)))
    {
        let what = format!(
            "without `write` all of {network} may write, and it is not in `stop`: a client that may start must be allowed to stop"
        );
        problems.push(
            stop.location
                .problem(what)
                .right("`write` with the networks that may, or leave `stop` out as well"),
        );
    }
}

/// Whether a role of the listener has `right`, or may have it once its list is fixed. False without roles.
pub(super) fn may(listener: &ListenerFile, right: RoleRight) -> bool {
    match &listener.tls {
        OptionalKey::Absent => false,
        OptionalKey::Invalid => true,
        OptionalKey::Valid(tls) => {
            let roles = tls.value.roles.as_ref();
            roles.is_none_or(|roles| roles.value.iter().any(|role| has(&role.rights, right)))
        }
    }
}

/// The rights of all roles, with their locations.
pub(super) fn rights(listener: &ListenerFile) -> impl Iterator<Item = &LocatedValue<RoleRight>> {
    roles(listener)
        .into_iter()
        .flat_map(|roles| &roles.value)
        .flat_map(|role| &role.rights.value)
}

/// The ready settings: `Some(None)` if the listener is not encrypted; `None` if they are invalid, see `problems`.
pub(super) fn settle(listener: &ListenerFile) -> Option<Option<ListenerTls>> {
    match &listener.tls {
        OptionalKey::Absent => Some(None),
        OptionalKey::Invalid => None,
        OptionalKey::Valid(tls) => ready(&tls.value).map(Some),
    }
}

/// The networks that may write without a list: all that may connect, if any role has a right.
pub(super) fn networks(allow: Option<&[IpNet]>, tls: &ListenerTls) -> Vec<IpNet> {
    let everywhere = [IpNet::V4(Ipv4Net::default()), IpNet::V6(Ipv6Net::default())];
    let anybody = tls.roles.values().any(|rights| rights.write || rights.stop);
    if anybody {
        allow.unwrap_or(&everywhere).to_vec()
    } else {
        Vec::new()
    }
}

fn ready(tls: &ListenerTlsFile) -> Option<ListenerTls> {
    let roles = tls.roles.as_ref()?.value.iter();
    let rights = |role: &RoleFile| Rights {
        write: has(&role.rights, RoleRight::Write),
        stop: has(&role.rights, RoleRight::Stop),
    };
    Some(ListenerTls {
        cert_file: tls.cert_file.as_ref()?.value.clone(),
        key_file: tls.key_file.as_ref()?.value.clone(),
        client_ca_file: tls.client_ca_file.as_ref()?.value.clone(),
        roles: roles
            .map(|role| (role.name.clone(), rights(role)))
            .collect(),
    })
}

fn roles(listener: &ListenerFile) -> Option<&LocatedValue<Vec<RoleFile>>> {
    listener.tls.valid()?.value.roles.as_ref()
}

fn has(rights: &LocatedValue<Vec<LocatedValue<RoleRight>>>, right: RoleRight) -> bool {
    rights.value.iter().any(|written| written.value == right)
}
