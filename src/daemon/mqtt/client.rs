//! Keeps a connection to the broker and carries messages between it and a [`BrokerConversation`].
//!
//! A connection is never repaired: after an error everything about it is dropped and a new one is made, with a new
//! will, after a growing wait. Only this task touches the connection, and it never waits for room in its queue: while
//! that is full, the conversation is not asked for more.

mod farewell;
mod limits;
mod rivals;
mod wanted;

use super::accepted::AcceptedLink;
use super::counters::{ClientCounters, count};
use super::incident::{
    BrokenConnection, BrokerTerms, CONNECT_TIMEOUT, ConnectionIncident, NotQueued, ReceivedMessage,
};
use super::link::{self, ConnectionEvents};
use super::packet_limit::PacketLimit;
use super::retry::RetryState;
use super::settings::ConnectionSettings;
use super::{BrokerConversation, ClientPacket, tls};
use crate::daemon::host::clock;
use crate::daemon::host::stall::{LOOK_EVERY, StallDetector};
use crate::north::broker::{BrokerEvent, PublicationRefusal};
use rustls::ClientConfig;
use std::cell::RefCell;
use std::future::poll_fn;
use std::pin::{Pin, pin};
use std::sync::Arc;
use std::task::Poll;
use std::time::Duration;
use tokio::sync::Notify;
use tokio::time::{Instant, sleep_until};

/// Margin beyond the connection's own time limit for connecting.
const CONNECT_MARGIN: Duration = Duration::from_secs(1);
/// A sleep that another event ends.
const LONG: Duration = Duration::from_secs(3600);
/// How often due work is checked while the broker accepts no packets.
const LOOK_WHILE_FULL: Duration = Duration::from_millis(10);
/// After a stall nothing is sent for this long, and longer while there is something to read. If the broker has closed
/// the connection by then, writing would reset it and lose what is still in the socket.
const LISTEN_FIRST: Duration = Duration::from_millis(100);
/// Longest time without sending after a stall, while there is always something to read.
const LISTEN_MAX: Duration = Duration::from_secs(1);

/// Runs the conversation with the broker until `stop`; then sends the farewell and returns. `bell` is to be rung when anything that the
/// conversation reads has changed. If dropped instead of stopped, the broker publishes the will.
pub async fn converse<T: BrokerConversation>(
    settings: ConnectionSettings,
    conversation: &RefCell<T>,
    bell: &Notify,
    counters: &ClientCounters,
    stop: impl Future<Output = ()>,
) {
    let mut stop = pin!(stop);
    let retry = RetryState::new(clock::now().as_nanos() ^ u64::from(std::process::id()));
    let turns = StallDetector::new(clock::now());
    let heard = Instant::now();
    let limit = PacketLimit::default();
    let mut client = BrokerClient {
        settings,
        conversation,
        bell,
        counters,
        retry,
        limit,
        turns,
        heard,
        listens_until: None,
        link: None,
    };
    let mut last_reason = String::new();
    loop {
        if client.stops_unwanted(stop.as_mut()).await {
            return;
        }
        let had = counters.connected.get();
        let ClientEnd::Broken(broken, life) = client.connection(stop.as_mut()).await else {
            return;
        };
        count(&counters.broken);
        if broken.is_unsent && life.is_none() {
            conversation.borrow_mut().unsent();
        }
        if life.is_none() {
            client.limit.not_reached();
        }
        let next = client.retry.after(&broken, life);
        let reason = broken.reason;
        let wait = next.wait;
        let ConnectionSettings {
            host,
            port,
            client_id,
            ..
        } = &client.settings;
        conversation
            .borrow_mut()
            .lost(&format!("{host}:{port}: {reason}"));
        if counters.connected.get() > had || reason != last_reason {
            tracing::warn!(client_id, reason, "no connection to the broker; retrying");
        } else {
            tracing::debug!(
                client_id,
                reason,
                ?wait,
                "no connection to the broker; retrying"
            );
        }
        client.counters.reason.replace(reason.clone());
        last_reason = reason;
        client.settings = client.settings.at_next_place();
        if let Some(rival) = next.rival {
            client.contested(rival, wait);
        }
        if let WaitOutcome::Stopped = client
            .attend(pin!(tokio::time::sleep(wait)), None, stop.as_mut())
            .await
        {
            return;
        }
    }
}

