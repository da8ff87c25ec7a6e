//! Health of a line with an open port: jammed, echoing or mute; its quality, and the suspected cause.

use super::core::LineCore;
use super::event::{LineEffect, LineWake, WakeReason};
use super::note::{DriveNote, LineNote};
use super::work::DriveWork;
use crate::domain::ids::{DriveIndex, Station};
use crate::domain::link::{EchoPolicy, Framing};
use crate::domain::report::{self, LineFault, LineState};
use crate::domain::suspicion::LineSuspicion;
use crate::domain::time::MonoTime;
use crate::line::damage::DamageWatch;
use crate::line::diagnosis::LineDiagnosis;
use crate::line::echo::LocalEcho;
use crate::line::fault::{Fault, consequence};
use crate::line::quality::QualityWatch;
use crate::line::timing::LineTiming;
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
    pub trouble: Option<LineFault>,
    pub quality: QualityWatch,
    pub diagnosis: LineDiagnosis,
    pub damage: DamageWatch,
    /// Nothing has been received for a long time.
    pub is_mute: bool,
    reopen_at: MonoTime,
    reopen_wait: Duration,
    pub probe_at: MonoTime,
    probe_wait: Duration,
    told: LastReport,
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
    pub fn new(framing: Framing, stations: impl Iterator<Item = Station> + Clone) -> Self {
        let drives = stations.clone().count();
        Self {
            trouble: None,
            quality: QualityWatch::new(drives),
            diagnosis: LineDiagnosis::new(framing, stations.clone()),
            damage: DamageWatch::new(framing, stations),
            is_mute: false,
            reopen_at: MonoTime::ZERO,
            reopen_wait: REOPEN_FIRST,
            probe_at: MonoTime::ZERO,
            probe_wait: PROBE_FIRST,
            told: LastReport {
                suspicion: None,
                line_is_suspended: false,
                drives_are_suspended: vec![false; drives],
            },
        }
    }

    pub fn port_opened(&mut self) {
        self.diagnosis.port_opened();
        self.probe_wait = PROBE_FIRST;
    }

    pub const fn is_jammed(&self) -> bool {
        matches!(self.trouble, Some(LineFault::Jammed))
    }

    /// An echoing line was read again at `now`.
    pub fn was_probed(&mut self, now: MonoTime) {
        self.probe_at = now + self.probe_wait;
        self.probe_wait = (self.probe_wait * 2).min(PROBE_MAX);
    }

    pub fn report(&self) -> report::LineQuality {
        let bad_per_cent = self.quality.line().bad_per_cent();
        report::LineQuality {
            bad_per_cent,
            is_suspended: self.quality.is_line_suspended(),
        }
    }

    pub const fn suspicion(&self) -> Option<LineSuspicion> {
        self.told.suspicion
    }
}

impl LineCore {
    /// Whether requests and commands are accepted. A mute line accepts them: its drives are silent one by one.
    pub(super) const fn takes_requests(&self) -> bool {
        self.is_open
            && !matches!(
                self.health.trouble,
                Some(LineFault::Jammed | LineFault::Echo)
            )
    }

    /// Updates the health after received bytes, and after an exchange that is `done`.
    pub(super) fn conclude(&mut self, now: MonoTime, done: Option<DoneExchange>) {
        let has_ended = done.is_some();
        let trouble = self.health.trouble;
        if let Some(done) = done {
            self.echo.ended();
            let misses_echo = self.echo.misses_echo();
            self.wire.strip_echo(self.echo.known() == LocalEcho::Found);
            if misses_echo {
                // It may be over: the next read shows whether it is.
                self.health.probe_at = now;
            }
            if done.counts {
                self.health
                    .quality
                    .take(done.drive.get(), done.fault.is_some() || misses_echo);
            }
            self.health.diagnosis.ended(done.fault, done.reply_bytes);
            self.health.damage.ended(done.fault, done.reply_bytes);
            self.tell_quality();
        }
        self.check(now);
        if has_ended || trouble != self.health.trouble {
            self.tell_suspicion();
        }
    }

    /// When the health must be checked next, whatever else happens.
    pub(super) fn health_wake(&self) -> Option<LineWake> {
        if !self.is_open || self.wire.is_busy() {
            return None;
        }
        let at = match self.health.trouble {
            Some(LineFault::Jammed) => return None,
            Some(LineFault::Mute) => self.health.reopen_at,
            _ if self.drives.are_silent() => self.wire.last_byte_at() + MUTE_AFTER,
            _ => return None,
        };
        Some(LineWake {
            at,
            reason: WakeReason::LineCheck,
        })
    }

