//! `map`: every Modbus map of a configuration, for programmers of controllers and SCADA systems.

mod form;

use crate::cli::tools::{CommandFailure, input, print};
use crate::config::{Config, ListenerSettings};
use crate::daemon::lines::build;
use crate::domain::command::Rights;
use crate::domain::ids::UnitId;
use crate::drive::description::DriveDescription;
use crate::north::modbus::own;
use crate::north::modbus::sheet::{self, SheetRow};
use std::path::PathBuf;

/// Arguments of `map`.
#[derive(Debug, clap::Args)]
pub struct Args {
    /// The configuration file
    #[arg(short, long, value_name = "FILE")]
    config: PathBuf,
    /// Output format
    #[arg(long, value_enum, default_value_t = MapFormat::Md)]
    format: MapFormat,
    /// Only this unit, native or uniform; 255 is the gateway itself
    #[arg(long, value_name = "N")]
    unit: Option<u8>,
    /// Print JSON
    #[arg(long, conflicts_with = "format")]
    json: bool,
}

/// The output format.
#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum)]
enum MapFormat {
    /// CSV for spreadsheets and tag imports
    Csv,
    /// Markdown for reading and printing
    Md,
}

/// One unit with everything that is reached at it.
#[derive(Debug)]
struct UnitMap {
    unit: u8,
    /// `native`, `uniform` or `gateway`.
    kind: &'static str,
    /// The drive's name; `None` for the gateway.
    drive: Option<String>,
    /// Model and line of the drive.
    model: Option<(String, String)>,
    /// The listeners and serial masters that reach it.
    listeners: Vec<String>,
    rows: Vec<SheetRow>,
}

/// Prints the maps.
pub fn map(args: &Args) -> Result<(), CommandFailure> {
    let config = input::configuration(&args.config)?;
    if config.listeners.is_empty() && config.serial_masters.is_empty() {
        return Err(CommandFailure::wrong(format!(
            "{}: there is no Modbus server, so there is no map; a `[[modbus_tcp]]` with `listen` serves one",
            args.config.display()
        )));
    }
    let mut maps = maps(&config);
    if let Some(unit) = args.unit {
        let units: Vec<_> = maps.iter().map(|map| map.unit.to_string()).collect();
        maps.retain(|map| map.unit == unit);
        if maps.is_empty() {
            return Err(CommandFailure::wrong(format!(
                "there is no unit {unit}; units are {}",
                units.join(", ")
            )));
        }
    }
    print(&match (args.json, args.format) {
        (true, _) => form::json(&maps),
        (false, MapFormat::Csv) => form::csv(&maps),
        (false, MapFormat::Md) => form::markdown(&maps),
    })
}

/// The maps of all units: each drive's two in the order of the file, then the gateway's.
fn maps(config: &Config) -> Vec<UnitMap> {
    let shared = build::shared(config);
    let drives: Vec<_> = shared
        .drives
        .iter()
        .map(|drive| &drive.description)
        .collect();
    let mut maps = Vec::new();
    for drive in &drives {
        maps.extend(of_drive(config, drive, drive.unit, "native", |rights| {
            sheet::native(drive, rights)
        }));
        maps.extend(of_drive(
            config,
            drive,
            drive.uniform_unit,
            "uniform",
            |rights| sheet::uniform(drive, rights),
        ));
    }
    let lines: Vec<_> = config.lines.iter().map(|line| line.name.as_str()).collect();
    let names: Vec<_> = drives.iter().map(|drive| drive.name.as_str()).collect();
    let servers = servers(config);
    let rows = sheet::gateway(&lines, &names, rights(&servers));
    maps.push(UnitMap {
        unit: own::UNIT,
        kind: "gateway",
        drive: None,
        model: None,
        listeners: servers.into_iter().map(|(name, _)| name).collect(),
        rows,
    });
    maps
}

/// What serves units, by name: an address, or a serial master.
type Server<'c> = (String, &'c ListenerSettings);

/// All of them, listeners first.
fn servers(config: &Config) -> Vec<Server<'_>> {
    let listeners = config
        .listeners
        .iter()
        .map(|listener| (listener.listen.to_string(), listener));
    let masters = config
        .serial_masters
        .iter()
        .map(|master| (format!("modbus-rtu:{}", master.name), &master.serving));
    listeners.chain(masters).collect()
}

/// The map of `unit` of `drive`; `None` if nothing serves it.
fn of_drive(
    config: &Config,
    drive: &DriveDescription,
    unit: UnitId,
    kind: &'static str,
    rows: impl FnOnce(Rights) -> Vec<SheetRow>,
) -> Option<UnitMap> {
    let line = usize::from(drive.place.line);
    let serve = |(_, server): &Server<'_>| server.serves(line) && server.answers_at(unit);
    let servers: Vec<_> = servers(config).into_iter().filter(serve).collect();
    (!servers.is_empty()).then(|| UnitMap {
        unit: unit.get(),
        kind,
        drive: Some(drive.name.to_string()),
        model: Some((drive.model.id.clone(), drive.line.to_string())),
        rows: rows(rights(&servers)),
        listeners: servers.into_iter().map(|(name, _)| name).collect(),
    })
}

