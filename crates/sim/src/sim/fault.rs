//! Seeded faults of replies: plans, and random draws that are identical for the same seed.

use crate::domain::link::Framing;
use crate::domain::problem::nearest;
use crate::wire::framing;
use fastrand::Rng;
use std::str::FromStr;
use std::time::Duration;

/// Probabilities of faults. Each is in per mille of all replies, 0 to 1000, and drawn independently, so that one
/// reply can have several faults.
///
/// As text: `noise=5,lost=2,late=3,cut=1,flip=2,foreign=1,hole=1,timeout-ms=200,lateness-ms=500`, in any order, every
/// part optional.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct FaultPlan {
    /// One to eight random bytes right before the reply.
    pub noise: u16,
    /// The drive obeys, but sends no reply.
    pub lost: u16,
    /// The reply arrives after [`Self::reply_timeout`] and ends at most [`Self::max_lateness`] later.
    pub late: u16,
    /// The end of the reply is missing; at least one byte arrives and at least one does not.
    pub cut: u16,
    /// One to three bits are wrong, anywhere in the reply.
    pub flip: u16,
    /// An extra valid frame: one from another station before the reply, or the reply repeated after it.
    pub foreign: u16,
    /// The adapter delivers the rest of the reply 16 ms after its beginning, like a USB chip with a full packet.
    pub hole: u16,
    /// An unsolicited burst: part of the request, of its reply or of the previous reply, at any moment after the request
    /// while the bus is idle: its beginning or end, of any length, or all of it with a byte lost or wrong.
    pub burst: u16,
    /// The reply arrives a second time, 15 to 40 ms after the first, as from another drive with the same number.
    pub twin: u16,
    /// The reply arrives later than [`Self::reply_timeout`] and [`Self::max_lateness`] together, up to twice as late.
    pub beyond: u16,
    /// The master's time-out from the end of its request, beyond which a reply is late.
    pub reply_timeout: Duration,
    /// How long after the time-out a late reply may end.
    pub max_lateness: Duration,
}

/// The names of a plan's parts in its text.
const NAMES: [&str; 12] = [
    "noise",
    "lost",
    "late",
    "cut",
    "flip",
    "foreign",
    "hole",
    "burst",
    "twin",
    "beyond",
    "timeout-ms",
    "lateness-ms",
];

/// Delay of the second reply of a [`FaultPlan::twin`] after the first, in milliseconds.
const TWIN_MS: std::ops::RangeInclusive<u64> = 15..=40;

impl FaultPlan {
    /// No faults; late replies, if enabled, arrive 200 to 700 ms after the request.
    pub const NONE: Self = Self {
        noise: 0,
        lost: 0,
        late: 0,
        cut: 0,
        flip: 0,
        foreign: 0,
        hole: 0,
        burst: 0,
        twin: 0,
        beyond: 0,
        reply_timeout: Duration::from_millis(200),
        max_lateness: Duration::from_millis(500),
    };

    /// Sets the part called `name`.
    fn set(&mut self, name: &str, value: &str) -> Result<(), PlanError> {
        let chance = match name {
            "noise" => &mut self.noise,
            "lost" => &mut self.lost,
            "late" => &mut self.late,
            "cut" => &mut self.cut,
            "flip" => &mut self.flip,
            "foreign" => &mut self.foreign,
            "hole" => &mut self.hole,
            "burst" => &mut self.burst,
            "twin" => &mut self.twin,
            "beyond" => &mut self.beyond,
            "timeout-ms" => return set_ms(&mut self.reply_timeout, name, value),
            "lateness-ms" => return set_ms(&mut self.max_lateness, name, value),
            _ => return Err(PlanError::unknown(name)),
        };
        *chance = number(name, value, 1000)?;
        Ok(())
    }
}

impl Default for FaultPlan {
    fn default() -> Self {
        Self::NONE
    }
}

impl FromStr for FaultPlan {
    type Err = PlanError;

    /// Parses a plan; an empty text is a plan without faults.
    ///
    /// # Errors
    ///
    /// An unknown name, a part without `=`, an invalid number or one that is too large.
    fn from_str(text: &str) -> Result<Self, PlanError> {
        let mut plan = Self::NONE;
        for part in text
            .split(',')
            .map(str::trim)
            .filter(|part| !part.is_empty())
        {
            let (name, value) = part
                .split_once('=')
                .ok_or_else(|| PlanError::NoValue(part.to_owned()))?;
            plan.set(name.trim(), value.trim())?;
        }
        Ok(plan)
    }
}

