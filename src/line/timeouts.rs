//! How long a reply is waited for, by what is asked.

use super::budget::ASSUMED_TURNAROUND;
use super::station::PROBE_TIMEOUT;
use super::timing::Timing;
use crate::profile::model::{self, Model};
use crate::wire::pdu::Request;
use std::time::Duration;

/// What a drive has to do for a request.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Class {
    /// It shows something.
    Read,
    /// It takes a value.
    Write,
    /// It takes a value and stores it.
    StoredWrite,
}

/// How long an adapter may keep back bytes that it has received: a USB bridge collects them for 16 ms and is asked for
/// them within the next few.
pub const ADAPTER_HOLDS: Duration = Duration::from_millis(20);

impl Class {
    /// All of them.
    pub const ALL: [Self; 3] = [Self::Read, Self::Write, Self::StoredWrite];

    /// The class of `request` to a drive of `model`.
    #[must_use]
    pub fn of(request: &Request, model: &Model) -> Self {
        let is_stored = match request {
            Request::ReadHolding { .. } | Request::Loopback { .. } | Request::Unserved { .. } => return Self::Read,
            Request::WriteSingle { address, .. } => model.is_stored(*address),
            Request::WriteMultiple { address, values } => {
                (*address..=u16::MAX).zip(values).any(|(address, _)| model.is_stored(address))
            }
        };
        if is_stored { Self::StoredWrite } else { Self::Write }
    }
}

/// Longest waits from the end of a request to the start of its reply.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ReplyTimeouts {
    /// To a read.
    pub read: Duration,
    /// To a write.
    pub write: Duration,
    /// To a write of a stored register.
    pub stored_write: Duration,
    /// Whether shorter waits follow from the reply times that were seen.
    pub learns: bool,
}

impl ReplyTimeouts {
    /// The same for all, as somebody wants it.
    #[must_use]
    pub const fn fixed(timeout: Duration) -> Self {
        Self { read: timeout, write: timeout, stored_write: timeout, learns: false }
    }

    /// As `timing` says: the model's cap while nothing better is known, but never less than the drive may need.
    #[must_use]
    pub fn auto(timing: &model::Timing) -> Self {
        let wait =
            |class| timing.reply_timeout_cap.value.max(work(timing, class).unwrap_or_default() + reply_delay(timing));
        let (read, write) = (wait(Class::Read), wait(Class::Write));
        Self { read, write, stored_write: wait(Class::StoredWrite), learns: true }
    }

    /// The wait in force for a station of `timing`, of whose replies `learned` is known.
    #[must_use]
    pub fn in_force(&self, class: Class, timing: &model::Timing, learned: Option<Duration>) -> Duration {
        let learned = learned.filter(|_| self.learns).map(|learned| learned.max(floor(timing, class)));
        learned.map_or(self.of(class), |learned| learned.min(self.of(class)))
    }

    /// The wait for a station that is known to be silent: short, but never so short that it could not answer.
    #[must_use]
    pub fn probe(&self, class: Class, timing: &model::Timing, learned: Option<Duration>) -> Duration {
        let needed = learned.unwrap_or_default().max(floor(timing, class));
        PROBE_TIMEOUT.max(needed).min(self.of(class))
    }

    /// The wait for a request of `class`.
    #[must_use]
    pub const fn of(&self, class: Class) -> Duration {
        match class {
            Class::Read => self.read,
            Class::Write => self.write,
            Class::StoredWrite => self.stored_write,
        }
    }
}

/// The wait that would follow for a station of `timing` whose replies all but one in a thousand took no longer than
/// `usual`: twice that, never less than the drive may need, never more than the model's.
#[must_use]
pub fn suggested(class: Class, timing: &model::Timing, usual: Duration) -> Duration {
    ReplyTimeouts::auto(timing).in_force(class, timing, Some(usual * 2))
}

/// The shortest wait that may follow from what was learned: the longest that the drive may need for work and delay, and
/// what an adapter keeps back.
#[must_use]
pub fn floor(timing: &model::Timing, class: Class) -> Duration {
    turnaround(timing, class) + reply_delay(timing) + ADAPTER_HOLDS
}

/// The longest that the drive works on a request, as documented or else assumed, without the delay that can be set.
#[must_use]
pub fn turnaround(timing: &model::Timing, class: Class) -> Duration {
    work(timing, class).unwrap_or(ASSUMED_TURNAROUND)
}

/// The longest delay of replies that can be set on the drive, as far as it is known.
#[must_use]
pub fn reply_delay(timing: &model::Timing) -> Duration {
    timing.reply_delay_max.as_ref().map_or(Duration::ZERO, |fact| fact.value)
}

fn work(timing: &model::Timing, class: Class) -> Option<Duration> {
    let value = |fact: &Option<model::Fact<Duration>>| fact.as_ref().map(|fact| fact.value);
    let processing = value(&timing.processing_max);
    match class {
        Class::Read | Class::Write => processing,
        Class::StoredWrite => value(&timing.stored_write_max).max(processing),
    }
}

