//! The drive that `read`, `write` and `watch` address: behind a gateway by its unit, or directly on a port by its
//! station.

use super::Failure;
use super::client::{Client, Way};
use super::own_gateway::{DriveArgs, Extra, OwnGateway, UNIFORM_UNIT, UNIT};
use crate::config::{self, PortAddress};
use crate::profile::catalog::Catalog;
use crate::profile::model::Model;
use std::sync::Arc;

/// Where the drive is.
#[derive(Clone, Debug, clap::Args)]
pub struct Target {
    /// Where the gateway listens
    #[arg(long, default_value = "127.0.0.1")]
    host: String,
    /// Modbus TCP port of the gateway; or, without a gateway, the line itself: a serial port or tcp://HOST:PORT, with
    /// --model and --station
    #[arg(long, value_name = "PORT", default_value = "1502", value_parser = Port::parse)]
    port: Port,
    /// Unit of the drive at the gateway: the native one, or with `--uniform` the uniform one
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u8).range(0..=255), required_unless_present = "station")]
    unit: Option<u8>,
    #[command(flatten)]
    on_port: DriveArgs,
}

/// A port of either kind.
#[derive(Clone, Debug, PartialEq, Eq)]
enum Port {
    /// Of the gateway.
    Tcp(u16),
    /// Of the line.
    Line(PortAddress),
}

impl Port {
    fn parse(text: &str) -> Result<Self, String> {
        match text.parse() {
            Ok(number) => Ok(Self::Tcp(number)),
            Err(_) => config::port_address(text).map(Self::Line),
        }
    }
}

/// A reachable drive.
pub struct Reached {
    /// The path to it.
    pub client: Client,
    own: Option<OwnGateway>,
}

impl Reached {
    /// Shuts down the gateway that was started for this, if any.
    pub async fn close(self) {
        if let Some(own) = self.own {
            own.close().await;
        }
    }
}

impl Target {
    /// The drive's model, directly on a port.
    ///
    /// # Errors
    /// None is given, or there is none of this name.
    pub fn model(&self) -> Result<Option<Arc<Model>>, Failure> {
        match self.port {
            Port::Tcp(_) => Ok(None),
            Port::Line(_) => self.on_port.model().map(Some),
        }
    }

    /// The known models, with those in the given directories.
    ///
    /// # Errors
    /// Problems of their files, and what cannot be read.
    pub fn catalog(&self) -> Result<Catalog, Failure> {
        self.on_port.catalog()
    }

    /// Whether there is no gateway between.
    #[must_use]
    pub const fn is_straight(&self) -> bool {
        matches!(self.port, Port::Line(_))
    }

    /// The addressed drive, for people and programs: `unit 3`, `station 3`.
    #[must_use]
    pub fn place(&self) -> (&'static str, u8) {
        match self.port {
            Port::Tcp(_) => ("unit", self.unit.unwrap_or_default()),
            Port::Line(_) => ("station", self.on_port.station().unwrap_or_default()),
        }
    }

    /// The path to the drive: directly on a port through a gateway of the tool's own that may do what `extra` says.
    ///
    /// # Errors
    /// The arguments do not go together, or directly on a port the drive does not answer.
    pub async fn reach(&self, is_uniform: bool, extra: &Extra) -> Result<Reached, Failure> {
        match &self.port {
            Port::Tcp(port) => {
                let unit = self
                    .unit
                    .ok_or_else(|| Failure::wrong("through a gateway, --unit is needed"))?;
                Ok(Reached {
                    client: Client::new(Way::Tcp(self.host.clone(), *port), unit),
                    own: None,
                })
            }
            Port::Line(line) => {
                let own = OwnGateway::start(line, &self.on_port, extra).await?;
                let unit = if is_uniform { UNIFORM_UNIT } else { UNIT };
                let client = Client::new(Way::Own(own.connections()), unit);
                Ok(Reached {
                    client,
                    own: Some(own),
                })
            }
        }
    }
}
