//! The configuration file, from its text to ready values or to all its problems at once. Opens nothing.
//!
//! `read` takes the values as they are written (`file`), each with its place, and refuses every key that is
//! not in the table of [`keys`]. `resolve` fills in what is left out and checks what lies between keys: `link`
//! the lines against their models, `control` and `native` what may be commanded and written, `mqtt` the broker,
//! `line_plan` what the polls of a line cost, `listen` the listeners with their roles (`listener_tls`), `http` who reaches the page and signs in there, `units` who answers where, `commanders` whether
//! commands can come at all. Neither stops at the first mistake. A key that has no effect (on this model, or beside the
//! other keys) is a warning; what changes what may move a motor is an error. What only shows when a port is opened (whether it is a
//! pseudo-terminal, whether its driver can turn the direction) is left to the daemon.

mod broker;
pub mod change;
mod commanders;
mod control;
mod file;
mod host;
mod http;
pub mod keys;
pub mod line_plan;
mod link;
mod listen;
mod listener_tls;
mod lists;
mod mqtt;
mod native;
mod points;
mod port;
mod ratings;
mod read;
pub mod ready;
mod ready_broker;
mod ready_http;
mod resolve;
#[cfg(test)]
mod tests;
mod units;
mod watchdog;
pub mod words;

pub use control::why_not as why_not_controlled;
pub use http::{HashSource, HttpSettings, HttpTls, UserSettings};
pub use native::{Listed, listed};
pub use ratings::shown_in_per_cent;
pub use ready::{
    BEHIND_A_BRIDGE, BrokerSettings, ClientCertificate, Config, Credentials, DriveSettings, GatewaySettings,
    JournalSettings, LineSettings, ListenerSettings, ListenerTls, MqttSettings, PasswordSource, PortAddress, Removal,
    Silence, SparkplugSettings, TlsSettings, command_deadline,
};

use crate::domain::problem::Problem;
use crate::profile::catalog::Catalog;
use crate::toml_file::Spanned;
use resolve::Models;
use std::path::PathBuf;

/// The port that `text` writes, for tools that are given one.
///
/// # Errors
/// It is none: what is wrong, and what would be right.
pub fn port_address(text: &str) -> Result<PortAddress, String> {
    port::parse(text).map_err(|(what, right)| format!("{what}; right would be {right}"))
}

/// The directories whose models belong into the catalogue with which `text` is [loaded](load), each with its place.
/// None where they cannot be told, which loading reports.
#[must_use]
pub fn model_dirs(text: &str) -> Vec<Spanned<PathBuf>> {
    read::model_dirs(text)
}

/// The configuration that `text` states, with the models of `catalog`.
///
/// # Errors
/// Every problem of the text, at least one of them more than a warning, in the order of the text. A text that is no TOML is
/// reported as such, and its keys are not looked at. Where there are warnings only, they are in the configuration.
pub fn load(text: &str, catalog: &Catalog) -> Result<Config, Vec<Problem>> {
    with_models(text, Models { catalog, are_all: true })
}

/// The problems of `text` as far as they show with a `catalog` that lacks models, because the files of those have
/// problems of their own: a drive's model that is not there may be one of them.
#[must_use]
pub fn problems_without_some_models(text: &str, catalog: &Catalog) -> Vec<Problem> {
    with_models(text, Models { catalog, are_all: false }).err().unwrap_or_default()
}

fn with_models(text: &str, models: Models<'_>) -> Result<Config, Vec<Problem>> {
    let mut problems = Vec::new();
    let file = read::read(text, &mut problems);
    let config = file.and_then(|file| resolve::resolve(&file, models, &mut problems));
    problems.sort_by_key(|problem| problem.span.start);
    match config {
        Some(config) if problems.iter().all(|problem| problem.is_warning) => {
            Ok(Config { digest: digest(text), warnings: problems, ..config })
        }
        _ => Err(problems),
    }
}

/// The CRC of the settings in `text`, which is sound TOML.
fn digest(text: &str) -> u64 {
    const CRC: crc::Crc<u64> = crc::Crc::<u64>::new(&crc::CRC_64_XZ);
    // Its keys come in the order of their names.
    let table: toml::Table = text.parse().unwrap_or_default();
    CRC.checksum(table.to_string().as_bytes())
}
