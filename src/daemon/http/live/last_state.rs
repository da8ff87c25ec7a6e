//! What listeners have received, and what is new since. An unchanged drive costs one pointer comparison.

use super::events::event;
use super::source::{LiveSource, shown};
use crate::daemon::exchange::shared::{SharedDrive, SharedLine};
use crate::domain::standby::LineRole;
use crate::domain::time::MonoTime;
use crate::drive::view::DriveView;
use crate::north::finding::{Finding, ranked};
use crate::north::page::changes::changes;
use crate::north::page::{PageGateway, trips};
use serde_json::{Map, Value, json};
use std::sync::Arc;

/// The state as it was last sent, for one configuration.
#[derive(Debug)]
pub struct LastState {
    gateway: PageGateway,
    lines: Vec<Value>,
    drives: Vec<SentDrive>,
    advice: Vec<Finding>,
}

#[derive(Debug)]
struct SentDrive {
    view: Arc<DriveView>,
    /// The gateway's role on its line at that time.
    role: Option<LineRole>,
    /// When it has to be sent again although the view is the same.
    changes_at: MonoTime,
    advice: Vec<Finding>,
    /// The document as the listener knows it by now.
    document: Value,
}

impl SentDrive {
    fn now(
        source: &LiveSource<'_>,
        line: &SharedLine,
        drive: &SharedDrive,
        view: Arc<DriveView>,
    ) -> Self {
        let role = drive.role.get();
        let changes_at = shown(line, drive, &view).changes_at(source.present.now);
        let advice = source.drive_advice(line, drive, &view);
        let document = source.drive(line, drive, &view);
        Self {
            view,
            role,
            changes_at,
            advice,
            document,
        }
    }
}

/// What is new of the drives.
#[derive(Default)]
struct DriveNews {
    /// The changes of each drive that has changed.
    changed: Vec<Value>,
    /// The age of the oldest value of each drive that was read.
    oldest_ms: Map<String, Value>,
}

impl LastState {
    /// The state as of now, which is being sent.
    pub fn now(source: &LiveSource<'_>) -> Self {
        let drives = source
            .drives()
            .map(|(line, drive, view)| SentDrive::now(source, line, drive, view));
        let mut state = Self {
            gateway: source.gateway(),
            lines: lines(source),
            drives: drives.collect(),
            advice: Vec::new(),
        };
        state.advice = state.all_advice(source);
        state
    }

    /// Events for what is new; empty if nothing is. The configuration must be the same.
    pub fn news(&mut self, source: &LiveSource<'_>) -> String {
        let mut events = String::new();
        let mut update = Map::new();
        let gateway = source.gateway();
        if gateway != self.gateway {
            update.insert("gateway".to_owned(), gateway.document(source.uptime_s()));
            self.gateway = gateway;
        }
        let new = lines(source);
        let changed: Vec<_> = new
            .iter()
            .zip(&self.lines)
            .filter(|(new, old)| new != old)
            .map(|(new, _)| new.clone())
            .collect();
        if !changed.is_empty() {
            update.insert("lines".to_owned(), changed.into());
            self.lines = new;
        }
        let DriveNews { changed, oldest_ms } = self.drive_news(source, &mut events);
        if !changed.is_empty() {
            update.insert("drives".to_owned(), changed.into());
        }
        if !oldest_ms.is_empty() {
            update.insert("oldest_ms".to_owned(), oldest_ms.into());
        }
        let advice = self.all_advice(source);
        if advice != self.advice {
            update.insert("advice".to_owned(), json!(source.documents(&advice)));
            self.advice = advice;
        }
        if !update.is_empty() {
            update.insert("at".to_owned(), source.present.text().into());
            events += &event("update", &Value::Object(update).to_string());
        }
        events
    }

    /// What is new of the drives; their trips are added to `events`.
    fn drive_news(&mut self, source: &LiveSource<'_>, events: &mut String) -> DriveNews {
        let mut news = DriveNews::default();
        for ((line, drive, view), sent) in source.drives().zip(&mut self.drives) {
            let is_same = Arc::ptr_eq(&view, &sent.view) && drive.role.get() == sent.role;
            if is_same && source.present.now < sent.changes_at {
                continue;
            }
            for trip in trips::between(&source.present, &drive.description, &sent.view, &view) {
                *events += &event("trip", &trip.to_string());
            }
            let now = SentDrive::now(source, line, drive, view);
            news.changed.extend(changes(&sent.document, &now.document));
            let name = drive.description.name.as_str().to_owned();
            news.oldest_ms
                .insert(name, now.document["oldest_ms"].clone());
            *sent = now;
        }
        news
    }

    fn all_advice(&self, source: &LiveSource<'_>) -> Vec<Finding> {
        let lines = source
            .shared
            .lines
            .iter()
            .flat_map(|line| source.line(line, |line| line.advice()));
        let drives = self
            .drives
            .iter()
            .flat_map(|drive| drive.advice.iter().cloned());
        ranked(self.gateway.advice().into_iter().chain(lines).chain(drives))
    }
}

fn lines(source: &LiveSource<'_>) -> Vec<Value> {
    source
        .shared
        .lines
        .iter()
        .map(|line| source.line(line, |line| line.document()))
        .collect()
}
