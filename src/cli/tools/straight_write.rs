//! What `write` needs besides its order if there is no gateway: limits, and permissions.

use super::CommandFailure;
use super::client::{NoAnswer, STATUS, UnitClient, reason};
use super::log::complain;
use super::order::{WriteOrder, frequency};
use super::own_gateway::{ToolAccess, control};
use super::stopping::acknowledged;
use super::target::DriveTarget;
use crate::domain::command::Reason;
use crate::domain::control::ControlAction;
use crate::drive::view::RunState;
use crate::north::modbus::address as map;
use crate::north::modbus::uniform::{bit, run};
use crate::profile::model::{BasicFact, Model, ParameterKind};
use std::time::Duration;
use tokio::time::{Instant, sleep};

/// How often the drive is read while it is commanded.
const POLL: Duration = Duration::from_millis(200);
/// Longest time until a stop before a start is effective.
const AT_REST_WITHIN: Duration = Duration::from_secs(30);
/// Wait between two checks of that.
const LOOK_EVERY: Duration = Duration::from_millis(200);
/// The consequence of killing this program.
const WARNING: &str = "warning: directly on a port, only the drive's own watchdog stops the motor \
                       if this program is killed or the cable is lost\n";

/// Options that apply only directly on a port.
#[derive(Clone, Debug, Default, clap::Args)]
pub struct StraightOptions {
    /// Directly on a port, for `run` and `frequency`: frequencies that are allowed, in Hz, such as 5-50
    #[arg(long, value_name = "MIN-MAX", value_parser = limits)]
    limits: Option<(f64, f64)>,
    /// Directly on a port, before `run`: give the drive this frequency, in Hz
    #[arg(long, value_name = "HZ")]
    frequency: Option<String>,
    /// Directly on a port: accept this control fact although the model marks it as unproven; repeat it for several
    #[arg(long, value_name = "FACT")]
    accept_unverified: Vec<String>,
}

impl StraightOptions {
    /// This frequency in Hz before `run`, and nothing else.
    #[must_use]
    pub fn with_frequency(hz: &str) -> Self {
        Self {
            frequency: Some(hz.to_owned()),
            ..Self::default()
        }
    }
}

/// Two frequencies in Hz, as `5-50`.
///
/// # Errors
/// What would be right.
pub(crate) fn limits(text: &str) -> Result<(f64, f64), String> {
    let wrong = || format!("{text} are not limits such as 5-50, in Hz");
    let (least, most) = text.split_once('-').ok_or_else(wrong)?;
    match (least.trim().parse(), most.trim().parse()) {
        (Ok(least), Ok(most)) if 0.0 <= least && least <= most && most <= 600.0 => {
            Ok((least, most))
        }
        _ => Err(wrong()),
    }
}

/// What a gateway of our own may do for `order`; `None` if there is another one.
///
/// # Errors
/// Limits are missing, or the register is one that commands are written to.
pub fn extra(
    target: &DriveTarget,
    straight: &StraightOptions,
    order: &WriteOrder,
) -> Result<ToolAccess, CommandFailure> {
    let Some(model) = target.model()? else {
        let is_given = straight.limits.is_some()
            || straight.frequency.is_some()
            || !straight.accept_unverified.is_empty();
        let what = "--limits, --frequency and --accept-unverified are for a port: a gateway has its own limits";
        return if is_given {
            Err(CommandFailure::wrong(what))
        } else {
            Ok(ToolAccess::default())
        };
    };
    if !order.is_uniform {
        let register = model.register_at(order.address);
        if register.is_some_and(|it| it.parameter_kind() == ParameterKind::Command) {
            return Err(CommandFailure::wrong(
                "commands are not written as words: use `run` or `frequency`",
            ));
        }
        let native_write = vec![order.address];
        return Ok(ToolAccess {
            control: ToolAccess::control_at_rest(),
            native_write,
            poll: Some(POLL),
            ..ToolAccess::default()
        });
    }
    let moves = order.makes_run() || order.address == map::SETPOINT;
    let limits = match straight.limits {
        Some(limits) => limits,
        None if moves => {
            return Err(CommandFailure::wrong(
                "directly on a port, --limits is needed, such as --limits 5-50",
            ));
        }
        None => (1.0, 1.0),
    };
    let direction = if order.makes_run() && order.word == 2 {
        "reverse"
    } else {
        "forward"
    };
    // A command that only sets something leaves the drive as it is; one that makes it run stops it in any case.
    let on_shutdown = if order.makes_run() { "stop" } else { "hold" };
    let control = control(limits, direction, on_shutdown);
    let accept_unverified = straight.accept_unverified.clone();
    if moves {
        basics_are_accepted(&model, &accept_unverified)?;
    }
    Ok(ToolAccess {
        control,
        moves,
        accept_unverified,
        native_write: Vec::new(),
        poll: Some(POLL),
    })
}

