//! Health of a line with an open port: jammed, echoing or mute; its quality, and the suspected cause.

use super::drive::LineDrives;
use super::event::LineEffect;
use super::note::{DriveNote, LineNote};
use super::outbox::EffectOutbox;
use super::setup::LineSetup;
use crate::domain::counts::DamageCounts;
use crate::domain::ids::DriveIndex;
use crate::domain::link::EchoPolicy;
use crate::domain::report::{self, LineFault};
use crate::domain::suspicion::LineSuspicion;
use crate::domain::time::MonoTime;
use crate::domain::traffic::{HeardFrame, TrafficKind};
use crate::line::damage::DamageWatch;
use crate::line::diagnosis::LineDiagnosis;
use crate::line::echo::LocalEcho;
use crate::line::fault::{Fault, consequence};
use crate::line::quality::{ExchangeQuality, QualityWatch};
use crate::line::station::StrayFrame;
use crate::line::timing::LineTiming;
use crate::line::transaction::LineWire;
use crate::wire::framing;
use std::time::Duration;

/// Minimum time of uninterrupted traffic, while something waits, before the line counts as jammed: at any usual speed a
/// single frame of a drive is over by then.
const JAM_AFTER: Duration = Duration::from_millis(500);
/// Minimum time of uninterrupted traffic before the line counts as jammed, in maximum-length frames, for slow lines:
/// another master's request and its reply.
const JAM_FRAMES: u32 = 2;
/// Complete silence after which the line counts as mute: by then each drive has been probed several times.
const MUTE_AFTER: Duration = Duration::from_secs(10);
/// First wait before a mute port is reopened again; doubled up to the maximum.
const REOPEN_FIRST: Duration = Duration::from_secs(10);
/// Maximum wait before a mute port is reopened again: drives that are switched off overnight must not fill the log.
const REOPEN_MAX: Duration = Duration::from_secs(300);
/// First wait before an echoing line is read again; doubled up to the maximum.
const PROBE_FIRST: Duration = Duration::from_secs(1);
/// Maximum wait before an echoing line is read again.
const PROBE_MAX: Duration = Duration::from_secs(30);

/// What is known about a line apart from its state.
#[derive(Debug)]
pub(super) struct LineHealth {
    /// Why no request can be sent although the port is open.
    trouble: Option<LineFault>,
    quality: QualityWatch,
    diagnosis: LineDiagnosis,
    damage: DamageWatch,
    /// Nothing has been received for a long time.
    is_mute: bool,
    echo_policy: EchoPolicy,
    reopen_at: MonoTime,
    reopen_wait: Duration,
    probe_at: MonoTime,
    probe_wait: Duration,
    reported: LastReport,
}

/// The suspicion that was last logged.
#[derive(Debug)]
struct LastReport {
    suspicion: Option<LineSuspicion>,
    line_is_suspended: bool,
    drives_are_suspended: Vec<bool>,
}

/// An exchange that is over.
pub(super) struct DoneExchange {
    pub drive: DriveIndex,
    /// What went wrong.
    pub fault: Option<Fault>,
    /// Whether it counts towards the quality of the line.
    pub counts: bool,
    pub reply_bytes: usize,
}

impl LineHealth {
    pub fn new(setup: &LineSetup) -> Self {
        let framing = setup.timing.framing;
        let drives = setup.drives.len();
        let stations = || setup.drives.iter().map(|drive| drive.station);
        Self {
            trouble: None,
            quality: QualityWatch::new(drives),
            diagnosis: LineDiagnosis::new(framing, stations()),
            damage: DamageWatch::new(framing, stations()),
            is_mute: false,
            echo_policy: setup.echo,
            reopen_at: MonoTime::ZERO,
            reopen_wait: REOPEN_FIRST,
            probe_at: MonoTime::ZERO,
            probe_wait: PROBE_FIRST,
            reported: LastReport {
                suspicion: None,
                line_is_suspended: false,
                drives_are_suspended: vec![false; drives],
            },
        }
    }

    /// Why the line cannot be used although the port is open.
    pub const fn trouble(&self) -> Option<LineFault> {
        self.trouble
    }

