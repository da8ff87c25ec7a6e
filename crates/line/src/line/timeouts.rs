//! Reply timeouts by class of request.

use super::budget::ASSUMED_TURNAROUND;
use super::station::PROBE_TIMEOUT;
use super::timing::LineTiming;
use crate::profile::model::{self, Model};
use crate::wire::pdu::Request;
use std::time::Duration;

/// Classes of requests, by what the drive has to do.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum RequestClass {
    /// Return a value.
    Read,
    /// Accept a value.
    Write,
    /// Accept a value and store it.
    StoredWrite,
}

/// How long an adapter may hold back received bytes: a USB bridge collects them for 16 ms and is polled within the
/// next few.
pub const ADAPTER_HOLDS: Duration = Duration::from_millis(20);

impl RequestClass {
    /// All of them.
    pub const ALL: [Self; 3] = [Self::Read, Self::Write, Self::StoredWrite];

    /// The class of `request` to a drive of `model`.
    #[must_use]
    pub fn of(request: &Request, model: &Model) -> Self {
        let is_stored = match request {
            Request::Read { .. } | Request::Loopback { .. } | Request::Unserved { .. } => {
                return Self::Read;
            }
            Request::WriteSingle { address, .. } => model.is_stored(*address),
            Request::WriteMultiple { address, values } => address
                .onwards()
                .zip(values)
                .any(|(address, _)| model.is_stored(address)),
        };
        if is_stored {
            Self::StoredWrite
        } else {
            Self::Write
        }
    }
}

/// Longest waits from the end of a request to the start of its reply.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ReplyTimeouts {
    /// The time-out of a read.
    pub read: Duration,
    /// The time-out of a write.
    pub write: Duration,
    /// The time-out of a write of a stored register.
    pub stored_write: Duration,
    /// Whether the waits are shortened according to measured reply times.
    pub learns: bool,
}

impl ReplyTimeouts {
    /// One configured wait for all classes.
    #[must_use]
    pub const fn fixed(timeout: Duration) -> Self {
        Self {
            read: timeout,
            write: timeout,
            stored_write: timeout,
            learns: false,
        }
    }

    /// From `timing`: the model's cap until reply times are known, but never less than the drive may need.
    #[must_use]
    pub fn auto(timing: &model::ModelTiming) -> Self {
        let wait = |class| {
            timing
                .reply_timeout_cap
                .value
                .max(work(timing, class).unwrap_or_default() + reply_delay(timing))
        };
        Self {
            read: wait(RequestClass::Read),
            write: wait(RequestClass::Write),
            stored_write: wait(RequestClass::StoredWrite),
            learns: true,
        }
    }

    /// The effective wait for a station with `timing`, whose reply times suggest `learned`.
    #[must_use]
    pub fn in_force(
        &self,
        class: RequestClass,
        timing: &model::ModelTiming,
        learned: Option<Duration>,
    ) -> Duration {
        match learned {
            Some(learned) if self.learns => learned.max(floor(timing, class)).min(self.of(class)),
            _ => self.of(class),
        }
    }

    /// The wait for a station that is known to be silent: short, but never so short that it could not answer.
    #[must_use]
    pub fn probe(
        &self,
        class: RequestClass,
        timing: &model::ModelTiming,
        learned: Option<Duration>,
    ) -> Duration {
        let needed = learned.unwrap_or_default().max(floor(timing, class));
        PROBE_TIMEOUT.max(needed).min(self.of(class))
    }

    /// The wait for a request of `class`.
    #[must_use]
    pub const fn of(&self, class: RequestClass) -> Duration {
        match class {
            RequestClass::Read => self.read,
            RequestClass::Write => self.write,
            RequestClass::StoredWrite => self.stored_write,
        }
    }
}

/// The suggested wait for a station with `timing` whose 99.9th percentile of reply times is `usual`: twice that, but
/// never less than the drive may need and never more than the model's cap.
#[must_use]
pub fn suggested(class: RequestClass, timing: &model::ModelTiming, usual: Duration) -> Duration {
    ReplyTimeouts::auto(timing).in_force(class, timing, Some(usual * 2))
}

