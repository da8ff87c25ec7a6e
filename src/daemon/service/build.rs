//! Builds from the configuration what the line threads need.

use crate::config::{
    self, BrokerSettings, Config, DriveSettings, LineSettings, MqttSettings, PasswordSource,
    line_plan,
};
use crate::daemon::exchange::shared::{Shared, SharedLine, StandbyShare};
use crate::daemon::host::secret_files;
use crate::daemon::journal;
use crate::daemon::line_thread::LinePort;
use crate::daemon::mqtt::{ConnectionSettings, Keeps, Secret, TlsSettings, check_tls};
use crate::daemon::port::PortSettings;
use crate::daemon::service::conversations::{BrokerSide, Sparkplug};
use crate::domain::ids::{DriveIndex, Name};
use crate::domain::link::Wiring;
use crate::domain::report::LineReport;
use crate::domain::standby::{LineRole, StandbyPair, StandbyReport, StandbyTrouble};
use crate::drive::description::{DriveDescription, DriveRef};
use crate::drive::plan::Pace;
use crate::gateway::{DriveSetup, LineSetup};
use crate::journal::Remembered;
use std::net::SocketAddr;
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// The core of a line. `first_epoch` must be different at each start of the gateway. `keeps` is whether there is a
/// journal, whose remembered state is not known yet; `joins_late` whether commands are accepted already.
#[must_use]
pub fn line_setup(
    line: &LineSettings,
    first_epoch: u64,
    keeps: bool,
    joins_late: bool,
) -> LineSetup {
    let drives = line.drives.iter().map(drive_setup).collect();
    let tells_traffic = tracing::enabled!(tracing::Level::TRACE);
    LineSetup {
        timing: line_plan::timing(line).0,
        drives,
        echo: line.echo,
        tells_traffic,
        first_epoch,
        asked_before: true,
        joins_late,
        standby: line
            .standby
            .as_ref()
            .map(|pair| line_plan::standby_times(line, pair)),
        keeps,
    }
}

/// The settings of the journal of a gateway with a data directory.
#[must_use]
pub fn journal(config: &Config) -> Option<journal::Settings> {
    let directory = config.gateway.data_dir.clone()?;
    Some(journal::Settings {
        directory,
        max_bytes: config.journal.max_bytes,
        configuration: format!("{:016x}", config.digest),
    })
}

/// What lines and north sides share, with lines that are not served yet.
#[must_use]
pub fn shared(config: &Config) -> Shared {
    let lines = (0..)
        .zip(&config.lines)
        .map(|(number, line)| Arc::new(shared_line(number, line)));
    Shared::of(lines.collect(), Arc::default())
}

/// The same of one line, with a `number` that no other line of the process has.
#[must_use]
pub fn shared_line(number: u16, line: &LineSettings) -> SharedLine {
    let stretch = line_plan::budget(line).stretch;
    let drives = (0..).zip(&line.drives).map(|(index, drive)| {
        let place = DriveRef {
            line: number,
            drive: DriveIndex(index),
        };
        description(place, line, drive, stretch)
    });
    let standby = line.standby.clone().map(|pair| StandbyShare {
        times: line_plan::standby_times(line, &pair),
        pair,
    });
    let shared =
        SharedLine::new(number, line.name.clone(), line.interface, drives).wired(wiring(line));
    if standby.is_some() {
        // Before the first report of its thread it must not be taken for the only gateway there.
        let role = LineRole::Listening;
        let standby = StandbyReport {
            role,
            take_overs: 0,
            given_up: 0,
            rivals: 0,
            hears_other: false,
            listener: None,
            kept: 0,
            trouble: StandbyTrouble::default(),
        };
        shared.set_report(LineReport {
            standby: Some(standby),
            ..LineReport::default()
        });
    }
    shared.shared_with(standby)
}

fn wiring(line: &LineSettings) -> Wiring {
    let stations = line.drives.iter().map(|drive| drive.station).collect();
    Wiring {
        port: line.port.to_string(),
        link: line.link,
        framing: line.framing,
        stations,
    }
}

/// Values age by the period that an overloaded line can actually keep.
fn description(
    place: DriveRef,
    line: &LineSettings,
    drive: &DriveSettings,
    stretch: f64,
) -> DriveDescription {
    DriveDescription {
        place,
        name: drive.name.clone(),
        line: line.name.clone(),
        model: Arc::clone(&drive.model),
        unit: drive.unit,
        uniform_unit: drive.uniform_unit,
        group: drive.group.clone(),
        pace: Pace::new(drive.poll, stretch),
        ratings: drive.ratings,
        control: drive.control.clone(),
        points: drive.points.clone(),
    }
}

