//! The trials in their order: each is described, confirmed at the keyboard, sent, compared with what is read, and ends
//! in a stop. Whatever is not as expected is answered by a stop at once.

use super::gateway::{HeldLease, OrderOutcome, TrialDrive};
use super::person::{TypedLines, is_skip, is_yes};
use super::seen::{ComparedState, ExpectedState, SeenState, compare, state_text};
use super::texts;
use crate::cli::tools::{CommandFailure, print};
use crate::config::qualified::TrialFinding;
use crate::daemon::host::clock;
use crate::north::api::TrialDocument;
use std::time::Duration;
use tokio::time::sleep;

/// Time between two looks at the drive.
const LOOK_EVERY: Duration = Duration::from_millis(150);
/// Longest ramp up to the slow speed of a trial.
const RUNS_WITHIN: Duration = Duration::from_secs(30);
/// Longest ramp down, or coasting to rest.
const RESTS_WITHIN: Duration = Duration::from_secs(120);

/// Why the trials end early.
#[derive(Debug)]
pub(super) enum TrialsEnd {
    /// The person does not want to go on.
    Quit,
    /// A signal.
    Interrupted,
    /// The keyboard is gone.
    NoInput,
    /// The gateway does not answer, or keeps no result.
    Failed(CommandFailure),
}

impl From<CommandFailure> for TrialsEnd {
    fn from(failure: CommandFailure) -> Self {
        Self::Failed(failure)
    }
}

/// The result of one action.
#[derive(Debug)]
pub(super) struct ActionResult {
    /// The action's word.
    pub action: &'static str,
    /// The result.
    pub result: TrialFinding,
    /// Why, in words.
    pub why: String,
}

impl ActionResult {
    /// Whether the drive did something else.
    pub fn is_contradicted(&self) -> bool {
        self.result == TrialFinding::Contradicted
    }
}

/// The result of one step.
type Step = (TrialFinding, String);

/// A step that went as expected.
fn confirmed() -> Step {
    (TrialFinding::Confirmed, String::new())
}

/// The trials at one drive.
pub(super) struct TrialSession<'a> {
    gateway: &'a TrialDrive,
    person: TypedLines,
    document: &'a TrialDocument,
    by: &'a str,
    /// The results so far.
    pub found: Vec<ActionResult>,
    /// Whether anything was sent, so that a stop has to be the last word.
    pub has_sent: bool,
}

impl<'a> TrialSession<'a> {
    pub const fn new(
        gateway: &'a TrialDrive,
        person: TypedLines,
        document: &'a TrialDocument,
        by: &'a str,
    ) -> Self {
        Self {
            gateway,
            person,
            document,
            by,
            found: Vec::new(),
            has_sent: false,
        }
    }

    /// Makes all trials.
    pub async fn run(&mut self) -> Result<(), TrialsEnd> {
        let state = self.gateway.state().await?;
        if !matches!(state.run_state.as_str(), "stopped" | "tripped") {
            let what = format!(
                "the motor must stand still before the trials: {}",
                state_text(&state)
            );
            return Err(TrialsEnd::Failed(CommandFailure::failed(what)));
        }
        // A trip is reset first: nothing else can be tried before.
        let is_tripped = state.tripped == Some(true);
        let at_rest = self.stop_at_rest().await?;
        if at_rest.0 != TrialFinding::Confirmed {
            return self.keep("basic", at_rest).await;
        }
        if self.is_unproven("reset") && is_tripped && self.is_basic_sure() {
            self.reset().await?;
        }
        if self.is_unproven("basic") && !self.basic().await? {
            return Ok(());
        }
        if self.is_unproven("reverse") {
            self.reverse().await?;
        }
        if self.is_unproven("coast") {
            self.coast().await?;
        }
        if self.is_unproven("reset") && !self.has("reset") {
            self.reset_if_tripped().await?;
        }
        if self.is_unproven("release") {
            self.release().await?;
        }
        Ok(())
    }

    fn is_unproven(&self, action: &str) -> bool {
        self.document.actions.iter().any(|it| it.action == *action)
    }

