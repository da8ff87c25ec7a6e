//! Diagnostics: one archive with everything that helps others to find out what is wrong, without secrets.
//!
//! The documents in it are those of the routes, so that there is one form of them to learn.

mod recording;
mod routes;

pub use routes::SECONDS;
pub(super) use routes::{answer, own_router};

use super::routes::{RouteDocuments, router};
use super::state::HttpState;
use crate::config::without_secrets;
use crate::daemon::host::archive::{ArchivedFile, archive};
use crate::daemon::host::{about, clock, recent_log, user_files};
use crate::domain::calendar::rfc3339;
use axum::Router;
use axum::body::{Body, to_bytes};
use axum::http::Request;
use hyper::service::Service;
use hyper_util::service::TowerToHyperService;
use recording::LineRecording;
use std::io;
use std::sync::Arc;
use std::time::Duration;
use tokio::sync::{Semaphore, SemaphorePermit};
use tokio::time::{Instant, sleep};

/// How often the traffic is collected.
const EVERY: Duration = Duration::from_millis(250);
/// Most bytes of one document.
const DOCUMENT_BYTES_MAX: usize = 8 * 1024 * 1024;

/// The documents of the gateway as a whole: file and route.
const DOCUMENTS: [(&str, &str); 5] = [
    ("health.json", "/api/v1/health"),
    ("state.json", "/api/v1/state"),
    ("advice.json", "/api/v1/advice"),
    ("metrics.txt", "/metrics"),
    ("journal.csv", "/api/v1/journal?last=5000&format=csv"),
];

/// What each file is.
const CONTENTS: &str = "\
about.json          versions of the program and of its host
ports.json          the serial ports of the host, and who has them open
configuration.toml  the configuration file, with stars in place of passwords and their hashes
log.txt             the newest lines of the log
health.json         what `vfd-gateway health --json` says
state.json          what the page shows
advice.json         what is wrong, as far as the gateway knows
metrics.txt         the metrics
journal.csv         the newest rows of the journal, if there is one
lines/NAME/report.json      the report of a line, over the last minutes
lines/NAME/traffic.pcapng   what was sent on it while this archive was made, for Wireshark
";

/// Makes archives, one at a time.
#[derive(Debug)]
pub(super) struct ArchiveMaker {
    state: Arc<HttpState>,
    documents: Router,
    place: Semaphore,
}

impl ArchiveMaker {
    /// Archives of `documents`.
    pub fn new(documents: RouteDocuments) -> Self {
        Self {
            state: Arc::clone(&documents.state),
            documents: router(documents),
            place: Semaphore::new(1),
        }
    }

    /// The permission to make an archive; `None` while another one is made.
    fn place(&self) -> Option<SemaphorePermit<'_>> {
        self.place.try_acquire().ok()
    }

    /// The name of an archive that is made now.
    fn name(&self) -> String {
        let at = rfc3339(clock::wall());
        let digits: String = at
            .chars()
            .take_while(|c| *c != '.')
            .filter(|c| *c != ':' && *c != '-')
            .collect();
        format!("vfd-gateway-{}-{digits}", self.state.gateway)
    }

    /// The archive with this name, with the traffic of the lines for `span` from now on.
    async fn archive(&self, name: String, span: Duration) -> io::Result<Vec<u8>> {
        let mut files = vec![ArchivedFile::new("README.txt", CONTENTS)];
        files.extend(self.traffic(span).await);
        for (file, path) in DOCUMENTS {
            files.extend(self.document(file, path).await);
        }
        for line in self.line_names() {
            files.extend(
                self.document(
                    &format!("lines/{line}/report.json"),
                    &format!("/api/v1/lines/{line}/report"),
                )
                .await,
            );
        }
        files.push(ArchivedFile::new("log.txt", recent_log::own().text()));
        let configuration = self.state.configuration.clone();
        // To read the host and to compress takes longer than this thread may.
        let made = tokio::task::spawn_blocking(move || {
            files.extend(about::files());
            if let Some(path) = configuration {
                let text = user_files::text(&path, user_files::BYTES_MAX);
                let text = text.map_or_else(
                    |error| format!("# {}: {error}\n", path.display()),
                    |it| without_secrets(&it),
                );
                files.push(ArchivedFile::new("configuration.toml", text));
            }
            archive(&name, &files)
        });
        made.await.map_err(io::Error::other)?
    }

    fn line_names(&self) -> Vec<String> {
        super::health::line_names(&self.state)
    }

    /// What is sent on the lines for `span`, a file for each line.
    async fn traffic(&self, span: Duration) -> Vec<ArchivedFile> {
        let lines = self.state.shared.get();
        let mut recordings: Vec<_> = lines
            .lines
            .iter()
            .filter_map(LineRecording::begin)
            .collect();
        let until = Instant::now() + span;
        while Instant::now() < until {
            sleep(EVERY.min(until - Instant::now())).await;
            recordings.iter_mut().for_each(LineRecording::take);
        }
        let files = recordings.into_iter().map(LineRecording::end);
        files
            .map(|(line, file)| ArchivedFile::new(format!("lines/{line}/traffic.pcapng"), file))
            .collect()
    }

    /// What the route at `path` answers; `None` if it has nothing.
    async fn document(&self, file: &str, path: &str) -> Option<ArchivedFile> {
        let request = Request::builder().uri(path).body(Body::empty()).ok()?;
        let answer = TowerToHyperService::new(self.documents.clone())
            .call(request)
            .await
            .ok()?;
        let is_there = answer.status().is_success();
        let body = to_bytes(answer.into_body(), DOCUMENT_BYTES_MAX)
            .await
            .ok()?;
        is_there.then(|| ArchivedFile::new(file, body))
    }
}
