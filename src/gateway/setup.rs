//! What a line is made of, ready to use.

use crate::domain::control::ControlSettings;
use crate::domain::ids::Station;
use crate::domain::link::EchoPolicy;
use crate::line::budget;
use crate::line::timeouts::{Class, ReplyTimeouts, longer_reply};
use crate::line::timing::Timing;
use crate::profile::model::{BlockWrite, Model};
use crate::wire::pdu::Request;
use std::sync::Arc;
use std::time::Duration;

/// One line and its drives.
#[derive(Clone, Debug)]
pub struct LineSetup {
    /// Times on the wire.
    pub timing: Timing,
    /// The drives, in the order of the configuration.
    pub drives: Vec<DriveSetup>,
    /// What to do if what is sent comes back.
    pub echo: EchoPolicy,
    /// Whether the traffic is told.
    pub tells_traffic: bool,
    /// Where the epochs of its drives begin: another number at each start of the gateway.
    pub first_epoch: u64,
}

impl LineSetup {
    /// Longest time from the acceptance of a stop for one drive to its first bit.
    #[must_use]
    pub fn worst_stop(&self) -> Duration {
        budget::worst_stop(&self.timing, self.drives.iter().map(|drive| drive.longest_exchange(&self.timing)))
    }
}

/// One drive of a line.
#[derive(Clone, Debug)]
pub struct DriveSetup {
    /// Number on the line.
    pub station: Station,
    /// What it is.
    pub model: Arc<Model>,
    /// Period of its fast polls.
    pub poll: Duration,
    /// Longest waits for a reply.
    pub timeouts: ReplyTimeouts,
    /// How long after a time-out a reply may still come.
    pub max_lateness: Duration,
    /// What may be commanded; nothing: it is read-only from everywhere.
    pub control: Option<Arc<ControlSettings>>,
}

impl DriveSetup {
    /// Longest wait for the start of the reply to `request`, and for what its characters take longer than ours. Cut to
    /// `at_most` where there is such a bound.
    pub(super) fn wait_for(&self, request: &Request, timing: &Timing, at_most: Duration) -> Duration {
        let longer = self.longer_reply(timing, request.reply_pdu_bytes());
        self.timeouts.of(Class::of(request, &self.model)).min(at_most) + longer
    }

    /// The longest exchange with it, whether it answers or not. Lengths are those of PDUs.
    fn longest_exchange(&self, timing: &Timing) -> Duration {
        const WORD_BYTES: usize = 2;
        let (timeouts, words) = (&self.timeouts, usize::from(self.model.read.max_words.value));
        let block = |block: &BlockWrite| (6 + WORD_BYTES * usize::from(block.count.value), 5);
        let writes = [Some((5, 5)), self.model.write.block.as_ref().map(block)].into_iter().flatten();
        let writes = writes.map(|bytes| (bytes, timeouts.write.max(timeouts.stored_write)));
        let exchanges = writes.chain([((5, 2 + WORD_BYTES * words), timeouts.read), ((5, 5), timeouts.read)]);
        let times = exchanges.map(|((request, reply), timeout)| {
            budget::exchange_time(timing, request, timeout + self.longer_reply(timing, reply), reply)
        });
        times.max().unwrap_or_default()
    }

    fn longer_reply(&self, timing: &Timing, pdu_bytes: usize) -> Duration {
        let char_bits = self.model.timing.reply_char_bits.as_ref().map(|fact| fact.value);
        longer_reply(timing, char_bits, timing.adu_bytes(pdu_bytes))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::domain::link::{Framing, LinkSettings};
    use crate::profile::check;
    use crate::profile::model::{Confidence, Fact};
    use crate::vendors;

    fn drive(change: impl FnOnce(&mut Model)) -> DriveSetup {
        let (_, text) = vendors::texts().first().expect("a built-in model");
        let mut model = check::model(text).expect("a sound model");
        change(&mut model);
        DriveSetup {
            station: Station(1),
            model: Arc::new(model),
            poll: Duration::from_secs(1),
            timeouts: ReplyTimeouts::fixed(Duration::from_millis(100)),
            max_lateness: Duration::from_millis(500),
            control: None,
        }
    }

    fn worst_stop(drives: Vec<DriveSetup>) -> Duration {
        let models = drives.iter().map(|drive| drive.model.as_ref());
        let timing = Timing::for_models(Framing::Rtu, LinkSettings::DEFAULT, models, Duration::ZERO);
        LineSetup { timing, drives, echo: EchoPolicy::Refuse, tells_traffic: false, first_epoch: 0 }.worst_stop()
    }

    fn fact<T>(value: T) -> Fact<T> {
        Fact { value, confidence: Confidence::Manual, source: String::new() }
    }

    /// So many characters at 9600 bit/s 8N1, two silences, and 100 ms of waiting.
    fn chars(chars: u64) -> Duration {
        Duration::from_millis(100) + Duration::from_nanos(2 * 4_687_500 + chars * 1_041_667)
    }

    fn assert_near(got: Duration, expected: Duration) {
        assert!(got.abs_diff(expected) < Duration::from_micros(1), "{got:?}, not {expected:?}");
    }

    #[test]
    fn a_stop_waits_for_the_longest_exchange_of_any_kind() {
        let with_words = |words| drive(|model| model.read.max_words.value = words);
        assert_near(worst_stop(vec![with_words(8)]), chars(8 + 21));
        assert_near(worst_stop(vec![with_words(1)]), chars(8 + 8));
        assert_near(worst_stop(vec![with_words(1), with_words(8)]), chars(8 + 21));
        let block = BlockWrite { address: 2, count: fact(10) };
        let by_blocks = drive(|model| (model.read.max_words.value, model.write.block) = (1, Some(block)));
        assert_near(worst_stop(vec![by_blocks]), chars(29 + 8));
        let long_characters = drive(|model| {
            (model.read.max_words.value, model.timing.reply_char_bits) = (1, Some(fact(20)));
        });
        assert_near(worst_stop(vec![long_characters]), chars(8 + 16));
        let stores = ReplyTimeouts { stored_write: Duration::from_millis(300), ..with_words(1).timeouts };
        let storing = DriveSetup { timeouts: stores, ..with_words(8) };
        assert_near(worst_stop(vec![storing]), chars(8 + 8) + Duration::from_millis(200));
    }

    #[test]
    fn a_reply_is_waited_for_as_its_class_and_its_characters_ask() {
        let drive = drive(|model| model.timing.reply_char_bits = Some(fact(12)));
        let timing = Timing::for_models(Framing::Rtu, LinkSettings::DEFAULT, [drive.model.as_ref()], Duration::ZERO);
        let read = Request::ReadHolding { address: 1, count: 1 };
        let longer = Duration::from_nanos(7 * 2 * 104_167);
        for (at_most, wait) in [(Duration::MAX, 100), (Duration::from_millis(50), 50)] {
            assert_near(drive.wait_for(&read, &timing, at_most), Duration::from_millis(wait) + longer);
        }
    }
}
