//! Where a gateway keeps its data, for commands that read it whether the gateway runs or not.

use super::{CommandFailure, input};
use crate::config::Config;
use crate::north::titles::PlantTitles;
use std::path::PathBuf;

/// The data directory, by itself or by the configuration that names it.
#[derive(Debug, clap::Args)]
pub struct DataDirArgs {
    /// The gateway's configuration file: the journal is in the data directory that it names, and its titles are shown
    #[arg(short, long, value_name = "FILE", conflicts_with = "data_dir")]
    config: Option<PathBuf>,
    /// The gateway's data directory
    #[arg(long, value_name = "DIR", default_value = "/var/lib/vfd-gateway")]
    data_dir: PathBuf,
}

impl DataDirArgs {
    /// The directory, and the titles of the configuration, if that is given.
    ///
    /// # Errors
    /// The configuration cannot be read, or names no directory.
    pub fn read(&self) -> Result<(PathBuf, PlantTitles), CommandFailure> {
        let Some(config) = &self.config else {
            return Ok((self.data_dir.clone(), PlantTitles::default()));
        };
        let Config {
            gateway, titles, ..
        } = input::configuration(config)?;
        let directory = gateway.data_dir.ok_or_else(|| {
            CommandFailure::wrong(format!(
                "{}: without `data_dir` in [gateway] there is no journal",
                config.display()
            ))
        })?;
        Ok((directory, titles))
    }
}
