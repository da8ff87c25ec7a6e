//! Turns the configuration as written into ready values, with its models and by the rules between keys.

use super::file::{ConfigFile, DriveFile, DriveUnits, LineDefaults, LineFile, MqttDefaults};
use super::link::{self, OnLine, SettledLink};
use super::qualified::{FILE_NAME, QualifiedResults, QualifiedStanding};
use super::ready::{Config, DriveSettings, JournalSettings, LineSettings, PortAddress};
use super::units;
use super::{
    acceptance, commanders, control, http, line_plan, listen, lists, mqtt, points, port, ratings,
    serial, standby, titles, watchdog,
};
use crate::domain::control::ControlSettings;
use crate::domain::ids::Station;
use crate::domain::link::{DirectionControl, Framing, Interface};
use crate::domain::problem::{Problem, alternatives, nearest_names};
use crate::domain::standby::StandbyPair;
use crate::drive::description::{DriveRatings, PointSettings};
use crate::profile::catalog::Catalog;
use crate::profile::model::Model;
use crate::profile::register::with_extra;
use crate::toml_file::{LocatedValue, OptionalKey};
use std::collections::BTreeMap;
use std::sync::Arc;

/// The models that a configuration may name.
#[derive(Clone, Copy)]
pub(super) struct KnownModels<'a> {
    pub catalog: &'a Catalog,
    /// Whether the catalog is complete. Only then can an unknown name be reported as a typing error.
    pub are_all: bool,
    /// What was tried at the drives, or why nobody knows.
    pub site: Result<&'a QualifiedResults, &'a str>,
}

/// The ready configuration; `None` if any part of `file` is unusable, see `problems`.
pub(super) fn resolve(
    file: &ConfigFile,
    models: KnownModels<'_>,
    problems: &mut Vec<Problem>,
) -> Option<Config> {
    unique(file, problems);
    let titles = titles::settle(file, problems);
    site_is_known(file, models, problems);
    acceptance::trials_are_kept(file, problems);
    let are_all = models.are_all && !matches!(file.gateway.model_dirs, OptionalKey::Invalid);
    let models = KnownModels { are_all, ..models };
    let defaults = mqtt::defaults(file);
    let of_mqtt = (!file.mqtt.is_absent()).then_some(defaults);
    standby::check(file, problems);
    let mut parts = Vec::new();
    for line in &file.lines {
        parts.push(parts_of(line, models, of_mqtt, problems));
    }
    let served = listen::settle(file, problems);
    let units = units::settle(file, &served, problems);
    let lease = mqtt::session_lease(file, defaults.lease);
    let mqtt = file
        .mqtt
        .settle(|mqtt| mqtt::settle(mqtt, file, lease, problems));
    let http = file.http.settle(|http| http::settle(http, file, problems));
    listen::units_exist(file, &served, &units, problems);
    commanders::check(file, &served, &units, problems);
    points::idle(file, problems);
    let pair = file
        .standby
        .settle(|standby| standby::settle(standby, file, problems));

    let mut lines = Vec::new();
    for ((of_line, parts), units) in file.lines.iter().zip(parts).zip(&units) {
        let line = ready_line(of_line, parts, units, pair.as_ref());
        lines.push(line.inspect(|line| {
            line_plan::check(of_line, line, problems);
            standby::has_time(file, line, problems);
            for (location, drive) in of_line.drives.iter().enumerate() {
                watchdog::is_fed(drive, line, location, problems);
            }
        }));
    }
    let listeners = file.listeners.iter().zip(&served);
    let listeners = listeners.map(|(it, served)| listen::settings(it, served));
    let of_masters = served.iter().skip(file.listeners.len());
    let masters = serial::settle(file, of_masters, problems);
    let journal = ready_journal(file, problems);
    Some(Config {
        journal: journal?,
        gateway: file.gateway.settings()?,
        titles,
        standby: pair?,
        lines: lines.into_iter().collect::<Option<_>>()?,
        listeners: listeners.collect::<Option<_>>()?,
        serial_masters: masters?,
        mqtt: mqtt?,
        http: http?,
        // Computed from the text, which is not known here.
        digest: 0,
        warnings: Vec::new(),
    })
}

/// Reports a file of trials that cannot be used: without it nothing that was tried at a drive counts, which is no
/// reason not to serve the other drives.
fn site_is_known(file: &ConfigFile, models: KnownModels<'_>, problems: &mut Vec<Problem>) {
    if let (Err(why), OptionalKey::Valid(dir)) = (models.site, &file.gateway.data_dir) {
        let what = format!(
            "{FILE_NAME} there cannot be used, so nothing that was qualified counts: {why}"
        );
        dir.warn(what, "the file as it was, or none and new trials", problems);
    }
}

