//! Walks the TOML from the outer tables to the inner ones and takes each value with its place.

use super::file::{DriveFile, File, LineFile, ListenerFile};
use super::keys;
use super::ready::Silence;
use crate::domain::ids::{Name, Station, UnitId};
use crate::domain::problem::Problem;
use crate::profile::reader::{Given, Needed, Reader, Written, document};
use crate::profile::register::{RegisterFile, extra_register};
use crate::profile::values::Kind;
use crate::profile::words::{FRAMINGS, INTERFACES, PARITIES};
use ipnet::IpNet;
use std::net::IpAddr;
use std::ops::RangeInclusive;
use std::path::PathBuf;
use std::time::Duration;

const BAUD: RangeInclusive<u32> = 300..=4_000_000;
const SILENCE: RangeInclusive<Duration> = Duration::ZERO..=Duration::from_secs(1);
const REQUEST_GAP: RangeInclusive<Duration> = Duration::ZERO..=Duration::from_secs(10);
const REPLY_TIMEOUT: RangeInclusive<Duration> = Duration::from_millis(1)..=Duration::from_secs(60);
const MAX_LATENESS: RangeInclusive<Duration> = Duration::from_millis(10)..=Duration::from_secs(60);
const POLL: RangeInclusive<Duration> = Duration::from_millis(10)..=Duration::from_secs(3600);

/// The configuration as it is written; nothing: `text` is no TOML, and `problems` says where.
pub(super) fn read(text: &str, problems: &mut Vec<Problem>) -> Option<File> {
    let document = document(text, problems)?;
    let mut reader = Reader::new(document.section(), problems);
    refuse_not_served(&mut reader, keys::Section::Root);
    let gateway = reader.table("gateway");
    let file = File {
        name: gateway.usable().map_or(Given::LeftOut, |section| read_gateway(reader.open(section.value.clone()))),
        lines: each(&mut reader, "line", read_line),
        listeners: each(&mut reader, "modbus_tcp", read_listener),
    };
    if file.lines.is_empty() {
        let problem = reader.place().missing("line").problem("there is no line");
        reader.problems().push(problem.right("`[[line]]` with `name`, `port` and at least one `[[line.drive]]`"));
    }
    reader.finish();
    Some(file)
}

fn read_gateway(mut reader: Reader<'_, '_>) -> Given<Name> {
    refuse_not_served(&mut reader, keys::Section::Gateway);
    let name = reader.optional("name", &name_kind());
    reader.finish();
    name
}

fn read_line(mut reader: Reader<'_, '_>) -> LineFile {
    refuse_not_served(&mut reader, keys::Section::Line);
    let line = LineFile {
        place: reader.place().clone(),
        name: reader.required("name", &name_kind()),
        port: read_port(&mut reader),
        baud: reader.optional("baud", &Kind::number(BAUD)),
        data_bits: reader.optional("data_bits", &Kind::number(7..=8)),
        parity: reader.optional("parity", &Kind::one_of(&PARITIES)),
        stop_bits: reader.optional("stop_bits", &Kind::number(1..=2)),
        framing: reader.optional("framing", &Kind::one_of(&FRAMINGS)),
        interface: reader.optional("interface", &Kind::one_of(&INTERFACES)),
        silence: read_silence(&mut reader),
        min_request_gap: reader.optional("min_request_gap", &Kind::duration(REQUEST_GAP)),
        reply_timeout: reader.optional("reply_timeout", &Kind::duration(REPLY_TIMEOUT).or_word("auto")),
        drives: each(&mut reader, "drive", read_drive),
    };
    if line.drives.is_empty() {
        let problem = line.place.missing("drive").problem("the line has no drive");
        reader.problems().push(problem.right("`[[line.drive]]` with `name`, `model` and `station`"));
    }
    reader.finish();
    line
}

fn read_drive(mut reader: Reader<'_, '_>) -> DriveFile {
    refuse_not_served(&mut reader, keys::Section::Drive);
    let drive = DriveFile {
        place: reader.place().clone(),
        name: reader.required("name", &name_kind()),
        model: reader.required("model", &Kind::text()),
        station: read_station(&mut reader),
        unit: read_unit(&mut reader),
        poll: reader.optional("poll", &Kind::duration(POLL)),
        reply_timeout: reader.optional("reply_timeout", &Kind::duration(REPLY_TIMEOUT).or_word("auto")),
        max_lateness: reader.optional("max_lateness", &Kind::duration(MAX_LATENESS)),
        registers: read_registers(&mut reader),
    };
    reader.finish();
    drive
}

fn read_listener(mut reader: Reader<'_, '_>) -> ListenerFile {
    refuse_not_served(&mut reader, keys::Section::ModbusTcp);
    let listen = Kind::parsed("an address with a port: \"127.0.0.1:1502\", \"[::1]:1502\"", |text| text.parse().ok());
    let listener = ListenerFile {
        place: reader.place().clone(),
        listen: reader.required("listen", &listen),
        allow: read_allow(&mut reader),
        lines: reader.list("lines", &Kind::text()),
    };
    reader.finish();
    listener
}

