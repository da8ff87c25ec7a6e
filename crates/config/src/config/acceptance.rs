//! Which unproven actions of one drive are accepted: those that its control section lists, and those that were confirmed
//! at the drive itself.

use super::file::{ConfigFile, ControlFile};
use super::lists;
use super::qualified::QualifiedStanding;
use crate::domain::control::{BusFunctions, ControlAction, FailSafe, SiteEvidence};
use crate::domain::problem::Problem;
use crate::profile::model::Model;
use crate::toml_file::{KeyLocation, OptionalKey};
use crate::vendors;

/// What is accepted for one drive, and how what is not is reported.
#[derive(Clone, Copy)]
pub(super) struct DriveAcceptance<'a> {
    file: &'a ControlFile,
    standing: &'a QualifiedStanding,
}

impl<'a> DriveAcceptance<'a> {
    pub const fn new(file: &'a ControlFile, standing: &'a QualifiedStanding) -> Self {
        Self { file, standing }
    }

    /// Whether the section lists `action`; an invalid list, which is reported, counts as one that does.
    pub fn lists(&self, action: ControlAction) -> bool {
        match &self.file.accept_unverified {
            OptionalKey::Absent => false,
            OptionalKey::Invalid => true,
            OptionalKey::Valid(list) => lists::has(&list.value, &action),
        }
    }

    /// Whether `action` is listed, or was confirmed at the drive.
    pub fn accepts(&self, action: ControlAction) -> bool {
        self.lists(action) || self.standing.actions().contains(&action)
    }

    /// `problem`, that something unproven is not accepted. It is only a warning while the drive is being qualified, or if
    /// what was confirmed at it no longer counts: the guard refuses the orders, and the other drives are served.
    pub fn judged(&self, problem: Problem) -> Problem {
        let is_expected = self.file.qualify.valid_as(&true).is_some()
            || matches!(
                self.standing,
                QualifiedStanding::Void(..) | QualifiedStanding::Unreadable
            );
        if is_expected {
            problem.warning()
        } else {
            problem
        }
    }

    /// The actions that are accepted besides those that the section lists: for what was seen at the drive.
    pub fn evidence(&self, model: Option<&Model>) -> SiteEvidence {
        let QualifiedStanding::Counts(evidence) = self.standing else {
            return SiteEvidence::default();
        };
        let counts = |action: &ControlAction| {
            !self.lists(*action) && model.is_some_and(|it| is_unproven(it, *action))
        };
        SiteEvidence {
            actions: evidence.actions.iter().copied().filter(counts).collect(),
            identity: evidence.identity,
        }
    }

    /// Reports what there is to say about trials at this drive, whose section is at `location`.
    pub fn check(&self, location: &KeyLocation, model: &Model, problems: &mut Vec<Problem>) {
        if let QualifiedStanding::Void(actions, why) = self.standing {
            let lost = actions
                .iter()
                .filter(|it| !self.lists(**it) && is_unproven(model, **it));
            let lost: Vec<_> = lost.map(|it| it.keyword()).collect();
            if !lost.is_empty() {
                let what = format!(
                    "what was confirmed at this drive no longer counts ({}): {why}",
                    lost.join(", ")
                );
                location.warn(what, "`vfd-gateway qualify` once more", problems);
            }
        }
        let Some(qualify) = self.file.qualify.valid_as(&true) else {
            return;
        };
        let what = "the drive is being qualified: a person at this host may try what is unproven \
                    for its model";
        qualify.warn(what, "remove it when the trials are done", problems);
        if let Some(lost) = &self.file.on_commander_lost
            && lost.value == FailSafe::Hold
        {
            let what = "with `qualify`, a motor that runs in a trial would run on if the command is killed";
            lost.refuse(what, "\"stop\"", problems);
        }
        if let Some(bus) = self.file.bus.valid()
            && bus.value != BusFunctions::Both
        {
            let what = "with `qualify`, run commands and the frequency must come over the bus";
            bus.refuse(what, "\"both\"", problems);
        }
    }
}

/// Without a data directory there is no socket for the command, and no place for the results.
pub(super) fn trials_are_kept(file: &ConfigFile, problems: &mut Vec<Problem>) {
    if !file.gateway.data_dir.is_absent() {
        return;
    }
    for qualify in file.controls().filter_map(|it| it.qualify.valid_as(&true)) {
        let what = "has no effect: without a data directory no result can be kept";
        qualify.warn(what, "`data_dir` in `[gateway]`", problems);
    }
}

/// Whether `qualify` tries `action` at drives of `model`: what is unproven, and all that a model states which is not built in. Its
/// grades are those that its writer gave, and a word that was typed wrong is as proven there as a right one.
#[must_use]
pub fn is_tried(model: &Model, action: ControlAction) -> bool {
    let has = || match action {
        ControlAction::Basic => model.run.is_some(),
        action => model
            .run
            .as_ref()
            .is_some_and(|run| run.action(action).is_some()),
    };
    is_unproven(model, action) || (has() && vendors::catalog().ids().all(|id| id != model.id))
}

/// Whether `action` needs to be accepted on drives of `model`.
#[must_use]
pub fn is_unproven(model: &Model, action: ControlAction) -> bool {
    match action {
        ControlAction::Basic => !model.unproven_basics().is_empty(),
        action => model
            .run
            .as_ref()
            .is_some_and(|run| run.unproven().any(|(it, _)| it == action)),
    }
}