/// A start needs a stop that is proven, or that the user has seen.
fn basics_are_accepted(model: &Model, accepted: &[String]) -> Result<(), CommandFailure> {
    let basic = ControlAction::Basic.keyword();
    let unproven = model.unproven_basics();
    if unproven.is_empty() || accepted.iter().any(|word| word == basic) {
        return Ok(());
    }
    let what: Vec<_> = unproven.iter().map(BasicFact::described).collect();
    Err(CommandFailure::wrong(format!(
        "{} takes no orders to move: no manual of it proves {}; add --accept-unverified \
         {basic} if you have seen a stop work",
        model.id,
        what.join(", ")
    )))
}

/// Prepares for a run command: a guard that has just started requires a stop first, and a motor seen at standstill.
///
/// # Errors
/// The stop is not acknowledged or shows no effect, or the frequency is refused.
pub async fn arm(
    client: &mut UnitClient,
    straight: &StraightOptions,
) -> Result<(), CommandFailure> {
    complain(WARNING.as_bytes());
    arm_simulated(client, straight).await
}

/// Prepares a simulated drive for a run command, without the warning of [`arm`].
///
/// # Errors
/// See [`arm`].
pub async fn arm_simulated(
    client: &mut UnitClient,
    straight: &StraightOptions,
) -> Result<(), CommandFailure> {
    acknowledged(client, run::STOP).await?;
    let until = Instant::now() + AT_REST_WITHIN;
    let word = straight.frequency.as_deref().map(frequency).transpose()?;
    let Some(word) = word else {
        return is_settled(client, until).await;
    };
    is_settled(client, until).await?;
    match client.write(map::SETPOINT, word).await {
        Ok(()) => Ok(()),
        Err(error) => Err(CommandFailure::failed(format!(
            "frequency: {error}{}",
            reason(client).await
        ))),
    }
}

/// Waits until the stop is effective: an identical one is answered from what is known then.
async fn is_settled(client: &mut UnitClient, until: Instant) -> Result<(), CommandFailure> {
    loop {
        let words = match client.read(STATUS, 2).await {
            Ok(words) => words,
            Err(NoAnswer::Exception(_)) => Vec::new(),
            Err(error) => return Err(CommandFailure::failed(error)),
        };
        if let [status, state] = words[..]
            && status & bit::PENDING == 0
            && state == RunState::Stopped.number()
        {
            return Ok(());
        }
        if Instant::now() >= until {
            let why = Reason::StopPending.text();
            return Err(CommandFailure::failed(format!(
                "nothing was started: {why}{}",
                reason(client).await
            )));
        }
        sleep(LOOK_EVERY).await;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn limits_are_two_frequencies_in_order() {
        assert_eq!(limits("5-50"), Ok((5.0, 50.0)));
        assert_eq!(limits("0.5-7.25"), Ok((0.5, 7.25)));
        for wrong in ["", "5", "50-5", "a-b", "-5-5", "0-601", "NaN-5"] {
            assert!(limits(wrong).is_err(), "{wrong}");
        }
    }
}
