//! Which unproven actions of one drive are accepted: those that its control section lists, and those that were confirmed
//! at the drive itself.

use super::file::{ConfigFile, ControlFile};
use super::qualified::QualifiedStanding;
use crate::domain::control::{BusFunctions, ControlAction, FailSafe, SiteEvidence};
use crate::domain::problem::Problem;
use crate::profile::model::Model;
use crate::toml_file::{KeyLocation, LocatedValue, OptionalKey};
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
            OptionalKey::Valid(list) => list.value.iter().any(|accepted| accepted.value == action),
        }
    }

    /// Whether `action` is listed, or was confirmed at the drive.
    pub fn accepts(&self, action: ControlAction) -> bool {
        self.lists(action) || self.standing.actions().contains(&action)
    }

    /// `problem`, that something unproven is not accepted. It is only a warning while the drive is being qualified, or if
    /// what was confirmed at it no longer counts: the guard refuses the orders, and the other drives are served.
    pub fn judged(&self, problem: Problem) -> Problem {
        let is_expected = self.qualifies()
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

    fn qualifies(&self) -> bool {
        self.file
            .qualify
            .valid()
            .is_some_and(|qualify| qualify.value)
    }

    /// All accepted actions, and those of them that rest on what was seen at the drive.
    pub fn settled(&self, model: Option<&Model>) -> (Vec<ControlAction>, SiteEvidence) {
        let listed = super::lists::values(&self.file.accept_unverified).unwrap_or_default();
        let QualifiedStanding::Counts(evidence) = self.standing else {
            return (listed, SiteEvidence::default());
        };
        let counts = |action: &ControlAction| {
            !listed.contains(action) && model.is_some_and(|it| is_unproven(it, *action))
        };
        let actions: Vec<_> = evidence.actions.iter().copied().filter(counts).collect();
        let accepted = listed
            .iter()
            .copied()
            .chain(actions.iter().copied())
            .collect();
        (
            accepted,
            SiteEvidence {
                actions,
                identity: evidence.identity,
            },
        )
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
                problems.push(
                    location
                        .problem(what)
                        .right("`vfd-gateway qualify` once more")
                        .warning(),
                );
            }
        }
        let OptionalKey::Valid(LocatedValue {
            value: true,
            location,
        }) = &self.file.qualify
        else {
            return;
        };
        let what = "the drive is being qualified: a person at this host may try what is unproven \
                    for its model";
        problems.push(
            location
                .problem(what)
                .right("remove it when the trials are done")
                .warning(),
        );
        if let Some(lost) = self
            .file
            .on_commander_lost
            .as_ref()
            .filter(|lost| lost.value == FailSafe::Hold)
        {
            let what = "with `qualify`, a motor that runs in a trial would run on if the command is killed";
            problems.push(lost.location.problem(what).right("\"stop\""));
        }
        if let Some(bus) = self
            .file
            .bus
            .valid()
            .filter(|bus| bus.value != BusFunctions::Both)
        {
            let what = "with `qualify`, run commands and the frequency must come over the bus";
            problems.push(bus.location.problem(what).right("\"both\""));
        }
    }
}

/// Without a data directory there is no socket for the command, and no place for the results.
pub(super) fn trials_are_kept(file: &ConfigFile, problems: &mut Vec<Problem>) {
    if !matches!(file.gateway.data_dir, OptionalKey::Absent) {
        return;
    }
    let controls = file
        .lines
        .iter()
        .flat_map(|line| &line.drives)
        .filter_map(|drive| drive.control.valid());
    for qualify in controls
        .filter_map(|control| control.value.qualify.valid())
        .filter(|qualify| qualify.value)
    {
        let problem = qualify
            .location
            .problem("has no effect: without a data directory no result can be kept");
        problems.push(problem.right("`data_dir` in `[gateway]`").warning());
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
