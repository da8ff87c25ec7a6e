//! The farewell on a connection: last messages and DISCONNECT.

use super::{BrokerClient, BrokerConversation, ClientEnd, ConnectionEvents};
use crate::daemon::host::clock;
use crate::north::broker::{MqttVersion, Publication};
use std::collections::VecDeque;
use std::time::Duration;
use tokio::time::timeout;

/// Time for the last messages.
const FAREWELL_MAX: Duration = Duration::from_secs(1);
/// Time for the broker to close the connection after DISCONNECT, or to read the last messages where none is sent.
/// Closing first could lose messages that it has not read.
const CLOSING_MAX: Duration = Duration::from_millis(200);

impl<T: BrokerConversation> BrokerClient<'_, T> {
    /// Sends the last messages and DISCONNECT, and waits for the broker to close the connection; all in bounded time.
    pub(super) async fn farewell(&mut self, events: &mut ConnectionEvents) -> ClientEnd {
        if self.link.is_none() {
            return ClientEnd::Stopped;
        }
        let mut words: VecDeque<Publication> = self
            .conversation
            .borrow_mut()
            .farewell(clock::moment())
            .into();
        match timeout(FAREWELL_MAX, self.say(&mut words, events)).await {
            Err(_) => tracing::warn!("broker did not accept the last messages in time"),
            Ok(()) => {
                let closed = async {
                    while let Ok(incident) = events.next().await {
                        self.take(incident);
                    }
                };
                // Either way there is nothing left to send.
                let _ = timeout(CLOSING_MAX, closed).await;
            }
        }
        events.rest().into_iter().for_each(|it| self.take(it));
        self.link = None;
        ClientEnd::Stopped
    }

    /// Sends `words` and, where one is sent, DISCONNECT; returns earlier if the connection is lost. Stops that arrive
    /// in that time are handled as usual.
    async fn say(&mut self, words: &mut VecDeque<Publication>, events: &mut ConnectionEvents) {
        // The library cannot send a DISCONNECT that requests the will. Closing without one does.
        let is_closed_only =
            self.settings.version == MqttVersion::V5 && self.conversation.borrow().leaves_will();
        let mut has_ended = false;
        while let Some(link) = &mut self.link {
            while link.window.has_room() && !has_ended {
                has_ended = match words.pop_front() {
                    Some(publication) => link.publish(publication, self.counters).is_err(),
                    // Not before the messages are sent: a broker may answer nothing once it has read DISCONNECT.
                    None if link.window.is_empty() => {
                        if !is_closed_only {
                            link.disconnect();
                        }
                        true
                    }
                    None => break,
                };
            }
            if has_ended && link.window.is_empty() {
                return;
            }
            let Ok(incident) = events.next().await else {
                return;
            };
            self.take(incident);
        }
    }
}
