//! Reloading the configuration while the gateway runs: completely, or not at all.
//!
//! Everything that can fail is done first: the file is loaded and checked, addresses are bound, secrets and
//! certificates read, threads started. Then the drives of removed lines are checked, and only then anything changes.

use crate::config::change::{ChangeNote, ConfigChange, ConfigPart};
use crate::config::{Config, MqttSettings, RemovalRule};
use crate::daemon::commissioning::{ConfigSite, Judge};
use crate::daemon::exchange::hand_over::hand_over;
use crate::daemon::exchange::reload_request::{AppliedReload, ReloadRefusal, Reloaded};
use crate::daemon::exchange::shared::{CurrentPlant, SharedLine, SharedPlant};
use crate::daemon::journal::Journal;
use crate::daemon::line_thread::{LineHandle, Memory};
use crate::daemon::lines;
use crate::daemon::lines::threads::LineThreads;
use crate::daemon::mqtt::broker_child::BrokerChild;
use crate::daemon::service::build;
use crate::daemon::service::conversations::BrokerSide;
use crate::daemon::service::embedded_broker::embedded_broker;
use crate::daemon::service::north::{self, BoundListeners, RunningNorth};
use crate::domain::ids::Name;
use std::fmt;
use std::path::PathBuf;
use std::sync::Arc;
use std::time::Duration;
use tokio::task::JoinHandle;
use tokio::time::timeout;

/// Most time for the journal to return its remembered state.
const MEMORY_WITHIN: Duration = Duration::from_secs(1);

/// Most time for the files of the configuration to be read.
const LOADED_WITHIN: Duration = Duration::from_secs(10);

/// Loads the configuration, or returns all its problems as text.
type Read = dyn Fn() -> Result<Config, String> + Send + Sync;

/// Where the configuration comes from.
#[derive(Clone)]
pub struct ConfigOrigin {
    /// The file.
    pub file: PathBuf,
    /// Loads it.
    pub read: Arc<Read>,
    /// Judges a text that might become its content.
    pub judge: Arc<Judge>,
}

impl ConfigOrigin {
    /// File and judge, for what changes the file.
    #[must_use]
    pub fn site(&self) -> ConfigSite {
        ConfigSite {
            file: self.file.clone(),
            judge: Arc::clone(&self.judge),
        }
    }
}

/// The parts of a running gateway that a reload changes.
#[derive(Debug)]
pub struct RunningGateway {
    /// The configuration in force.
    pub config: Config,
    /// Its name.
    pub name: Name,
    /// What lines and north sides share.
    pub current: CurrentPlant,
    /// The lines' threads.
    pub lines: LineThreads,
    /// The north sides.
    pub north: RunningNorth,
    /// The embedded broker, if there is one.
    pub broker: Option<BrokerChild>,
    /// The journal, if there is one.
    pub journal: Option<Arc<Journal>>,
    /// Loads the configuration.
    pub loader: ConfigLoader,
}

/// Loads the configuration outside the runtime, since its storage may be slow: one load at a time, with a time limit.
#[derive(Debug, Default)]
pub struct ConfigLoader {
    running: Option<JoinHandle<Result<Config, String>>>,
}

impl ConfigLoader {
    async fn load(
        &mut self,
        load: &ConfigOrigin,
        within: Duration,
    ) -> Result<Config, ReloadRefusal> {
        let late = || {
            let what = format!(
                "the files of the configuration cannot be read within {} s",
                within.as_secs()
            );
            ReloadRefusal::System(what)
        };
        if let Some(earlier) = &mut self.running {
            // Its result may be out of date by now.
            let _ = timeout(within, earlier).await.map_err(|_| late())?;
            self.running = None;
        }
        let read = Arc::clone(&load.read);
        let running = self
            .running
            .insert(tokio::task::spawn_blocking(move || read()));
        let loaded = timeout(within, running).await.map_err(|_| late())?;
        self.running = None;
        match loaded {
            Ok(loaded) => loaded.map_err(ReloadRefusal::Configuration),
            Err(error) => Err(ReloadRefusal::System(error.to_string())),
        }
    }
}

