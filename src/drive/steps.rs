//! An order becomes a bounded list of steps, from what the model says.

use crate::domain::command::{Direction, Go, RegisterWrite};
use crate::domain::control::ControlSettings;
use crate::domain::frequency::Hertz;
use crate::profile::model::{Model, Register, Role, RunCommand};

/// One exchange of a command.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Step {
    /// Read a register before anything is written: its word must lie within these. Otherwise the command is refused.
    Check {
        /// The register.
        address: u16,
        /// Lowest word that lets the command go on.
        least: u16,
        /// Highest such word.
        most: u16,
    },
    /// Write a register.
    Write(Write),
}

/// One write of a command.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Write {
    /// The register.
    pub address: u16,
    /// The word.
    pub value: u16,
    /// What it does.
    pub part: Part,
    /// Where the drive shows what became of it, if it does: a register and the word that it then holds.
    pub shown: Option<(u16, u16)>,
}

/// What a write of a command does.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Part {
    /// It sets a register without a role.
    Register,
    /// It gives the setpoint.
    Setpoint(Hertz),
    /// It starts the motor.
    Run(Direction),
    /// It belongs to a reset.
    Reset {
        /// It is the last one.
        ends: bool,
    },
}

/// Why an order has no steps on a model.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum NoSteps {
    /// The model has no such command.
    NotCapable,
    /// The frequency lies between two steps of its register, or beyond it.
    BetweenSteps,
}

/// The steps of an order that sets something: registers, then the setpoint, then run. At most one for each part of the
/// order and one before them: RUN without a setpoint checks the drive's own setting first.
///
/// # Errors
/// [`NoSteps`]
pub fn of_go(model: &Model, go: &Go, control: &ControlSettings) -> Result<Vec<Step>, NoSteps> {
    let mut steps: Vec<Step> = go.registers().iter().map(|write| register(model, *write)).collect();
    if let Some(frequency) = go.frequency() {
        steps.push(setpoint(model, frequency)?);
    }
    if let Some(direction) = go.run() {
        let (register, run) = command_register(model)?;
        let value = match direction {
            Direction::Forward => run.forward.value,
            Direction::Reverse => run.reverse.as_ref().ok_or(NoSteps::NotCapable)?.value,
        };
        if go.frequency().is_none() {
            steps.insert(0, check_setting(model, control)?);
        }
        steps.push(Step::Write(Write { address: register.address, value, part: Part::Run(direction), shown: None }));
    }
    Ok(steps)
}

/// The steps of a reset: the model's sequence, after which nothing turns.
///
/// # Errors
/// [`NoSteps::NotCapable`]
pub fn of_reset(model: &Model) -> Result<Vec<Step>, NoSteps> {
    let (register, run) = command_register(model)?;
    let last = run.reset_sequence.len().checked_sub(1).ok_or(NoSteps::NotCapable)?;
    let output = model.register_for(Role::OutputFrequency);
    let write = |(index, value): (usize, &u16)| {
        let ends = index == last;
        let shown = output.filter(|_| ends).map(|output| (output.address, 0));
        Step::Write(Write { address: register.address, value: *value, part: Part::Reset { ends }, shown })
    };
    Ok(run.reset_sequence.iter().enumerate().map(write).collect())
}

/// The register and the word that stop a drive, or cut its output off.
///
/// # Errors
/// [`NoSteps::NotCapable`]
pub fn of_stop(model: &Model, coast: bool) -> Result<(u16, u16), NoSteps> {
    let (register, run) = command_register(model)?;
    let value = if coast { run.coast.as_ref().ok_or(NoSteps::NotCapable)?.value } else { run.stop.value };
    Ok((register.address, value))
}

fn command_register(model: &Model) -> Result<(&Register, &RunCommand), NoSteps> {
    let register = model.register_for(Role::RunCommand).ok_or(NoSteps::NotCapable)?;
    Ok((register, model.run.as_ref().ok_or(NoSteps::NotCapable)?))
}