    pub const fn is_jammed(&self) -> bool {
        matches!(self.trouble, Some(LineFault::Jammed))
    }

    pub const fn echoes(&self) -> bool {
        matches!(self.trouble, Some(LineFault::Echo))
    }

    /// Whether requests can be sent over an open port. A mute line carries them: its drives are silent one by one.
    pub const fn carries_requests(&self) -> bool {
        !self.is_jammed() && !self.echoes()
    }

    /// Too many exchanges with the drive at `place` fail.
    pub fn is_suspended(&self, place: usize) -> bool {
        self.quality.is_suspended(place)
    }

    pub fn bad_per_cent(&self, place: usize) -> Option<u8> {
        self.quality
            .station(place)
            .and_then(ExchangeQuality::bad_per_cent)
    }

    pub fn damage_of(&self, place: usize) -> DamageCounts {
        self.damage.of(place)
    }

    /// Bytes between frames that form none.
    pub const fn noise_between(&self) -> u64 {
        self.damage.between()
    }

    pub fn report(&self) -> report::LineQuality {
        let bad_per_cent = self.quality.line().bad_per_cent();
        report::LineQuality {
            bad_per_cent,
            is_suspended: self.quality.is_line_suspended(),
        }
    }

    pub const fn suspicion(&self) -> Option<LineSuspicion> {
        self.reported.suspicion
    }

    /// The port was opened. A mute line stays mute until something is received: an open port proves nothing.
    pub fn port_opened(&mut self) {
        self.trouble = self.is_mute.then_some(LineFault::Mute);
        self.diagnosis.port_opened();
        self.probe_wait = PROBE_FIRST;
    }

    /// The port was closed, because of `fault`.
    pub fn port_gone(&mut self, fault: LineFault) {
        self.trouble = None;
        self.is_mute &= fault == LineFault::Mute;
    }

    /// Something was received.
    pub const fn received(&mut self) {
        self.is_mute = false;
    }

    /// A request was sent to the drive at `place`.
    pub fn sent(&mut self, place: usize, function: u8) {
        self.diagnosis.sent(place);
        self.damage.sent(place, function);
    }

    pub fn heard(&mut self, kind: TrafficKind, bytes: &[u8]) {
        self.diagnosis.heard(kind, bytes);
        self.damage.heard(kind, bytes);
    }

    /// A frame of the drive at `place` answers no request.
    pub fn stray(&mut self, place: usize, stray: StrayFrame) {
        self.diagnosis.stray(place, stray);
        self.damage.stray(place, stray);
    }

    /// The drive at `place` answers `request` in its own way.
    pub fn wrong_reply(&mut self, place: usize, request: HeardFrame, reply: HeardFrame) {
        self.diagnosis.wrong_reply(place, request, reply);
    }

    /// An exchange is `done`, in which an echo that was known was missed or not.
    pub fn exchange_ended(
        &mut self,
        now: MonoTime,
        done: &DoneExchange,
        misses_echo: bool,
        effects: &mut EffectOutbox,
    ) {
        if misses_echo {
            // It may be over: the next read shows whether it is.
            self.probe_at = now;
        }
        if done.counts {
            self.quality
                .take(done.drive.get(), done.fault.is_some() || misses_echo);
        }
        self.diagnosis.ended(done.fault, done.reply_bytes);
        self.damage.ended(done.fault, done.reply_bytes);
        self.tell_quality(effects);
    }

    /// From when on an echoing line is read again.
    pub const fn probe_at(&self) -> MonoTime {
        self.probe_at
    }

    /// Whether an echoing line is read again at `now`; if so, the next time is later.
    pub fn takes_probe(&mut self, now: MonoTime) -> bool {
        let is_due = now >= self.probe_at;
        if is_due {
            self.probe_at = now + self.probe_wait;
            self.probe_wait = (self.probe_wait * 2).min(PROBE_MAX);
        }
        is_due
    }