/// By how much a reply of `bytes` characters is longer on the line of `timing` than our own frames would be, because the
/// drive sends characters of `char_bits` bits.
#[must_use]
pub fn longer_reply(timing: &Timing, char_bits: Option<u8>, bytes: usize) -> Duration {
    let bits = char_bits.map_or(0, |bits| u32::from(bits).saturating_sub(timing.link.bits_per_char()));
    if !timing.paced || bits == 0 {
        return Duration::ZERO;
    }
    Duration::from_nanos((bytes as u64 * u64::from(bits) * 1_000_000_000).div_ceil(timing.link.baud.max(1).into()))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::domain::link::{Framing, LinkSettings, Parity};
    use crate::profile::check;
    use crate::profile::model::Memory;
    use crate::profile::model::{Confidence, Fact, Role};
    use crate::vendors;

    fn model() -> Model {
        let (_, text) = vendors::texts().first().expect("a built-in model");
        check::model(text).expect("a sound model")
    }

    const fn ms(millis: u64) -> Duration {
        Duration::from_millis(millis)
    }

    fn fact(value: Duration) -> Option<Fact<Duration>> {
        Some(Fact { value, confidence: Confidence::Manual, source: String::new() })
    }

    #[test]
    fn a_reply_is_waited_for_at_least_as_long_as_the_drive_may_need() {
        let timing = model::Timing { processing_max: fact(ms(10)), ..model().timing };
        let delayed = model::Timing { reply_delay_max: fact(ms(600)), ..timing.clone() };
        let storing = model::Timing { stored_write_max: fact(ms(800)), ..timing.clone() };
        let both = model::Timing { stored_write_max: fact(ms(50)), ..delayed.clone() };
        for (timing, read, stored_write) in
            [(&timing, 500, 500), (&delayed, 610, 610), (&storing, 500, 800), (&both, 610, 650)]
        {
            let auto = ReplyTimeouts::auto(timing);
            assert_eq!((auto.read, auto.write, auto.stored_write), (ms(read), ms(read), ms(stored_write)));
        }
    }

    #[test]
    fn a_learned_wait_lies_between_what_the_drive_may_need_and_the_cap() {
        let timing = model::Timing { processing_max: fact(ms(10)), ..model().timing };
        let timing = model::Timing { reply_delay_max: fact(ms(65)), stored_write_max: fact(ms(50)), ..timing };
        let unknown = model().timing;
        let auto = ReplyTimeouts::auto(&timing);
        for (timing, class, learned, wait, probe) in [
            (&timing, Class::Read, None, 500, 100),
            (&timing, Class::Read, Some(8), 95, 100),
            (&timing, Class::StoredWrite, Some(8), 135, 135),
            (&timing, Class::Read, Some(240), 240, 240),
            (&timing, Class::Read, Some(900), 500, 500),
            (&unknown, Class::Write, Some(4), 30, 100),
            (&unknown, Class::StoredWrite, Some(4), 30, 100),
        ] {
            let learned = learned.map(ms);
            assert_eq!(auto.in_force(class, timing, learned), ms(wait), "{class:?} {learned:?}");
            assert_eq!(auto.probe(class, timing, learned), ms(probe), "{class:?} {learned:?}");
        }
        let fixed = ReplyTimeouts::fixed(ms(300));
        assert_eq!(fixed.in_force(Class::Read, &timing, Some(ms(4))), ms(300), "what somebody wants stays");
        let slow = model::Timing { reply_delay_max: fact(ms(1000)), ..timing };
        assert_eq!(fixed.probe(Class::Read, &slow, None), ms(300));
        assert_eq!(ReplyTimeouts::fixed(ms(2000)).probe(Class::Read, &slow, None), ms(1030));
    }

    #[test]
    fn what_is_not_known_to_be_lost_with_the_power_is_stored() {
        let mut model = model();
        let at = |role| model.register_for(role).unwrap().address;
        let (run, ramp) = (at(Role::RunCommand), at(Role::AccelerationTime));
        let class = |model: &Model, address| Class::of(&Request::WriteSingle { address, value: 1 }, model);
        assert_eq!(class(&model, run), Class::Write, "it is commanded cyclically");
        assert_eq!(class(&model, ramp), Class::StoredWrite);
        assert_eq!(class(&model, 0xFFFE), Class::StoredWrite, "nobody knows it");
        for register in &mut model.registers {
            let memory = if register.address == run { Memory::Stored } else { Memory::Ram };
            register.memory = Some(memory);
        }
        assert_eq!(class(&model, run), Class::StoredWrite);
        assert_eq!(class(&model, ramp), Class::Write);
        let block = |values| Class::of(&Request::WriteMultiple { address: ramp, values }, &model);
        assert_eq!((block(vec![1]), block(vec![1, 2])), (Class::Write, Class::StoredWrite));
        assert_eq!(Class::of(&Request::ReadHolding { address: run, count: 1 }, &model), Class::Read);
    }

    #[test]
    fn characters_of_more_bits_make_a_longer_reply() {
        let link = LinkSettings { baud: 19_200, parity: Parity::Even, ..LinkSettings::DEFAULT };
        let timing = Timing::for_models(Framing::Rtu, link, [], Duration::ZERO);
        // 7 characters of 12 bits in the place of 11.
        assert_eq!(longer_reply(&timing, Some(12), 7), Duration::from_nanos(364_584));
        assert_eq!(longer_reply(&timing, Some(11), 7), Duration::ZERO);
        assert_eq!(longer_reply(&timing, None, 7), Duration::ZERO);
        assert_eq!(longer_reply(&timing.unpaced(ms(1)), Some(12), 7), Duration::ZERO);
    }
}
