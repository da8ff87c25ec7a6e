//! Registers by the vendor's code or by name, and values in their units.

use super::payload::{RefusedCommand, short};
use crate::domain::command::{Reason, RegisterWrite};
use crate::domain::problem::nearest;
use crate::profile::model::{Model, Register, RegisterRole};
use crate::profile::scale::{NoWord, to_both, to_raw};

/// The name of a register in topics and results: the vendor's code, else its name.
pub(super) fn label(register: &Register) -> &str {
    register.code.as_deref().unwrap_or(&register.name)
}

/// The index in `model` of the register called `code`, which can be read.
///
/// # Errors
/// There is no such register, or reading it is not documented.
pub(super) fn readable(model: &Model, code: &str) -> Result<usize, RefusedCommand> {
    let register = find(model, code)?;
    if !register.access.can_read() {
        let message = format!(
            "reading `{}` is not documented for this drive",
            label(register)
        );
        return Err(RefusedCommand::new(Reason::NotCapable, message));
    }
    if register.form.bases().next().is_some() || !register.form.plus.is_empty() {
        let message = format!(
            "the value of `{}` depends on other registers: see its own topic",
            label(register)
        );
        return Err(RefusedCommand::new(Reason::NotCapable, message));
    }
    let place = model
        .registers
        .iter()
        .position(|it| it.name == register.name);
    place.ok_or_else(|| RefusedCommand::plain(Reason::NotListed))
}

/// The write of `value`, in the register's unit, to the register called `code`.
///
/// # Errors
/// There is no such register, it has an input of its own, or it cannot hold the value.
pub(super) fn write(
    model: &Model,
    code: &str,
    value: f64,
) -> Result<RegisterWrite, RefusedCommand> {
    let register = find(model, code)?;
    if let Some(input) = own_input(register) {
        let message = format!("`{}` has an input of its own: `{input}`", label(register));
        return Err(RefusedCommand::new(Reason::NotListed, message));
    }
    if !register.is_exact() {
        let message = format!(
            "`{}` is not in whole steps of its unit: write its word by Modbus TCP",
            label(register)
        );
        return Err(RefusedCommand::new(Reason::NotCapable, message));
    }
    let refused = |why| no_word(why, register);
    Ok(match register.form.pair {
        Some(order) => RegisterWrite::pair(
            register.address,
            order.words(to_both(value, register).map_err(refused)?),
        ),
        None => RegisterWrite::new(register.address, to_raw(value, register).map_err(refused)?),
    })
}

/// The input of a register that is written only by orders.
const fn own_input(register: &Register) -> Option<&'static str> {
    match register.role {
        Some(RegisterRole::RunCommand | RegisterRole::Order) => Some("run/set"),
        Some(RegisterRole::FrequencyCommand) => Some("frequency/set"),
        _ => None,
    }
}

fn find<'m>(model: &'m Model, code: &str) -> Result<&'m Register, RefusedCommand> {
    model
        .register_named(code)
        .ok_or_else(|| unknown(model, code))
}

fn unknown(model: &Model, code: &str) -> RefusedCommand {
    let labels = model
        .registers
        .iter()
        .map(label)
        .chain(model.registers.iter().map(|it| it.name.as_str()));
    // The cost of comparing grows with the square of the length.
    let near = (code.len() <= 64).then(|| nearest(code, labels)).flatten();
    let hint = near.map_or_else(String::new, |near| format!("; is it `{near}`?"));
    RefusedCommand::new(
        Reason::NotListed,
        format!("the drive has no parameter `{}`{hint}", short(code)),
    )
}

fn no_word(why: NoWord, register: &Register) -> RefusedCommand {
    let reason = match why {
        NoWord::NotANumber => Reason::NotANumber,
        NoWord::OutOfRange { .. } | NoWord::BetweenSteps { .. } => Reason::BetweenSteps,
    };
    RefusedCommand::new(
        reason,
        format!("the value of `{}` is {why}", label(register)),
    )
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::north::mqtt::harness::model;

    #[test]
    fn registers_are_found_by_code_in_any_case_or_by_name() {
        let model = model();
        for code in ["F007", "f007", "acceleration_time"] {
            assert_eq!(
                write(&model, code, 10.5),
                Ok(RegisterWrite::new(0x020C_u16, 105))
            );
        }
    }

    #[test]
    fn a_value_that_is_a_ratio_of_its_word_is_not_guessed() {
        let mut model = Model::clone(&model());
        for register in model
            .registers
            .iter_mut()
            .filter(|it| it.name == "acceleration_time")
        {
            register.form.per = 4;
        }
        let refused = write(&model, "F007", 10.5).unwrap_err();
        assert_eq!(refused.reason, Reason::NotCapable);
        assert!(
            refused.message.contains("write its word by Modbus TCP"),
            "{}",
            refused.message
        );
    }

    #[test]
    fn refusals_name_what_is_near_or_right() {
        let model = model();
        let message = |code, value| write(&model, code, value).unwrap_err().message;
        assert_eq!(
            message("F0007", 1.0),
            "the drive has no parameter `F0007`; is it `F007`?"
        );
        assert!(message("run_command", 1.0).ends_with("`run/set`"));
        assert!(message("frequency_command", 1.0).ends_with("`frequency/set`"));
        assert_eq!(
            message("F007", -1.0),
            "the value of `F007` is outside 0.0 to 6553.5"
        );
        assert_eq!(
            readable(&model, "run_command").unwrap_err().reason,
            Reason::NotCapable
        );
        assert!(message(&"x".repeat(60_000), 1.0).len() < 200);
    }
}