/// What is wrong with the text of a fault plan.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum PlanError {
    /// Unknown fault.
    #[error("unknown fault \"{name}\"{}; known faults: {}", hint(.nearest), NAMES.join(", "))]
    Unknown {
        /// The text.
        name: String,
        /// The probably intended name.
        nearest: Option<&'static str>,
    },
    /// A name without a number.
    #[error("\"{0}\" has no number: write it as noise=5, in per mille of all replies")]
    NoValue(String),
    /// Not a number of the allowed range.
    #[error("{name}={value}: a whole number from 0 to {max} is needed")]
    BadNumber {
        /// The name of the part.
        name: String,
        /// The text.
        value: String,
        /// The largest number allowed.
        max: u16,
    },
}

impl PlanError {
    fn unknown(name: &str) -> Self {
        Self::Unknown {
            name: name.to_owned(),
            nearest: nearest(name, NAMES),
        }
    }
}

/// The fate of a reply as a whole.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum ReplyFate {
    /// The reply arrives in time.
    OnTime,
    /// The reply arrives after the time-out.
    Late,
    /// The reply arrives after the maximum lateness.
    Beyond,
    /// The reply is lost.
    Lost,
}

/// A plan with its random number generator.
#[derive(Debug)]
pub(super) struct FaultGenerator {
    pub plan: FaultPlan,
    framing: Framing,
    /// Bits of a character that can be wrong.
    data_bits: usize,
    rng: Rng,
    /// Stations on the bus. A valid frame in the name of one could not be distinguished from its own.
    stations: Vec<u8>,
    /// The previous reply.
    before: Vec<u8>,
}

impl FaultGenerator {
    pub fn new(plan: FaultPlan, framing: Framing, data_bits: u8, seed: u64) -> Self {
        Self {
            plan,
            framing,
            data_bits: data_bits.into(),
            rng: Rng::with_seed(seed),
            stations: Vec::new(),
            before: Vec::new(),
        }
    }

    /// `station` is on the bus.
    pub fn connect(&mut self, station: u8) {
        self.stations.push(station);
    }

    /// Draws the faults of one whole `reply` frame and applies them. The second value is the byte from which on it is
    /// delivered late, if any.
    pub fn spoil(&mut self, reply: &mut Vec<u8>) -> (ReplyFate, usize) {
        if self.hits(self.plan.lost) {
            return (ReplyFate::Lost, usize::MAX);
        }
        let late = self.hits(self.plan.late);
        let beyond = self.hits(self.plan.beyond);
        let foreign = self.hits(self.plan.foreign).then(|| reply.clone());
        if self.hits(self.plan.flip) {
            self.flip(reply);
        }
        if self.hits(self.plan.cut) {
            reply.truncate(self.rng.usize(1..reply.len().max(2)));
        }
        let first = reply.len();
        if let Some(copy) = foreign {
            self.add_frame(reply, copy);
        }
        let whole = reply.len();
        if self.hits(self.plan.noise) {
            let noise = self.rng.usize(1..=8);
            let unused_bits = 8_usize.saturating_sub(self.data_bits);
            reply.splice(
                0..0,
                std::iter::repeat_with(|| self.rng.u8(..) >> unused_bits).take(noise),
            );
        }
        let hole = if self.hits(self.plan.hole) {
            self.rng.usize(1..reply.len().max(2))
        } else {
            usize::MAX
        };
        // A second frame that arrives as a whole after a hole is a late reply to an answered request: it cannot be
        // distinguished from the reply to the next one. In reality, a listener hears that something follows the first.
        let second = reply.len() - whole + first;
        let hole = if hole == second && whole > first {
            hole + 1
        } else {
            hole
        };
        let fate = match (late, beyond) {
            (_, true) => ReplyFate::Beyond,
            (true, false) => ReplyFate::Late,
            (false, false) => ReplyFate::OnTime,
        };
        (fate, hole)
    }

