//! Parses the broker's address: scheme, host and port, and nothing else.

use super::host::{host_and_port, port_number};
use crate::domain::problem::nearest;
use std::net::IpAddr;

/// Examples of valid addresses.
const RIGHT: &str =
    "\"mqtts://broker.example:8883\", \"mqtt://127.0.0.1:1883\", or \"embedded\" for trying out";

/// A broker's address.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) enum BrokerAddress {
    /// The broker inside this process.
    Embedded,
    /// A broker on the network.
    Tcp {
        /// Name or address, an IPv6 address without its brackets.
        host: String,
        port: u16,
        tls: bool,
    },
}

impl BrokerAddress {
    /// Whether traffic to it stays on this host.
    pub fn is_local(&self) -> bool {
        match self {
            Self::Embedded => true,
            Self::Tcp { host, .. } => {
                host.eq_ignore_ascii_case("localhost")
                    || host
                        .parse()
                        .is_ok_and(|ip: IpAddr| ip.to_canonical().is_loopback())
            }
        }
    }

    /// Whether the connection is encrypted.
    pub const fn is_tls(&self) -> bool {
        matches!(self, Self::Tcp { tls: true, .. })
    }
}

/// Why a text is not a valid address: what is wrong, and what would be right.
pub(super) type Wrong = (String, String);

/// Parses an address.
pub(super) fn parse(text: &str) -> Result<BrokerAddress, Wrong> {
    if text == "embedded" {
        return Ok(BrokerAddress::Embedded);
    }
    if text.contains('@') {
        // The text may contain a password, so it is not repeated.
        let what = "a user or a password must not be in the address".to_owned();
        return Err((
            what,
            "`user`, and `password_file` or `password_env`, beside it".to_owned(),
        ));
    }
    let Some((scheme, rest)) = text.split_once("://") else {
        let near = nearest(text, ["embedded"])
            .map_or_else(|| RIGHT.to_owned(), |near| format!("\"{near}\""));
        return Err((format!("`{text}` is not the address of a broker"), near));
    };
    let (tls, default_port) = match scheme {
        "mqtt" => (false, 1883),
        "mqtts" => (true, 8883),
        _ => {
            return Err((
                format!("a broker over `{scheme}://` is not served"),
                RIGHT.to_owned(),
            ));
        }
    };
    let wrong = |what: &str| (format!("`{text}` {what}"), RIGHT.to_owned());
    if rest.contains(['/', '?', '#']) {
        return Err(wrong("has more than a host and a port"));
    }
    let (host, port) = host_and_port(rest).ok_or_else(|| wrong("has no usable host"))?;
    let port = match port {
        None => default_port,
        Some(digits) => port_number(digits).ok_or_else(|| wrong("has no usable port"))?,
    };
    Ok(BrokerAddress::Tcp {
        host: host.to_owned(),
        port,
        tls,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn tcp(host: &str, port: u16, tls: bool) -> BrokerAddress {
        BrokerAddress::Tcp {
            host: host.to_owned(),
            port,
            tls,
        }
    }

    #[test]
    fn hosts_ports_and_schemes_are_distinguished() {
        for (text, address) in [
            ("embedded", BrokerAddress::Embedded),
            ("mqtt://broker", tcp("broker", 1883, false)),
            ("mqtts://broker.example", tcp("broker.example", 8883, true)),
            ("mqtt://10.0.0.7:2883", tcp("10.0.0.7", 2883, false)),
            ("mqtt://[::1]", tcp("::1", 1883, false)),
            ("mqtts://[fd00::7]:65535", tcp("fd00::7", 65_535, true)),
        ] {
            assert_eq!(parse(text), Ok(address), "{text}");
        }
    }

    #[test]
    fn whatever_else_is_refused() {
        for text in [
            "",
            "broker",
            "broker:1883",
            "tcp://broker",
            "ws://broker",
            "MQTT://broker",
            "mqtt:/broker",
            "mqtt://",
            "mqtt://:1883",
            "mqtt://broker:",
            "mqtt://broker:0",
            "mqtt://broker:65536",
            "mqtt://broker:+1",
            "mqtt://broker:1883:1",
            "mqtt://fd00::7",
            "mqtt://[fd00::7",
            "mqtt://[broker]",
            "mqtt://[::1]1883",
            "mqtt://broker/",
            "mqtt://broker/x",
            "mqtt://broker?x",
            "mqtt://bro ker",
            "mqtt://user@broker",
        ] {
            assert!(parse(text).is_err(), "{text}");
        }
        assert_eq!(parse("embeded").unwrap_err().1, "\"embedded\"");
    }

    #[test]
    fn a_password_in_the_address_is_not_repeated() {
        assert!(
            !parse("mqtt:user:secret@broker")
                .unwrap_err()
                .0
                .contains("secret")
        );
        let (what, right) = parse("mqtt://user:secret@broker").unwrap_err();
        assert!(
            !what.contains("secret") && !right.contains("secret"),
            "{what}; {right}"
        );
    }

    #[test]
    fn what_stays_on_this_host_is_known() {
        for local in [
            "embedded",
            "mqtt://localhost",
            "mqtt://127.1.2.3",
            "mqtt://[::1]",
            "mqtt://[::ffff:127.0.0.1]",
        ] {
            assert!(parse(local).unwrap().is_local(), "{local}");
        }
        assert!(
            !parse("mqtt://10.0.0.7").unwrap().is_local()
                && !parse("mqtt://localhost.example").unwrap().is_local()
        );
        assert!(
            parse("mqtts://broker").unwrap().is_tls() && !parse("mqtt://broker").unwrap().is_tls()
        );
    }
}
