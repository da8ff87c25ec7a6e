//! From the text of a model file to a sound model, or to all its problems at once.

mod alias;
mod commit;
mod exchange;
mod keys;
mod link;
mod orders;
mod registers;
mod reset;
mod run;
mod run_word;
mod setup;
mod silence;
mod start;
mod state;
mod status;
mod stop_bits;
mod tables;
mod values;
mod warnings;

use super::file::{ModelFile, WrittenModel};
use super::like::{ModelText, ModelTexts, NoOtherModels, WholeFile};
use super::model::Model;
use crate::domain::problem::Problem;
use crate::toml_file::{KeyLocation, OptionalKey};

/// The model that `text` describes.
///
/// # Errors
/// All problems of the file, by position. A fact must cite one of the file's documents; only a time on the
/// line may be a conservative default instead.
pub fn model(text: &str) -> Result<Model, Vec<Problem>> {
    model_and_id(text, &NoOtherModels).map(|(model, _)| model)
}

/// Like [`model`], with the location of its identifier. The file may begin from one of `sources`.
pub(super) fn model_and_id(
    text: &str,
    sources: &dyn ModelTexts,
) -> Result<(Model, KeyLocation), Vec<Problem>> {
    let mut problems = Vec::new();
    let ready = WholeFile::read(text, sources, &mut problems).and_then(|whole| {
        let mut of_whole = Vec::new();
        let written = WrittenModel::read(whole.document().section(), &mut of_whole);
        compare(&written.file, &mut of_whole);
        of_whole.sort_by_key(|problem| problem.span.start);
        let is_unsound = |base: ModelText<'_>| model_and_id(base.text, sources).is_err();
        let has_taken_over = of_whole.iter().any(|problem| whole.is_taken_over(problem));
        if has_taken_over && whole.base().is_some_and(is_unsound) {
            of_whole.retain(|problem| !whole.is_taken_over(problem));
            problems.extend(whole.base_has_mistakes());
        }
        problems.extend(whole.placed(of_whole));
        Some((written.ready()?, written.head.id?.location))
    });
    problems.sort_by_key(|problem| problem.span.start);
    match ready {
        Some(ready) if problems.is_empty() => Ok(ready),
        _ => Err(problems),
    }
}