    /// Draws the burst beside the `reply` to `request`, and its time after the end of the request; `None` without a
    /// burst. `right_time`: when the reply begins.
    pub fn burst(
        &mut self,
        request: &[u8],
        reply: &[u8],
        right_time: Duration,
        time: impl Fn(usize) -> Duration,
    ) -> Option<(Duration, Vec<u8>)> {
        let is_hit = self.hits(self.plan.burst);
        let before = if self.plan.burst > 0 {
            std::mem::replace(&mut self.before, reply.to_vec())
        } else {
            Vec::new()
        };
        if !is_hit {
            return None;
        }
        // A whole write equals its reply.
        let is_read = framing::decode(self.framing, request)
            .is_some_and(|(_, pdu)| pdu.first() == Some(&0x03));
        let (whole, may_be_whole) = match self.rng.u8(0..4) {
            0 => (before.as_slice(), false),
            1 => (request, is_read),
            _ => (reply, false),
        };
        let mut bytes = self.part_of(whole, may_be_whole);
        if bytes.is_empty() || (!may_be_whole && framing::decode(self.framing, &bytes).is_some()) {
            return None;
        }
        let window = self.plan.reply_timeout + Duration::from_millis(50);
        let after = match self.rng.u8(0..4) {
            // Right after the request, as an echo, or right before the reply.
            0 => Duration::from_micros(self.rng.u64(0..3_000)),
            1 => {
                let room = (0..=bytes.len())
                    .rev()
                    .find(|count| time(*count) <= right_time)
                    .unwrap_or_default();
                bytes.drain(..bytes.len() - room);
                right_time - time(bytes.len())
            }
            _ => Duration::from_nanos(
                self.rng
                    .u64(0..u64::try_from(window.as_nanos()).unwrap_or(u64::MAX)),
            ),
        };
        Some((after, bytes))
    }

    /// The beginning or the end of `whole`, of any length, or all of it with a byte lost or wrong.
    fn part_of(&mut self, whole: &[u8], may_be_whole: bool) -> Vec<u8> {
        let most = whole.len() + usize::from(may_be_whole);
        if most < 2 {
            return Vec::new();
        }
        let length = self.rng.usize(1..most);
        let at = self.rng.usize(0..whole.len());
        let mut bytes = whole.to_vec();
        match self.rng.u8(0..5) {
            0 | 1 => bytes.truncate(length),
            2 => _ = bytes.drain(..whole.len() - length),
            3 => _ = bytes.remove(at),
            _ => bytes[at] ^= 1 << self.rng.usize(0..self.data_bits),
        }
        bytes
    }

    /// Draws the delay of the second reply from two drives with the same number, if there are two.
    pub fn twin(&mut self) -> Option<Duration> {
        self.hits(self.plan.twin)
            .then(|| Duration::from_millis(self.rng.u64(TWIN_MS)))
    }

    /// Draws the start of a reply beyond the maximum lateness, from the end of its request.
    pub fn beyond_start(&mut self) -> Duration {
        let limit = self.plan.reply_timeout + self.plan.max_lateness;
        limit
            + Duration::from_nanos(
                self.rng
                    .u64(1_000_000..u64::try_from(limit.as_nanos()).unwrap_or(u64::MAX)),
            )
    }

    /// Draws the start of a late reply, from the end of its request, so that a frame that takes `frame` still ends
    /// within the plan's lateness.
    pub fn late_start(&mut self, frame: Duration) -> Duration {
        let room = self.plan.max_lateness.saturating_sub(frame);
        let nanos = u64::try_from(room.as_nanos()).unwrap_or(u64::MAX);
        self.plan.reply_timeout + Duration::from_nanos(self.rng.u64(0..=nanos))
    }

    /// Draws whether a drive that still has a late reply to send ignores a new request.
    pub fn ignores_new_request(&mut self) -> bool {
        self.rng.bool()
    }

    /// A plan without faults draws no random numbers, so that it costs nothing.
    fn hits(&mut self, per_mille: u16) -> bool {
        per_mille > 0 && self.rng.u16(0..1000) < per_mille
    }

    /// Flips one to three different bits.
    fn flip(&mut self, reply: &mut [u8]) {
        let mut turned = [usize::MAX; 3];
        for n in 0..self.rng.usize(1..=3) {
            let bit = self.rng.usize(0..reply.len() * self.data_bits);
            if !turned.contains(&bit) {
                turned[n] = bit;
                reply[bit / self.data_bits] ^= 1 << (bit % self.data_bits);
            }
        }
    }

