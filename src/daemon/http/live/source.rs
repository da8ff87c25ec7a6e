//! From what the gateway shares to the documents of the page.

use crate::daemon::exchange::shared::{SharedDrive, SharedLine, SharedPlant};
use crate::daemon::http::state::HttpState;
use crate::daemon::journal::JournalState as Keeps;
use crate::domain::calendar::rfc3339;
use crate::domain::ids::Name;
use crate::drive::view::DriveView;
use crate::north::api::FindingDocument;
use crate::north::finding::{Finding, ranked};
use crate::north::page::gateway::{BrokerWay, PageJournal};
use crate::north::page::{LineUse, PageDrive, PageGateway, PageLine, PageMoment};
use serde_json::{Value, json};
use std::collections::BTreeMap;
use std::sync::Arc;

/// Everything at one moment.
pub struct LiveSource<'s> {
    pub state: &'s HttpState,
    pub shared: &'s SharedPlant,
    pub uses: &'s BTreeMap<u16, LineUse>,
    pub present: PageMoment<'s>,
}

impl LiveSource<'_> {
    /// All of it as one document.
    pub fn document(&self) -> Value {
        let gateway = self.gateway();
        let lines = self
            .shared
            .lines
            .iter()
            .map(|line| self.line(line, |line| line.document()));
        let mut document = json!({
            "at": self.present.text(),
            "gateway": gateway.document(self.uptime_s()),
            "lines": lines.collect::<Vec<_>>(),
            "drives": self.drives().map(|(line, drive, view)| self.drive(line, drive, &view)).collect::<Vec<_>>(),
            "advice": self.documents(&self.advice()),
        });
        if !self.shared.titles.is_empty() {
            document["titles"] = json!(*self.shared.titles);
        }
        document
    }

    /// All drives in order, each with its line and its newest view.
    pub fn drives(&self) -> impl Iterator<Item = (&SharedLine, &Arc<SharedDrive>, Arc<DriveView>)> {
        let lines = self.shared.lines.iter();
        lines.flat_map(|line| {
            line.drives
                .iter()
                .map(move |drive| (line.as_ref(), drive, drive.view.load_full()))
        })
    }

    /// The document of `drive`, on `line`, with this view.
    pub fn drive(&self, line: &SharedLine, drive: &SharedDrive, view: &DriveView) -> Value {
        shown(line, drive, view).document(&self.present)
    }

    /// Applies `made` to `line`.
    pub fn line<T>(&self, line: &SharedLine, made: impl FnOnce(&PageLine<'_>) -> T) -> T {
        let report = line.report();
        let drives = line.drives.iter().map(|drive| &drive.description.name);
        made(&PageLine {
            name: &line.name,
            interface: line.interface,
            wiring: &line.wiring,
            pair: line.standby.as_ref().map(|it| &it.pair),
            report: &report,
            hangs: line.hangs(),
            rates: self.uses.get(&line.number).and_then(LineUse::rates),
            drives: &drives.collect::<Vec<&Name>>(),
        })
    }

    /// All findings.
    pub fn advice(&self) -> Vec<Finding> {
        let mut all = self.gateway().advice();
        for line in &self.shared.lines {
            all.extend(self.line(line, |line| line.advice()));
        }
        for (line, drive, view) in self.drives() {
            all.extend(self.drive_advice(line, drive, &view));
        }
        ranked(all)
    }

    /// Each of `findings` as a document, with the title of what it concerns.
    pub fn documents(&self, findings: &[Finding]) -> Vec<FindingDocument> {
        let titles = &self.shared.titles;
        let document = |finding: &Finding| {
            let title = match (&finding.drive, &finding.line) {
                (Some(drive), _) => titles.drives.get(drive.as_str()),
                (None, Some(line)) => titles.lines.get(line.as_str()),
                (None, None) => None,
            };
            FindingDocument {
                title: title.cloned(),
                ..finding.document()
            }
        };
        findings.iter().map(document).collect()
    }

    /// The findings for `drive` with this view.
    pub fn drive_advice(
        &self,
        line: &SharedLine,
        drive: &SharedDrive,
        view: &DriveView,
    ) -> Vec<Finding> {
        shown(line, drive, view).advice(line.interface, self.present.now)
    }

    /// The gateway as a whole.
    pub fn gateway(&self) -> PageGateway {
        let state = self.state;
        let journal = state
            .journal
            .as_ref()
            .map(|journal| journal.report())
            .map(|report| PageJournal {
                state: report.state.keyword(),
                is_ok: report.state == Keeps::Ok,
                reason: report.reason,
                moved_aside: report.moved_aside,
                replaced: report.replaced,
                lost: report.lost,
            });
        PageGateway {
            name: state.gateway.clone(),
            started_at: rfc3339(state.started_at),
            is_ready: state.is_ready(),
            mqtt: state.mqtt.load().as_ref().map(|mqtt| BrokerWay {
                is_connected: mqtt.is_connected(),
                is_contested: mqtt.is_contested(),
                is_partner_missing: mqtt.counters().partner_online == Some(false),
                lost_reason: mqtt.lost_reason(),
                oversized: mqtt.oversized(),
                clients_gone: mqtt.clients_gone(),
            }),
            journal,
            unreachable: state.socket.as_ref().and_then(|socket| socket.refusal()),
        }
    }

    /// Seconds since the start.
    pub fn uptime_s(&self) -> u64 {
        self.present.now.since(self.state.started).as_secs()
    }
}

/// `drive`, on `line`, with this view.
pub fn shown<'d>(line: &SharedLine, drive: &'d SharedDrive, view: &'d DriveView) -> PageDrive<'d> {
    let station = line
        .wiring
        .stations
        .get(drive.description.place.drive.get())
        .copied();
    PageDrive {
        description: &drive.description,
        view,
        station,
        standby: drive.role.get(),
    }
}
