//! The configuration changed while the connection stays: other drives, other lines.

use super::command_ids::CommandIds;
use super::home_assistant::DiscoveryPlant;
use super::session::MqttSession;
use crate::domain::ids::Name;
use crate::drive::description::DriveDescription;
use crate::north::clock::ClockMoment;

impl MqttSession {
    /// Replaces drives and lines.
    pub(super) fn replace_plant(
        &mut self,
        at: ClockMoment,
        drives: Vec<DriveDescription>,
        lines: Vec<Name>,
    ) {
        let goes_on = |old: &DriveDescription| {
            drives
                .iter()
                .position(|it| it.place == old.place && it.name == old.name)
        };
        let moved: Vec<_> = self.drives.iter().map(goes_on).collect();
        while let Some((pending, report)) = self.link.commands.take_gone(&moved) {
            self.end(at, &pending, report);
        }
        self.link.commands.move_drives(&moved);
        let mut seen = std::mem::take(&mut self.seen);
        // Ids survive a restart of the drive's line: a command that arrived once is not executed twice.
        let known = |name: &Name| self.drives.iter().position(|it| it.name == *name);
        self.seen = drives
            .iter()
            .map(|drive| {
                known(&drive.name)
                    .and_then(|at| seen.get_mut(at))
                    .map(std::mem::take)
                    .unwrap_or_else(CommandIds::default)
            })
            .collect();
        let started = self.link.clock.text(self.started);
        self.telemetry.replace(
            &self.settings,
            &self.topics,
            (&self.drives, &drives),
            &lines,
            &started,
        );
        let old = DiscoveryPlant::of(
            &self.settings,
            &self.topics,
            &self.titles,
            &self.lines,
            &self.drives,
        );
        let new = DiscoveryPlant::of(&self.settings, &self.topics, &self.titles, &lines, &drives);
        if let (Some(old), Some(new)) = (old, new) {
            self.discovery.replace(&old, &new);
        }
        self.half
            .replace(&lines, drives.iter().map(|drive| drive.line.clone()));
        self.drives = drives;
        self.lines = lines;
        self.apply_roles(at.mono);
    }
}
