//! Commissioning from the page: finds drives on a port that no line uses, and adds them to the configuration file. What it
//! does on a line only reads.

pub mod file;
pub mod running;
pub mod values;
pub mod wanted;

use crate::config::{self, Config, PortAddress};
use crate::daemon::lines::tool_line::ToolPort;
use crate::daemon::local::LocalSide;
use crate::daemon::scan::plan::{ScanOptions, ScanPlan, stations};
use crate::domain::link::{DirectionControl, Parity};
use crate::domain::problem::Problem;
use crate::profile::catalog::Catalog;
use running::{RunningScan, ScanState};
use std::fmt;
use std::path::PathBuf;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::Duration;
use tokio::sync::{OwnedSemaphorePermit, Semaphore};
use tokio::time::timeout;

/// Longest time until a scan that is to end has released its port.
const ENDS_WITHIN: Duration = Duration::from_secs(5);

/// What a text would be as the configuration.
#[derive(Debug)]
pub struct JudgedConfig {
    /// The models that it can name.
    pub catalog: Catalog,
    /// The configuration, or all its problems.
    pub config: Result<Config, Vec<Problem>>,
}

/// Judges a text that might become the configuration file, or says why that is not possible. May block.
pub type Judge = dyn Fn(&str) -> Result<JudgedConfig, String> + Send + Sync;

/// The configuration file and who judges its contents.
#[derive(Clone)]
pub struct ConfigSite {
    /// The file.
    pub file: PathBuf,
    /// Judges a text for it.
    pub judge: Arc<Judge>,
}

impl fmt::Debug for ConfigSite {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Site")
            .field("file", &self.file)
            .finish_non_exhaustive()
    }
}

/// Which settings of a line a scan tries.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Settings {
    /// The settings with which drives leave the factory.
    Factory,
    /// All that a drive can be set to, which takes long.
    All,
    /// The one that the drives are known to have.
    Only {
        /// Speed in bit/s.
        baud: u32,
        /// Parity.
        parity: Parity,
        /// 1 or 2.
        stop_bits: u8,
    },
}

/// Why something is refused, for people.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum CommissioningRefusal {
    /// What was sent cannot be meant.
    #[error("{0}")]
    Wrong(String),
    /// Not now: something else is in the way.
    #[error("{0}")]
    InTheWay(String),
    /// There is no such thing.
    #[error("{0}")]
    NotThere(String),
}

/// Commissioning of one gateway: one scan at a time, one change of the file at a time.
#[derive(Debug)]
pub struct Commissioning {
    site: ConfigSite,
    side: Arc<LocalSide>,
    scan: Mutex<Option<Arc<RunningScan>>>,
    /// For whatever uses a port.
    port: Arc<Semaphore>,
    writing: tokio::sync::Mutex<()>,
}

impl Commissioning {
    /// Commissioning of the gateway whose configuration is at `site` and whose lines are behind `side`.
    #[must_use]
    pub fn new(site: ConfigSite, side: Arc<LocalSide>) -> Self {
        let port = Arc::new(Semaphore::new(1));
        Self {
            site,
            side,
            scan: Mutex::default(),
            port,
            writing: tokio::sync::Mutex::default(),
        }
    }

    /// The path to the gateway's own lines.
    #[must_use]
    pub const fn side(&self) -> &Arc<LocalSide> {
        &self.side
    }

    /// The last scan, unless it was forgotten.
    #[must_use]
    pub fn scan(&self) -> Option<Arc<RunningScan>> {
        self.last().clone()
    }

    /// Starts a scan of the port called `port`.
    ///
    /// # Errors
    /// Why there is none.
    pub async fn begin(
        &self,
        port: &str,
        asked: &str,
        how: Settings,
    ) -> Result<Arc<RunningScan>, CommissioningRefusal> {
        let place = self.place()?;
        let address = config::serial_port_address(port).map_err(CommissioningRefusal::Wrong)?;
        let asked = stations(asked).map_err(CommissioningRefusal::Wrong)?;
        let is_network = matches!(address, PortAddress::Tcp { .. });
        let options = match how {
            _ if is_network => ScanOptions {
                is_network,
                ..ScanOptions::default()
            },
            Settings::Factory => ScanOptions::default(),
            Settings::All => ScanOptions {
                everything: true,
                ..ScanOptions::default()
            },
            Settings::Only {
                baud,
                parity,
                stop_bits,
            } => ScanOptions {
                bauds: vec![baud],
                parity: Some(parity),
                stop_bits: Some(stop_bits),
                ..ScanOptions::default()
            },
        };
        let catalog = self.catalog().await?;
        let models: Vec<_> = catalog.models().cloned().collect();
        let plan = ScanPlan::new(&models, asked, &options);
        let none = || {
            CommissioningRefusal::Wrong("no model has such a setting: nothing to try".to_owned())
        };
        let link = plan.settings.first().ok_or_else(none)?.link;
        let direction = DirectionControl::Adapter;
        let port = ToolPort {
            address,
            link,
            direction,
        };
        port.try_open(running::NAME)
            .await
            .map_err(|error| CommissioningRefusal::InTheWay(error.to_string()))?;
        let running = Arc::new(RunningScan::new(port, plan));
        *self.last() = Some(Arc::clone(&running));
        tokio::spawn(Arc::clone(&running).run(place));
        Ok(running)
    }

    /// Ends the scan if it still runs, and forgets what it found.
    pub async fn forget(&self) {
        let scan = self.last().take();
        if let Some(scan) = scan {
            scan.end();
            // Released when the scan has given its port back.
            let _ = timeout(ENDS_WITHIN, self.port.acquire()).await;
        }
    }

    /// The last scan, if it was completed.
    ///
    /// # Errors
    /// It was not.
    pub fn done(&self) -> Result<Arc<RunningScan>, CommissioningRefusal> {
        let scan = self
            .scan()
            .filter(|scan| scan.progress().state == ScanState::Done);
        scan.ok_or_else(|| {
            CommissioningRefusal::InTheWay(
                "no scan has been completed; scan the port first".to_owned(),
            )
        })
    }

    /// The permission to use a port.
    fn place(&self) -> Result<OwnedSemaphorePermit, CommissioningRefusal> {
        let busy =
            || CommissioningRefusal::InTheWay("a scan or a read is under way already".to_owned());
        Arc::clone(&self.port)
            .try_acquire_owned()
            .map_err(|_| busy())
    }

    async fn catalog(&self) -> Result<Catalog, CommissioningRefusal> {
        let text = self.text().await.map_err(CommissioningRefusal::InTheWay)?;
        Ok(self
            .judged(text)
            .await
            .map_err(CommissioningRefusal::InTheWay)?
            .catalog)
    }

    fn last(&self) -> MutexGuard<'_, Option<Arc<RunningScan>>> {
        self.scan.lock().unwrap_or_else(PoisonError::into_inner)
    }
}
