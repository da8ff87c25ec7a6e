//! Parses the port of a line or of a serial master.

use super::host::{host_and_port, port_number};
use super::ready::PortAddress;
use std::net::Ipv6Addr;
use std::path::PathBuf;

/// Examples of valid ports.
const RIGHT: &str = "an absolute path, as \"/dev/serial/by-id/...\" or \"/dev/ttyUSB0\", or a serial device server, as \
                     \"tcp://10.0.0.7:4001\", or Modbus TCP, as \"modbus-tcp://10.0.0.7\"";

/// The port of Modbus TCP where none is given.
const MODBUS_TCP_PORT: u16 = 502;

/// Why a text is not a valid port: what is wrong, and what would be right.
pub(super) type Wrong = (String, String);

/// Parses a port.
pub(super) fn parse(text: &str) -> Result<PortAddress, Wrong> {
    let Some((scheme, rest)) = text.split_once("://") else {
        return match PathBuf::from(text) {
            path if path.is_absolute() => Ok(PortAddress::Device(path)),
            _ => Err((
                format!("`{text}` is not an absolute path"),
                RIGHT.to_owned(),
            )),
        };
    };
    let wrong = |what: &str, right: &str| Err((format!("`{text}` {what}"), right.to_owned()));
    let is_modbus_tcp = scheme == PortAddress::MODBUS_TCP;
    if !is_modbus_tcp && scheme != "tcp" {
        return Err((
            format!("a line over `{scheme}://` is not served"),
            RIGHT.to_owned(),
        ));
    }
    if rest.contains(['/', '?', '#', '@']) {
        return wrong("has more than a host and a port", RIGHT);
    }
    let Some((host, port)) = host_and_port(rest) else {
        return wrong("has no usable host", RIGHT);
    };
    let number = match port {
        None if is_modbus_tcp => Some(MODBUS_TCP_PORT),
        Some(digits) => port_number(digits),
        None => {
            let bracketed = if host.contains(':') {
                format!("[{host}]")
            } else {
                host.to_owned()
            };
            let right = format!(
                "the port that the serial device server listens on, as \"tcp://{bracketed}:4001\""
            );
            return wrong("has no port, and there is no default one", &right);
        }
    };
    let Some(port) = number else {
        return wrong("has no usable port", "a port from 1 to 65535");
    };
    // One spelling per host, so that duplicate ports are found.
    let host = host
        .parse()
        .map_or_else(|_| host.to_ascii_lowercase(), |ip: Ipv6Addr| ip.to_string());
    Ok(if is_modbus_tcp {
        PortAddress::ModbusTcp { host, port }
    } else {
        PortAddress::Tcp { host, port }
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::path::Path;

    fn tcp(host: &str, port: u16) -> PortAddress {
        PortAddress::Tcp {
            host: host.to_owned(),
            port,
        }
    }

    #[test]
    fn devices_device_servers_and_modbus_tcp_are_distinguished() {
        let modbus_tcp = |host: &str, port| PortAddress::ModbusTcp {
            host: host.to_owned(),
            port,
        };
        let device = |path: &str| PortAddress::Device(Path::new(path).to_owned());
        for (text, address) in [
            ("/dev/ttyUSB0", device("/dev/ttyUSB0")),
            (
                "/dev/serial/by-id/usb-a:b",
                device("/dev/serial/by-id/usb-a:b"),
            ),
            ("tcp://10.0.0.7:4001", tcp("10.0.0.7", 4001)),
            ("tcp://Hall-1.Example:1", tcp("hall-1.example", 1)),
            ("tcp://[::1]:65535", tcp("::1", 65_535)),
            ("tcp://[FD00:0::7]:4001", tcp("fd00::7", 4001)),
            ("modbus-tcp://10.0.0.7:1502", modbus_tcp("10.0.0.7", 1502)),
            (
                "modbus-tcp://Press.Example",
                modbus_tcp("press.example", 502),
            ),
            ("modbus-tcp://[FD00:0::7]", modbus_tcp("fd00::7", 502)),
        ] {
            assert_eq!(parse(text), Ok(address), "{text}");
        }
        assert_eq!(tcp("fd00::7", 4001).to_string(), "tcp://[fd00::7]:4001");
        assert_eq!(tcp("hall", 1).to_string(), "tcp://hall:1");
        assert_eq!(
            modbus_tcp("fd00::7", 502).to_string(),
            "modbus-tcp://[fd00::7]:502"
        );
    }

    #[test]
    fn whatever_else_is_refused_with_what_would_be_right() {
        let usual = "/dev/ttyUSB0";
        for (text, what, right) in [
            ("", "`` is not an absolute path", usual),
            ("ttyUSB0", "`ttyUSB0` is not an absolute path", usual),
            ("10.0.0.7:4001", "is not an absolute path", "tcp://"),
            (
                "http://10.0.0.7:4001",
                "a line over `http://` is not served",
                "tcp://",
            ),
            (
                "TCP://10.0.0.7:4001",
                "a line over `TCP://` is not served",
                "tcp://",
            ),
            (
                "udp://10.0.0.7:4001",
                "a line over `udp://` is not served",
                "tcp://",
            ),
            ("modbus-tcp://", "has no usable host", usual),
            (
                "modbus-tcp://10.0.0.7:0",
                "has no usable port",
                "1 to 65535",
            ),
            (
                "modbus-tcp://10.0.0.7/1",
                "has more than a host and a port",
                "modbus-tcp://",
            ),
            (
                "modbus://10.0.0.7",
                "a line over `modbus://` is not served",
                "modbus-tcp://",
            ),
            ("tcp://", "has no usable host", usual),
            ("tcp://:4001", "has no usable host", usual),
            ("tcp://a b:4001", "has no usable host", usual),
            ("tcp://fd00::7:4001", "has no usable port", "1 to 65535"),
            ("tcp://10.0.0.7", "has no port", "\"tcp://10.0.0.7:4001\""),
            ("tcp://[::1]", "has no port", "\"tcp://[::1]:4001\""),
            ("tcp://10.0.0.7:", "has no usable port", "1 to 65535"),
            ("tcp://10.0.0.7:0", "has no usable port", "1 to 65535"),
            ("tcp://10.0.0.7:65536", "has no usable port", "1 to 65535"),
            ("tcp://10.0.0.7:+1", "has no usable port", "1 to 65535"),
            (
                "tcp://10.0.0.7:4001/",
                "has more than a host and a port",
                "tcp://",
            ),
            (
                "tcp://me@10.0.0.7:4001",
                "has more than a host and a port",
                "tcp://",
            ),
        ] {
            let (problem, instead) = parse(text).expect_err(text);
            assert!(
                problem.contains(what) && instead.contains(right),
                "{text}: {problem}; {instead}"
            );
        }
    }
}