/// What `read` makes of each table `[[key]]`.
fn each<'a, T>(reader: &mut Reader<'a, '_>, key: &'static str, read: impl Fn(Reader<'a, '_>) -> T) -> Vec<T> {
    let sections = reader.tables(key);
    sections.into_iter().map(|section| read(reader.open(section))).collect()
}

/// Refuses each key of `section` that is known but not served.
fn refuse_not_served(reader: &mut Reader<'_, '_>, section: keys::Section) {
    for key in keys::not_served(section) {
        reader.refuse(key.name, key.refusal(), key.instead);
    }
}

fn read_registers(reader: &mut Reader<'_, '_>) -> Vec<RegisterFile> {
    let sections = reader.tables("register");
    sections.into_iter().map(|section| extra_register(section, reader.problems())).collect()
}

fn name_kind() -> Kind<'static, Name> {
    let right = format!("1 to {} letters, digits, \"-\", \"_\" or \".\"", Name::MAX_CHARS);
    Kind::parsed(right, Name::new)
}

fn read_silence(reader: &mut Reader<'_, '_>) -> Given<Silence> {
    let silence = reader.optional("silence", &Kind::duration(SILENCE).or_word("auto"));
    turned(silence, |fixed| Some(fixed.map_or(Silence::Auto, Silence::Fixed)))
}

fn read_station(reader: &mut Reader<'_, '_>) -> Needed<Station> {
    let Written { value, place } = reader.required("station", &Kind::number(0..=u8::MAX))?;
    Some(Written { value: Station(value), place })
}

fn read_unit(reader: &mut Reader<'_, '_>) -> Given<UnitId> {
    turned(reader.optional("unit", &Kind::number(UnitId::MIN..=UnitId::MAX)), UnitId::new)
}

/// What `turn` makes of the value; it takes every value that the kind lets through.
fn turned<T, U>(given: Given<T>, turn: impl Fn(T) -> Option<U>) -> Given<U> {
    match given {
        Given::LeftOut => Given::LeftOut,
        Given::Unusable => Given::Unusable,
        Given::Usable(Written { value, place }) => {
            turn(value).map_or(Given::Unusable, |value| Given::Usable(Written { value, place }))
        }
    }
}

fn read_port(reader: &mut Reader<'_, '_>) -> Needed<PathBuf> {
    const RIGHT: &str = "an absolute path, as \"/dev/serial/by-id/...\" or \"/dev/ttyUSB0\"";
    let port = reader.required("port", &Kind::text())?;
    let path = PathBuf::from(&port.value);
    let what = match port.value.split_once("://") {
        Some((scheme, _)) => format!("a line over `{scheme}://` is not served by this version"),
        None if path.is_absolute() => return Some(Written { value: path, place: port.place }),
        None => format!("`{}` is no absolute path", port.value),
    };
    reader.problems().push(port.place.problem(what).right(RIGHT));
    None
}

fn read_allow(reader: &mut Reader<'_, '_>) -> Given<Vec<IpNet>> {
    let list = match reader.list("allow", &Kind::text()) {
        Given::LeftOut => return Given::LeftOut,
        Given::Unusable => return Given::Unusable,
        Given::Usable(list) => list,
    };
    if list.value.is_empty() {
        let problem = list.place.problem("an empty list lets nobody connect");
        reader.problems().push(problem.right("networks as \"10.0.0.0/24\", or no listener at all"));
        return Given::Unusable;
    }
    let networks: Vec<Option<IpNet>> = list.value.iter().map(|it| network(it, reader.problems())).collect();
    match networks.into_iter().collect() {
        Some(value) => Given::Usable(Written { value, place: list.place }),
        None => Given::Unusable,
    }
}

/// A network in the notation address/bits. One with bits behind its length set is refused, because it may
/// mean the network or the one host.
fn network(written: &Written<String>, problems: &mut Vec<Problem>) -> Option<IpNet> {
    let text = &written.value;
    let (what, right) = match (text.parse::<IpNet>(), text.parse::<IpAddr>()) {
        (Ok(network), _) if network.trunc() == network => return Some(network),
        (Ok(network), _) => {
            let host = IpNet::from(network.addr());
            ("is a host inside a network", format!("\"{}\" for the network, \"{host}\" for the host", network.trunc()))
        }
        (_, Ok(host)) => ("has no length", format!("\"{}\" for this one host", IpNet::from(host))),
        _ => ("is no network", "an address and its length: \"10.0.0.0/24\", \"fd00::/64\"".to_owned()),
    };
    problems.push(written.place.problem(format!("`{text}` {what}")).right(right));
    None
}