/// The rules between the keys of a file.
fn compare(file: &ModelFile, problems: &mut Vec<Problem>) {
    if let Some(link) = &file.link {
        link::check(link, problems);
    }
    if let Some(timing) = &file.timing {
        link::pauses_fit(timing, problems);
    }
    exchange::check(file, problems);
    registers::check(file, problems);
    alias::check(file, problems);
    values::check(file, problems);
    tables::check(file, problems);
    if let OptionalKey::Valid(run) = &file.run {
        run::check(&run.value, &run.location, &file.registers, problems);
    }
    orders::check(file, problems);
    start::check(file, problems);
    state::check(file, problems);
    status::check(file, problems);
    silence::check(file, problems);
    commit::check(file, problems);
    setup::check(file, problems);
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::domain::link::LinkSettings;
    use crate::profile::model::{BasicFact, Confidence};
    use crate::profile::testing::{EVERYTHING, MODEL, golden, problem_lines, told_with};
    use std::time::Duration;

    #[test]
    fn a_sound_file_is_a_model() {
        let model = model(MODEL).unwrap();
        assert_eq!(model.link.factory(), Some(LinkSettings::DEFAULT));
        assert_eq!(model.link.stations.value, 1..=247);
        assert_eq!(model.timing.max_lateness.value, Duration::from_secs(1));
        assert_eq!(model.timing.max_lateness.confidence, Confidence::Default);
        assert_eq!(
            (model.run, model.link.broadcast, model.read.boundary),
            (None, None, None)
        );
        assert_eq!(model.registers[0].source, "IM 4");
    }

    #[test]
    fn all_mistakes_are_reported_at_once() {
        let text = include_str!("../../../../../tests/golden/models/mistakes.toml");
        golden(
            "mistakes.txt",
            &problem_lines(&model(text).unwrap_err(), text),
        );
    }

    #[test]
    fn invalid_toml_is_the_only_problem() {
        let found = told_with(MODEL, "vendor = \"Acme\"", "vendor = ");
        assert!(
            found.starts_with("2:") && found.contains(": not valid TOML: "),
            "{found}"
        );
        assert_eq!(found.lines().count(), 2, "{found}");
    }

    #[test]
    fn an_empty_file_lists_what_a_model_needs() {
        let found = problem_lines(&model("").unwrap_err(), "");
        let keys: Vec<_> = found
            .lines()
            .filter_map(|line| line.strip_prefix("1:1 ")?.split(':').next())
            .collect();
        assert_eq!(
            keys,
            [
                "documents",
                "id",
                "vendor",
                "title",
                "link",
                "timing",
                "functions",
                "read",
                "write"
            ]
        );
    }

    #[test]
    fn sources_are_not_checked_while_the_documents_are_missing() {
        let found = told_with(MODEL, "[documents]\nIM = \"Interface manual\"\n", "");
        assert_eq!(
            found,
            "1:1 documents: `documents` is missing\n    right: a table `documents`\n"
        );
    }

    #[test]
    fn a_fact_is_no_surer_than_the_document_that_states_it() {
        let title = "IM = \"Interface manual\"";
        let facts = MODEL.matches("confidence = \"manual\"").count();
        for (document, what, best) in [
            (
                "kind = \"program\"",
                "a program of this model",
                "third-party",
            ),
            (
                "kind = \"distributor-manual\", of = [\"acme-1\"]",
                "a distributor-manual of this model",
                "second-source",
            ),
        ] {
            let found = told_with(
                MODEL,
                title,
                &format!("IM = {{ title = \"One\", {document} }}"),
            );
            let expected = format!(
                "the source does not support \"manual\": `IM` is {what}\n    right: at best \"{best}\", or another source"
            );
            assert_eq!(found.matches(&expected).count(), facts, "{found}");
            let labelled = MODEL.replace("\"manual\"", &format!("\"{best}\""));
            model(&labelled.replace(title, &format!("IM = {{ title = \"One\", {document} }}")))
                .unwrap();
        }
        let of_both = "IM = { title = \"One\", kind = \"manual\", of = [\"acme-1\", \"acme-2\"] }";
        assert_eq!(
            model(&MODEL.replace(title, of_both)).unwrap().documents[0].of,
            ["acme-1", "acme-2"]
        );
        assert!(
            model(MODEL).unwrap().documents[0].of.is_empty(),
            "a title alone is a manual of this very model"
        );
    }

    #[test]
    fn a_mistyped_id_is_one_mistake() {
        let title = "IM = \"Interface manual\"";
        let of_another = "IM = { title = \"One\", kind = \"addendum\", of = [\"acme-2\"] }";
        let facts = MODEL.matches("confidence = \"manual\"").count();
        let found = told_with(MODEL, title, of_another);
        let expected = format!(
            "id: no document is of `acme-1`, and {facts} facts need one\n    right: `acme-2`, or this one in `of` of its \
             manual\n"
        );
        assert_eq!(found.split_once(' ').unwrap().1, expected);
        let siblings = MODEL
            .replace("\"manual\"", "\"sibling\"")
            .replace(title, of_another);
        let one = siblings.replacen("\"sibling\"", "\"manual\"", 1);
        let found = problem_lines(&model(&one).unwrap_err(), &one);
        assert!(
            found.contains("`IM` is an addendum of acme-2\n    right: at best \"sibling\""),
            "{found}"
        );
        model(&siblings).unwrap();
    }

    #[test]
    fn a_document_says_what_it_is() {
        let title = "IM = \"Interface manual\"";
        for (document, expected) in [
            (
                "IM = { title = \"One\" }",
                "documents.IM.kind: `kind` is missing",
            ),
            (
                "IM = { title = \"One\", kind = \"manuel\" }",
                "documents.IM.kind: `manuel` is not an allowed value",
            ),
            (
                "IM = { title = \"One\", kind = \"manual\", of = [] }",
                "documents.IM.of: is empty",
            ),
            (
                "IM = { title = \"One\", kind = \"manual\", off = 1 }",
                "documents.IM.off: unknown key `off`",
            ),
            ("IM = 1", "documents.IM: must be text"),
        ] {
            let found = told_with(MODEL, title, document);
            assert!(found.contains(expected), "{document}: {found}");
        }
    }

    #[test]
    fn a_second_source_is_independent_of_the_first() {
        let forward = "forward = { value = 0xC400, confidence = \"manual\", source = \"IM 5\"";
        let also = |text: &str| format!("{forward}, also = \"{text}\"");
        let found = model(&EVERYTHING.replace(forward, &also("FN 4"))).unwrap();
        assert_eq!(
            (
                found.second_source("run.forward"),
                found.second_source("run.stop")
            ),
            (Some("FN 4"), None)
        );
        let right = "right: an independent document, or leave it out";
        for (text, expected) in [
            (
                "IM 6",
                format!("run.forward.also: `IM` is the document of `source`\n    {right}"),
            ),
            (
                "MM 6",
                format!(
                    "run.forward.also: `MM` was made from the same as the document of `source`\n    {right}"
                ),
            ),
            (
                "XM 6",
                "run.forward.also: `XM 6` does not cite a place in a declared document".to_owned(),
            ),
            (
                "FN",
                "run.forward.also: `FN` does not cite a place in a declared document".to_owned(),
            ),
        ] {
            let found = told_with(EVERYTHING, forward, &also(text));
            assert!(
                found.contains(&expected) && found.lines().count() == 2,
                "{text}: {found}"
            );
        }
        // Two documents that were made from a third one are one source.
        let twin = "MM = {";
        let twins = EVERYTHING.replace(
            twin,
            &format!("M2 = {{ title = \"x\", kind = \"forum\", made_from = \"IM\" }}\n{twin}"),
        );
        let found = told_with(
            &twins,
            "source = \"FN 4\", also = \"MM 5\"",
            "source = \"M2 4\", also = \"MM 5\"",
        );
        assert!(
            found.contains("run.reverse.also: `MM` was made from the same"),
            "{found}"
        );
        let found = told_with(EVERYTHING, "made_from = \"IM\"", "made_from = \"AM\"");
        assert!(
            found.contains("documents.MM.made_from: there is no document `AM`"),
            "{found}"
        );
        let default = "confidence = \"default\", source = \"cautious\"";
        let found = told_with(EVERYTHING, default, &format!("{default}, also = \"IM 2\""));
        assert!(
            found.contains("timing.reply_timeout_cap.also: a default has no source"),
            "{found}"
        );
    }

    #[test]
    fn second_sources_are_named_by_row() {
        let register = "role = \"frequency-command\"\nmemory = \"ram\"\nrange = [0.0, 400.0]\nconfidence = \"manual\"";
        let text = EVERYTHING.replace(
            register,
            &format!(
                "{}\nalso = \"FN 9\"",
                register.replace("manual", "third-party")
            ),
        );
        let found = model(&text).unwrap();
        let keys: Vec<_> = found
            .second_sources
            .iter()
            .map(|second| second.key.as_str())
            .collect();
        assert_eq!(keys, ["run.reverse", "register.frequency_command"]);
        let described: Vec<_> = found
            .unproven_basics()
            .iter()
            .map(BasicFact::described)
            .collect();
        assert_eq!(
            described,
            ["the frequency command's register (third-party, two independent sources)"]
        );
    }

    #[test]
    fn a_third_party_may_be_cited_but_a_default_only_for_a_time() {
        let fact = "confidence = \"third-party\", source = \"FN 2\"";
        let found = told_with(
            EVERYTHING,
            fact,
            "confidence = \"default\", source = \"FN 2\"",
        );
        assert!(
            found.contains("`default` is allowed for timings only")
                && found.contains("\"third-party\""),
            "{found}"
        );
        assert_eq!(
            model(EVERYTHING)
                .unwrap()
                .quirks
                .decimal_numbers
                .unwrap()
                .confidence,
            Confidence::ThirdParty
        );
    }
}
