//! Follows who sends on the line of a pair.

use crate::support::pair::{Pair, Sent};
use std::sync::Arc;
use vfd_gateway::domain::command::Order;
use vfd_gateway::domain::standby::LineRole;
use vfd_gateway::domain::time::MonoTime;
use vfd_gateway::drive::bases::FrequencyBases;
use vfd_gateway::drive::decode;
use vfd_gateway::profile::model::Model;

/// Who sends, in which term, and what the other one sent since.
pub struct Watch {
    model: Arc<Model>,
    bases: FrequencyBases,
    /// Frames that were looked at.
    frames: usize,
    terms: [Term; 2],
    longest: usize,
}

/// The time of one half since it took the line.
#[derive(Clone, Copy, Default)]
struct Term {
    number: u64,
    began: MonoTime,
    /// Its frames since the other one is in a later term.
    doubled: usize,
}

impl Watch {
    pub fn new(model: &Arc<Model>) -> Self {
        Self {
            model: Arc::clone(model),
            bases: FrequencyBases::of(model),
            frames: 0,
            terms: [Term::default(); 2],
            longest: 0,
        }
    }

    /// Most frames in a row that a half sent after the other one had taken the line, and while that one kept it.
    pub const fn longest(&self) -> usize {
        self.longest
    }

    /// Looks at the frames that were sent since the last call.
    pub fn look(&mut self, pair: &Pair) {
        for sent in &pair.sent[self.frames..] {
            if sent.is_of_listener() || sent.is_lost || pair.halves.len() < 2 {
                continue;
            }
            let half = sent.half;
            // A half that may not send says single stops.
            if pair.role(half) != LineRole::Active && self.is_stop(sent) {
                continue;
            }
            let report = pair.halves[half]
                .core
                .as_ref()
                .and_then(|core| core.report().standby);
            let number = report.map_or(0, |report| {
                report.take_overs + pair.halves[half].setup.first_epoch
            });
            let other_goes_on = pair.role(1 - half) == LineRole::Active;
            let other_began = self.terms[1 - half].began;
            let term = &mut self.terms[half];
            if term.number != number {
                *term = Term {
                    number,
                    began: sent.at,
                    doubled: 0,
                };
            } else if other_began > term.began && other_goes_on {
                term.doubled += 1;
                self.longest = self.longest.max(term.doubled);
            } else {
                term.doubled = 0;
            }
        }
        self.frames = pair.sent.len();
    }

    fn is_stop(&self, sent: &Sent) -> bool {
        let word = |at: usize| {
            sent.pdu
                .get(at..at + 2)
                .map(|it| u16::from_be_bytes([it[0], it[1]]))
        };
        let (Some(address), Some(function)) = (word(1), sent.pdu.first()) else {
            return false;
        };
        let values: Vec<u16> = match function {
            6 => word(3).into_iter().collect(),
            16 => sent
                .pdu
                .get(6..)
                .unwrap_or_default()
                .chunks_exact(2)
                .map(|it| u16::from_be_bytes([it[0], it[1]]))
                .collect(),
            _ => return false,
        };
        let order = decode::order_on(&self.model, &self.bases, address.into(), &values);
        matches!(order, Ok(Order::Stop { .. } | Order::Coast))
    }
}
