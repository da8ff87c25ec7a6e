//! Kinds of values that several tables have.

use super::super::port_address;
use super::super::ready::PortAddress;
use crate::domain::ids::{CommanderName, Name, UnitId};
use crate::north::titles::PartTitle;
use crate::toml_file::declare::{KeyForm, optional};
use crate::toml_file::values::{ValueKind, WrongValue};
use crate::toml_file::{LocatedValue, OptionalKey};
use ipnet::IpNet;
use std::net::{IpAddr, SocketAddr};
use std::ops::RangeInclusive;
use std::path::PathBuf;
use std::time::Duration;

/// A time of `count` milliseconds.
pub const fn ms(count: u64) -> Duration {
    Duration::from_millis(count)
}

/// A time of `count` seconds.
pub const fn seconds(count: u64) -> Duration {
    Duration::from_secs(count)
}

/// A time of `count` minutes.
pub const fn minutes(count: u64) -> Duration {
    seconds(count * 60)
}

/// A time of `count` hours.
pub const fn hours(count: u64) -> Duration {
    minutes(count * 60)
}

/// A name of a part of the plant.
pub fn name() -> ValueKind<'static, Name> {
    let most = Name::MAX_CHARS;
    let right = format!("1 to {most} {}", Name::RULE);
    ValueKind::parsed(right, Name::new).listed_as(format!("name of up to {most} characters"))
}

/// What people call a part of the plant.
pub fn title() -> ValueKind<'static, PartTitle> {
    let most = PartTitle::MAX_CHARS;
    let right = format!("1 to {most} characters of any language, on one line");
    ValueKind::parsed(right, |text| Some(PartTitle::new(text)))
        .and_then(|title| title.map_err(WrongValue::new))
        .listed_as(format!("text of up to {most} characters"))
}

/// A name that may hold control.
pub fn commander_name() -> ValueKind<'static, CommanderName> {
    let most = CommanderName::MAX_CHARS;
    let right = format!("1 to {most} {}", Name::RULE);
    ValueKind::parsed(right, CommanderName::new)
        .listed_as(format!("name of up to {most} characters"))
}

/// An absolute path.
pub fn absolute_path() -> ValueKind<'static, PathBuf> {
    ValueKind::parsed("an absolute path", |text| {
        Some(PathBuf::from(text)).filter(|path| path.is_absolute())
    })
    .listed_as("absolute path")
}

/// A port of the gateway.
pub fn port() -> ValueKind<'static, PortAddress> {
    ValueKind::text().and_then(|text| port_address::parse(&text).map_err(WrongValue::from))
}

/// The speed of a serial port in bit/s.
pub fn baud() -> ValueKind<'static, u32> {
    let kind = ValueKind::number(300..=4_000_000);
    let notation = format!("{} bit/s", kind.notation());
    kind.listed_as(notation)
}

/// Maximum wait for a reply, or as the models need it.
pub fn reply_timeout() -> ValueKind<'static, Option<Duration>> {
    ValueKind::duration(ms(1)..=minutes(1)).or_word("auto")
}

/// A unit of Modbus.
pub fn unit() -> ValueKind<'static, UnitId> {
    ValueKind::number(UnitId::MIN..=UnitId::MAX)
        .and_then(|unit| UnitId::new(unit).ok_or_else(|| WrongValue::new("is no unit")))
}

/// An address with a port; `port` is used in the examples.
pub fn address(port: &str) -> ValueKind<'static, SocketAddr> {
    let right = format!("an address with a port: \"127.0.0.1:{port}\", \"[::1]:{port}\"");
    ValueKind::parsed(right, |text| text.parse().ok()).listed_as("address:port")
}

/// A network in the notation address/bits. Host bits must be zero, because otherwise it may mean the network or
/// the single host.
pub fn network() -> ValueKind<'static, IpNet> {
    ValueKind::text().and_then(|text| {
        let (what, right) = match (text.parse::<IpNet>(), text.parse::<IpAddr>()) {
            (Ok(network), _) if network.trunc() == network => return Ok(network),
            (Ok(network), _) => {
                let (host, network) = (IpNet::from(network.addr()), network.trunc());
                (
                    "is a host inside a network",
                    format!("\"{network}\" for the network, \"{host}\" for the host"),
                )
            }
            (_, Ok(host)) => (
                "has no length",
                format!("\"{}\" for this one host", IpNet::from(host)),
            ),
            _ => (
                "is no network",
                "an address and its length: \"10.0.0.0/24\", \"fd00::/64\"".to_owned(),
            ),
        };
        Err((format!("`{text}` {what}"), right).into())
    })
}

/// A key that is true or false.
pub fn flag() -> KeyForm<'static, OptionalKey<bool>> {
    optional(ValueKind::flag())
}

/// A key with a time in `range`.
pub fn time(range: RangeInclusive<Duration>) -> KeyForm<'static, OptionalKey<Duration>> {
    optional(ValueKind::duration(range))
}

/// A key with one of `words`, which are explained in messages by what each `means`.
pub fn choice<T: Copy + 'static>(
    words: &'static [(&'static str, T)],
    means: fn(T) -> &'static str,
) -> KeyForm<'static, OptionalKey<T>> {
    optional(ValueKind::choice(words, means))
}

/// A list that may be left out.
pub type ListKey<T> = OptionalKey<Vec<LocatedValue<T>>>;

/// Values by the names of registers.
pub type RegisterValues<T> = OptionalKey<Vec<(String, LocatedValue<T>)>>;

/// A table in which the operator chooses the keys: polled registers.
pub fn of_registers<'k, T: 'k>(kind: ValueKind<'k, T>) -> KeyForm<'k, RegisterValues<T>> {
    let notation = format!("table: polled register = {}", kind.notation());
    KeyForm::new(notation, move |reader, key| {
        reader.inner(key, |reader| reader.all(&kind))
    })
}