    fn add_frame(&mut self, reply: &mut Vec<u8>, mut copy: Vec<u8>) {
        if self.rng.bool() {
            reply.append(&mut copy);
        } else if let Some((_, pdu)) = framing::decode(self.framing, &copy) {
            let station = other_station(&self.stations, self.rng.u8(1..=247));
            let mut foreign = Vec::with_capacity(copy.len());
            framing::encode(self.framing, &mut foreign, station, |out| {
                out.extend_from_slice(&pdu)
            });
            reply.splice(0..0, foreign);
        }
    }
}

/// `drawn`, or the next one that is not among `taken`. All are 1 to 247.
fn other_station(taken: &[u8], drawn: u8) -> u8 {
    let all = (drawn..=247).chain(1..drawn);
    all.into_iter()
        .find(|station| !taken.contains(station))
        .unwrap_or(drawn)
}

fn number(name: &str, value: &str, max: u16) -> Result<u16, PlanError> {
    match value.parse() {
        Ok(number) if number <= max => Ok(number),
        _ => Err(PlanError::BadNumber {
            name: name.to_owned(),
            value: value.to_owned(),
            max,
        }),
    }
}

fn set_ms(span: &mut Duration, name: &str, value: &str) -> Result<(), PlanError> {
    *span = Duration::from_millis(number(name, value, u16::MAX)?.into());
    Ok(())
}

