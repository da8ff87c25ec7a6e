//! Single reads from one station of which no model is known.

use crate::cli::tools::CommandFailure;
use crate::config::PortAddress;
use crate::daemon::lines::tool_line::ToolPort;
use crate::daemon::scan::asker::PortAsker;
pub use crate::daemon::scan::judge::ReadOutcome;
use crate::daemon::scan::plan::{ScanOptions, ScanPlan};
use crate::daemon::scan::survey::LineAsker;
use crate::domain::address::Address;
use crate::domain::link::{DirectionControl, LinkSettings};
use crate::vendors;

/// One station of a line that is used by nothing else.
pub struct SingleReads {
    asker: PortAsker,
    station: u8,
}

impl SingleReads {
    /// Opens `port`, after listening as a scan does.
    ///
    /// # Errors
    /// The line cannot be used, or another master uses it.
    pub async fn open(
        port: &PortAddress,
        link: LinkSettings,
        direction: DirectionControl,
        station: u8,
    ) -> Result<Self, CommandFailure> {
        let options = ScanOptions {
            everything: true,
            bauds: vec![link.baud],
            parity: Some(link.parity),
            stop_bits: Some(link.stop_bits),
            is_network: matches!(port, PortAddress::Tcp { .. }),
            ..ScanOptions::default()
        };
        let models: Vec<_> = vendors::catalog().models().cloned().collect();
        let plan = ScanPlan::new(&models, vec![station], &options);
        let setting = plan
            .settings
            .first()
            .ok_or_else(|| CommandFailure::wrong(format!("no drive is set to {link}")))?;
        let mut asker = PortAsker::new(ToolPort {
            address: port.clone(),
            link,
            direction,
        });
        asker.open(setting, &[station]).await?;
        Ok(Self { asker, station })
    }

    /// Reads one register.
    ///
    /// # Errors
    /// The line is lost, or another master uses it.
    pub async fn read(&mut self, address: Address) -> Result<ReadOutcome, CommandFailure> {
        Ok(self.asker.ask(self.station, address).await?)
    }

    /// Releases the port.
    pub async fn close(&mut self) {
        self.asker.close().await;
    }
}