/// Everything that a new configuration needs, prepared. If it is not used, dropping it releases everything.
struct PreparedReload {
    shared: Arc<SharedPlant>,
    handles: Vec<LineHandle>,
    bound: BoundListeners,
    broker_side: Option<BrokerSide>,
    broker: Option<BrokerChild>,
}

impl RunningGateway {
    /// Reloads the configuration.
    ///
    /// # Errors
    /// Why nothing has changed; drives that were to be stopped first may have been stopped, though.
    pub async fn reload(&mut self, load: &ConfigOrigin) -> Reloaded {
        let new = self.loader.load(load, LOADED_WITHIN).await?;
        let change = ConfigChange::between(&self.config, &new);
        if !change.needs_restart.is_empty() {
            return Err(ReloadRefusal::NeedsRestart(change.needs_restart));
        }
        let prepared = self.prepare(&new, &change).await?;
        let mut changes = change.notes.clone();
        if !self.north.talks_as(prepared.broker_side.as_ref())
            && changes.iter().all(|it| it.part != ConfigPart::Mqtt)
        {
            changes.push(ChangeNote::mqtt_changed());
        }
        let ending = self.numbers(&change);
        self.hand_over(&ending).await;
        self.have_leave(&ending, new.gateway.on_removal).await?;
        let warnings = new.warnings.clone();
        self.switch(new, &change, &ending, prepared).await;
        Ok(AppliedReload { changes, warnings })
    }

    async fn prepare(
        &mut self,
        new: &Config,
        change: &ConfigChange,
    ) -> Result<PreparedReload, ReloadRefusal> {
        let system = |error: &dyn fmt::Display| ReloadRefusal::System(error.to_string());
        let has_http_moved =
            self.config.http.as_ref().map(|it| it.listen) != new.http.as_ref().map(|it| it.listen);
        let bound = north::bind(new, &change.listeners, has_http_moved)
            .await
            .map_err(|error| system(&error))?;
        let broker = if self.broker.is_some() {
            None
        } else {
            embedded_broker(new).map_err(|error| system(&error))?
        };
        let broker_at = self
            .broker
            .as_ref()
            .or(broker.as_ref())
            .map(BrokerChild::address);
        let broker_side = match new.mqtt.clone() {
            Some(mqtt) => Some(self.broker_side(mqtt, new, broker_at).await?),
            None => None,
        };
        let old = self.current.get();
        let mut lines = Vec::with_capacity(new.lines.len());
        let mut handles = Vec::new();
        for (settings, continues) in new.lines.iter().zip(&change.continues) {
            if let Some(line) = continues.and_then(|at| old.lines.get(at)) {
                lines.push(Arc::clone(line));
                continue;
            }
            let line = Arc::new(lines::build::shared_line(
                self.lines.next_number(),
                settings,
            ));
            lines.push(Arc::clone(&line));
            handles.push(
                self.lines
                    .prepare(settings, line)
                    .await
                    .map_err(|error| system(&error))?,
            );
        }
        let shared = SharedPlant::of(lines, Arc::clone(&old.changed)).titled(&new.titles);
        Ok(PreparedReload {
            shared: Arc::new(shared),
            handles,
            bound,
            broker_side,
            broker,
        })
    }

    /// Secrets and certificates are read outside the runtime: their storage may be slow.
    async fn broker_side(
        &self,
        mqtt: MqttSettings,
        new: &Config,
        embedded: Option<std::net::SocketAddr>,
    ) -> Result<BrokerSide, ReloadRefusal> {
        let name = self.name.clone();
        let (data_dir, standby) = (new.gateway.data_dir.clone(), new.standby.clone());
        let build = move || {
            build::broker(
                &mqtt,
                (&name, standby.as_ref()),
                data_dir.as_deref(),
                embedded,
            )
        };
        let read = tokio::task::spawn_blocking(build).await;
        let read = read.map_err(|error| ReloadRefusal::System(error.to_string()))?;
        read.map_err(|error| ReloadRefusal::System(format!("mqtt: {error}")))
    }

