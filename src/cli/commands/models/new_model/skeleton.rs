//! The text of a new model file: a skeleton with places to fill, or one that begins from another model.

use crate::profile::model::{Model, OrderKind, Register, RegisterRole};
use std::fmt::Write;

/// A model file whose facts are to be filled; `@ID@`, `@VENDOR@` and `@TITLE@` stand for those of the model.
const SKELETON: &str = include_str!("skeleton.toml");
/// Short names of the new model's document, of which one is free.
const DOCUMENTS: [&str; 3] = ["UM", "NEW", "NEWUM"];

/// The maker's name and the product's, as they follow from `id`: `acme-flux-2` is Acme, Flux 2.
pub fn names(id: &str) -> (String, String) {
    let mut parts = id.split('-').map(capitalised);
    let vendor = parts.next().unwrap_or_default();
    let title = parts.collect::<Vec<_>>().join(" ");
    if title.is_empty() {
        (vendor.clone(), vendor)
    } else {
        (vendor, title)
    }
}

/// `part` with its first letter in upper case.
pub(super) fn capitalised(part: &str) -> String {
    let mut chars = part.chars();
    chars
        .next()
        .map(|first| first.to_ascii_uppercase())
        .into_iter()
        .chain(chars)
        .collect()
}

/// The skeleton for `id`, with a place for each fact that a drive needs.
pub fn skeleton(id: &str) -> String {
    let (vendor, title) = names(id);
    SKELETON
        .replace("@ID@", id)
        .replace("@VENDOR@", &vendor)
        .replace("@TITLE@", &title)
}

/// A file for `id` that begins from `base`, with what has to be stated again so that the drive takes orders.
pub fn like(id: &str, base: &Model) -> String {
    let (_, title) = names(id);
    let is_free = |name: &&str| {
        base.documents
            .iter()
            .all(|document| document.name != **name)
    };
    let document = DOCUMENTS.into_iter().find(is_free).unwrap_or("NEWMANUAL");
    let mut text = format!(
        "# A drive that is like another one. Everything that is not said here is taken over from `{base}`, and is `sibling` from\n\
         # then on: what a document of another model says proves nothing for this one. `vfd-gateway models check` lists what is\n\
         # unproven; state again, from a document of this drive, what you have found there.\n\
         # The rules: docs/model-reference.md, \"A file that begins from another model\".\n\n\
         id = \"{id}\"\n\
         vendor = \"{vendor}\"\n\
         title = \"{title}\"\n\
         like = \"{base}\"\n\
         # What this drive does not have:\n\
         # without = [\"run.coast\", \"register.torque\", \"trip.7\"]\n\n\
         [documents]\n\
         {document} = {{ title = \"{vendor} {title} user manual\", kind = \"manual\", of = [\"{id}\"] }}\n\n\
         # The factory setting of this drive:\n\
         # [link]\n\
         # default = {{ baud = 9600, data_bits = 8, parity = \"none\", stop_bits = 1, confidence = \"manual\", source = \"{document} 1\" }}\n",
        base = base.id,
        vendor = base.vendor,
    );
    if base.run.is_none() {
        text.push_str("\n# That model is only read: it has no orders.\n");
        return text;
    }
    text.push_str("\n# Stop, forward and the registers below decide whether the drive takes orders.\n# [run]\n");
    for (kind, key) in [(OrderKind::Stop, "stop"), (OrderKind::Forward, "forward")] {
        let Some((address, fact)) = base.order(kind) else {
            continue;
        };
        let own = base
            .register_for(RegisterRole::RunCommand)
            .is_none_or(|register| register.address != address);
        let place = base
            .registers
            .iter()
            .find(|register| own && register.address == address);
        let place = place
            .map(|register| format!("register = \"{}\", ", register.name))
            .unwrap_or_default();
        let _ = writeln!(
            text,
            "# {key} = {{ {place}value = 0x{:04X}, confidence = \"manual\", source = \"{document} 1\" }}",
            fact.value
        );
    }
    for role in [
        RegisterRole::RunCommand,
        RegisterRole::FrequencyCommand,
        RegisterRole::OutputFrequency,
    ] {
        if let Some(register) = base.register_for(role) {
            stated_again(&mut text, register, document);
        }
    }
    text
}

/// The beginning of a row that replaces `register`.
fn stated_again(text: &mut String, register: &Register, document: &str) {
    let _ = write!(
        text,
        "\n# The row of `{}` ({}) is replaced as a whole; `models show MODEL --toml` prints the one that is taken over.\n\
         # [[register]]\n# name = \"{}\"\n# address = 0x{:04X}\n# confidence = \"manual\"\n# source = \"{document} 1\"\n",
        register.name,
        register.title,
        register.name,
        register.address.number(),
    );
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::profile::check;
    use crate::vendors;

    /// What is filled in: the first of these for the first `"?"`, and so on.
    const FILLED: [&str; 21] = [
        "19200",
        "\"none\"",
        "1",
        "19200",
        "\"none\"",
        "1",
        "\"rtu\"",
        "\"rs485\"",
        "31",
        "0x03, 0x06",
        "8",
        "\"exception\"",
        "5",
        "1",
        "0x2000",
        "0x2001",
        "100",
        "0x2101",
        "100",
        "",
        "",
    ];

    #[test]
    fn what_is_told_of_a_skeleton_is_what_is_to_fill() {
        let text = skeleton("acme-flux-2");
        let problems = check::model(&text).unwrap_err();
        let reported_lines: Vec<_> = problems
            .iter()
            .map(|problem| problem.place_in(&text).0)
            .collect();
        let is_open = |line: &str| {
            !line.starts_with('#') && (line.contains("\"?\"") || line.contains("source = \"UM\""))
        };
        for (number, line) in (1..).zip(text.lines()) {
            let code = line.split(" #").next().unwrap_or_default();
            assert_eq!(
                reported_lines.contains(&number),
                is_open(code),
                "line {number}: {line}\n{problems:#?}"
            );
        }
    }

    #[test]
    fn a_skeleton_that_is_filled_is_sound() {
        let mut text = skeleton("acme-flux-2").replace("source = \"UM\"", "source = \"UM 9\"");
        for filled in FILLED {
            text = text.replacen("\"?\"", filled, 1);
        }
        // The comment on top names the mark.
        let model = check::model(&text).unwrap_or_else(|problems| panic!("{problems:#?}\n{text}"));
        assert_eq!(
            (model.vendor.as_str(), model.title.as_str()),
            ("Acme", "Flux 2")
        );
        assert!(model.may_be_ordered(&[]));
    }

    #[test]
    fn a_file_that_begins_from_another_model_is_sound_and_says_what_to_state_again() {
        let catalog = vendors::catalog();
        for base in catalog.models() {
            let text = like("acme-flux-2", base);
            let joined = catalog.clone().with_texts([("own.toml", text.as_str())]);
            let joined =
                joined.unwrap_or_else(|problems| panic!("{}: {problems:?}\n{text}", base.id));
            let model = joined.find("acme-flux-2").unwrap();
            assert!(
                base.run.is_none() || !model.may_be_ordered(&[]),
                "{}: nothing of it is proven",
                base.id
            );
            for (kind, key) in [
                (OrderKind::Stop, "# stop = "),
                (OrderKind::Forward, "# forward = "),
            ] {
                assert_eq!(
                    text.contains(key),
                    base.order(kind).is_some(),
                    "{}: {key}",
                    base.id
                );
            }
        }
    }
}
