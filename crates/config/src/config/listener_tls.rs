//! Modbus Security: the rights of a listener's roles.

use super::file::{ListenerFile, RoleFile};
use super::lists;
use super::ready::ListenerTls;
use super::words::{FileWord, RoleRight};
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
        location.refuse(
            "no role is listed, so no client is answered",
            "`roles = { operator = [\"write\", \"stop\"], viewer = [] }` with your own roles",
            problems,
        );
    }
    for role in roles {
        lists::once(&role.rights.value, problems);
        if role.has(RoleRight::Write) && !role.has(RoleRight::Stop) {
            let what = format!(
                "role `{}` may write but not stop: a client that may start must be allowed to stop",
                role.name
            );
            role.rights.refuse(what, "[\"write\", \"stop\"]", problems);
        }
    }
    for (list, right) in [
        (&listener.write, RoleRight::Write),
        (&listener.stop, RoleRight::Stop),
    ] {
        if let Some(list) = list.valid()
            && !list.value.is_empty()
            && !roles.is_empty()
            && roles.iter().all(|role| !role.has(right))
        {
            let verb = right.word();
            let what = format!("has no effect: no role of `tls` may {verb}");
            let right = format!("\"{verb}\" in the `roles` of those who may, or leave it out");
            list.warn(what, right, problems);
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
    let may_stop = |net: &IpNet| stop.value.iter().any(|stop| stop.value.contains(net));
    for network in allow.value.iter().filter(|it| !may_stop(it)) {
        let what = format!(
            "without `write` all of {network} may write, and it is not in `stop`: a client that may start must be allowed to stop"
        );
        let right = "`write` with the networks that may, or leave `stop` out as well";
        stop.refuse(what, right, problems);
    }
}

/// Whether a role of the listener has `right`, or may have it once its list is fixed. False without roles.
pub(super) fn may(listener: &ListenerFile, right: RoleRight) -> bool {
    match &listener.tls {
        OptionalKey::Absent => false,
        OptionalKey::Invalid => true,
        OptionalKey::Valid(tls) => {
            let roles = tls.value.roles.as_ref();
            roles.is_none_or(|roles| roles.value.iter().any(|role| role.has(right)))
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

fn roles(listener: &ListenerFile) -> Option<&LocatedValue<Vec<RoleFile>>> {
    listener.tls.valid()?.value.roles.as_ref()
}
