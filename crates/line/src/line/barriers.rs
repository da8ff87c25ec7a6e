//! The barriers of one drive: exchanges for whose answer no late reply can be mistaken. A barrier that no document of
//! the drive promises is tested by one exchange before it is relied on.

use super::echo::LocalEcho;
use crate::domain::time::MonoTime;
use crate::profile::model::{Barrier, Model};
use crate::wire::pdu::Request;
use std::time::Duration;

/// How often a barrier is tested when its answer arrives damaged.
pub const TRIES_MAX: u8 = 3;
/// How long such a test gives way to everything else.
pub const TRY_PATIENCE: Duration = Duration::from_secs(2);

/// Data for loop tests: no word repeats before all have been used, and none resembles its predecessor.
#[derive(Clone, Copy, Debug)]
pub struct LoopNonces {
    next: u16,
}

impl LoopNonces {
    /// Data with a start that depends on `seed`.
    #[must_use]
    pub const fn new(seed: u64) -> Self {
        let folded = seed ^ (seed >> 16) ^ (seed >> 32) ^ (seed >> 48);
        Self {
            next: folded as u16,
        }
    }

    /// The next word.
    #[must_use]
    pub const fn peek(&self) -> u16 {
        // Each step is reversible, so that no two numbers give the same word.
        let mixed = (self.next ^ (self.next >> 7)).wrapping_mul(0x9E3B);
        mixed ^ (mixed >> 9)
    }

    /// Marks the word as used.
    pub const fn advance(&mut self) {
        self.next = self.next.wrapping_add(1);
    }
}

/// Whether a barrier may be relied on.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum BarrierProof {
    /// A document of the drive says so.
    Documented,
    /// The barrier has to be tested; `tries` answers arrived damaged.
    Open { tries: u8 },
    /// A test has succeeded.
    Shown,
    /// The test has failed. It is repeated when the drive comes back.
    Failed,
}

/// The barriers of one drive, in its model's order.
#[derive(Debug)]
pub struct DriveBarriers {
    known: Vec<(Barrier, BarrierProof)>,
    /// Since when the drive has been answering; `None` if it does not.
    online_since: Option<MonoTime>,
}

impl DriveBarriers {
    /// The barriers of a drive of `model`, none of them tested.
    #[must_use]
    pub fn new(model: &Model) -> Self {
        let known = model
            .barriers
            .iter()
            .map(|barrier| (barrier.clone(), proof_at_first(barrier)));
        Self {
            known: known.collect(),
            online_since: None,
        }
    }

    /// None: where replies say to which request they belong, nothing has to be ruled out.
    #[must_use]
    pub const fn none() -> Self {
        Self {
            known: Vec::new(),
            online_since: None,
        }
    }

    /// The port was opened: earlier tests do not count, because another drive may be there now.
    pub fn port_opened(&mut self) {
        self.online_since = None;
        for (barrier, proof) in &mut self.known {
            *proof = proof_at_first(barrier);
        }
    }

    /// The drive answered at `now`.
    pub fn answered(&mut self, now: MonoTime) {
        if self.online_since.is_none() {
            self.online_since = Some(now);
            for (_, proof) in self
                .known
                .iter_mut()
                .filter(|(_, proof)| *proof == BarrierProof::Failed)
            {
                *proof = BarrierProof::Open { tries: 0 };
            }
        }
    }

    /// The drive stopped answering.
    pub const fn lost(&mut self) {
        self.online_since = None;
    }

    /// The barriers that may be relied on, best first; loop tests with the data `nonce`.
    pub fn usable(&self, echo: LocalEcho, nonce: u16) -> impl Iterator<Item = Request> + '_ {
        let proven = self
            .known
            .iter()
            .filter(|(_, proof)| matches!(proof, BarrierProof::Documented | BarrierProof::Shown));
        proven.filter_map(move |(barrier, _)| request(barrier, echo, nonce))
    }

    /// A barrier to be tested: its index, its request, and since when the test has been due.
    #[must_use]
    pub fn to_try(&self, echo: LocalEcho, nonce: u16) -> Option<(usize, Request, MonoTime)> {
        let since = self.online_since?;
        let open = self
            .known
            .iter()
            .enumerate()
            .filter(|(_, (_, proof))| matches!(proof, BarrierProof::Open { .. }));
        open.filter_map(|(place, (barrier, _))| {
            Some((place, request(barrier, echo, nonce)?, since))
        })
        .next()
    }

    /// The barrier at `place` was tested and answered correctly.
    pub fn shown(&mut self, place: usize) {
        self.set(place, |_| BarrierProof::Shown);
    }

    /// The barrier at `place` was tested, and its answer arrived damaged.
    pub fn damaged(&mut self, place: usize) {
        self.set(place, |proof| match proof {
            BarrierProof::Open { tries } if tries + 1 < TRIES_MAX => {
                BarrierProof::Open { tries: tries + 1 }
            }
            _ => BarrierProof::Failed,
        });
    }

    /// The test of the barrier at `place` failed.
    pub fn failed(&mut self, place: usize) {
        self.set(place, |_| BarrierProof::Failed);
    }

    fn set(&mut self, place: usize, change: impl FnOnce(BarrierProof) -> BarrierProof) {
        if let Some((_, proof)) = self.known.get_mut(place) {
            *proof = change(*proof);
        }
    }
}

