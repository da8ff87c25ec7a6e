//! The conversations with the broker: that of the MQTT side and that of the Sparkplug side.

use crate::daemon::exchange::answers::AnswerBox;
use crate::daemon::exchange::north_sides::NorthSides;
use crate::daemon::exchange::shared::CurrentPlant;
use crate::daemon::host::clock;
use crate::daemon::http::HttpState;
use crate::daemon::journal::{self, Journal};
use crate::daemon::mqtt::speaker::{SessionSides, SessionSpeaker};
use crate::daemon::mqtt::{self, BdSeq, ClientCounters, ConnectionSettings};
use crate::domain::ids::Ticket;
use crate::north::broker::BrokerSession;
use crate::north::mqtt::{GatewayIdentity, MqttSession, Settings};
use crate::north::sparkplug::{self, SparkplugSession};
use arc_swap::ArcSwapOption;
use std::cell::RefCell;
use std::path::PathBuf;
use std::sync::Arc;
use std::time::Duration;
use tokio::sync::{Notify, oneshot};
use tokio::task::JoinHandle;

/// Most time for the last messages to the broker.
const FAREWELL_MAX: Duration = Duration::from_secs(2);

/// Tickets of one conversation with a broker; more than one can use.
const TICKETS: u64 = 1 << 40;

/// Connection and session settings for the gateway's own topics.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct MqttConversation {
    /// How the broker is reached.
    pub connection: ConnectionSettings,
    /// The gateway, as it names itself.
    pub gateway: GatewayIdentity,
    /// The settings of the session.
    pub settings: Settings,
}

/// Connection and session settings for Sparkplug, with the directory of the session number.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct SparkplugConversation {
    /// How the broker is reached.
    pub connection: ConnectionSettings,
    /// The settings of the session.
    pub settings: sparkplug::Settings,
    /// Where the number of the last session is kept.
    pub data_dir: PathBuf,
}

/// The settings of all conversations with the broker.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct BrokerSide {
    /// The gateway's own topics.
    pub mqtt: MqttConversation,
    /// Sparkplug B; `None` if it is not configured.
    pub sparkplug: Option<SparkplugConversation>,
}

/// All conversations with the broker.
#[derive(Debug)]
pub struct BrokerConversations {
    current: CurrentPlant,
    sides: NorthSides,
    journal: Option<Arc<Journal>>,
    state: Arc<HttpState>,
    mqtt: Option<RunningConversation<MqttConversation>>,
    sparkplug: Option<RunningConversation<SparkplugConversation>>,
    /// How many ranges of tickets were used.
    count: u64,
}

/// A conversation with a broker.
#[derive(Debug)]
struct RunningConversation<W> {
    with: W,
    stop: oneshot::Sender<()>,
    task: JoinHandle<()>,
}

impl BrokerConversations {
    /// Starts without conversations. Answers of the lines arrive through `sides`, what has no line goes to `journal`, and
    /// `state` shows the counts.
    #[must_use]
    pub const fn new(
        current: CurrentPlant,
        sides: NorthSides,
        journal: Option<Arc<Journal>>,
        state: Arc<HttpState>,
    ) -> Self {
        Self {
            current,
            sides,
            journal,
            state,
            mqtt: None,
            sparkplug: None,
            count: 0,
        }
    }

    /// Whether these are the settings of the present conversations.
    #[must_use]
    pub fn talks_as(&self, broker_side: Option<&BrokerSide>) -> bool {
        let mqtt = broker_side.map(|it| &it.mqtt);
        let sparkplug = broker_side.and_then(|it| it.sparkplug.as_ref());
        with(self.mqtt.as_ref()) == mqtt && with(self.sparkplug.as_ref()) == sparkplug
    }

    /// Changes the conversations to these settings. Unchanged ones continue.
    pub fn talk_as(&mut self, broker_side: Option<BrokerSide>) {
        let (mqtt, sparkplug) =
            broker_side.map_or((None, None), |it| (Some(it.mqtt), it.sparkplug));
        if with(self.mqtt.as_ref()) != mqtt.as_ref() {
            self.talk(mqtt);
        }
        if with(self.sparkplug.as_ref()) != sparkplug.as_ref() {
            self.talk_sparkplug(sparkplug);
        }
    }