/// The shortest wait that may be learned: the longest that the drive may need for processing and delay, plus
/// [`ADAPTER_HOLDS`].
#[must_use]
pub fn floor(timing: &model::ModelTiming, class: RequestClass) -> Duration {
    turnaround(timing, class) + reply_delay(timing) + ADAPTER_HOLDS
}

/// The longest processing time of the drive, documented or else assumed, without the reply delay that can be set.
#[must_use]
pub fn turnaround(timing: &model::ModelTiming, class: RequestClass) -> Duration {
    work(timing, class).unwrap_or(ASSUMED_TURNAROUND)
}

/// The longest reply delay that can be set on the drive; zero if it is not known.
#[must_use]
pub fn reply_delay(timing: &model::ModelTiming) -> Duration {
    timing
        .reply_delay_max
        .as_ref()
        .map_or(Duration::ZERO, |fact| fact.value)
}

fn work(timing: &model::ModelTiming, class: RequestClass) -> Option<Duration> {
    let value = |fact: &Option<model::Fact<Duration>>| fact.as_ref().map(|fact| fact.value);
    let processing = value(&timing.processing_max);
    match class {
        RequestClass::Read | RequestClass::Write => processing,
        RequestClass::StoredWrite => value(&timing.stored_write_max).max(processing),
    }
}

