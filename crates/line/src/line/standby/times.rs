//! The times of the rule on one line: what is safe there, and how they differ by rank.

use crate::line::timing::LineTiming;
use crate::wire::framing;
use std::time::Duration;

/// How long the active gateway may leave the line silent before it sends a signal for its own sake.
pub const SIGNAL_AFTER: Duration = Duration::from_millis(500);
/// How much later each rank takes a line over than the one before it.
pub const RANK_STEP: Duration = Duration::from_millis(500);
/// How much sooner each rank sends again than the one before it.
const SIGNAL_STEP: Duration = Duration::from_millis(35);
/// How much later each rank accepts a line that is handed over than the one before it: the first frame of that one must
/// be heard before the next rank has its turn.
const ACCEPT_STEP: Duration = Duration::from_millis(200);
/// How much later each rank answers a question.
const ANSWER_STEP: Duration = Duration::from_millis(30);
/// Longest random wait before a line that two gateways gave up is taken again.
pub(super) const TIE_BREAK: Duration = Duration::from_millis(500);
/// Longest random wait before the line is taken again after a jam, during which no gateway sent: shorter than the step
/// between two ranks.
pub(super) const JAM_BREAK: Duration = Duration::from_millis(250);
/// How long a gateway sends without a sound reply before it falls silent: its receiver may be dead.
pub(super) const DEAF_AFTER: Duration = Duration::from_secs(3);
/// How long a gateway whose receiver may be dead waits at least, in silences for a take-over.
pub(super) const DEAF_WAITS: u32 = 4;
/// How often the active gateway says that it is active, whatever else it sends.
pub const ROLE_SAID_EVERY: Duration = Duration::from_secs(4);
/// A gateway that begins to listen, or missed something, has heard the one that is active say so by then.
pub const SIGNALS_WITHIN: Duration = Duration::from_secs(6);
/// How many times in a row one waits for [`CONTEND_WAIT`], if what comes is damaged. Silence is more often that of a drive that is
/// off: then it waits once.
pub(super) const CONTEND_MAX: u8 = 3;
/// How often a listener looks at a silent line.
pub(super) const LOOK_EVERY: Duration = Duration::from_millis(200);
/// A listener that did not look for longer was suspended, perhaps with its whole host: it may have missed what was sent.
pub(super) const LOOK_MAX: Duration = Duration::from_millis(400);
/// Longest random wait before the next frame, if no drive has answered since the line was taken over.
pub(super) const CONTEND_WAIT: Duration = Duration::from_millis(250);
/// The least of [`StandbyTimes::silent_at_most`].
const SILENT_AT_LEAST: Duration = Duration::from_millis(1500);
/// The least of [`StandbyTimes::take_over_after`] at rank 0.
const TAKE_OVER_AT_LEAST: Duration = Duration::from_millis(2500);
/// How much longer than its longest exchange the active gateway may be silent: time in which it is not scheduled.
const SLACK: Duration = Duration::from_millis(500);
/// How long an adapter may hold received bytes back: the longest latency timer of common USB adapters.
const HELD_BACK: Duration = Duration::from_millis(255);
/// How long handing a frame to the port may take. One that took longer was sent late: another gateway may have taken
/// the line over in between.
pub(super) const HAND_OVER_MAX: Duration = Duration::from_millis(250);
/// Two clocks differ by at most one part in this many.
const DRIFT: u32 = 50;

/// The times of the rule on one line.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct StandbyTimes {
    /// Longest time since its last frame within which the active gateway may send another.
    pub silent_at_most: Duration,
    /// Silence after which this gateway takes the line over, with its rank.
    pub take_over_after: Duration,
    /// How soon it takes over a line that is handed over, by its rank.
    pub accept_after: Duration,
    /// How soon it answers when the active gateway asks who listens, by its rank: who hears another answer gives none. Its stops
    /// wait as long for one of a lower rank.
    pub answer_after: Duration,
    /// How long it leaves the line silent while it is active, at most [`SIGNAL_AFTER`]. It differs by rank, so that two
    /// that are active do not stay in step, where neither hears the other.
    pub signal_after: Duration,
}

impl StandbyTimes {
    /// The shortest safe times at rank 0 on a line with this `timing`, where no exchange lasts longer than
    /// `longest_exchange`.
    #[must_use]
    pub fn shortest(timing: &LineTiming, longest_exchange: Duration) -> Self {
        let silent_at_most = SILENT_AT_LEAST.max(longest_exchange.max(SIGNAL_AFTER) + SLACK);
        let frame = timing.on_wire(framing::max_adu_bytes(timing.framing));
        let needed = silent_at_most + silent_at_most / DRIFT + HAND_OVER_MAX + frame + HELD_BACK;
        let take_over_after = TAKE_OVER_AT_LEAST.max(needed);
        let (accept_after, answer_after) = (Duration::ZERO, Duration::ZERO);
        Self {
            silent_at_most,
            take_over_after,
            accept_after,
            answer_after,
            signal_after: SIGNAL_AFTER,
        }
    }

    /// These times with a longer silence, if `take_over_after` is longer, and at `rank`.
    #[must_use]
    pub fn with(self, take_over_after: Option<Duration>, rank: u8) -> Self {
        let silence = take_over_after
            .unwrap_or_default()
            .max(self.take_over_after);
        let rank = u32::from(rank);
        Self {
            take_over_after: silence + RANK_STEP * rank,
            accept_after: ACCEPT_STEP * rank,
            answer_after: ANSWER_STEP * rank,
            signal_after: SIGNAL_AFTER.saturating_sub(SIGNAL_STEP * rank),
            ..self
        }
    }

    /// Longest additional wait after a take-over, if the first drive that is asked is silent.
    #[must_use]
    pub const fn waits_after_silence() -> Duration {
        CONTEND_WAIT
    }

    /// How long one that has left the line to another gateway is silent between its stops, so that the other one takes it.
    #[must_use]
    pub fn room(&self) -> Duration {
        self.take_over_after + RANK_STEP * 2 + TIE_BREAK
    }

    /// Longest time from the last frame of an active gateway to the first frame of this one, on a line that is not
    /// noisy.
    #[must_use]
    pub fn worst_take_over(&self) -> Duration {
        self.take_over_after + TIE_BREAK
    }
}

/// A random time up to `longest`.
pub(in crate::line) fn random(seed: &mut u64, longest: Duration) -> Duration {
    // SplitMix64.
    *seed = seed.wrapping_add(0x9E37_79B9_7F4A_7C15);
    let mixed = (*seed ^ (*seed >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
    let mixed = (mixed ^ (mixed >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
    let thousandths = u32::try_from((mixed >> 33) % 1001).unwrap_or(0);
    longest * thousandths / 1000
}
