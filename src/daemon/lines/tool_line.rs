//! A line of a tool: the same thread and core as a gateway's, with stations that are not polled. There is no second
//! master in this program.

use crate::config::PortAddress;
use crate::daemon::exchange::north_sides::NorthSides;
use crate::daemon::exchange::shared::{SharedLine, SharedPlant};
use crate::daemon::line_thread::{LineHandle, LinePort};
use crate::daemon::lines::build;
use crate::daemon::local::LocalSide;
use crate::daemon::port::{PortOpener, PortSettings};
use crate::domain::address::Address;
use crate::domain::command::Report;
use crate::domain::ids::{DriveIndex, Name};
use crate::domain::link::{DirectionControl, EchoPolicy, Interface, LinkSettings};
use crate::domain::report::{LineReport, LineState};
use crate::domain::time::MonoTime;
use crate::drive::description::DriveRef;
use crate::gateway::{DriveSetup, LineSetup};
use crate::line::timing::LineTiming;
use std::io;
use std::sync::Arc;
use std::time::Duration;
use tokio::task::JoinHandle;
use tokio::time::{Instant, sleep};

/// Longest time until a port is open, or a device server has answered.
const OPEN_WITHIN: Duration = Duration::from_secs(6);
/// Longest time until the thread of a closed line has exited.
const END_WITHIN: Duration = Duration::from_secs(3);
/// How often it is checked whether the port is open.
const LOOK_EVERY: Duration = Duration::from_millis(10);

/// Why a tool has no line.
#[derive(Debug, thiserror::Error)]
pub enum NoLine {
    /// The port cannot be opened.
    #[error("cannot open {port}: {reason}")]
    Port {
        /// The port as it was named.
        port: PortAddress,
        /// Why.
        reason: String,
    },
    /// The port was opened, or a device server was contacted, but the line did not come up in time.
    #[error("{port} did not come up within {} s{}", OPEN_WITHIN.as_secs(), .fault.as_ref().map(|it| format!(": {it}")).unwrap_or_default())]
    Down {
        /// The port as it was named.
        port: PortAddress,
        /// Why, as far as it is known.
        fault: Option<String>,
    },
    /// The system refuses a resource.
    #[error("the system refuses a resource that a line needs: {0}")]
    System(#[from] io::Error),
}

/// The port of a tool.
#[derive(Clone, Debug)]
pub struct ToolPort {
    /// Where it is.
    pub address: PortAddress,
    /// Speed and character format.
    pub link: LinkSettings,
    /// What controls the direction.
    pub direction: DirectionControl,
}

impl ToolPort {
    fn settings(&self, name: &str) -> PortSettings {
        PortSettings {
            line: name.to_owned(),
            address: self.address.clone(),
            link: self.link,
            direction: self.direction,
            low_latency: true,
            needs_virtual: false,
            lock_dirs: build::lock_dirs(None),
        }
    }

    /// Opens the port for a moment, so that another user of it is named before work begins. No other device is contacted:
    /// many accept one connection, and free it late.
    ///
    /// # Errors
    /// [`NoLine::Port`]
    pub async fn try_open(&self, name: &str) -> Result<(), NoLine> {
        if self.address.network().is_some() {
            return Ok(());
        }
        let settings = self.settings(name);
        let mut opener = PortOpener::new(&settings);
        let opened = opener.open().await;
        opened.map(drop).map_err(|error| NoLine::Port {
            port: self.address.clone(),
            reason: opener.explain(&error),
        })
    }
}

/// A line that a tool has for itself. It ends when it is [closed](Self::close) or with the process.
#[derive(Debug)]
pub struct ToolLine {
    side: Arc<LocalSide>,
    line: Arc<SharedLine>,
    handle: LineHandle,
    distributes: JoinHandle<()>,
}

impl ToolLine {
    /// Opens `port` for the tool called `name`, with `drives` that only get the tool's own requests.
    ///
    /// # Errors
    /// [`NoLine`]
    pub async fn open(
        port: &ToolPort,
        name: &Name,
        timing: LineTiming,
        drives: Vec<DriveSetup>,
    ) -> Result<Self, NoLine> {
        port.try_open(name.as_str()).await?;
        let setup = LineSetup {
            timing,
            drives,
            echo: EchoPolicy::Strip,
            tells_traffic: tracing::enabled!(tracing::Level::TRACE),
            first_epoch: 1,
            asked_before: true,
            joins_late: false,
            standby: None,
            keeps: false,
        };
        let line = Arc::new(SharedLine::new(0, name.clone(), Interface::Rs485, []));
        let shared = Arc::new(SharedPlant::of(vec![Arc::clone(&line)], Arc::default()));
        let side = Arc::new(LocalSide::new(Arc::clone(&shared), None));
        let north = NorthSides::default();
        let distributes = tokio::spawn(Arc::clone(&side).distribute(Arc::clone(&north.local)));
        let place = LinePort {
            line: name.to_string(),
            drives: Vec::new(),
            settings: port.settings(name.as_str()),
        };
        let changed = Arc::clone(&shared.changed);
        let mut handle =
            LineHandle::prepare(place, setup, Arc::clone(&line), changed, north, None)?;
        handle.begin(&crate::daemon::line_thread::Memory::new());
        let line = Self {
            side,
            line,
            handle,
            distributes,
        };
        match line.comes_up().await {
            true => Ok(line),
            false => {
                let fault = line.report().down_reason();
                line.close().await;
                Err(NoLine::Down {
                    port: port.address.clone(),
                    fault,
                })
            }
        }
    }

    async fn comes_up(&self) -> bool {
        let until = Instant::now() + OPEN_WITHIN;
        while Instant::now() < until {
            if self.report().state == LineState::Up {
                return true;
            }
            sleep(LOOK_EVERY).await;
        }
        false
    }

    /// The line as of its last round.
    #[must_use]
    pub fn report(&self) -> LineReport {
        self.line.report()
    }

    /// Reads the register at `address` of the drive at `place` of the line.
    ///
    /// # Errors
    /// Why there is no word.
    pub async fn read(
        &self,
        place: u16,
        address: Address,
        deadline: MonoTime,
    ) -> Result<u16, Report> {
        self.side
            .read(
                DriveRef {
                    line: 0,
                    drive: DriveIndex(place),
                },
                address,
                deadline,
            )
            .await
    }

    /// Gives the port back.
    pub async fn close(mut self) {
        self.handle.close();
        self.handle.ended_by(Instant::now() + END_WITHIN).await;
        self.distributes.abort();
        self.handle.join();
    }
}