    /// The numbers of the removed lines.
    fn numbers(&self, change: &ConfigChange) -> Vec<u16> {
        let lines = &self.current.load().lines;
        change
            .ended
            .iter()
            .filter_map(|at| lines.get(*at))
            .map(|line| line.number)
            .collect()
    }

    /// Another gateway takes over what runs on the lines that end, if one listens there. If none does, the drives are in
    /// use as on any line.
    async fn hand_over(&self, ending: &[u16]) {
        let lines = &self.current.get().lines;
        let ends =
            |line: &&Arc<SharedLine>| line.standby.is_some() && ending.contains(&line.number);
        let lines: Vec<_> = lines.iter().filter(ends).cloned().collect();
        for (line, outcome) in hand_over(&lines).await {
            tracing::info!(line = %line.name, outcome = outcome.keyword(), "the reload ends the line here: asked the other gateway to take it");
        }
    }

    /// From here on no drive of a removed line can be started. If one is in use, it is stopped or the reload is
    /// refused.
    async fn have_leave(&self, ending: &[u16], removal: RemovalRule) -> Result<(), ReloadRefusal> {
        let stops = removal == RemovalRule::Stop;
        let names = self.lines.leave(ending, stops).await;
        if names.is_empty() {
            return Ok(());
        }
        self.lines.stay(ending);
        Err(if stops {
            ReloadRefusal::NoEffect(names)
        } else {
            ReloadRefusal::InUse(names)
        })
    }

    /// The remembered state of all drives.
    async fn memory(&self) -> Memory {
        let Some(journal) = &self.journal else {
            return Memory::new();
        };
        let memory = journal.memory(MEMORY_WITHIN).await;
        if memory.is_none() {
            tracing::error!(
                "ALARM: journal does not respond; new lines start without remembered state"
            );
        }
        memory.unwrap_or_default()
    }

    /// Nothing here can fail.
    async fn switch(
        &mut self,
        new: Config,
        change: &ConfigChange,
        ending: &[u16],
        prepared: PreparedReload,
    ) {
        let PreparedReload {
            shared,
            handles,
            bound,
            broker_side,
            broker,
        } = prepared;
        // Before the new ones begin: they may use the same ports.
        self.lines.end(ending).await;
        let changed = Arc::clone(&shared.changed);
        self.current.set(shared);
        self.lines.begin(handles, &self.memory().await);
        self.north.switch(&new, change, bound, broker_side);
        let is_embedded = new.mqtt.as_ref().is_some_and(MqttSettings::is_embedded);
        self.broker = self.broker.take().or(broker);
        if !is_embedded {
            self.broker = None;
        }
        self.config = new;
        changed.ring();
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::sync::Mutex;
    use std::sync::mpsc;

    #[tokio::test]
    async fn a_file_that_is_never_read_holds_up_one_reload_and_no_later_one() {
        let (release, hangs) = mpsc::channel::<()>();
        let hangs = Mutex::new(Some(hangs));
        let read = move || {
            let hangs = hangs.lock().unwrap().take();
            let _ = hangs.map(|hangs| hangs.recv());
            Err("read".to_owned())
        };
        let judge: Arc<Judge> = Arc::new(|_| Err("not judged".to_owned()));
        let load = ConfigOrigin {
            file: PathBuf::new(),
            read: Arc::new(read),
            judge,
        };
        let mut loader = ConfigLoader::default();
        for _ in 0..2 {
            let refused = loader
                .load(&load, Duration::from_millis(10))
                .await
                .unwrap_err();
            assert!(
                matches!(&refused, ReloadRefusal::System(what) if what.contains("cannot be read within")),
                "{refused}"
            );
        }
        drop(release);
        let refused = loader.load(&load, LOADED_WITHIN).await.unwrap_err();
        assert_eq!(
            refused,
            ReloadRefusal::Configuration("read".to_owned()),
            "it is read again"
        );
    }
}
