//! The time in which the conversation wants no connection.

use super::{BrokerClient, BrokerConversation, WaitOutcome};
use std::future::poll_fn;
use std::pin::{Pin, pin};
use std::task::Poll;

impl<T: BrokerConversation> BrokerClient<'_, T> {
    /// Waits until the conversation wants a connection. Returns whether the conversation is to stop instead.
    pub(super) async fn stops_unwanted<S: Future<Output = ()>>(
        &mut self,
        stop: Pin<&mut S>,
    ) -> bool {
        let conversation = self.conversation;
        let is_wanted = || conversation.borrow().wants_connection();
        if is_wanted() {
            return false;
        }
        conversation
            .borrow_mut()
            .lost("on standby: another gateway is active");
        // That one has the identifier now, as it should.
        conversation.borrow_mut().contested(None);
        // It is looked at whenever something has changed, and several times a second.
        let wanted = pin!(poll_fn(|_| if is_wanted() {
            Poll::Ready(())
        } else {
            Poll::Pending
        }));
        matches!(self.attend(wanted, None, stop).await, WaitOutcome::Stopped)
    }
}