    /// Whether stop, forward and the setpoint are proven or accepted already.
    fn is_basic_sure(&self) -> bool {
        self.document
            .actions
            .iter()
            .all(|it| it.action != "basic" || it.in_force)
    }

    fn has(&self, action: &str) -> bool {
        self.found.iter().any(|it| it.action == action)
    }

    fn has_order(&self, order: &str) -> bool {
        let orders = self.document.orders.as_ref();
        orders.is_some_and(|orders| orders.contains_key(order))
    }

    fn setpoint(&self) -> f64 {
        self.document.setpoint_hz.unwrap_or_default()
    }

    async fn stop_at_rest(&mut self) -> Result<Step, TrialsEnd> {
        if !self
            .agrees(
                "1. stop, at standstill",
                &["stop"],
                "acknowledged; nothing moves",
            )
            .await?
        {
            return Ok(skipped());
        }
        let seen = self
            .order("stop", ExpectedState::StaysAtRest, RUNS_WITHIN)
            .await?;
        self.asked(
            seen,
            "does the motor stand still, and does the panel show no new fault?",
            None,
        )
        .await
    }

    /// Forward, then the stop of a motor that runs. Returns whether both are confirmed.
    async fn basic(&mut self) -> Result<bool, TrialsEnd> {
        if self.document.may_go_forward == Some(false) {
            let why = "`directions` does not allow forward".to_owned();
            self.keep("basic", (TrialFinding::Skipped, why)).await?;
            return Ok(false);
        }
        let hertz = self.setpoint();
        let expected = format!("the motor turns forward, at about {hertz:.2} Hz");
        if !self
            .agrees(
                "2. forward, as slowly as permitted",
                &["forward"],
                &expected,
            )
            .await?
        {
            self.keep("basic", skipped()).await?;
            return Ok(false);
        }
        let held = self.hold();
        let ran = self
            .runs(
                "forward",
                "does the panel show forward, at about that frequency?",
            )
            .await?;
        if ran.0 != TrialFinding::Confirmed {
            self.keep("basic", ran).await?;
            return Ok(false);
        }
        let goes_on = self
            .agrees(
                "3. stop, while it runs",
                &["stop"],
                "the motor comes to rest along its ramp",
            )
            .await?;
        let seen = self
            .order("stop", ExpectedState::ComesToRest, RESTS_WITHIN)
            .await?;
        drop(held);
        let stopped = match (goes_on, seen) {
            (true, seen) => {
                self.asked(seen, "has the motor come to rest?", None)
                    .await?
            }
            (false, Ok(())) => skipped(),
            (false, Err(step)) => step,
        };
        let is_confirmed = stopped.0 == TrialFinding::Confirmed;
        self.keep("basic", stopped).await?;
        Ok(is_confirmed)
    }

    async fn reverse(&mut self) -> Result<(), TrialsEnd> {
        if self.document.may_reverse != Some(true) {
            let why = "`directions` does not allow reverse".to_owned();
            return self.keep("reverse", (TrialFinding::Skipped, why)).await;
        }
        let expected = format!(
            "the motor turns in reverse, at about {:.2} Hz, until the stop after it",
            self.setpoint()
        );
        if !self.agrees("reverse", &["reverse"], &expected).await? {
            return self.keep("reverse", skipped()).await;
        }
        let held = self.hold();
        let ran = self
            .runs(
                "reverse",
                "does the panel show reverse, and does the motor turn the other way?",
            )
            .await?;
        let seen = self
            .order("stop", ExpectedState::ComesToRest, RESTS_WITHIN)
            .await?;
        drop(held);
        self.keep("reverse", both(ran, seen)).await
    }

    async fn coast(&mut self) -> Result<(), TrialsEnd> {
        if !self.has_order("coast") || self.document.may_go_forward == Some(false) {
            return self.keep("coast", skipped()).await;
        }
        let expected = "the motor turns forward; then its output goes off at once, and the motor \
                        coasts to rest";
        if !self
            .agrees("coast, out of a slow run", &["forward", "coast"], expected)
            .await?
        {
            return self.keep("coast", skipped()).await;
        }
        let held = self.hold();
        let direction = ExpectedState::Runs("forward", self.setpoint());
        let ran = self.order("forward", direction, RUNS_WITHIN).await?;
        let step = match ran {
            Err(step) => step,
            Ok(()) => {
                let seen = self
                    .order("coast", ExpectedState::ComesToRest, RESTS_WITHIN)
                    .await?;
                drop(held);
                self.asked(seen, "was the output off at once, without a ramp?", None)
                    .await?
            }
        };
        let seen = self
            .order("stop", ExpectedState::ComesToRest, RESTS_WITHIN)
            .await?;
        self.keep("coast", both(step, seen)).await
    }