/// A journal requires a data directory.
fn ready_journal(file: &ConfigFile, problems: &mut Vec<Problem>) -> Option<JournalSettings> {
    if let (OptionalKey::Valid(journal), OptionalKey::Absent) =
        (&file.journal, &file.gateway.data_dir)
    {
        journal.warn(
            "has no effect: there is no journal without a data directory",
            "`data_dir` in `[gateway]`, or no `[journal]`",
            problems,
        );
    }
    let journal = file.journal.clone().optional()?.unwrap_or_default();
    journal.settings()
}

/// Data that the catalog adds to a line as written.
struct LineParts {
    drives: Vec<DriveParts>,
    settled: Option<SettledLink>,
}

/// Values that depend on a drive's model; for each `None` there is a problem.
struct DriveParts {
    model: Option<Arc<Model>>,
    control: Option<Option<Arc<ControlSettings>>>,
    ratings: Option<DriveRatings>,
    points: Option<PointSettings>,
}

/// Names of lines, names of drives and ports are unique.
fn unique(file: &ConfigFile, problems: &mut Vec<Problem>) {
    let line_names = file.lines.iter().filter_map(|line| line.name.as_ref());
    let drive_names = file.drives().filter_map(|drive| drive.name.as_ref());
    let ports = file.lines.iter().filter_map(|line| line.port.as_ref());
    let ports = ports.chain(file.serial.iter().filter_map(|serial| serial.port.as_ref()));
    let master_names = file.serial.iter().filter_map(|serial| serial.name.as_ref());
    lists::names_differ(master_names, "serial master", problems);
    lists::names_differ(line_names, "line", problems);
    lists::names_differ(drive_names, "drive of the gateway", problems);
    let right = "a different port; drives on one bus belong to one line";
    let called = |port: &PortAddress| format!("the port {port}");
    lists::differ(ports, PortAddress::place, called, right, problems);
    let dirs = file.gateway.model_dirs.valid();
    let dirs = dirs.map_or(&[][..], |dirs| &dirs.value);
    for (at, dir) in dirs.iter().enumerate() {
        if lists::has(dirs.iter().take(at), &dir.value) {
            let what = format!("the directory {} is listed twice", dir.value.display());
            dir.warn(what, "each directory once", problems);
        }
    }
}

/// Looks up the models of a line and checks the rules within that line.
/// `of_mqtt` holds the drives' defaults from `[mqtt]`, if there is one.
fn parts_of(
    line: &LineFile,
    models: KnownModels<'_>,
    of_mqtt: Option<MqttDefaults>,
    problems: &mut Vec<Problem>,
) -> LineParts {
    let drives: Vec<_> = line
        .drives
        .iter()
        .map(|drive| drive_parts(line, drive, models, of_mqtt, problems))
        .collect();
    stations(line, &drives, problems);
    alone_on_rs232(line, problems);
    port::check(line, problems);
    let mut on_line: Vec<OnLine> = Vec::new();
    for (drive, parts) in line.drives.iter().zip(&drives) {
        let Some(model) = &parts.model else { continue };
        if on_line.iter().all(|other| other.model.id != model.id) {
            on_line.push(OnLine { model, drive });
        }
    }
    let settled = link::settle(line, &on_line, problems);
    LineParts { drives, settled }
}

fn drive_parts(
    line: &LineFile,
    drive: &DriveFile,
    models: KnownModels<'_>,
    of_mqtt: Option<MqttDefaults>,
    problems: &mut Vec<Problem>,
) -> DriveParts {
    let model = model_of(drive, models, problems);
    let model = ratings::full_scale(drive, model, problems);
    let standing = standing(line, drive, model.as_deref(), models);
    let control = control::settle(
        (line, drive),
        model.as_deref(),
        of_mqtt.unwrap_or_default(),
        &standing,
        problems,
    );
    let ratings = ratings::settle(drive, model.as_deref(), problems);
    let points = points::settle(drive, model.as_deref(), of_mqtt.is_some(), problems);
    DriveParts {
        model,
        control,
        ratings,
        points,
    }
}

/// What was tried at `drive`.
fn standing(
    line: &LineFile,
    drive: &DriveFile,
    model: Option<&Model>,
    models: KnownModels<'_>,
) -> QualifiedStanding {
    let Ok(site) = models.site else {
        return QualifiedStanding::Unreadable;
    };
    let (Some(line), Some(station), Some(model)) = (&line.name, &drive.station, model) else {
        return QualifiedStanding::Never;
    };
    site.standing(line.value.as_str(), station.value, model)
}

