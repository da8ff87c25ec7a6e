//! What a request to the page says about itself: by which name the gateway was called, from which page it was sent,
//! whose it is.

use super::sessions::Key;
use std::net::{Ipv4Addr, Ipv6Addr};

/// Name of the session's cookie.
pub const COOKIE: &str = "vfd_session";

/// Whether a browser that calls the gateway `host`, as in the header `Host`, can only have been sent here by the
/// gateway itself: an address, this host, or one of `names` (in lower case). Any other name may be one that a foreign
/// page has pointed here.
#[must_use]
pub fn may_be_called<'n>(host: &str, mut names: impl Iterator<Item = &'n str>) -> bool {
    if let Some(bracketed) = host.strip_prefix('[') {
        let address = bracketed.split_once(']').filter(|(_, port)| is_port(port));
        return address.is_some_and(|(address, _)| address.parse::<Ipv6Addr>().is_ok());
    }
    let (name, port) = host.split_at(host.find(':').unwrap_or(host.len()));
    let name = name.strip_suffix('.').unwrap_or(name).to_ascii_lowercase();
    let is_own =
        name.parse::<Ipv4Addr>().is_ok() || name == "localhost" || name.ends_with(".localhost");
    is_port(port) && (is_own || names.any(|own| own == name))
}

fn is_port(text: &str) -> bool {
    text.is_empty()
        || text
            .strip_prefix(':')
            .is_some_and(|port| port.parse::<u16>().is_ok())
}

/// Whether a request with these headers `Origin` and `Host` comes from the gateway's own page. Browsers leave the usual port
/// out of both.
#[must_use]
pub fn is_own_page(origin: &str, host: &str) -> bool {
    let authority = origin
        .strip_prefix("https://")
        .or_else(|| origin.strip_prefix("http://"));
    authority.is_some_and(|authority| !host.is_empty() && authority.eq_ignore_ascii_case(host))
}

/// Whether a browser says, by the headers `Sec-Fetch-Site` and `Sec-Fetch-Mode`, that a page of another site sends the
/// request in the background. It could not read the answer, but it would hold its connection. Following a link is not
/// of this kind.
#[must_use]
pub fn is_of_another_site(site: &str, mode: &str) -> bool {
    site == "cross-site" && mode != "navigate"
}

/// The id of the session that the header `Cookie` names; `None` if it names none that could be one.
#[must_use]
pub fn session_id(cookies: &str) -> Option<Key> {
    let of = |cookie: &str| {
        cookie
            .trim()
            .strip_prefix(COOKIE)?
            .strip_prefix('=')
            .map(str::to_owned)
    };
    cookies.split(';').find_map(|cookie| key(&of(cookie)?))
}

/// The 32 bytes in `text` as hexadecimal digits.
#[must_use]
pub fn key(text: &str) -> Option<Key> {
    if text.len() != 64 || !text.bytes().all(|byte| byte.is_ascii_hexdigit()) {
        return None;
    }
    let mut key = Key::default();
    for (place, byte) in key.iter_mut().enumerate() {
        *byte = u8::from_str_radix(text.get(2 * place..2 * place + 2)?, 16).ok()?;
    }
    Some(key)
}

/// The key of a session as 64 hexadecimal digits.
#[must_use]
pub fn key_text(key: &Key) -> String {
    key.iter().map(|byte| format!("{byte:02x}")).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_names_that_are_ours_are_taken() {
        let names = ["gateway", "gateway.plant.example"];
        let may = |host: &str| may_be_called(host, names.into_iter());
        for good in [
            "127.0.0.1",
            "127.0.0.1:8080",
            "10.0.0.7:80",
            "[::1]:8080",
            "[fd00::1]",
            "localhost:8080",
            "LOCALHOST",
            "localhost.",
            "a.localhost",
            "gateway",
            "Gateway.Plant.Example:443",
        ] {
            assert!(may(good), "{good}");
        }
        for bad in [
            "",
            "evil.example",
            "evil.example:8080",
            "127.0.0.1.evil.example",
            "localhost.evil.example",
            "xlocalhost",
            "[::1",
            "[::1]x",
            "[evil]",
            "127.0.0.1:http",
            "127.0.0.1:99999",
            "gateway@evil.example",
            "plant.example",
            "::1",
        ] {
            assert!(!may(bad), "{bad}");
        }
    }

    #[test]
    fn only_the_own_page_is_taken() {
        for (origin, host) in [
            ("http://127.0.0.1:8080", "127.0.0.1:8080"),
            ("https://gw.example", "gw.example"),
            ("http://Localhost:8080", "localhost:8080"),
            ("http://[::1]:8080", "[::1]:8080"),
        ] {
            assert!(is_own_page(origin, host), "{origin}");
        }
        for (origin, host) in [
            ("null", "127.0.0.1:8080"),
            ("", ""),
            ("http://", ""),
            ("http://127.0.0.1:8081", "127.0.0.1:8080"),
            ("http://127.0.0.1", "127.0.0.1:8080"),
            ("http://evil.example", "127.0.0.1:8080"),
            ("http://127.0.0.1:8080.evil.example", "127.0.0.1:8080"),
            ("file://127.0.0.1:8080", "127.0.0.1:8080"),
            ("127.0.0.1:8080", "127.0.0.1:8080"),
        ] {
            assert!(!is_own_page(origin, host), "{origin}");
        }
    }

    #[test]
    fn only_pages_of_other_sites_ask_in_the_background_in_vain() {
        assert!(
            is_of_another_site("cross-site", "no-cors") && is_of_another_site("cross-site", "cors")
        );
        for (site, mode) in [
            ("cross-site", "navigate"),
            ("same-site", "cors"),
            ("same-origin", "cors"),
            ("none", ""),
            ("", ""),
        ] {
            assert!(!is_of_another_site(site, mode), "{site} {mode}");
        }
    }

    #[test]
    fn a_session_is_found_among_cookies() {
        let key = [0xA5; 32];
        let text = key_text(&key);
        assert_eq!(super::key(&text), Some(key));
        for cookies in [
            format!("vfd_session={text}"),
            format!("a=b; vfd_session={text}; c=d"),
            format!("vfd_session=short;vfd_session={text}"),
        ] {
            assert_eq!(session_id(&cookies), Some(key), "{cookies}");
        }
        let long = format!("vfd_session={text}00");
        for cookies in [
            "",
            "vfd_session",
            "vfd_session=",
            &long,
            &text,
            &format!("xvfd_session={text}"),
            "vfd_session=ü",
        ] {
            assert_eq!(session_id(cookies), None, "{cookies}");
        }
        let odd = format!("vfd_session={}ü", "a".repeat(62));
        assert_eq!(session_id(&odd), None);
        assert_eq!(super::key(&format!("+{}", "1".repeat(63))), None);
    }
}