/// By how much a reply of `bytes` characters takes longer on a line with `timing` than one of our frames, because
/// the drive sends characters of `char_bits` bits.
#[must_use]
pub fn longer_reply(timing: &LineTiming, char_bits: Option<u8>, bytes: usize) -> Duration {
    let bits = char_bits.map_or(0, |bits| {
        u32::from(bits).saturating_sub(timing.link.bits_per_char())
    });
    if !timing.paced || bits == 0 {
        return Duration::ZERO;
    }
    Duration::from_nanos(
        (bytes as u64 * u64::from(bits) * 1_000_000_000).div_ceil(timing.link.baud.max(1).into()),
    )
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::domain::link::{Framing, LinkSettings, Parity};
    use crate::profile::model::RegisterMemory;
    use crate::profile::model::{Confidence, Fact, RegisterRole};
    use crate::vendors;

    fn model() -> Model {
        Model::clone(
            vendors::catalog()
                .find("hyundai-n700")
                .expect("it is built in"),
        )
    }

    const fn ms(millis: u64) -> Duration {
        Duration::from_millis(millis)
    }

    fn fact(value: Duration) -> Option<Fact<Duration>> {
        Some(Fact {
            value,
            confidence: Confidence::Manual,
            source: String::new(),
        })
    }

    #[test]
    fn a_reply_is_waited_for_at_least_as_long_as_the_drive_may_need() {
        let timing = model::ModelTiming {
            processing_max: fact(ms(10)),
            ..model().timing
        };
        let delayed = model::ModelTiming {
            reply_delay_max: fact(ms(600)),
            ..timing.clone()
        };
        let storing = model::ModelTiming {
            stored_write_max: fact(ms(800)),
            ..timing.clone()
        };
        let both = model::ModelTiming {
            stored_write_max: fact(ms(50)),
            ..delayed.clone()
        };
        for (timing, read, stored_write) in [
            (&timing, 500, 500),
            (&delayed, 610, 610),
            (&storing, 500, 800),
            (&both, 610, 650),
        ] {
            let auto = ReplyTimeouts::auto(timing);
            assert_eq!(
                (auto.read, auto.write, auto.stored_write),
                (ms(read), ms(read), ms(stored_write))
            );
        }
    }

    #[test]
    fn a_learned_wait_lies_between_what_the_drive_may_need_and_the_cap() {
        let timing = model::ModelTiming {
            processing_max: fact(ms(10)),
            ..model().timing
        };
        let timing = model::ModelTiming {
            reply_delay_max: fact(ms(65)),
            stored_write_max: fact(ms(50)),
            ..timing
        };
        let unknown = model().timing;
        let auto = ReplyTimeouts::auto(&timing);
        for (timing, class, learned, wait, probe) in [
            (&timing, RequestClass::Read, None, 500, 100),
            (&timing, RequestClass::Read, Some(8), 95, 100),
            (&timing, RequestClass::StoredWrite, Some(8), 135, 135),
            (&timing, RequestClass::Read, Some(240), 240, 240),
            (&timing, RequestClass::Read, Some(900), 500, 500),
            (&unknown, RequestClass::Write, Some(4), 30, 100),
            (&unknown, RequestClass::StoredWrite, Some(4), 30, 100),
        ] {
            let learned = learned.map(ms);
            assert_eq!(
                auto.in_force(class, timing, learned),
                ms(wait),
                "{class:?} {learned:?}"
            );
            assert_eq!(
                auto.probe(class, timing, learned),
                ms(probe),
                "{class:?} {learned:?}"
            );
        }
        let fixed = ReplyTimeouts::fixed(ms(300));
        assert_eq!(
            fixed.in_force(RequestClass::Read, &timing, Some(ms(4))),
            ms(300),
            "a configured value stays"
        );
        let slow = model::ModelTiming {
            reply_delay_max: fact(ms(1000)),
            ..timing
        };
        assert_eq!(fixed.probe(RequestClass::Read, &slow, None), ms(300));
        assert_eq!(
            ReplyTimeouts::fixed(ms(2000)).probe(RequestClass::Read, &slow, None),
            ms(1030)
        );
    }

    #[test]
    fn what_is_not_known_to_be_lost_with_the_power_is_stored() {
        let mut model = model();
        let at = |role| model.register_for(role).unwrap().address;
        let run = at(RegisterRole::RunCommand);
        let ramp = at(RegisterRole::AccelerationTime);
        let class = |model: &Model, address| {
            RequestClass::of(&Request::WriteSingle { address, value: 1 }, model)
        };
        assert_eq!(
            class(&model, run),
            RequestClass::Write,
            "it is commanded cyclically"
        );
        assert_eq!(class(&model, ramp), RequestClass::StoredWrite);
        assert_eq!(
            class(&model, 0xFFFE_u16.into()),
            RequestClass::StoredWrite,
            "it is not in the model"
        );
        for register in &mut model.registers {
            let memory = if register.address == run {
                RegisterMemory::Stored
            } else {
                RegisterMemory::Ram
            };
            register.memory = Some(memory);
        }
        assert_eq!(class(&model, run), RequestClass::StoredWrite);
        assert_eq!(class(&model, ramp), RequestClass::Write);
        let block = |values| {
            RequestClass::of(
                &Request::WriteMultiple {
                    address: ramp,
                    values,
                },
                &model,
            )
        };
        assert_eq!(
            (block(vec![1]), block(vec![1, 2])),
            (RequestClass::Write, RequestClass::StoredWrite)
        );
        assert_eq!(
            RequestClass::of(
                &Request::Read {
                    address: run,
                    count: 1
                },
                &model
            ),
            RequestClass::Read
        );
    }

    #[test]
    fn characters_of_more_bits_make_a_longer_reply() {
        let link = LinkSettings {
            baud: 19_200,
            parity: Parity::Even,
            ..LinkSettings::DEFAULT
        };
        let timing = LineTiming::for_models(Framing::Rtu, link, [], Duration::ZERO);
        // 7 characters of 12 bits instead of 11.
        assert_eq!(
            longer_reply(&timing, Some(12), 7),
            Duration::from_nanos(364_584)
        );
        assert_eq!(longer_reply(&timing, Some(11), 7), Duration::ZERO);
        assert_eq!(longer_reply(&timing, None, 7), Duration::ZERO);
        assert_eq!(
            longer_reply(&timing.unpaced(ms(1)), Some(12), 7),
            Duration::ZERO
        );
    }
}
