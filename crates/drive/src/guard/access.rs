//! Rights of Modbus TCP clients, by network and by role.

use crate::domain::command::Rights;
use ipnet::IpNet;
use std::collections::BTreeMap;
use std::net::IpAddr;

/// The rights of a client at `peer`, given the networks that may `write` and `stop`. Without `stop`, every network that
/// may write may also stop.
#[must_use]
pub fn rights_of(peer: IpAddr, write: &[IpNet], stop: Option<&[IpNet]>) -> Rights {
    Rights {
        write: is_in(peer, write),
        stop: is_in(peer, stop.unwrap_or(write)),
    }
}

/// `rights` restricted to those that `roles` grants to `role`. `None` for an unknown role: not even its reads are
/// answered.
#[must_use]
pub fn rights_in_role(
    rights: Rights,
    role: &str,
    roles: &BTreeMap<String, Rights>,
) -> Option<Rights> {
    let granted = roles.get(role)?;
    Some(Rights {
        write: rights.write && granted.write,
        stop: rights.stop && granted.stop,
    })
}

/// Whether `peer` is in one of `nets`. An IPv4-mapped IPv6 address counts as the IPv4 address.
#[must_use]
pub fn is_in(peer: IpAddr, nets: &[IpNet]) -> bool {
    nets.iter().any(|net| net.contains(&peer.to_canonical()))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn nobody_may_anything_unless_named() {
        let nets = |text: &str| vec![text.parse::<IpNet>().unwrap()];
        let peer: IpAddr = "::ffff:10.0.0.7".parse().unwrap();
        let rights = |write: &[IpNet], stop: Option<&[IpNet]>| {
            let rights = rights_of(peer, write, stop);
            (rights.write, rights.stop)
        };
        assert_eq!(rights(&[], None), (false, false));
        assert_eq!(
            rights(&nets("10.0.0.0/24"), None),
            (true, true),
            "a mapped address is the address itself"
        );
        assert_eq!(rights(&[], Some(&nets("10.0.0.0/8"))), (false, true));
        assert_eq!(rights(&nets("10.0.1.0/24"), Some(&[])), (false, false));
    }
    #[test]
    fn address_and_role_must_both_grant() {
        let operator = Rights {
            write: true,
            stop: true,
        };
        let roles = [
            ("operator", operator),
            (
                "guard",
                Rights {
                    stop: true,
                    ..Rights::NONE
                },
            ),
            ("viewer", Rights::NONE),
        ];
        let roles = roles
            .into_iter()
            .map(|(name, rights)| (name.to_owned(), rights))
            .collect();
        let in_role = |rights, role| rights_in_role(rights, role, &roles);
        assert_eq!(in_role(operator, "operator"), Some(operator));
        assert_eq!(
            in_role(Rights::NONE, "operator"),
            Some(Rights::NONE),
            "not from that address"
        );
        assert_eq!(
            in_role(operator, "guard"),
            Some(Rights {
                write: false,
                stop: true
            })
        );
        assert_eq!(in_role(operator, "viewer"), Some(Rights::NONE));
        for unknown in ["", "Operator", "operator ", "root"] {
            assert_eq!(in_role(operator, unknown), None, "{unknown}");
        }
    }
}