/// The rights that at least one of `servers` grants to some client.
fn rights(servers: &[Server<'_>]) -> Rights {
    let all = servers.iter().map(|(_, server)| of_listener(server));
    all.fold(Rights::NONE, |rights, more| Rights {
        write: rights.write || more.write,
        stop: rights.stop || more.stop,
    })
}

/// The rights that `listener` grants to some client, by addresses and roles.
fn of_listener(listener: &ListenerSettings) -> Rights {
    let has_role = |may: fn(&Rights) -> bool| {
        listener
            .tls
            .as_ref()
            .is_none_or(|tls| tls.roles.values().any(may))
    };
    let stop = listener.stop.as_ref().unwrap_or(&listener.write);
    Rights {
        write: !listener.write.is_empty() && has_role(|role| role.write),
        stop: !stop.is_empty() && has_role(|role| role.stop),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::config;
    use crate::vendors;
    use std::path::Path;

    fn maps_of(file: &str) -> Vec<UnitMap> {
        let catalog = vendors::catalog();
        let text =
            std::fs::read_to_string(Path::new(env!("CARGO_MANIFEST_DIR")).join(file)).unwrap();
        maps(&config::load(&text, &catalog).unwrap())
    }

    /// Compared with `tests/golden/map/`, and written there with `UPDATE_GOLDEN`.
    fn is_golden(name: &str, found: &str) {
        let path = Path::new(env!("CARGO_MANIFEST_DIR"))
            .join("tests/golden/map")
            .join(name);
        if std::env::var_os("UPDATE_GOLDEN").is_some() {
            std::fs::write(&path, found).unwrap();
        }
        assert_eq!(
            found,
            std::fs::read_to_string(&path).unwrap(),
            "{}",
            path.display()
        );
    }

    #[test]
    fn the_maps_of_two_configurations_are_as_they_were() {
        let several = maps_of("tests/golden/config/several_vendors.toml");
        is_golden("several_vendors.csv", &form::csv(&several));
        let example = maps_of("deploy/vfd-gateway.toml");
        is_golden("example.md", &form::markdown(&example));
    }

    #[test]
    fn json_holds_every_row_of_the_other_forms() {
        let maps = maps_of("tests/golden/config/several_vendors.toml");
        let value: serde_json::Value = serde_json::from_str(&form::json(&maps)).unwrap();
        let rows: usize = value["maps"]
            .as_array()
            .unwrap()
            .iter()
            .map(|map| map["rows"].as_array().unwrap().len())
            .sum();
        assert_eq!(rows + 1, form::csv(&maps).lines().count());
        let uniform = value["maps"]
            .as_array()
            .unwrap()
            .iter()
            .find(|map| map["unit"] == 103)
            .unwrap();
        let word = uniform["rows"]
            .as_array()
            .unwrap()
            .iter()
            .find(|row| row["name"] == "output_frequency")
            .unwrap();
        assert_eq!(
            (&word["address"], &word["number"], &word["unit"]),
            (&4.into(), &"40005".into(), &"Hz".into())
        );
    }

    #[test]
    fn addresses_and_roles_must_both_grant() {
        let catalog = vendors::catalog();
        let found = |keys: &str| {
            let text = include_str!("../../../../tests/golden/config/several_vendors.toml");
            let write = "write = [\"127.0.0.1/32\"]";
            // Some client must be able to command the drive that accepts commands from here.
            let other = format!("{keys}\n[[modbus_tcp]]\nlisten = \"127.0.0.1:1503\"\n{write}");
            let text = text.replace(write, &other);
            let config =
                config::load(&text, &catalog).unwrap_or_else(|problems| panic!("{problems:?}"));
            let Rights { write, stop } = of_listener(&config.listeners[0]);
            (write, stop)
        };
        assert_eq!(found(""), (false, false));
        assert_eq!(found("write = [\"127.0.0.1/32\"]"), (true, true));
        assert_eq!(found("stop = [\"127.0.0.1/32\"]"), (false, true));
        let tls = |roles: &str| {
            let files = "cert_file = \"/a\"\nkey_file = \"/b\"\nclient_ca_file = \"/c\"";
            found(&format!("[modbus_tcp.tls]\n{files}\nroles = {{ {roles} }}"))
        };
        assert_eq!(tls("viewer = []"), (false, false));
        assert_eq!(tls("watchman = [\"stop\"]"), (false, true));
        assert_eq!(tls("operator = [\"write\", \"stop\"]"), (true, true));
    }

    #[test]
    fn every_word_of_a_uniform_unit_but_the_reserved_has_a_name() {
        let maps = maps_of("deploy/vfd-gateway.toml");
        let uniform = maps.iter().find(|map| map.kind == "uniform").unwrap();
        let nameless = uniform
            .rows
            .iter()
            .filter(|row| row.name.is_empty() && row.title != "reserved");
        let titles: Vec<_> = nameless
            .filter(|row| row.table.keyword().ends_with("register"))
            .map(|row| &row.title)
            .collect();
        assert_eq!(
            titles,
            ["write any value: renew the lease; reads lease left"]
        );
    }
}