    /// Whether a mute port is reopened at `now`; if so, the next time is later.
    pub fn takes_reopening(&mut self, now: MonoTime) -> bool {
        let reopens =
            self.trouble == Some(LineFault::Mute) && consequence(Fault::Mute).reopens_port;
        if !reopens || now < self.reopen_at {
            return false;
        }
        self.reopen_at = now + self.reopen_wait;
        self.reopen_wait = (self.reopen_wait * 2).min(REOPEN_MAX);
        true
    }

    /// When the health must be checked next, whatever else happens.
    pub fn next_check(&self, wire: &LineWire, drives: &LineDrives) -> Option<MonoTime> {
        match self.trouble {
            Some(LineFault::Jammed) => None,
            Some(LineFault::Mute) => Some(self.reopen_at),
            _ if drives.are_silent() => Some(wire.last_byte_at() + MUTE_AFTER),
            _ => None,
        }
    }

    /// The trouble at `now` of a line that `is_jammed` or not.
    pub fn found(
        &mut self,
        now: MonoTime,
        is_jammed: bool,
        echo: LocalEcho,
        wire: &LineWire,
        drives: &LineDrives,
    ) -> Option<LineFault> {
        self.is_mute |= now.since(wire.last_byte_at()) >= MUTE_AFTER && drives.are_silent();
        if is_jammed {
            Some(LineFault::Jammed)
        } else if self.echo_policy == EchoPolicy::Refuse && echo == LocalEcho::Found {
            Some(LineFault::Echo)
        } else {
            self.is_mute.then_some(LineFault::Mute)
        }
    }

    /// The trouble is another one from now on.
    pub fn set_trouble(&mut self, now: MonoTime, trouble: Option<LineFault>, is_shared: bool) {
        self.trouble = trouble;
        match trouble {
            Some(LineFault::Echo) => self.probe_at = now,
            // Reopening gives the line up: with another gateway on it, that is worth it only now and then.
            Some(LineFault::Mute) if is_shared => {
                (self.reopen_at, self.reopen_wait) = (now + REOPEN_MAX, REOPEN_MAX);
            }
            Some(LineFault::Mute) => (self.reopen_at, self.reopen_wait) = (now, REOPEN_FIRST),
            _ => {}
        }
    }

    fn tell_quality(&mut self, effects: &mut EffectOutbox) {
        let Self {
            quality, reported, ..
        } = self;
        let line_is_suspended = quality.is_line_suspended();
        if line_is_suspended != reported.line_is_suspended {
            reported.line_is_suspended = line_is_suspended;
            let bad_per_cent = quality.line().bad_per_cent().unwrap_or(0);
            let note = if line_is_suspended {
                LineNote::Suspended { bad_per_cent }
            } else {
                LineNote::Resumed
            };
            effects.push_back(LineEffect::LineNote(note));
        }
        for (place, was_suspended) in (0..).zip(&mut reported.drives_are_suspended) {
            let is_suspended = quality.is_suspended(usize::from(place)) && !line_is_suspended;
            if is_suspended != *was_suspended {
                *was_suspended = is_suspended;
                let note = if is_suspended {
                    DriveNote::Suspended
                } else {
                    DriveNote::Resumed
                };
                // A state of the whole line is reported for the line.
                if !line_is_suspended {
                    effects.push_back(LineEffect::Note(DriveIndex(place), note));
                }
            }
        }
    }

    /// Tells of a suspicion that has changed.
    pub fn tell_suspicion(&mut self, effects: &mut EffectOutbox) {
        let suspicion = match self.trouble {
            Some(LineFault::Jammed) => Some(LineSuspicion::Jam),
            Some(LineFault::Echo) => Some(LineSuspicion::Echo),
            _ => self.diagnosis.suspicion(),
        };
        if suspicion != self.reported.suspicion {
            self.reported.suspicion = suspicion;
            effects.push_back(LineEffect::LineNote(LineNote::Suspects(suspicion)));
        }
    }
}

/// How long traffic lasts on a line that is jammed.
pub(super) fn jam_after(timing: &LineTiming) -> Duration {
    JAM_AFTER.max(timing.on_wire(framing::max_adu_bytes(timing.framing)) * JAM_FRAMES)
}
