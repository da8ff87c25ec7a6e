//! Requests on a real port: a line of the tool's own, reopened for each setting.

use super::ScanError;
use super::judge::ReadOutcome;
use super::plan::{LISTEN, ScanSetting};
use super::survey::LineAsker;
use crate::daemon::host::clock;
use crate::daemon::lines::tool_line::{ToolLine, ToolPort};
use crate::domain::address::Address;
use crate::domain::command::Reason;
use crate::domain::ids::Name;
use crate::domain::link::LinkSettings;
use crate::domain::report::LineCounters;
use std::time::Duration;
use tokio::time::sleep;

/// Stray bytes without a request that are still attributed to an adapter that was switched on.
const LOOSE_BYTES_MAX: u64 = 3;
/// How much longer than the drive the line may take for a read: late replies, and other stations' turns.
const LATE: Duration = Duration::from_secs(2);

/// A port, and the line that is open on it.
#[derive(Debug)]
pub struct PortAsker {
    port: ToolPort,
    name: Name,
    line: Option<ToolLine>,
    stations: Vec<u8>,
    patience: Duration,
    has_listened: bool,
    seen: LineCounters,
    /// The adapter echoes what is sent.
    pub echoes: u64,
    /// Frames of drives that arrived too late to count.
    pub late: u64,
}

impl PortAsker {
    /// Nothing is open yet.
    pub fn new(port: ToolPort) -> Self {
        let name = Name::new("scan").unwrap_or_else(Name::fallback);
        Self {
            port,
            name,
            line: None,
            stations: Vec::new(),
            patience: Duration::ZERO,
            has_listened: false,
            seen: LineCounters::default(),
            echoes: 0,
            late: 0,
        }
    }

    /// Releases the port.
    pub async fn close(&mut self) {
        if let Some(line) = self.line.take() {
            line.close().await;
        }
    }

    fn line(&self) -> Result<&ToolLine, ScanError> {
        self.line
            .as_ref()
            .ok_or_else(|| ScanError::new("the line is not open"))
    }

    /// Only listens, and refuses a line with traffic: two masters take each other's answers.
    async fn listen(&mut self, link: LinkSettings) -> Result<(), ScanError> {
        sleep(LISTEN).await;
        let heard = self.line()?.report().counters;
        let place = &self.port.address;
        let seconds = LISTEN.as_secs();
        let frames = heard.foreign + heard.other_master + heard.strays;
        let how = if frames > 0 {
            format!(
                "{frames} frames were heard on {place} within {seconds} s, although this program has sent no request"
            )
        } else if heard.noise_bytes > LOOSE_BYTES_MAX {
            let bytes = heard.noise_bytes;
            format!(
                "{bytes} bytes were heard on {place} within {seconds} s that make no frame at {link}"
            )
        } else {
            self.has_listened = true;
            return Ok(());
        };
        let right = "stop the other master, a PLC or another gateway, and scan again";
        Err(ScanError::new(format!(
            "the line is in use: {how}; {right}"
        )))
    }

    /// The counters since the last call.
    fn counted(&mut self) -> Result<LineCounters, ScanError> {
        let now = self.line()?.report().counters;
        let before = std::mem::replace(&mut self.seen, now);
        let since = LineCounters {
            garbled: now.garbled - before.garbled,
            noise_bytes: now.noise_bytes - before.noise_bytes,
            other_master: now.other_master - before.other_master,
            foreign: now.foreign - before.foreign,
            strays: now.strays - before.strays,
            echoes: now.echoes - before.echoes,
            ..LineCounters::default()
        };
        self.echoes += since.echoes;
        self.late += since.foreign + since.strays;
        Ok(since)
    }
}

impl LineAsker for PortAsker {
    async fn open(&mut self, setting: &ScanSetting, stations: &[u8]) -> Result<(), ScanError> {
        self.close().await;
        let drives: Vec<_> = stations
            .iter()
            .filter_map(|station| setting.station(*station))
            .collect();
        let port = ToolPort {
            link: setting.link,
            ..self.port.clone()
        };
        self.line = Some(ToolLine::open(&port, &self.name, setting.timing(), drives).await?);
        self.stations = stations.to_vec();
        self.patience = setting.timeout * 2 + setting.lateness + LATE;
        self.seen = LineCounters::default();
        if self.has_listened {
            Ok(())
        } else {
            self.listen(setting.link).await
        }
    }

    async fn ask(&mut self, station: u8, address: Address) -> Result<ReadOutcome, ScanError> {
        let place = self
            .stations
            .iter()
            .position(|it| *it == station)
            .and_then(|place| u16::try_from(place).ok());
        let place =
            place.ok_or_else(|| ScanError::new(format!("station {station} is not on the line")))?;
        self.counted()?;
        let read = self
            .line()?
            .read(place, address, clock::now() + self.patience)
            .await;
        let counted = self.counted()?;
        if counted.other_master > 0 {
            let what = "the line is in use: requests from another master were heard; stop that \
                        master and scan again";
            return Err(ScanError::new(what));
        }
        match read {
            Ok(word) => Ok(ReadOutcome::Word(word)),
            Err(report) => match (report.exception, report.reason) {
                (Some(code), _) => Ok(ReadOutcome::Exception(code)),
                (None, Reason::LineDown) => {
                    let fault = self
                        .line()?
                        .report()
                        .fault
                        .map(|fault| format!(": {fault}"))
                        .unwrap_or_default();
                    Err(ScanError::new(format!(
                        "{} is lost{fault}",
                        self.port.address
                    )))
                }
                (None, _) if counted.garbled > 0 || counted.noise_bytes > 0 => {
                    Ok(ReadOutcome::Damaged)
                }
                (None, _) => Ok(ReadOutcome::Silent),
            },
        }
    }
}
