//! What a new model file will say of what moves the motor and shows that it does, with its grades, for a last look.

use super::facts::{Evidence, Facts, FlagFacts};
use std::fmt::Write;

/// What stands below the rows: what no program can find out.
const NO_CHECK: &str = "\
No check can find a wrong digit, or words that are swapped. Compare each row with the manual now. When the drive is in the
configuration, `vfd-gateway qualify DRIVE` tries the words with the motor in front of you, the stop first.
";

/// The rows of `facts`: orders, flags, and registers that the gateway uses.
pub fn of(facts: &Facts) -> String {
    let mut text = format!(
        "\n{} ({} {}). What the file says:\n",
        facts.id, facts.vendor, facts.title
    );
    let mut row = |what: &str, value: &str, evidence: &Evidence| {
        let _ = writeln!(
            text,
            "  {what:<28} {value:<8} {:<11} {}",
            evidence.grade(),
            evidence.source()
        );
    };
    for (order, word) in facts.run.iter().flat_map(|run| run.words()) {
        row(order, &format!("0x{:04X}", word.value), &word.evidence);
    }
    for FlagFacts {
        flag,
        mask,
        evidence,
    } in &facts.flags
    {
        row(
            &format!("status shows `{flag}`"),
            &format!("0x{mask:04X}"),
            evidence,
        );
    }
    for register in facts.registers.iter() {
        row(
            &format!("register of {}", register.name),
            &format!("0x{:04X}", register.address),
            &register.evidence,
        );
    }
    if facts.run.is_some() {
        text + NO_CHECK
    } else {
        text + "  no orders: it is only read\n"
    }
}
