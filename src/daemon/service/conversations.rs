//! What is said to the broker: the conversation of the MQTT side, and beside it that of the Sparkplug side.

use crate::daemon::exchange::answers::AnswerBox;
use crate::daemon::exchange::north_journal;
use crate::daemon::exchange::shared::Current;
use crate::daemon::host::clock;
use crate::daemon::http::State;
use crate::daemon::mqtt::speaker::Speaker;
use crate::daemon::mqtt::{self, ConnectionSettings, Counters, Talk};
use crate::daemon::service::north_sides::NorthSides;
use crate::daemon::sparkplug::BdSeq;
use crate::daemon::sparkplug::speaker::{Sides, Speaker as SparkplugSpeaker};
use crate::domain::ids::Ticket;
use crate::north::mqtt::Settings;
use crate::north::sparkplug;
use arc_swap::ArcSwapOption;
use std::cell::RefCell;
use std::path::PathBuf;
use std::sync::Arc;
use std::time::Duration;
use tokio::sync::{Notify, oneshot};
use tokio::task::JoinHandle;

/// Most time for the last words to the broker.
const FAREWELL_MAX: Duration = Duration::from_secs(2);

/// Tickets of one conversation with a broker. None has as many.
const TICKETS: u64 = 1 << 40;

/// How the broker is reached and what is said there.
pub type Mqtt = (ConnectionSettings, Settings);

/// The same for Sparkplug, and where sessions are numbered.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Sparkplug {
    /// How the broker is reached.
    pub connection: ConnectionSettings,
    /// What is said there.
    pub settings: sparkplug::Settings,
    /// Where the number of the last session is kept.
    pub data_dir: PathBuf,
}

/// Everything that is said to the broker.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct BrokerSide {
    /// The gateway's own topics.
    pub mqtt: Mqtt,
    /// Sparkplug B; nothing: nothing is said of it.
    pub sparkplug: Option<Sparkplug>,
}

/// All that is said to the broker.
#[derive(Debug)]
pub struct Conversations {
    current: Current,
    sides: NorthSides,
    state: Arc<State>,
    mqtt: Option<Conversation<Mqtt>>,
    sparkplug: Option<Conversation<Sparkplug>>,
    /// How many ranges of tickets were given.
    count: u64,
}

/// What is said to a broker.
#[derive(Debug)]
struct Conversation<W> {
    with: W,
    stop: oneshot::Sender<()>,
    task: JoinHandle<()>,
}

impl Conversations {
    /// Nothing is said yet. What the lines answer comes through `sides`, and `state` shows what is counted.
    #[must_use]
    pub const fn new(current: Current, sides: NorthSides, state: Arc<State>) -> Self {
        Self { current, sides, state, mqtt: None, sparkplug: None, count: 0 }
    }

    /// Whether this is what is said to the broker already.
    #[must_use]
    pub fn talks_as(&self, broker_side: Option<&BrokerSide>) -> bool {
        let (mqtt, sparkplug) = (broker_side.map(|it| &it.mqtt), broker_side.and_then(|it| it.sparkplug.as_ref()));
        with(self.mqtt.as_ref()) == mqtt && with(self.sparkplug.as_ref()) == sparkplug
    }

    /// Says this to the broker from now on. What is said already goes on.
    pub fn talk_as(&mut self, broker_side: Option<BrokerSide>) {
        let (mqtt, sparkplug) = broker_side.map_or((None, None), |it| (Some(it.mqtt), it.sparkplug));
        if with(self.mqtt.as_ref()) != mqtt.as_ref() {
            self.talk(mqtt);
        }
        if with(self.sparkplug.as_ref()) != sparkplug.as_ref() {
            self.talk_sparkplug(sparkplug);
        }
    }

    fn talk(&mut self, mqtt: Option<Mqtt>) {
        let (first_ticket, current) = (self.next_ticket(), self.current.clone());
        let journal = north_journal::side(self.sides.journal.as_ref(), &self.current);
        let says = async move |(connection, settings): Mqtt, totals, news, stopped| {
            let changed = Arc::clone(&current.load().changed);
            let speaker = Speaker::new(settings, current, news, totals, journal, first_ticket, clock::moment());
            speak(connection, speaker, &changed.mqtt, stopped).await;
        };
        self.mqtt = begun_anew(self.mqtt.take(), mqtt, &self.state.mqtt, self.sides.mqtt.clone(), says);
    }

    fn talk_sparkplug(&mut self, sparkplug: Option<Sparkplug>) {
        let (first_ticket, current) = (self.next_ticket(), self.current.clone());
        let journal = north_journal::side(self.sides.journal.as_ref(), &self.current);
        let says = async move |with: Sparkplug, totals, news, stopped| {
            let Sparkplug { connection, settings, data_dir } = with;
            let Ok(bdseq) = tokio::task::spawn_blocking(move || BdSeq::read(&data_dir)).await else { return };
            let changed = Arc::clone(&current.load().changed);
            let sides = Sides { current, news, totals, journal };
            let speaker = SparkplugSpeaker::new(settings, bdseq, sides, first_ticket, clock::moment());
            speak(connection, speaker, &changed.sparkplug, stopped).await;
        };
        self.sparkplug =
            begun_anew(self.sparkplug.take(), sparkplug, &self.state.sparkplug, self.sides.sparkplug.clone(), says);
    }

    /// The first ticket of the next conversation.
    const fn next_ticket(&mut self) -> Ticket {
        self.count += 1;
        Ticket(self.count * TICKETS)
    }

    /// Says goodbye to the broker, if there is one, and waits for that for a moment.
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

/// Ends `before`, and begins anew as `with` says. The old words come first: the broker knows both by the same name. What is
/// counted is in `shown` from now on, and the answers of the lines wait in `news`.
fn begun_anew<W: Clone + 'static, C: Default + 'static>(
    before: Option<Conversation<W>>,
    with: Option<W>,
    shown: &ArcSwapOption<C>,
    news: Option<Arc<AnswerBox>>,
    says: impl AsyncFnOnce(W, Arc<C>, Arc<AnswerBox>, oneshot::Receiver<()>) + 'static,
) -> Option<Conversation<W>> {
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
    Some(Conversation { with, stop, task })
}

/// With what a conversation is held.
fn with<W>(conversation: Option<&Conversation<W>>) -> Option<&W> {
    conversation.map(|conversation| &conversation.with)
}

impl<W> Conversation<W> {
    async fn end(self) {
        // A task that has ended needs no stop.
        let _ = self.stop.send(());
        let mut task = self.task;
        if tokio::time::timeout(FAREWELL_MAX, &mut task).await.is_err() {
            tracing::warn!("broker did not accept the last messages");
            task.abort();
        }
    }
}

async fn speak<T: Talk>(connection: ConnectionSettings, speaker: T, changed: &Notify, stopped: oneshot::Receiver<()>) {
    let (speaker, counters) = (RefCell::new(speaker), Counters::default());
    let stop = async {
        // A dropped sender means the end as well.
        let _ = stopped.await;
    };
    mqtt::converse(connection, &speaker, changed, &counters, stop).await;
}