    fn talk(&mut self, mqtt: Option<MqttConversation>) {
        let first_ticket = self.next_ticket();
        let current = self.current.clone();
        let journal = journal::side(self.journal.as_ref(), &self.current);
        let says = async move |with: MqttConversation, totals, news, stopped| {
            let changed = Arc::clone(&current.load().changed);
            let sides = SessionSides {
                current,
                news,
                totals,
                journal,
            };
            let speaker = SessionSpeaker::<MqttSession>::new(
                (with.gateway, with.settings),
                None,
                sides,
                first_ticket,
                clock::moment(),
            );
            speak(with.connection, speaker, &changed.mqtt, stopped).await;
        };
        self.mqtt = begun_anew(
            self.mqtt.take(),
            mqtt,
            &self.state.mqtt,
            self.sides.mqtt.clone(),
            says,
        );
    }

    fn talk_sparkplug(&mut self, sparkplug: Option<SparkplugConversation>) {
        let first_ticket = self.next_ticket();
        let current = self.current.clone();
        let journal = journal::side(self.journal.as_ref(), &self.current);
        let says = async move |with: SparkplugConversation, totals, news, stopped| {
            let SparkplugConversation {
                connection,
                settings,
                data_dir,
            } = with;
            let Ok(bdseq) = tokio::task::spawn_blocking(move || BdSeq::read(&data_dir)).await
            else {
                return;
            };
            let changed = Arc::clone(&current.load().changed);
            let sides = SessionSides {
                current,
                news,
                totals,
                journal,
            };
            let speaker = SessionSpeaker::<SparkplugSession>::new(
                settings,
                Some(bdseq),
                sides,
                first_ticket,
                clock::moment(),
            );
            speak(connection, speaker, &changed.sparkplug, stopped).await;
        };
        self.sparkplug = begun_anew(
            self.sparkplug.take(),
            sparkplug,
            &self.state.sparkplug,
            self.sides.sparkplug.clone(),
            says,
        );
    }

    /// The first ticket of the next conversation.
    const fn next_ticket(&mut self) -> Ticket {
        self.count += 1;
        Ticket(self.count * TICKETS)
    }

    /// Ends the conversations with a farewell, and waits a moment for that.
    pub async fn farewell(self) {
        let end_mqtt = async {
            if let Some(conversation) = self.mqtt {
                conversation.end().await;
            }
        };
        let end_sparkplug = async {
            if let Some(conversation) = self.sparkplug {
                conversation.end().await;
            }
        };
        tokio::join!(end_mqtt, end_sparkplug);
    }
}

/// Ends `before`, and begins a new conversation with the settings `with`. The old one ends first: the broker knows both
/// by the same identifier. The counts are in `shown` from now on, and the answers of the lines wait in `news`.
fn begun_anew<W: Clone + 'static, C: Default + 'static>(
    before: Option<RunningConversation<W>>,
    with: Option<W>,
    shown: &ArcSwapOption<C>,
    news: Option<Arc<AnswerBox>>,
    says: impl AsyncFnOnce(W, Arc<C>, Arc<AnswerBox>, oneshot::Receiver<()>) + 'static,
) -> Option<RunningConversation<W>> {
    let totals = with.is_some().then(Arc::<C>::default);
    shown.store(totals.clone());
    if let Some(news) = &news {
        news.set_open(with.is_some());
    }
    let Some(((with, totals), news)) = with.zip(totals).zip(news) else {
        if let Some(before) = before {
            tokio::task::spawn_local(before.end());
        }
        return None;
    };
    let (stop, stopped) = oneshot::channel();
    let words = with.clone();
    let task = tokio::task::spawn_local(async move {
        if let Some(before) = before {
            before.end().await;
        }
        says(words, totals, news, stopped).await;
    });
    Some(RunningConversation { with, stop, task })
}

/// The settings of a conversation.
fn with<W>(conversation: Option<&RunningConversation<W>>) -> Option<&W> {
    conversation.map(|conversation| &conversation.with)
}

impl<W> RunningConversation<W> {
    async fn end(self) {
        // A task that has ended does not need a stop.
        let _ = self.stop.send(());
        let mut task = self.task;
        if tokio::time::timeout(FAREWELL_MAX, &mut task).await.is_err() {
            tracing::warn!("broker did not accept the last messages");
            task.abort();
        }
    }
}

async fn speak<S: BrokerSession>(
    connection: ConnectionSettings,
    speaker: SessionSpeaker<S>,
    changed: &Notify,
    stopped: oneshot::Receiver<()>,
) {
    let speaker = RefCell::new(speaker);
    let counters = ClientCounters::default();
    let stop = async {
        // A dropped sender also means the end.
        let _ = stopped.await;
    };
    mqtt::converse(connection, &speaker, changed, &counters, stop).await;
}