    fn check(&mut self, now: MonoTime) {
        if !self.is_open {
            return;
        }
        let all_are_silent = || self.drives.are_silent();
        self.health.is_mute |=
            now.since(self.wire.last_byte_at()) >= MUTE_AFTER && all_are_silent();
        let echoes =
            self.echo_policy == EchoPolicy::Refuse && self.echo.known() == LocalEcho::Found;
        let trouble = if self.is_jammed(now) {
            Some(LineFault::Jammed)
        } else if echoes {
            Some(LineFault::Echo)
        } else {
            self.health.is_mute.then_some(LineFault::Mute)
        };
        if trouble != self.health.trouble {
            self.set_trouble(now, trouble);
        }
        let reopens = trouble == Some(LineFault::Mute) && consequence(Fault::Mute).reopens_port;
        if reopens && !self.wire.is_busy() && now >= self.health.reopen_at {
            self.health.reopen_at = now + self.health.reopen_wait;
            self.health.reopen_wait = (self.health.reopen_wait * 2).min(REOPEN_MAX);
            self.effects.push_back(LineEffect::Reopen(LineFault::Mute));
        }
    }

    /// Detects traffic that lasts so long that nothing can be sent. The jam is over with the first silence that is long
    /// enough for a frame.
    fn is_jammed(&self, now: MonoTime) -> bool {
        let is_silent = !self.wire.is_busy() && now >= self.wire.may_send_from();
        if self.wire.is_busy() || is_silent {
            return self.health.is_jammed() && !is_silent;
        }
        // Shorter traffic began after a silence that was not seen: the process was suspended.
        let talks = self
            .wire
            .talks_since(now)
            .map_or(Duration::ZERO, |since| now.since(since));
        let is_long = talks >= jam_after(&self.timing);
        is_long && (self.health.is_jammed() || self.work_at().is_some_and(|at| at <= now))
    }

    /// The line has become unusable, or usable again. If it is unusable, everything that waits is answered.
    fn set_trouble(&mut self, now: MonoTime, trouble: Option<LineFault>) {
        if self.health.is_jammed() {
            self.share
                .iter_mut()
                .for_each(|share| share.rule.jam_ended(now));
        }
        self.health.trouble = trouble;
        self.state = if trouble.is_some() {
            LineState::Down
        } else {
            LineState::Up
        };
        self.fault = trouble.or(self.fault);
        if !self.takes_requests() {
            self.end_waiting(now);
        }
        match trouble {
            Some(LineFault::Jammed) => self.counters.jams += 1,
            Some(LineFault::Echo) => self.health.probe_at = now,
            // Reopening gives the line up: with another gateway on it, that is worth it only now and then.
            Some(LineFault::Mute) if self.share.is_some() => {
                (self.health.reopen_at, self.health.reopen_wait) = (now + REOPEN_MAX, REOPEN_MAX);
            }
            Some(LineFault::Mute) => {
                (self.health.reopen_at, self.health.reopen_wait) = (now, REOPEN_FIRST)
            }
            _ => {}
        }
        self.drives.works_mut().for_each(DriveWork::mark_changed);
        self.effects.push_back(LineEffect::LineNote(
            trouble.map_or(LineNote::Up, LineNote::Down),
        ));
    }

    fn tell_quality(&mut self) {
        let LineHealth { quality, told, .. } = &mut self.health;
        let line_is_suspended = quality.is_line_suspended();
        if line_is_suspended != told.line_is_suspended {
            told.line_is_suspended = line_is_suspended;
            let bad_per_cent = quality.line().bad_per_cent().unwrap_or(0);
            let note = if line_is_suspended {
                LineNote::Suspended { bad_per_cent }
            } else {
                LineNote::Resumed
            };
            self.effects.push_back(LineEffect::LineNote(note));
        }
        for (place, told) in (0..).zip(&mut told.drives_are_suspended) {
            let is_suspended = quality.is_suspended(usize::from(place)) && !line_is_suspended;
            if is_suspended != *told {
                *told = is_suspended;
                let note = if is_suspended {
                    DriveNote::Suspended
                } else {
                    DriveNote::Resumed
                };
                // A state of the whole line is reported for the line.
                if !line_is_suspended {
                    self.effects
                        .push_back(LineEffect::Note(DriveIndex(place), note));
                }
            }
        }
    }

    fn tell_suspicion(&mut self) {
        let suspicion = match self.health.trouble {
            Some(LineFault::Jammed) => Some(LineSuspicion::Jam),
            Some(LineFault::Echo) => Some(LineSuspicion::Echo),
            _ => self.health.diagnosis.suspicion(),
        };
        if suspicion != self.health.told.suspicion {
            self.health.told.suspicion = suspicion;
            self.effects
                .push_back(LineEffect::LineNote(LineNote::Suspects(suspicion)));
        }
    }
}

fn jam_after(timing: &LineTiming) -> Duration {
    JAM_AFTER.max(timing.on_wire(framing::max_adu_bytes(timing.framing)) * JAM_FRAMES)
}