fn alone_on_rs232(line: &LineFile, problems: &mut Vec<Problem>) {
    let count = line.drives.len();
    if let Some(interface) = line.interface.valid_as(&Interface::Rs232)
        && count > 1
    {
        let what = format!("RS-232 carries one drive, and this line has {count}");
        interface.refuse(what, "\"rs485\", or a line for each drive", problems);
    }
}

/// The model of a drive, with the registers that the file adds.
fn model_of(
    drive: &DriveFile,
    models: KnownModels<'_>,
    problems: &mut Vec<Problem>,
) -> Option<Arc<Model>> {
    let written = drive.model.as_ref()?;
    let Some(model) = models.catalog.find(&written.value).cloned() else {
        if models.are_all {
            problems.push(unknown_model(written, models.catalog));
        }
        return None;
    };
    if drive.registers.is_empty() {
        return Some(model);
    }
    Some(Arc::new(with_extra(&model, &drive.registers, problems)))
}

fn unknown_model(written: &LocatedValue<String>, catalog: &Catalog) -> Problem {
    let problem = written
        .location
        .problem(format!("there is no model `{}`", written.value));
    let near: Vec<_> = nearest_names(&written.value, catalog.ids())
        .iter()
        .map(|near| format!("\"{near}\""))
        .collect();
    if !near.is_empty() {
        return problem.right(alternatives(&near));
    }
    problem.right(format!(
        "one of the {} that `vfd-gateway models list` shows, or any Modbus device that a model file of your own describes, in \
         a directory of `model_dirs`",
        catalog.ids().count()
    ))
}

/// Each station is in its model's range and unique on the line.
fn stations(line: &LineFile, parts: &[DriveParts], problems: &mut Vec<Problem>) {
    let mut owners: BTreeMap<Station, &DriveFile> = BTreeMap::new();
    for (drive, parts) in line.drives.iter().zip(parts) {
        let Some(station) = &drive.station else {
            continue;
        };
        let number = station.value;
        if port::is_modbus_tcp(line) {
            is_a_unit(station, problems);
        } else if let Some(model) = &parts.model
            && !model.link.stations.value.contains(&number.0)
        {
            let range = &model.link.stations.value;
            let what = format!("station {number} cannot be set on {}", model.id);
            let right = format!("{} to {}", range.start(), range.end());
            station.refuse(what, right, problems);
        }
        let Some(owner) = owners.get(&number) else {
            owners.insert(number, drive);
            continue;
        };
        let (owner, drive) = (owner.label(), drive.label());
        let what = format!("{owner} and {drive} both use station {number}");
        let right = "a station that no other drive on the line uses";
        station.refuse(what, right, problems);
    }
}

/// Over Modbus TCP the unit need not be one that the drive takes on a serial line (messaging on TCP/IP implementation
/// guide V1.0b, 4.4.2.1): 255 and 0 stand for the device itself.
fn is_a_unit(station: &LocatedValue<Station>, problems: &mut Vec<Problem>) {
    if (248..=254).contains(&station.value.0) {
        station.refuse(
            format!("the unit {} is reserved", station.value),
            "0 to 247, or 255, as the drive or the converter is set",
            problems,
        );
    }
}

fn ready_line(
    line: &LineFile,
    parts: LineParts,
    units: &[DriveUnits],
    pair: Option<&Option<StandbyPair>>,
) -> Option<LineSettings> {
    let SettledLink {
        link,
        framing,
        interface,
    } = parts.settled?;
    let defaults = LineDefaults {
        framing,
        reply_timeout: line.reply_timeout()?,
        max_lateness: line.port.as_ref()?.value.max_lateness(),
    };
    let drives = line.drives.iter().zip(parts.drives).zip(units);
    let drives = drives.map(|((drive, parts), units)| ready_drive(drive, parts, &defaults, *units));
    let drives = drives.collect::<Option<_>>()?;
    let direction = match (port::why_not_turned(line), line.direction()?) {
        (None, direction) => direction,
        (Some(_), _) => DirectionControl::Adapter,
    };
    let standby = if line.standby()? { pair?.clone() } else { None };
    line.settings(link, framing, interface, direction, standby, drives)
}

fn ready_drive(
    drive: &DriveFile,
    parts: DriveParts,
    line: &LineDefaults,
    units: DriveUnits,
) -> Option<DriveSettings> {
    let model = match line.framing {
        Framing::Rtu | Framing::Mbap => parts.model?,
        Framing::Ascii => Arc::new(parts.model?.on(line.framing)),
    };
    let (control, ratings, points) = (parts.control?, parts.ratings?, parts.points?);
    drive.settings(model, units, line, control, ratings, points)
}
