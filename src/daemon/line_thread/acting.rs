//! Passes messages of the north sides to the core, and executes the core's effects.

use super::{ENDING_MAX, LineTask};
use crate::daemon::exchange::answers::LineNews;
use crate::daemon::exchange::inbox::LineMessage;
use crate::daemon::host::clock;
use crate::daemon::port::OpenPort;
use crate::domain::ids::DriveIndex;
use crate::drive::snapshot::DrivePresence;
use crate::drive::view::{TripEvent, TripEventKind};
use crate::gateway::{LineEffect, LineInput};
use std::io;

/// What follows from a stop without effect.
const MAY_RUN: &str = "the motor may still run, go to the drive";

impl LineTask<'_> {
    /// Passes all waiting messages to the core.
    pub(super) fn take_messages(&mut self) {
        self.board.count_round();
        self.board.inbox().take(&mut self.round);
        let now = clock::now();
        let is_watched = self.board.is_watched(now);
        self.core.tell_traffic(self.logs_traffic || is_watched);
        for message in self.round.drain(..) {
            self.board.note(&message);
            let input = match message {
                LineMessage::Native(request) | LineMessage::NativeStop(request) => {
                    LineInput::Native(request)
                }
                LineMessage::Command(command) => LineInput::Command(command),
                LineMessage::AskerGone(asker) => LineInput::AskerGone(asker),
                LineMessage::PathAlive(owner) => LineInput::PathAlive(owner),
                LineMessage::ResetUsage(drive, owner) => LineInput::ResetUsage(drive, owner),
                LineMessage::ConfirmStandstill(drive, owner) => {
                    LineInput::ConfirmStandstill(drive, owner)
                }
                LineMessage::PathOpened(owner) => LineInput::PathOpened(owner),
                LineMessage::Shutdown => {
                    self.ending = Some(now + ENDING_MAX);
                    LineInput::Shutdown
                }
                LineMessage::Hurry => {
                    self.is_hurried = true;
                    continue;
                }
                LineMessage::Leave { stops, tell } => {
                    self.core.handle(now, LineInput::Leave { stops });
                    if stops {
                        self.leaving = Some(tell);
                    } else {
                        // If the requester is gone, it sends `Stay`.
                        let _ = tell.send(self.core.in_use().collect());
                    }
                    continue;
                }
                LineMessage::Stay => {
                    self.leaving = None;
                    LineInput::Stay
                }
                LineMessage::Yield => LineInput::Yield,
                LineMessage::Kept(row) => LineInput::Kept(row),
            };
            self.core.handle(now, input);
        }
    }

    /// Reports, if requested, that no drive is in use any more.
    fn tell_of_leaving(&mut self) {
        if self.leaving.is_some() && self.core.bound().next().is_none() {
            // If the requester is gone, it sends `Stay`.
            let _ = self.leaving.take().map(|tell| tell.send(Vec::new()));
        }
    }

    /// Executes the core's effects.
    pub(super) fn act(&mut self, mut device: Option<&mut OpenPort>) -> io::Result<()> {
        while let Some(effect) = self.core.next_effect() {
            match effect {
                LineEffect::Transmit(frame) => {
                    if let Some(device) = &mut device {
                        self.transmit(device, &frame)?;
                    }
                }
                LineEffect::Reopen(fault) => self.to_reopen = Some(fault),
                LineEffect::Answer(answer) => self.board.tell(LineNews::Native(answer)),
                LineEffect::Command(answer) => self.board.tell(LineNews::Command(answer)),
                LineEffect::Trip(drive, event) => {
                    self.log_trip(drive, &event);
                    self.board.tell_trip(drive, event);
                }
                LineEffect::Keep(keep) => self.board.keep(keep),
                LineEffect::Note(drive, note) => {
                    tracing::warn!(line = self.port.line, drive = self.name_of(drive), "{note}");
                }
                LineEffect::LineNote(note) => tracing::warn!(line = self.port.line, "{note}"),
                LineEffect::Presence(drive, presence) => self.log_presence(drive, presence),
                LineEffect::Traffic(record) => {
                    tracing::trace!(line = self.port.line, kind = ?record.kind, bytes = ?record.bytes, "traffic");
                    self.board.tell_traffic(record);
                }
            }
        }
        self.board.show(&mut self.core);
        self.tell_of_leaving();
        Ok(())
    }

    fn log_presence(&self, drive: DriveIndex, presence: DrivePresence) {
        let line = &self.port.line;
        let drive = self.name_of(drive);
        match presence {
            DrivePresence::Online => tracing::info!(line, drive, "drive online"),
            DrivePresence::Offline => tracing::warn!(line, drive, "drive offline"),
            DrivePresence::Unknown => tracing::info!(line, drive, "drive not polled yet"),
        }
    }

    fn log_trip(&self, drive: DriveIndex, event: &TripEvent) {
        let line = &self.port.line;
        let drive = self.name_of(drive);
        let while_away = event.while_away;
        match &event.kind {
            TripEventKind::Tripped { trips, record } => {
                tracing::warn!(
                    line,
                    drive,
                    trips,
                    code = record.code,
                    while_away,
                    "drive tripped"
                )
            }
            TripEventKind::Cleared => tracing::info!(line, drive, while_away, "trip cleared"),
        }
    }

    /// Logs each open stop that the shutdown leaves behind, once, if `is_due` by whether it was sent.
    pub(super) fn log_open_stops(&mut self, is_due: impl Fn(bool) -> bool) {
        let open: Vec<_> = self
            .core
            .open_stops()
            .filter(|(drive, was_sent)| is_due(*was_sent) && !self.left_behind.contains(drive))
            .collect();
        let line = &self.port.line;
        for (drive, was_sent) in open {
            let name = self.name_of(drive);
            if !was_sent {
                tracing::error!(
                    line,
                    drive = name,
                    "a STOP was never sent, because the drive could not be reached; shutting down anyway: {MAY_RUN}"
                );
            } else if !self.is_hurried {
                tracing::error!(
                    line,
                    drive = name,
                    "a STOP had no effect; shutting down anyway: it was sent, and {MAY_RUN}"
                );
            }
            self.left_behind.push(drive);
        }
    }

    fn name_of(&self, drive: DriveIndex) -> &str {
        self.port
            .drives
            .get(drive.get())
            .map_or("?", String::as_str)
    }
}