struct BrokerClient<'a, T> {
    settings: ConnectionSettings,
    conversation: &'a RefCell<T>,
    bell: &'a Notify,
    counters: &'a ClientCounters,
    retry: RetryState,
    /// What is known of the largest packet that the broker takes.
    limit: PacketLimit,
    turns: StallDetector,
    /// When the broker last sent something, or could next have done so.
    heard: Instant,
    /// After a stall: until then nothing is sent.
    listens_until: Option<Instant>,
    /// The accepted connection.
    link: Option<AcceptedLink>,
}

/// How a connection ended.
enum ClientEnd {
    Stopped,
    /// How the connection broke, and how long after the broker had accepted it; `None` if it had not.
    Broken(BrokenConnection, Option<Duration>),
}

/// What ended a wait.
enum WaitOutcome<O> {
    Done(O),
    Stopped,
    /// The conversation gives up the connection.
    GivenUp(GivenUp),
    Overdue,
}

/// How the conversation gives up a connection, and why.
#[derive(Clone, Copy)]
enum GivenUp {
    Dropped(&'static str),
    Left(&'static str),
}

impl<T: BrokerConversation> BrokerClient<'_, T> {
    /// One connection, from the first byte to the last.
    async fn connection<S: Future<Output = ()>>(&mut self, mut stop: Pin<&mut S>) -> ClientEnd {
        let chore = self.conversation.borrow_mut().chore();
        if let Some(chore) = chore {
            // A chore that panics is not done, and the panic is reported anyway.
            let done = pin!(tokio::task::spawn_blocking(chore));
            if let WaitOutcome::Stopped = self.attend(done, None, stop.as_mut()).await {
                return ClientEnd::Stopped;
            }
        }
        let tls = match self.read_tls(stop.as_mut()).await {
            Ok(tls) => tls,
            Err(end) => return end,
        };
        let will = self.conversation.borrow().will();
        let (sender, mut events) = link::open(&self.settings, will, tls);
        let mut sender = Some(sender);
        let mut patience = CONNECT_TIMEOUT + CONNECT_MARGIN;
        self.heard = Instant::now();
        loop {
            let outcome = {
                let next = pin!(events.next());
                self.attend(next, Some(patience), stop.as_mut()).await
            };
            let mut incident = match outcome {
                WaitOutcome::Done(Ok(incident)) => incident,
                WaitOutcome::Done(Err(broken)) => return self.abandon(&mut events, broken),
                WaitOutcome::GivenUp(how) => return self.give_up(&mut events, how).await,
                WaitOutcome::Overdue => {
                    return self.abandon(
                        &mut events,
                        BrokenConnection::because("the broker stopped responding"),
                    );
                }
                WaitOutcome::Stopped => return self.farewell(&mut events).await,
            };
            if incident.is_heard() {
                self.heard = Instant::now();
            }
            if let ConnectionIncident::Offence(what) = incident {
                let reason = format!("the broker breaks the protocol: {what}");
                return self.abandon(&mut events, BrokenConnection::because(reason));
            }
            if let ConnectionIncident::Connected(terms) = &mut incident {
                self.limit.apply(terms, clock::now());
                patience = self.patience(terms);
                let since = Instant::now();
                let alone_above = self.limit.alone_above();
                self.link = sender
                    .take()
                    .map(|sender| AcceptedLink::new(sender, since, *terms, alone_above));
            }
            self.take(incident);
            self.settle();
            if let Some(how) = self.send() {
                return self.give_up(&mut events, how).await;
            }
        }
    }

    /// The TLS configuration, read while the conversation gets its ticks; how the connection ended if it cannot be read.
    async fn read_tls<S: Future<Output = ()>>(
        &mut self,
        stop: Pin<&mut S>,
    ) -> Result<Option<Arc<ClientConfig>>, ClientEnd> {
        let read = pin!(tls::read(self.settings.tls.clone()));
        match self.attend(read, None, stop).await {
            WaitOutcome::Done(Ok(tls)) => Ok(tls),
            WaitOutcome::Done(Err(reason)) => {
                Err(ClientEnd::Broken(BrokenConnection::unsent(reason), None))
            }
            WaitOutcome::Stopped => Err(ClientEnd::Stopped),
            WaitOutcome::GivenUp(GivenUp::Dropped(reason) | GivenUp::Left(reason)) => {
                Err(ClientEnd::Broken(BrokenConnection::unsent(reason), None))
            }
            WaitOutcome::Overdue => Err(ClientEnd::Broken(
                BrokenConnection::unsent("the TLS files cannot be read in time"),
                None,
            )),
        }
    }

    /// Longest silence of the broker: one and a half times the keep-alive, since each ping is answered.
    fn patience(&self, terms: &BrokerTerms) -> Duration {
        let keep_alive = terms
            .keep_alive
            .filter(|span| !span.is_zero())
            .unwrap_or(self.settings.keep_alive());
        keep_alive * 3 / 2
    }

    /// Waits for `future`, but with `patience` no longer than the broker may be silent; the conversation still gets its
    /// ticks.
    async fn attend<F: Future, S: Future<Output = ()>>(
        &mut self,
        mut future: Pin<&mut F>,
        patience: Option<Duration>,
        mut stop: Pin<&mut S>,
    ) -> WaitOutcome<F::Output> {
        loop {
            let overdue = patience.map_or_else(far, |patience| self.heard + patience);
            let wake = self
                .next_wake()
                .min(overdue)
                .min(Instant::now() + LOOK_EVERY);
            // Unbiased, so that a flood of one kind does not starve the others.
            let done = tokio::select! {
                output = future.as_mut() => Some(output),
                () = stop.as_mut() => return WaitOutcome::Stopped,
                () = self.bell.notified() => None,
                () = sleep_until(wake) => None,
            };
            self.notice_stall();
            let done = match done {
                // Readable data takes precedence over the time limit for it.
                None if self.listens() => {
                    poll_fn(|cx| Poll::Ready(ready(future.as_mut().poll(cx)))).await
                }
                done => done,
            };
            if let Some(output) = done {
                return WaitOutcome::Done(output);
            }
            self.listens_until.take_if(|until| *until <= Instant::now());
            if patience.is_some_and(|patience| self.heard.elapsed() >= patience) {
                return WaitOutcome::Overdue;
            }
            self.conversation.borrow_mut().tick(clock::moment());
            if let Some(how) = self.send() {
                return WaitOutcome::GivenUp(how);
            }
        }
    }

    /// After a stall of this process, received messages may be that old, and the silence was not the broker's.
    fn notice_stall(&mut self) {
        let Some(stood) = self.turns.turn(clock::now()) else {
            return;
        };
        self.heard = Instant::now();
        if self.link.is_some() {
            tracing::debug!(
                ?stood,
                "process was suspended; messages from the broker may be old"
            );
            self.listens_until = Some(self.heard + LISTEN_FIRST);
            self.notify(BrokerEvent::Stalled(stood));
        }
    }

    /// Whether nothing may be sent yet.
    fn listens(&self) -> bool {
        self.listens_until
            .is_some_and(|until| Instant::now() < until + LISTEN_MAX)
    }

    fn next_wake(&self) -> Instant {
        let wake = self.conversation.borrow().next_wake();
        // Due packets cannot be sent before the broker has taken some, and stay due.
        let is_full = self.listens() || self.link.as_ref().is_some_and(|link| !link.has_room());
        let least = if is_full {
            LOOK_WHILE_FULL
        } else {
            Duration::ZERO
        };
        wake.map_or_else(far, |at| {
            Instant::now() + at.since(clock::now()).clamp(least, LONG)
        })
    }

    /// Queues what the conversation has for the broker, as far as there is room. Returns how it gives up the connection, if it
    /// does.
    fn send(&mut self) -> Option<GivenUp> {
        if self.listens() {
            return None;
        }
        while self.link.as_ref().is_none_or(AcceptedLink::has_room) {
            let packet = self
                .conversation
                .borrow_mut()
                .next_packet(clock::moment())?;
            let Some(link) = &mut self.link else {
                tracing::debug!(?packet, "no connection to the broker; packet dropped");
                continue;
            };
            match packet {
                ClientPacket::Reconnect(reason) => return Some(GivenUp::Dropped(reason)),
                ClientPacket::Leave(reason) => return Some(GivenUp::Left(reason)),
                ClientPacket::Publish(publication) => {
                    let token = publication.token;
                    match link.publish(publication, self.counters) {
                        Err(NotQueued) => {
                            let reason = "the connection's queue is unexpectedly full";
                            return Some(GivenUp::Dropped(reason));
                        }
                        // It will never be acknowledged.
                        Ok(false) => token.into_iter().for_each(|it| {
                            self.notify(BrokerEvent::Refused(it, PublicationRefusal::Never))
                        }),
                        Ok(true) => {}
                    }
                }
                ClientPacket::Subscribe(filters) => link.subscribe(filters),
            }
        }
        None
    }

    /// Handles an incident.
    fn take(&mut self, incident: ConnectionIncident) {
        let window = self.link.as_mut().map(|link| &mut link.window);
        match incident {
            ConnectionIncident::Connected(terms) => {
                count(&self.counters.connected);
                let ConnectionSettings {
                    host,
                    port,
                    client_id,
                    ..
                } = &self.settings;
                tracing::info!(client_id, host, port, "connected to the broker");
                self.notify(BrokerEvent::Connected(terms.broker));
            }
            ConnectionIncident::Subscribed(granted) => {
                if let Some(granted) = self.link.as_mut().and_then(|link| link.subscribed(granted))
                {
                    self.notify(BrokerEvent::Subscribed(granted));
                }
            }
            ConnectionIncident::Message(message) => self.receive(&message),
            ConnectionIncident::Acknowledged(identifier) => {
                let settled = window
                    .map(|window| window.settle(identifier))
                    .unwrap_or_default();
                self.took(settled.taken_bytes);
                if let Some(token) = settled.token {
                    self.notify(BrokerEvent::Acknowledged(token));
                }
            }
            ConnectionIncident::Refused(identifier, refusal, reason) => {
                count(&self.counters.refused);
                let settled = window
                    .map(|window| window.settle(identifier))
                    .unwrap_or_default();
                self.took(settled.taken_bytes);
                let token = settled.token;
                tracing::warn!(reason, ?token, "broker refused a publication");
                if let Some(token) = token {
                    self.notify(BrokerEvent::Refused(token, refusal));
                }
            }
            ConnectionIncident::PublicationLeft(identifier) => {
                count(&self.counters.published);
                if let Some(window) = window {
                    window.publication_left(identifier);
                }
            }
            ConnectionIncident::OtherLeft => {
                if let Some(window) = window {
                    window.other_left();
                }
            }
            ConnectionIncident::Offence(_)
            | ConnectionIncident::Heard
            | ConnectionIncident::Nothing => {}
        }
    }

    fn receive(&self, message: &ReceivedMessage) {
        count(&self.counters.received);
        self.notify(BrokerEvent::Message(message.as_message()));
    }

    fn notify(&self, event: BrokerEvent<'_>) {
        self.conversation
            .borrow_mut()
            .handle(clock::moment(), event);
    }

    /// Gives up the connection. What was received is handed over: acknowledgements are valid at any age, and so is a
    /// stop.
    fn abandon(&mut self, events: &mut ConnectionEvents, broken: BrokenConnection) -> ClientEnd {
        let life = self.life();
        let rest = events.rest();
        if !broken.is_fresh
            && rest
                .iter()
                .any(|it| matches!(it, ConnectionIncident::Message(_)))
        {
            self.notify(BrokerEvent::Stalled(Duration::MAX));
        }
        rest.into_iter()
            .filter(|it| !matches!(it, ConnectionIncident::Connected(_)))
            .for_each(|it| self.take(it));
        let broken = self.judged(broken);
        self.listens_until = None;
        if life.is_some() {
            self.notify(BrokerEvent::Lost);
        }
        ClientEnd::Broken(broken, life)
    }

    /// Ends the connection as the conversation requests.
    async fn give_up(&mut self, events: &mut ConnectionEvents, how: GivenUp) -> ClientEnd {
        let reason = match how {
            GivenUp::Dropped(reason) => {
                return self.abandon(events, BrokenConnection::because(reason));
            }
            GivenUp::Left(reason) => reason,
        };
        let life = self.life();
        self.farewell(events).await;
        if life.is_some() {
            self.notify(BrokerEvent::Lost);
        }
        ClientEnd::Broken(BrokenConnection::because(reason), life)
    }

    /// How long ago the broker accepted the connection.
    fn life(&self) -> Option<Duration> {
        self.link.as_ref().map(|link| link.since.elapsed())
    }
}

fn ready<O>(polled: Poll<O>) -> Option<O> {
    match polled {
        Poll::Ready(output) => Some(output),
        Poll::Pending => None,
    }
}

fn far() -> Instant {
    Instant::now() + LONG
}
