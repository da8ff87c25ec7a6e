//! What a new model file will say of the line, of what moves the motor and of what shows that it does, with its grades, for a
//! last look.

use super::facts::{FactEvidence, FlagFacts, ModelFacts};
use std::fmt::Write;

/// What stands below the rows: what no program can find out.
const NO_CHECK: &str = "\
No check can find a wrong digit, or words that are swapped. Compare each row with the manual now. When the drive is in the
configuration, `vfd-gateway qualify DRIVE` tries the words with the motor in front of you, the stop first.
";

/// The rows of `facts`: the line, orders, flags, registers that the gateway uses, and settings at the panel.
pub fn summary_rows(facts: &ModelFacts) -> String {
    let mut text = format!(
        "\n{} ({} {}). What the file says:\n",
        facts.id, facts.vendor, facts.title
    );
    let mut row = |what: &str, value: &str, evidence: &FactEvidence| {
        let _ = writeln!(
            text,
            "  {what:<28} {value:<10} {:<11} {}",
            evidence.grade(),
            evidence.source()
        );
    };
    match &facts.link {
        Some((link, evidence)) => row("line", &link.to_string(), evidence),
        None => row("line", "not known", &facts.evidence),
    }
    row(
        "words in one read",
        &facts.max_words.0.to_string(),
        &facts.max_words.1,
    );
    let functions: Vec<_> = facts
        .functions
        .0
        .iter()
        .map(|function| format!("{function:02X}"))
        .collect();
    row("functions (hex)", &functions.join(" "), &facts.functions.1);
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
    for register in &facts.registers {
        row(
            &format!("register of {}", register.name),
            &format!("0x{:04X}", register.address),
            &register.evidence,
        );
        if register.unit == "Hz" {
            row(
                "  its raw steps in one hertz",
                &register.scale.to_string(),
                &register.evidence,
            );
        }
    }
    for setup in &facts.setup {
        row(
            &format!("at the panel: {}", setup.code),
            &setup.text,
            &setup.evidence,
        );
    }
    if facts.run.is_some() {
        text + NO_CHECK
    } else {
        text + "  no orders: it is only read\n"
    }
}

#[cfg(test)]
mod tests {
    use super::super::interview::ModelInterview;
    use super::*;
    use crate::cli::tools::questions::PersonQuestions;

    /// The facts of these answers, without a drive on a port.
    fn asked(answers: &[&str]) -> Result<ModelFacts, String> {
        let answers = answers.join("\n") + "\n";
        let questions = PersonQuestions::new(answers.as_bytes());
        let mut interview = ModelInterview {
            questions,
            live: None,
            has_manual: false,
        };
        interview
            .facts("acme-flux-2", "2026-01-31")
            .map_err(|failure| failure.to_string())
    }

    #[test]
    fn every_answer_is_shown_with_the_place_that_was_named_for_it() {
        let answers = [
            "Acme",
            "Flux 2",
            "Manual",
            "19200 8N1 9.1",
            "8 9.3",
            "y 9.4",
            "0x2101 9.6",
            "100 9.7",
            "",
            "",
            "0x2000 9.5",
            "0 9.5",
            "1 9.5",
            "",
            "0x2001 9.5",
            "10",
            "P0-02",
            "run commands: 2",
            "9.8",
            "",
        ];
        let text = summary_rows(&asked(&answers).unwrap());
        for row in [
            "line                         19200 8N1  manual      UM 9.1\n",
            "words in one read            8          manual      UM 9.3\n",
            "functions (hex)              03 06      manual      UM 9.4\n",
            "register of output_frequency 0x2101     manual      UM 9.6, steps 9.7\n",
            "  its raw steps in one hertz 100        manual      UM 9.6, steps 9.7\n",
            "  its raw steps in one hertz 10         manual      UM 9.5\n",
            "at the panel: P0-02          run commands: 2 manual      UM 9.8\n",
        ] {
            assert!(text.contains(row), "no {row}:\n{text}");
        }
        assert!(!text.contains("third-party"), "{text}");
    }

    #[test]
    fn answers_without_a_register_make_no_model() {
        let why = asked(&[""; 9]).unwrap_err();
        assert!(
            why.contains("no register was named") && why.contains("output frequency"),
            "{why}"
        );
    }
}