fn hint(nearest: &Option<&'static str>) -> String {
    nearest
        .map(|name| format!(" (did you mean \"{name}\"?)"))
        .unwrap_or_default()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::wire::crc;

    /// Reply to a read of one word: station 1, 60.00 Hz.
    const REPLY: [u8; 7] = [0x01, 0x03, 0x02, 0x17, 0x70, 0xB6, 0x50];

    fn spoiled(plan: &str, seed: u64) -> (ReplyFate, Vec<u8>) {
        let mut reply = REPLY.to_vec();
        let (fate, _) = faults(plan, seed).spoil(&mut reply);
        (fate, reply)
    }

    fn faults(plan: &str, seed: u64) -> FaultGenerator {
        let mut faults = FaultGenerator::new(plan.parse().unwrap(), Framing::Rtu, 8, seed);
        faults.connect(REPLY[0]);
        faults
    }

    #[test]
    fn plans_are_read_from_text() {
        let plan: FaultPlan = "noise=5,lost=2, late=3 ,cut=1,flip=2".parse().unwrap();
        assert_eq!(
            plan,
            FaultPlan {
                noise: 5,
                lost: 2,
                late: 3,
                cut: 1,
                flip: 2,
                ..FaultPlan::NONE
            }
        );
        let plan: FaultPlan = "foreign=1000,timeout-ms=100,lateness-ms=1500"
            .parse()
            .unwrap();
        assert_eq!(plan.foreign, 1000);
        assert_eq!(plan.reply_timeout, Duration::from_millis(100));
        assert_eq!(plan.max_lateness, Duration::from_millis(1500));
        assert_eq!("".parse(), Ok(FaultPlan::NONE));
    }

    #[test]
    fn mistakes_in_a_plan_are_explained() {
        let message = |text: &str| text.parse::<FaultPlan>().unwrap_err().to_string();
        assert_eq!(
            message("nose=5"),
            "unknown fault \"nose\" (did you mean \"noise\"?); known faults: noise, lost, late, cut, flip, \
             foreign, hole, burst, twin, beyond, timeout-ms, lateness-ms"
        );
        assert!(
            message("earthquake=1")
                .starts_with("unknown fault \"earthquake\"; known faults: noise")
        );
        assert!(message("noise").contains("noise=5"));
        assert_eq!(
            message("lost=1001"),
            "lost=1001: a whole number from 0 to 1000 is needed"
        );
        assert_eq!(
            message("lost=-1"),
            "lost=-1: a whole number from 0 to 1000 is needed"
        );
    }

    #[test]
    fn each_fault_does_what_it_says() {
        for seed in 0..500 {
            assert_eq!(spoiled("lost=1000", seed).0, ReplyFate::Lost);
            assert_eq!(
                spoiled("late=1000", seed),
                (ReplyFate::Late, REPLY.to_vec())
            );
            assert_eq!(spoiled("", seed), (ReplyFate::OnTime, REPLY.to_vec()));

            let (_, noisy) = spoiled("noise=1000", seed);
            assert!(noisy.ends_with(&REPLY) && (8..=15).contains(&noisy.len()));
            let (_, cut) = spoiled("cut=1000", seed);
            assert!(REPLY.starts_with(&cut) && (1..7).contains(&cut.len()));
            let (_, flipped) = spoiled("flip=1000", seed);
            let wrong: u32 = flipped
                .iter()
                .zip(REPLY)
                .map(|(is, was)| (is ^ was).count_ones())
                .sum();
            assert!((1..=3).contains(&wrong) && !crc::is_sound(&flipped));
        }
    }

    #[test]
    fn a_frame_too_many_is_sound_and_foreign_or_a_copy() {
        let mut copies = 0;
        for seed in 0..500 {
            let (_, both) = spoiled("foreign=1000", seed);
            let (first, second) = both.split_at(7);
            assert!(crc::is_sound(first) && second == REPLY);
            copies += usize::from(first[0] == 1);
        }
        assert!((150..350).contains(&copies), "{copies}");
    }

    #[test]
    fn a_hole_never_hides_that_a_second_frame_follows() {
        let holes = (0..500).map(|seed| {
            let mut reply = REPLY.to_vec();
            faults("foreign=1000,hole=1000", seed).spoil(&mut reply).1
        });
        let behind: Vec<usize> = holes.collect();
        assert!(!behind.contains(&7) && behind.contains(&6) && behind.contains(&8));
    }

    #[test]
    fn text_is_spoilt_within_its_seven_bits() {
        let reply = b":010302177073\r\n";
        let spoilt = |plan: &str, seed| {
            let mut text = reply.to_vec();
            FaultGenerator::new(plan.parse().unwrap(), Framing::Ascii, 7, seed).spoil(&mut text);
            text
        };
        for seed in 0..500 {
            assert!(spoilt("noise=1000,flip=1000,cut=1000", seed).is_ascii());
            assert!(spoilt("noise=1000", seed).ends_with(reply));
            assert_ne!(spoilt("flip=1000", seed), reply);
            let both = spoilt("foreign=1000", seed);
            let (first, second) = both.split_at(reply.len());
            assert!(framing::decode(Framing::Ascii, first).is_some() && second == reply);
        }
    }

    #[test]
    fn a_burst_is_a_part_of_what_is_said_and_never_a_reply() {
        const REQUEST: [u8; 8] = [0x01, 0x03, 0x01, 0x01, 0x00, 0x01, 0xD4, 0x36];
        let time = |bytes: usize| Duration::from_millis(bytes as u64);
        let mut faults = faults("burst=1000", 3);
        let mut shaped = 0;
        let mut before_the_reply = 0;
        for _ in 0..5_000 {
            let Some((after, bytes)) =
                faults.burst(&REQUEST, &REPLY, Duration::from_millis(5), time)
            else {
                continue;
            };
            assert!(!bytes.is_empty() || after == Duration::from_millis(5));
            assert!(bytes == REQUEST || !crc::is_sound(&bytes), "{bytes:02X?}");
            shaped += usize::from(bytes.len() == 7 && bytes.starts_with(&[1, 3]));
            before_the_reply += usize::from(after + time(bytes.len()) == Duration::from_millis(5));
        }
        assert!(
            shaped > 300 && before_the_reply > 800,
            "{shaped} {before_the_reply}"
        );
    }

    #[test]
    fn a_reply_beyond_the_limit_is_later_than_any_late_one() {
        let mut faults = faults("timeout-ms=100,lateness-ms=50", 7);
        for _ in 0..1000 {
            let start = faults.beyond_start();
            assert!((Duration::from_millis(151)..=Duration::from_millis(300)).contains(&start));
        }
    }

    #[test]
    fn a_late_reply_ends_within_its_lateness() {
        let mut faults = faults("timeout-ms=100,lateness-ms=50", 7);
        for _ in 0..1000 {
            let start = faults.late_start(Duration::from_millis(20));
            assert!((Duration::from_millis(100)..=Duration::from_millis(130)).contains(&start));
        }
    }

    #[test]
    fn chances_are_per_mille() {
        let mut faults = faults("lost=20", 1);
        let lost = (0..100_000)
            .filter(|_| faults.spoil(&mut REPLY.to_vec()).0 == ReplyFate::Lost)
            .count();
        assert!((1_800..2_200).contains(&lost), "{lost}");
    }
}
