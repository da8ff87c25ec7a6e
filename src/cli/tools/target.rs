//! The drive that `read`, `write` and `watch` address: behind a gateway by its unit, or directly on a port by its
//! station.

use super::CommandFailure;
use super::client::{GatewayPath, UnitClient};
use super::own_gateway::{DriveArgs, OwnGateway, ToolAccess, UNIFORM_UNIT, UNIT};
use crate::config::{self, PortAddress};
use crate::profile::catalog::Catalog;
use crate::profile::model::Model;
use std::sync::Arc;

/// Where the drive is.
#[derive(Clone, Debug, clap::Args)]
pub struct DriveTarget {
    /// Where the gateway listens
    #[arg(long, default_value = "127.0.0.1")]
    host: String,
    /// Modbus TCP port of the gateway; or, without a gateway, the line itself: a serial port or tcp://HOST:PORT, with
    /// --model and --station
    #[arg(long, value_name = "PORT", default_value = "1502", value_parser = TargetPort::parse)]
    port: TargetPort,
    /// Unit of the drive at the gateway: the native one, or with `--uniform` the uniform one
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u8).range(0..=255), required_unless_present = "station")]
    unit: Option<u8>,
    #[command(flatten)]
    on_port: DriveArgs,
}

/// A port of either kind.
#[derive(Clone, Debug, PartialEq, Eq)]
enum TargetPort {
    /// The port of the gateway.
    Tcp(u16),
    /// The port of the line.
    Line(PortAddress),
}

impl TargetPort {
    fn parse(text: &str) -> Result<Self, String> {
        match text.parse() {
            Ok(number) => Ok(Self::Tcp(number)),
            Err(_) => config::port_address(text).map(Self::Line),
        }
    }
}

/// A reachable drive.
pub struct ReachedDrive {
    /// The path to it.
    pub client: UnitClient,
    own: Option<OwnGateway>,
}

impl ReachedDrive {
    /// Shuts down the gateway that was started for this, if any.
    pub async fn close(self) {
        if let Some(own) = self.own {
            own.close().await;
        }
    }
}

impl DriveTarget {
    /// The drive's model, directly on a port.
    ///
    /// # Errors
    /// None is given, or there is none of this name.
    pub fn model(&self) -> Result<Option<Arc<Model>>, CommandFailure> {
        match self.port {
            TargetPort::Tcp(_) => Ok(None),
            TargetPort::Line(_) => self.on_port.model().map(Some),
        }
    }

    /// The known models, with those in the given directories.
    ///
    /// # Errors
    /// Problems of their files, and what cannot be read.
    pub fn catalog(&self) -> Result<Catalog, CommandFailure> {
        self.on_port.catalog()
    }

    /// Whether there is no gateway between.
    #[must_use]
    pub const fn is_straight(&self) -> bool {
        matches!(self.port, TargetPort::Line(_))
    }

    /// The addressed drive, for people and programs: `unit 3`, `station 3`.
    #[must_use]
    pub fn place(&self) -> (&'static str, u8) {
        match self.port {
            TargetPort::Tcp(_) => ("unit", self.unit.unwrap_or_default()),
            TargetPort::Line(_) => ("station", self.on_port.station().unwrap_or_default()),
        }
    }

    /// The path to the drive: directly on a port through a gateway of the tool's own that may do what `extra` says.
    ///
    /// # Errors
    /// The arguments do not go together, or directly on a port the drive does not answer.
    pub async fn reach(
        &self,
        is_uniform: bool,
        extra: &ToolAccess,
    ) -> Result<ReachedDrive, CommandFailure> {
        match &self.port {
            TargetPort::Tcp(port) => {
                let unit = self
                    .unit
                    .ok_or_else(|| CommandFailure::wrong("through a gateway, --unit is needed"))?;
                Ok(ReachedDrive {
                    client: UnitClient::new(GatewayPath::Tcp(self.host.clone(), *port), unit),
                    own: None,
                })
            }
            TargetPort::Line(line) => {
                let own = OwnGateway::start(line, &self.on_port, extra).await?;
                let unit = if is_uniform { UNIFORM_UNIT } else { UNIT };
                let client = UnitClient::new(GatewayPath::Own(own.connections()), unit);
                Ok(ReachedDrive {
                    client,
                    own: Some(own),
                })
            }
        }
    }
}