fn register(model: &Model, write: RegisterWrite) -> Step {
    let RegisterWrite { address, value } = write;
    let is_readable = model.register_at(address).is_some_and(|register| register.access.can_read());
    let shown = is_readable.then_some((address, value));
    Step::Write(Write { address, value, part: Part::Register, shown })
}

fn setpoint(model: &Model, frequency: Hertz) -> Result<Step, NoSteps> {
    let register = model.register_for(Role::FrequencyCommand).ok_or(NoSteps::NotCapable)?;
    let value = frequency.to_word(register.scale).ok_or(NoSteps::BetweenSteps)?;
    let setting = model.register_for(Role::FrequencySetting).filter(|setting| setting.access.can_read());
    let shown = setting.and_then(|setting| Some((setting.address, frequency.to_word(setting.scale)?)));
    Ok(Step::Write(Write { address: register.address, value, part: Part::Setpoint(frequency), shown }))
}

/// The drive's own setting must lie within the limits: least rounded up, most rounded down to its steps.
fn check_setting(model: &Model, control: &ControlSettings) -> Result<Step, NoSteps> {
    let setting = model.register_for(Role::FrequencySetting).ok_or(NoSteps::NotCapable)?;
    let steps = |limit: Hertz| u64::from(limit.millihertz()) * u64::from(setting.scale);
    let least = u16::try_from(steps(control.least).div_ceil(1000)).map_err(|_| NoSteps::BetweenSteps)?;
    let most = u16::try_from(steps(control.most) / 1000).unwrap_or(u16::MAX);
    Ok(Step::Check { address: setting.address, least, most })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::drive::testing::{control, model};

    fn hertz(centi: u16) -> Hertz {
        Hertz::from_centihertz(centi)
    }

    fn write(address: u16, value: u16, part: Part, shown: Option<(u16, u16)>) -> Step {
        Step::Write(Write { address, value, part, shown })
    }

    #[test]
    fn setpoint_goes_before_run() {
        let go = Go::new(Vec::new(), Some(hertz(4250)), Some(Direction::Forward)).unwrap();
        let setpoint = write(0x0004, 4250, Part::Setpoint(hertz(4250)), Some((0x0201, 4250)));
        let run = write(0x0002, 1, Part::Run(Direction::Forward), None);
        assert_eq!(of_go(&model(), &go, &control()).unwrap(), [setpoint, run]);
    }

    #[test]
    fn run_alone_looks_at_the_drives_own_setting_first() {
        let go = Go::new(Vec::new(), None, Some(Direction::Reverse)).unwrap();
        let check = Step::Check { address: 0x0201, least: 500, most: 5000 };
        let run = write(0x0002, 2, Part::Run(Direction::Reverse), None);
        assert_eq!(of_go(&model(), &go, &control()).unwrap(), [check, run]);
    }

    #[test]
    fn a_register_is_read_back() {
        let ramp = RegisterWrite { address: 0x020C, value: 100 };
        let steps = of_go(&model(), &Go::new(vec![ramp], None, None).unwrap(), &control()).unwrap();
        assert_eq!(steps, [write(0x020C, 100, Part::Register, Some((0x020C, 100)))]);
    }

    #[test]
    fn a_reset_never_carries_a_run_order() {
        let reset = |value, ends, shown| write(0x0002, value, Part::Reset { ends }, shown);
        let expected = [reset(0, false, None), reset(4, false, None), reset(0, true, Some((0x0101, 0)))];
        assert_eq!(of_reset(&model()).unwrap(), expected);
    }

    #[test]
    fn what_the_register_cannot_hold_is_refused() {
        let fine = Go::new(Vec::new(), Some(Hertz::from_millihertz(42_505)), None).unwrap();
        assert_eq!(of_go(&model(), &fine, &control()), Err(NoSteps::BetweenSteps));
    }
}