fn proof_at_first(barrier: &Barrier) -> BarrierProof {
    match barrier {
        Barrier::Read(_) => BarrierProof::Documented,
        Barrier::Loop(fact) if fact.confidence.is_proven() => BarrierProof::Documented,
        // Silence would cost a timeout each time, so documents are not trusted without a test.
        Barrier::Loop(_) | Barrier::Refused(_) => BarrierProof::Open { tries: 0 },
    }
}

/// The request of `barrier`; `None` for a loop test on a line where its answer proves nothing.
fn request(barrier: &Barrier, echo: LocalEcho, nonce: u16) -> Option<Request> {
    match barrier {
        Barrier::Read(read) => Some(Request::Read {
            address: read.address,
            count: read.count,
        }),
        Barrier::Loop(_) => {
            (echo == LocalEcho::Excluded).then_some(Request::Loopback { data: nonce })
        }
        Barrier::Refused(fact) => Some(Request::Unserved {
            function: fact.value,
            data: nonce,
        }),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::profile::model::{BarrierRead, Confidence, Fact};
    use crate::vendors;
    use std::collections::HashSet;

    const ECHOES: [LocalEcho; 3] = [LocalEcho::Unknown, LocalEcho::Excluded, LocalEcho::Found];

    fn barriers(all: Vec<Barrier>) -> DriveBarriers {
        let mut model = Model::clone(
            vendors::catalog()
                .find("hyundai-n700")
                .expect("it is built in"),
        );
        model.barriers = all;
        DriveBarriers::new(&model)
    }

    fn fact<T>(value: T, confidence: Confidence) -> Fact<T> {
        Fact {
            value,
            confidence,
            source: String::new(),
        }
    }

    fn count(barriers: &DriveBarriers, echo: LocalEcho) -> usize {
        barriers.usable(echo, 7).count()
    }

    #[test]
    fn no_word_repeats_and_neighbours_differ_in_more_than_a_bit() {
        let mut nonces = LoopNonces::new(0xFFFF_FFF0);
        let mut words = vec![];
        for _ in 0..=u16::MAX {
            words.push(nonces.peek());
            nonces.advance();
        }
        assert_eq!(words.iter().collect::<HashSet<_>>().len(), 0x1_0000);
        let alike = words
            .windows(2)
            .filter(|pair| (pair[0] ^ pair[1]).count_ones() < 2)
            .count();
        assert!(alike < 200, "{alike}");
        assert_ne!(LoopNonces::new(1).peek(), LoopNonces::new(2).peek());
    }

    #[test]
    fn a_documented_loop_test_is_used_once_no_echo_can_be() {
        let barriers = barriers(vec![Barrier::Loop(fact((), Confidence::Manual))]);
        assert_eq!(ECHOES.map(|echo| count(&barriers, echo)), [0, 1, 0]);
        assert_eq!(
            barriers.usable(LocalEcho::Excluded, 7).next(),
            Some(Request::Loopback { data: 7 })
        );
        assert_eq!(barriers.to_try(LocalEcho::Excluded, 7), None);
    }

    #[test]
    fn what_is_not_documented_is_shown_first() {
        for barrier in [
            Barrier::Loop(fact((), Confidence::Inferred)),
            Barrier::Refused(fact(8, Confidence::Inferred)),
            Barrier::Refused(fact(8, Confidence::Manual)),
        ] {
            let mut barriers = barriers(vec![
                Barrier::Read(BarrierRead {
                    address: 1_u16.into(),
                    count: 1,
                }),
                barrier.clone(),
            ]);
            let echo = LocalEcho::Excluded;
            assert_eq!(count(&barriers, echo), 1, "{barrier:?}");
            assert_eq!(barriers.to_try(echo, 7), None, "the drive is not there yet");
            let online = MonoTime::from_millis(5);
            barriers.answered(online);
            let (place, _, since) = barriers.to_try(echo, 7).unwrap();
            assert_eq!((place, since), (1, online));
            barriers.shown(place);
            assert_eq!(
                (count(&barriers, echo), barriers.to_try(echo, 7)),
                (2, None)
            );
            barriers.port_opened();
            barriers.answered(online);
            assert_eq!(
                count(&barriers, echo),
                1,
                "on another port it is tested again"
            );
            assert!(barriers.to_try(echo, 7).is_some());
        }
    }

    #[test]
    fn a_drive_that_did_not_show_it_is_asked_again_when_it_comes_back() {
        let mut barriers = barriers(vec![Barrier::Refused(fact(8, Confidence::Inferred))]);
        let echo = LocalEcho::Found;
        let now = MonoTime::from_millis(5);
        barriers.answered(now);
        barriers.failed(0);
        barriers.answered(now);
        assert_eq!(
            (count(&barriers, echo), barriers.to_try(echo, 7)),
            (0, None)
        );
        barriers.lost();
        barriers.answered(now);
        assert!(barriers.to_try(echo, 7).is_some());
        for _ in 0..TRIES_MAX {
            assert!(barriers.to_try(echo, 7).is_some(), "damage is no silence");
            barriers.damaged(0);
        }
        assert_eq!(barriers.to_try(echo, 7), None);
    }
}