    async fn reset_if_tripped(&mut self) -> Result<(), TrialsEnd> {
        if self.gateway.state().await?.tripped == Some(true) {
            return self.reset().await;
        }
        self.keep(
            "reset",
            (TrialFinding::Skipped, "the drive is not tripped".to_owned()),
        )
        .await
    }

    async fn reset(&mut self) -> Result<(), TrialsEnd> {
        if !self
            .agrees(
                "reset of the trip",
                &["reset"],
                "the trip is gone; nothing moves",
            )
            .await?
        {
            return self.keep("reset", skipped()).await;
        }
        let seen = self
            .order("reset", ExpectedState::TripIsGone, RUNS_WITHIN)
            .await?;
        let step = self
            .asked(
                seen,
                "does the panel no longer show the fault, and does the motor stand still?",
                None,
            )
            .await?;
        let seen = self
            .order("stop", ExpectedState::ComesToRest, RESTS_WITHIN)
            .await?;
        self.keep("reset", both(step, seen)).await
    }

    async fn release(&mut self) -> Result<(), TrialsEnd> {
        if self.document.may_release != Some(true) {
            return self
                .keep(
                    "release",
                    (
                        TrialFinding::Skipped,
                        "`allow_release` is not true".to_owned(),
                    ),
                )
                .await;
        }
        let expected =
            "the drive obeys its panel or terminals; A CLOSED TERMINAL MAY START THE MOTOR";
        if !self.agrees("release", &["release"], expected).await? {
            return self.keep("release", skipped()).await;
        }
        let seen = self
            .order("release", ExpectedState::ObeysPanel, RUNS_WITHIN)
            .await?;
        let step = self
            .asked(
                seen,
                "does the drive obey its panel or terminals again?",
                None,
            )
            .await?;
        let seen = self
            .order("stop", ExpectedState::ComesToRest, RESTS_WITHIN)
            .await?;
        self.keep("release", both(step, seen)).await
    }

    /// Describes a trial, and asks whether to send it. `false`: it is left out.
    async fn agrees(
        &mut self,
        title: &str,
        orders: &[&str],
        expected: &str,
    ) -> Result<bool, TrialsEnd> {
        print(&texts::trial(self.document, title, orders, expected))?;
        match self.person.ask("send it? [y/N/skip] ").await? {
            None => Err(TrialsEnd::NoInput),
            Some(answer) if is_yes(&answer) => Ok(true),
            Some(answer) if is_skip(&answer) => Ok(false),
            Some(_) => Err(TrialsEnd::Quit),
        }
    }

    /// Runs the motor, and asks what the panel shows while it is watched. It runs on if all is as expected.
    async fn runs(&mut self, direction: &'static str, question: &str) -> Result<Step, TrialsEnd> {
        let expected = ExpectedState::Runs(direction, self.setpoint());
        let seen = self.order(direction, expected, RUNS_WITHIN).await?;
        self.asked(seen, question, Some(expected)).await
    }

