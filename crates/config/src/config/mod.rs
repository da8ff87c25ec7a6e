//! The configuration file, from its text to ready values or to all its problems at once. Opens nothing.
//!
//! `file` declares the tables with their keys, takes the values as written, each with its location, refuses every other key,
//! and fills the settings that the rooms use. `resolve` checks the rules between keys and puts all together: `link` compares
//! lines with their models, `control` and `native` check what may be commanded and written, `mqtt` checks the broker,
//! `line_plan` the cost of polls, `listen` the listeners with their roles (`listener_tls`), `http` the page and its users,
//! `units` the units of drives, `titles` what people call each part, `standby` the second gateway, `commanders` whether commands
//! can arrive at all. Neither stops at the first mistake. A key without effect (on this model, or beside the other keys) is a
//! warning; a key that affects what may move a motor is an error. Properties that only show when a port is opened (a
//! pseudo-terminal, a driver that can switch the direction) are left to the daemon.

mod acceptance;
mod broker;
pub mod change;
mod client_ids;
mod commanders;
mod control;
pub mod edit;
mod file;
mod host;
mod http;
pub mod line_plan;
mod link;
mod listen;
mod listener_tls;
mod lists;
mod mqtt;
mod native;
mod points;
mod port;
mod port_address;
pub mod qualified;
mod ratings;
pub mod ready;
mod ready_broker;
mod resolve;
mod secrets;
mod serial;
mod standby;
#[cfg(test)]
mod tests;
mod titles;
pub mod units;
mod watchdog;
pub mod words;
pub mod written;

pub use acceptance::{is_tried, is_unproven};
pub use control::why_not as why_not_controlled;
pub use native::{ListedRegister, listed};
pub use ratings::shown_in_per_cent;
pub use ready::{
    BEHIND_A_BRIDGE, BrokerCredentials, BrokerSettings, ClientCertificate, Config, DriveSettings,
    GatewaySettings, HashSource, HttpSettings, HttpTls, JournalSettings, LineSettings, LineSilence,
    ListenerSettings, ListenerTls, MqttSettings, PageViewers, PasswordSource, PortAddress,
    RemovalRule, SerialMasterSettings, SparkplugSettings, TlsSettings, UserSettings,
    command_deadline,
};
pub use secrets::without_secrets;

use crate::domain::problem::Problem;
use crate::profile::catalog::Catalog;
use crate::toml_file::{LocatedValue, OptionalKey};
use file::ConfigFile;
use qualified::QualifiedResults;
use resolve::KnownModels;
use std::path::PathBuf;

/// Parses a port, for tools that take one as an argument.
///
/// # Errors
/// The text is not a valid port: what is wrong, and what would be right.
pub fn port_address(text: &str) -> Result<PortAddress, String> {
    port_address::parse(text).map_err(|(what, right)| format!("{what}; help: {right}"))
}

/// Parses the port of a serial line, for tools that look for drives at each station and setting.
///
/// # Errors
/// The text is not a valid port, or one of Modbus TCP: what is wrong, and what would be right.
pub fn serial_port_address(text: &str) -> Result<PortAddress, String> {
    let address = port_address(text)?;
    if address.is_serial_line() {
        return Ok(address);
    }
    Err(
        "drives can be searched only on serial lines; help: a `[[line]]` with this port, and the \
         unit of each drive as its `station`"
            .to_owned(),
    )
}

/// The model directories of `text`, whose models belong to the catalog that it is [loaded](load) with; each with its
/// location. Empty if they are unusable, which loading reports.
#[must_use]
pub fn model_dirs(text: &str) -> Vec<LocatedValue<PathBuf>> {
    match file::gateway(text).map(|gateway| gateway.model_dirs) {
        Some(OptionalKey::Valid(dirs)) => dirs.value,
        _ => Vec::new(),
    }
}

/// The data directory of `text`; `None` if it names none, or no usable one, which loading reports.
#[must_use]
pub fn data_dir(text: &str) -> Option<PathBuf> {
    let dir = file::gateway(text)?.data_dir;
    dir.valid().map(|dir| dir.value.clone())
}

/// Loads the configuration in `text`, with the models of `catalog`, where nothing was tried at any drive.
///
/// # Errors
/// Every problem of the text, by position, at least one of them more than a warning. Invalid TOML is reported as such,
/// and its keys are not checked. If there are only warnings, they are in the configuration.
pub fn load(text: &str, catalog: &Catalog) -> Result<Config, Vec<Problem>> {
    load_at_site(text, catalog, Ok(&QualifiedResults::default()))
}

/// Loads the configuration as [`load`] does, with what was tried at its drives; or why nobody knows, which is reported.
///
/// # Errors
/// As [`load`].
pub fn load_at_site(
    text: &str,
    catalog: &Catalog,
    site: Result<&QualifiedResults, &str>,
) -> Result<Config, Vec<Problem>> {
    let models = KnownModels {
        catalog,
        are_all: true,
        site,
    };
    with_models(text, models)
}

/// The problems of `text` with an incomplete `catalog`, some of whose model files have problems of their own: a
/// missing model may be one of those.
#[must_use]
pub fn problems_without_some_models(text: &str, catalog: &Catalog) -> Vec<Problem> {
    let models = KnownModels {
        catalog,
        are_all: false,
        site: Ok(&QualifiedResults::default()),
    };
    with_models(text, models).err().unwrap_or_default()
}

fn with_models(text: &str, models: KnownModels<'_>) -> Result<Config, Vec<Problem>> {
    let mut problems = Vec::new();
    let file = ConfigFile::read(text, &mut problems);
    let config = file.and_then(|file| resolve::resolve(&file, models, &mut problems));
    problems.sort_by_key(|problem| problem.span.start);
    secrets::hide_in(&mut problems, text);
    match config {
        Some(config) if problems.iter().all(|problem| problem.is_warning) => Ok(Config {
            digest: digest(text),
            warnings: problems,
            ..config
        }),
        _ => Err(problems),
    }
}

/// The CRC of the settings in `text`, which must be valid TOML.
fn digest(text: &str) -> u64 {
    const CRC: crc::Crc<u64> = crc::Crc::<u64>::new(&crc::CRC_64_XZ);
    // Its keys are in the order of their names.
    let table: toml::Table = text.parse().unwrap_or_default();
    CRC.checksum(table.to_string().as_bytes())
}
