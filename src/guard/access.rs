//! Who may do what, by where a Modbus TCP client comes from.

use crate::domain::command::Rights;
use ipnet::IpNet;
use std::net::IpAddr;

/// The rights of a client at `peer`, where `write` and `stop` name the networks of those who may. Without `stop`,
/// whoever may write may stop.
#[must_use]
pub fn rights_of(peer: IpAddr, write: &[IpNet], stop: Option<&[IpNet]>) -> Rights {
    Rights { write: is_in(peer, write), stop: is_in(peer, stop.unwrap_or(write)) }
}

/// Whether `peer` is in one of `nets`. An IPv4 address that is mapped into IPv6 is the address itself.
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
        assert_eq!(rights(&nets("10.0.0.0/24"), None), (true, true), "a mapped address is the address itself");
        assert_eq!(rights(&[], Some(&nets("10.0.0.0/8"))), (false, true));
        assert_eq!(rights(&nets("10.0.1.0/24"), Some(&[])), (false, false));
    }
}