    /// Sends an order, and waits until the drive shows what is expected. Anything else is answered by a stop at once.
    async fn order(
        &mut self,
        order: &str,
        expected: ExpectedState,
        within: Duration,
    ) -> Result<Result<(), Step>, TrialsEnd> {
        let epoch = match expected {
            ExpectedState::Runs(..) => self.gateway.state().await?.epoch,
            _ => None,
        };
        self.has_sent = true;
        let sent = clock::now();
        match self.gateway.order(order, epoch).await? {
            OrderOutcome::Acknowledged => {}
            OrderOutcome::Refused(why) => {
                return Ok(Err((
                    TrialFinding::Skipped,
                    format!("{order} was not sent: {why}"),
                )));
            }
            OrderOutcome::Failed(why) => {
                return self.against(format!("{order}: {why}")).await.map(Err);
            }
        }
        loop {
            let state = self.gateway.state().await?;
            match compare(expected, &state, clock::now().since(sent)) {
                ComparedState::Seen => {
                    print(&format!("  read:     {}\n", state_text(&state)))?;
                    return Ok(Ok(()));
                }
                ComparedState::Against(why) => return self.against(why).await.map(Err),
                ComparedState::NotYet if clock::now().since(sent) > within => {
                    return self.late(&state, within).await.map(Err);
                }
                ComparedState::NotYet => sleep(LOOK_EVERY).await,
            }
        }
    }

    async fn late(&mut self, state: &SeenState, within: Duration) -> Result<Step, TrialsEnd> {
        self.against(format!(
            "not seen within {} s: {}",
            within.as_secs(),
            state_text(state)
        ))
        .await
    }

    /// Stops the motor at once.
    async fn against(&mut self, why: String) -> Result<Step, TrialsEnd> {
        self.gateway.stop_at_last().await?;
        print(&format!("  NOT AS EXPECTED, a stop was sent: {why}\n"))?;
        Ok((TrialFinding::Contradicted, why))
    }

    /// Asks what the panel shows, if the drive itself showed what was expected. Meanwhile it must go on to show `stays`.
    async fn asked(
        &mut self,
        seen: Result<(), Step>,
        question: &str,
        stays: Option<ExpectedState>,
    ) -> Result<Step, TrialsEnd> {
        if let Err(step) = seen {
            return Ok(step);
        }
        let question = format!("  {question} [y/N/skip] ");
        let gateway = self.gateway;
        let answer = tokio::select! {
            answer = self.person.ask(&question) => answer?,
            why = leaves(gateway, stays) => {
                print("\n")?;
                return self.against(why?).await;
            }
        };
        match answer {
            None => Err(TrialsEnd::NoInput),
            Some(answer) if is_yes(&answer) => Ok(confirmed()),
            Some(answer) if is_skip(&answer) => {
                self.gateway.stop_at_last().await?;
                Ok(skipped())
            }
            Some(_) => self.against("you saw something else".to_owned()).await,
        }
    }

    /// Renews the lease of a motor that is about to run.
    fn hold(&self) -> HeldLease {
        self.gateway.hold(Duration::from_millis(
            self.document.lost_after_ms.unwrap_or_default(),
        ))
    }

    /// Has the gateway keep the result of `action`.
    async fn keep(&mut self, action: &'static str, (result, why): Step) -> Result<(), TrialsEnd> {
        if !self.is_unproven(action) {
            return Ok(());
        }
        print(&format!("  {action}: {}\n", result.keyword()))?;
        self.found.push(ActionResult {
            action,
            result,
            why,
        });
        Ok(self.gateway.keep(action, result.keyword(), self.by).await?)
    }
}

/// Waits until the drive no longer shows what it should go on to show; for ever, if that is nothing.
async fn leaves(gateway: &TrialDrive, stays: Option<ExpectedState>) -> Result<String, TrialsEnd> {
    let Some(expected) = stays else {
        return std::future::pending().await;
    };
    loop {
        sleep(LOOK_EVERY).await;
        let state = gateway.state().await?;
        // It was seen before, so every reading is one of this run.
        match compare(expected, &state, Duration::MAX) {
            ComparedState::Seen => {}
            ComparedState::Against(why) => return Ok(why),
            ComparedState::NotYet => {
                return Ok(format!(
                    "the drive does not follow the order: {}",
                    state_text(&state)
                ));
            }
        }
    }
}

fn skipped() -> Step {
    (TrialFinding::Skipped, "left out".to_owned())
}

/// A trial and the stop after it: the stop that fails counts more than the trial.
fn both(step: Step, stop: Result<(), Step>) -> Step {
    match stop {
        Err(stop) if stop.0 == TrialFinding::Contradicted || step.0 == TrialFinding::Confirmed => {
            stop
        }
        _ => step,
    }
}
