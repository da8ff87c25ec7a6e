//! Turns the configuration as written into ready values: defaults, models, and the rules between keys.

use super::file::{ConfigFile, DriveFile, LineFile, ListenerFile};
use super::full_scale;
use super::link::{self, OnLine, SettledLink};
use super::mqtt::DriveDefaults;
use super::qualified::{FILE_NAME, QualifiedResults, QualifiedStanding};
use super::ready::{
    Config, DriveSettings, GatewaySettings, JournalSettings, LineSettings, ListenerSettings,
    PortAddress,
};
use super::units::{self, DriveUnits};
use super::{
    acceptance, commanders, control, http, line_plan, listen, listener_tls, lists, mqtt, points,
    port, ratings, serial, standby, watchdog,
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
use crate::toml_file::{KeyLocation, LocatedValue, OptionalKey};
use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;
use std::time::Duration;

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
    site_is_known(file, models, problems);
    acceptance::trials_are_kept(file, problems);
    let are_all = models.are_all && !matches!(file.gateway.model_dirs, OptionalKey::Invalid);
    let models = KnownModels { are_all, ..models };
    let is_published = !matches!(file.mqtt, OptionalKey::Absent);
    let defaults = mqtt::defaults(file);
    let of_mqtt = is_published.then_some(defaults);
    standby::check(file, problems);
    let parts: Vec<LineParts> = file
        .lines
        .iter()
        .map(|line| parts_of(line, models, of_mqtt, problems))
        .collect();
    let served = listen::settle(file, problems);
    let units = units::settle(file, &served, problems);
    let session_lease = mqtt::session_lease(file, defaults.lease);
    let mqtt = whole(&file.mqtt, |mqtt| {
        mqtt::settle(mqtt, file, session_lease, problems)
    });
    let http = whole(&file.http, |http| http::settle(http, file, problems));
    listen::units_exist(file, &served, &units, problems);
    commanders::check(file, &served, &units, problems);
    points::idle(file, problems);
    let pair = whole(&file.standby, |it| standby::settle(it, file, problems));

    let lines = file.lines.iter().zip(parts).zip(&units);
    let mut ready = Vec::new();
    for ((of_line, parts), units) in lines {
        let line = ready_line(of_line, parts, units, pair.as_ref());
        ready.push(line.inspect(|line| {
            line_plan::check(of_line, line, problems);
            standby::has_time(file, line, problems);
            for (location, drive) in of_line.drives.iter().enumerate() {
                watchdog::is_fed(drive, line, location, problems);
            }
        }));
    }
    let listeners = file
        .listeners
        .iter()
        .zip(&served)
        .map(|(it, served)| ready_listener(it, served.clone()));
    let serial_masters = serial::settle(
        file,
        &served[file.listeners.len().min(served.len())..],
        problems,
    );
    let journal = ready_journal(file, problems);
    Some(Config {
        journal: journal?,
        gateway: GatewaySettings {
            name: file.gateway.name.clone().optional()?,
            data_dir: file.gateway.data_dir.clone().optional()?,
            on_removal: file.gateway.on_removal()?,
        },
        standby: pair?,
        lines: ready.into_iter().collect::<Option<Vec<_>>>()?,
        listeners: listeners.collect::<Option<Vec<_>>>()?,
        serial_masters: serial_masters?,
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
        problems.push(
            dir.location
                .problem(what)
                .right("the file as it was, or none and new trials")
                .warning(),
        );
    }
}

/// A journal requires a data directory.
fn ready_journal(file: &ConfigFile, problems: &mut Vec<Problem>) -> Option<JournalSettings> {
    if let (OptionalKey::Valid(journal), OptionalKey::Absent) =
        (&file.journal, &file.gateway.data_dir)
    {
        let problem = journal
            .location
            .problem("has no effect: there is no journal without a data directory");
        problems.push(
            problem
                .right("`data_dir` in `[gateway]`, or no `[journal]`")
                .warning(),
        );
    }
    let journal = file.journal.clone().optional()?.unwrap_or_default();
    Some(JournalSettings {
        max_bytes: journal.max_size()?,
    })
}

/// The table converted by `settle`: `Some(None)` if it is left out; `None` if it is invalid, see `problems`.
fn whole<T, U>(given: &OptionalKey<T>, settle: impl FnOnce(&T) -> Option<U>) -> Option<Option<U>> {
    match given {
        OptionalKey::Absent => Some(None),
        OptionalKey::Invalid => None,
        OptionalKey::Valid(written) => settle(&written.value).map(Some),
    }
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
    let drive_names = file
        .lines
        .iter()
        .flat_map(|line| &line.drives)
        .filter_map(|drive| drive.name.as_ref());
    let ports = file.lines.iter().filter_map(|line| line.port.as_ref());
    let ports = ports.chain(file.serial.iter().filter_map(|serial| serial.port.as_ref()));
    let master_names = file.serial.iter().filter_map(|serial| serial.name.as_ref());
    once(
        master_names,
        |name| name,
        |name| format!("the name `{name}`"),
        "a name that no other serial master uses",
        problems,
    );
    once(
        line_names,
        |name| name,
        |name| format!("the name `{name}`"),
        "a name that no other line uses",
        problems,
    );
    once(
        drive_names,
        |name| name,
        |name| format!("the name `{name}`"),
        "a name that no other drive of the gateway uses",
        problems,
    );
    let right = "a different port; drives on one bus belong to one line";
    once(
        ports,
        PortAddress::place,
        |port| format!("the port {port}"),
        right,
        problems,
    );
    let model_dirs = file
        .gateway
        .model_dirs
        .valid()
        .map_or(&[][..], |dirs| &dirs.value);
    for (at, dir) in model_dirs.iter().enumerate() {
        if model_dirs
            .iter()
            .take(at)
            .any(|earlier| earlier.value == dir.value)
        {
            let problem = dir.location.problem(format!(
                "the directory {} is listed twice",
                dir.value.display()
            ));
            problems.push(problem.right("each directory once").warning());
        }
    }
}

/// Each of `values` has a key of its own.
fn once<'a, T: 'a, K: Ord>(
    values: impl Iterator<Item = &'a LocatedValue<T>>,
    key: impl Fn(&'a T) -> K,
    called: impl Fn(&T) -> String,
    right: &str,
    problems: &mut Vec<Problem>,
) {
    let mut seen: BTreeMap<K, &KeyLocation> = BTreeMap::new();
    for written in values {
        let key = key(&written.value);
        let Some(first) = seen.get(&key) else {
            seen.insert(key, &written.location);
            continue;
        };
        let what = format!("{} is taken by {}", called(&written.value), first.key);
        problems.push(written.location.problem(what).right(right));
    }
}

/// Looks up the models of a line and checks the rules within that line.
/// `of_mqtt` holds the drives' defaults from `[mqtt]`, if there is one.
fn parts_of(
    line: &LineFile,
    models: KnownModels<'_>,
    of_mqtt: Option<DriveDefaults>,
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
    of_mqtt: Option<DriveDefaults>,
    problems: &mut Vec<Problem>,
) -> DriveParts {
    let model = model_of(drive, models, problems);
    let model = full_scale::settle(drive, model, problems);
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
    if let Some(interface) = line.interface.valid()
        && interface.value == Interface::Rs232
        && line.drives.len() > 1
    {
        let what = format!(
            "RS-232 carries one drive, and this line has {}",
            line.drives.len()
        );
        problems.push(
            interface
                .location
                .problem(what)
                .right("\"rs485\", or a line for each drive"),
        );
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
        problems.extend(
            models
                .are_all
                .then(|| unknown_model(written, models.catalog)),
        );
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
        if port::is_modbus_tcp(line) {
            is_a_unit(station, problems);
        } else if let Some(model) = parts
            .model
            .as_ref()
            .filter(|it| !it.link.stations.value.contains(&station.value.0))
        {
            let range = &model.link.stations.value;
            let what = format!("station {} cannot be set on {}", station.value, model.id);
            problems.push(station.location.problem(what).right(format!(
                "{} to {}",
                range.start(),
                range.end()
            )));
        }
        let Some(owner) = owners.get(&station.value) else {
            owners.insert(station.value, drive);
            continue;
        };
        let what = format!(
            "{} and {} both use station {}",
            owner.label(),
            drive.label(),
            station.value
        );
        problems.push(
            station
                .location
                .problem(what)
                .right("a station that no other drive on the line uses"),
        );
    }
}

/// Over Modbus TCP the unit need not be one that the drive takes on a serial line (messaging on TCP/IP implementation
/// guide V1.0b, 4.4.2.1): 255 and 0 stand for the device itself.
fn is_a_unit(station: &LocatedValue<Station>, problems: &mut Vec<Problem>) {
    if (248..=254).contains(&station.value.0) {
        let problem = station
            .location
            .problem(format!("the unit {} is reserved", station.value));
        problems.push(problem.right("0 to 247, or 255, as the drive or the converter is set"));
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
    let shared = LineDefaults {
        framing,
        reply_timeout: line.reply_timeout()?,
        max_lateness: line.port.as_ref()?.value.max_lateness(),
    };
    let drives = line.drives.iter().zip(parts.drives).zip(units);
    let drives = drives.map(|((drive, parts), units)| ready_drive(drive, parts, &shared, *units));
    let is_turned = port::why_not_turned(line).is_none();
    Some(LineSettings {
        name: line.name.as_ref()?.value.clone(),
        port: line.port.as_ref()?.value.clone(),
        link,
        interface,
        direction: line.direction().map(|turned| {
            if is_turned {
                turned
            } else {
                DirectionControl::Adapter
            }
        })?,
        low_latency: line.low_latency()?,
        framing,
        echo: line.echo()?,
        silence: line.silence()?,
        min_request_gap: line.min_request_gap()?,
        reply_timeout: shared.reply_timeout,
        max_status_age: line.max_status_age()?,
        standby: if line.standby()? { pair?.clone() } else { None },
        drives: drives.collect::<Option<Vec<_>>>()?,
    })
}

/// Defaults that drives take from their line.
struct LineDefaults {
    framing: Framing,
    /// Reply time-out for drives without their own.
    reply_timeout: Option<Duration>,
    /// Minimum lateness for drives without their own setting.
    max_lateness: Duration,
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
    Some(DriveSettings {
        name: drive.name.as_ref()?.value.clone(),
        station: drive.station.as_ref()?.value,
        unit: units.native?,
        uniform_unit: units.uniform?,
        group: drive.group.clone().optional()?,
        poll: drive.poll()?,
        reply_timeout: drive.reply_timeout.or(line.reply_timeout)?,
        max_lateness: drive.max_lateness.or(model
            .timing
            .max_lateness
            .value
            .max(line.max_lateness))?,
        control: parts.control?,
        ratings: parts.ratings?,
        points: parts.points?,
        model,
    })
}

fn ready_listener(listener: &ListenerFile, served: BTreeSet<usize>) -> Option<ListenerSettings> {
    let lines = listener
        .lines
        .clone()
        .optional()?
        .map(|_| served.into_iter().collect());
    let stop = match &listener.stop {
        OptionalKey::Absent => None,
        given => Some(lists::values(given)?),
    };
    let allow = listener.allow.clone().optional()?;
    let tls = listener_tls::settle(listener)?;
    let write = match (&listener.write, &tls) {
        (OptionalKey::Absent, Some(tls)) => listener_tls::networks(allow.as_deref(), tls),
        (write, _) => lists::values(write)?,
    };
    Some(ListenerSettings {
        listen: listener.listen.as_ref()?.value,
        allow,
        lines,
        write,
        stop,
        reads_renew: listener.reads_renew()?,
        cached: listener.cached()?,
        units: match &listener.units {
            OptionalKey::Absent => None,
            given => Some(lists::values(given)?),
        },
        connections_max: listener
            .connections_max
            .clone()
            .optional()?
            .map(|most| most as usize),
        priority: lists::values(&listener.priority)?,
        idle_timeout: Some(listener.idle_timeout()?).filter(|time| !time.is_zero()),
        keep_alive: Some(listener.keep_alive()?).filter(|time| !time.is_zero()),
        tls,
    })
}