/// The connection and session settings of the gateway called `name` for the broker of `mqtt`, with its data in
/// `data_dir`. `standby`: which of several gateways of the name it is. `embedded` is the address of the embedded broker,
/// if that is used.
///
/// # Errors
/// The password cannot be read, or the TLS files cannot be used.
pub fn broker(
    mqtt: &MqttSettings,
    (name, standby): (&Name, Option<&StandbyPair>),
    data_dir: Option<&Path>,
    embedded: Option<SocketAddr>,
) -> Result<BrokerSide, String> {
    let (host, port, also_at, tls) = match (&mqtt.broker, embedded) {
        (
            BrokerSettings::Tcp {
                host,
                port,
                also_at,
                tls,
            },
            _,
        ) => (
            host.clone(),
            *port,
            also_at.clone(),
            tls.as_ref().map(tls_settings),
        ),
        (BrokerSettings::Embedded, Some(address)) => {
            (address.ip().to_string(), address.port(), Vec::new(), None)
        }
        (BrokerSettings::Embedded, None) => {
            return Err("the embedded broker does not listen".to_owned());
        }
    };
    if let Some(tls) = &tls {
        check_tls(tls).map_err(|error| error.to_string())?;
    }
    let password = mqtt
        .credentials
        .as_ref()
        .and_then(|credentials| credentials.password.as_ref());
    let connection = ConnectionSettings {
        host,
        port,
        also_at,
        tls,
        client_id: mqtt.client_id(name, standby),
        user: mqtt
            .credentials
            .as_ref()
            .map(|credentials| credentials.user.clone()),
        password: password.map(read_password).transpose()?,
        keep_alive: mqtt.keep_alive,
        version: mqtt.version,
        keeps: Keeps::Nothing,
    };
    let sparkplug = mqtt
        .sparkplug_session(name.clone(), standby.is_some())
        .zip(data_dir)
        .map(|(settings, data_dir)| Sparkplug {
            connection: ConnectionSettings {
                client_id: mqtt.sparkplug_client_id(name),
                ..connection.clone()
            },
            settings,
            data_dir: data_dir.to_owned(),
        });
    Ok(BrokerSide {
        mqtt: (connection, mqtt.session(name.clone(), standby.cloned())),
        sparkplug,
    })
}

fn tls_settings(tls: &config::TlsSettings) -> TlsSettings {
    let client_cert = tls
        .client
        .as_ref()
        .map(|client| (client.cert_file.clone(), client.key_file.clone()));
    TlsSettings {
        ca_file: tls.ca_file.clone(),
        client_cert,
    }
}

/// A file's text without the line break that editors put at its end.
fn read_password(source: &PasswordSource) -> Result<Secret, String> {
    match source {
        PasswordSource::File(path) => secret_files::read(path)
            .map(|text| Secret::new(text.trim_end_matches(['\n', '\r']).to_owned()))
            .map_err(|error| format!("password_file {}: {error}", path.display())),
        PasswordSource::Env(name) => std::env::var(name)
            .map(Secret::new)
            .map_err(|error| format!("password_env {name}: {error}")),
    }
}

/// The port side of a line of the gateway whose data is in `data_dir`.
#[must_use]
pub fn line_port(line: &LineSettings, data_dir: Option<&Path>) -> LinePort {
    LinePort {
        line: line.name.to_string(),
        drives: line
            .drives
            .iter()
            .map(|drive| drive.name.to_string())
            .collect(),
        settings: PortSettings {
            line: line.name.to_string(),
            address: line.port.clone(),
            link: line.link,
            direction: line.direction,
            low_latency: line.low_latency,
            needs_virtual: line_plan::timing(line).1,
            lock_dirs: lock_dirs(data_dir),
        },
    }
}

/// Directories for the locks of serial devices: where terminal programs look for them, then one that an unprivileged
/// gateway may write.
#[must_use]
pub fn lock_dirs(data_dir: Option<&Path>) -> Vec<PathBuf> {
    let of_session = std::env::var_os("XDG_RUNTIME_DIR")
        .map(PathBuf::from)
        .filter(|dir| dir.is_absolute());
    [PathBuf::from("/run/lock")]
        .into_iter()
        .chain(of_session)
        .chain(data_dir.map(Path::to_owned))
        .collect()
}

fn drive_setup(drive: &DriveSettings) -> DriveSetup {
    DriveSetup {
        station: drive.station,
        model: Arc::clone(&drive.model),
        poll: drive.poll,
        timeouts: line_plan::reply_timeouts(drive),
        max_lateness: drive.max_lateness,
        control: drive.control.clone(),
        remembered: Remembered::default(),
    }
}
