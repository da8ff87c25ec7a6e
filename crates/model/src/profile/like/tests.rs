//! Tests of files that begin from another one.

use crate::domain::problem::Problem;
use crate::profile::catalog::Catalog;
use crate::profile::check;
use crate::profile::model::{Confidence, Model};
use crate::profile::summary::summary;
use crate::profile::testing::{EVERYTHING, MODEL, golden};
use crate::toml_file::{document, written};
use crate::vendors;

const LIKE: &str = include_str!("../../../../../tests/golden/models/like.toml");

/// The model `id` of the files `texts`, whose names are their places in the list.
fn model_among(id: &str, texts: &[&str]) -> Model {
    let catalog =
        catalog(texts).unwrap_or_else(|problems| panic!("{}", problem_lines(texts, &problems)));
    (**catalog.find(id).unwrap()).clone()
}

fn catalog(texts: &[&str]) -> Result<Catalog, Vec<(String, Problem)>> {
    Catalog::from_texts(
        named(texts)
            .iter()
            .map(|(file, text)| (file.as_str(), *text)),
    )
}

fn named<'t>(texts: &[&'t str]) -> Vec<(String, &'t str)> {
    texts
        .iter()
        .enumerate()
        .map(|(at, text)| (format!("{at}.toml"), *text))
        .collect()
}

/// A line per problem: file, line, key, what is wrong, what would be right.
fn problem_lines(texts: &[&str], problems: &[(String, Problem)]) -> String {
    let lines = problems.iter().map(|(file, problem)| {
        let (_, text) = *named(texts).iter().find(|(name, _)| name == file).unwrap();
        let line = problem.place_in(text).0;
        let right = problem.right.as_deref().unwrap_or("-");
        format!(
            "{file}:{line} {}: {} -> {right}\n",
            problem.key, problem.what
        )
    });
    lines.collect()
}

fn refused(texts: &[&str]) -> String {
    problem_lines(texts, &catalog(texts).unwrap_err())
}

/// A file that begins from [`MODEL`], with `more`.
fn like_one(more: &str) -> String {
    format!("id = \"acme-2\"\ntitle = \"Two\"\nlike = \"acme-1\"\n{more}")
}

#[test]
fn a_file_says_what_differs_from_another_one() {
    for texts in [[EVERYTHING, LIKE], [LIKE, EVERYTHING]] {
        golden("like.txt", &summary(&model_among("acme-like", &texts)));
    }
}

#[test]
fn what_is_taken_over_is_graded_for_the_new_model() {
    let model = model_among("acme-like", &[EVERYTHING, LIKE]);
    let run = model.run.as_ref().unwrap();
    assert_eq!(run.stop.confidence, Confidence::Manual, "its own");
    assert_eq!(
        run.forward.confidence,
        Confidence::Sibling,
        "`IM` is a manual of the other one"
    );
    assert_eq!(
        run.reverse.as_ref().unwrap().confidence,
        Confidence::ThirdParty,
        "`FN` is of both, but is no surer there"
    );
    assert_eq!(
        run.reset.as_ref().unwrap().confidence,
        Confidence::Inferred,
        "worse than a sibling"
    );
    assert_eq!(model.timing.max_lateness.confidence, Confidence::Default);
    let documents: Vec<_> = model
        .documents
        .iter()
        .map(|it| (it.name.as_str(), it.is_of("acme-like")))
        .collect();
    assert_eq!(
        documents,
        [("FN", true), ("IM", false), ("LM", true), ("MM", false)]
    );
    assert!(
        model
            .unproven_basics()
            .iter()
            .any(|basic| basic.what == "forward"),
        "it has to be accepted"
    );
}

#[test]
fn a_file_may_begin_from_one_that_begins_from_another() {
    let two = like_one("");
    let three = "id = \"acme-3\"\ntitle = \"Three\"\nvendor = \"Bcme\"\nlike = \"acme-2\"\n";
    let model = model_among("acme-3", &[three, &two, MODEL]);
    assert_eq!((model.vendor.as_str(), model.registers.len()), ("Bcme", 1));
    assert_eq!(model.registers[0].confidence, Confidence::Sibling);
    assert_eq!(model.documents[0].of, ["acme-1"]);
}

#[test]
fn a_circle_is_refused_and_so_is_a_long_way() {
    let circle = "id = \"acme-3\"\nlike = \"acme-2\"\n";
    let two = like_one("").replace("acme-1", "acme-3");
    assert_eq!(
        refused(&[&two, circle]),
        "0.toml:3 like: 1.toml, line 2: leads back to itself: acme-2, acme-3, acme-2 -> \
         a model that begins from another one; or `without`\n\
         1.toml:2 like: 0.toml, line 3: leads back to itself: acme-3, acme-2, acme-3 -> \
         a model that begins from another one; or `without`\n"
    );
    let own = like_one("").replace("acme-1", "acme-2");
    assert!(refused(&[&own]).starts_with("0.toml:3 like: leads back to itself: acme-2, acme-2"));
    let link = |at: u8| {
        format!(
            "id = \"acme-{at}\"\ntitle = \"{at}\"\nlike = \"acme-{}\"\n",
            at - 1
        )
    };
    let mut texts = vec![MODEL.to_owned()];
    texts.extend((2..=5).map(link));
    let all = |texts: &[String]| {
        catalog(&texts.iter().map(String::as_str).collect::<Vec<_>>()).map(|_| ())
    };
    all(&texts).unwrap();
    texts.push(link(6));
    let problems = all(&texts).unwrap_err();
    assert_eq!(problems.len(), 1, "{problems:?}");
    assert!(
        problems[0]
            .1
            .what
            .contains("begins from more than 4 models"),
        "{problems:?}"
    );
}

#[test]
fn mistakes_in_what_is_named_are_reported() {
    for (more, expected) in [
        (
            "without = [\"register.output_frequencie\"]\n",
            "0.toml:4 without[0]: `acme-1` has no `register.output_frequencie` -> \"register.output_frequency\"\n",
        ),
        (
            "without = [\"link.default.parity\"]\n",
            "0.toml:4 without[0]: `acme-1` has no `link.default.parity` -> a table, a key or a row of it, as \"watchdog\", \"run.coast\" or \"trip.7\"\n",
        ),
        (
            "without = [\"trip.7\"]\n",
            "0.toml:4 without[0]: `acme-1` has no `trip.7` -> a table, a key or a row of it, as \"watchdog\", \"run.coast\" or \"trip.7\"\n",
        ),
        (
            "without = [7]\n",
            "0.toml:4 without[0]: must be text, not a whole number -> text, not empty\n",
        ),
        (
            "[documents]\nIM = \"Another one\"\n",
            "0.toml:5 documents.IM: in `acme-1`, `IM` is another document: Interface manual -> another short name\n",
        ),
        (
            "[documents]\nIM = { title = \"Interface manual\", kind = \"forum\", of = [\"acme-1\"] }\n",
            "0.toml:5 documents.IM: in `acme-1`, `IM` is another document: Interface manual -> another short name\n",
        ),
        (
            "[documents]\nIM = \"Interface manual\"\n",
            "0.toml:5 documents.IM: `IM` is a document of `acme-1`; it does not say whether of this model -> `of` with all models that it is about, or leave it out\n",
        ),
    ] {
        assert_eq!(refused(&[&like_one(more), MODEL]), expected, "{more}");
    }
    let unknown = like_one("").replace("acme-1", "acme-11");
    assert_eq!(
        refused(&[&unknown, MODEL]),
        "0.toml:3 like: there is no model `acme-11` -> `acme-1` or `acme-2`\n"
    );
    let alone = MODEL.replacen("vendor", "without = [\"trip.7\"]\nvendor", 1);
    assert_eq!(
        refused(&[&alone]),
        "0.toml:2 without: there is nothing to leave out -> `like`, the model that this file begins from\n"
    );
}

#[test]
fn mistakes_in_what_is_taken_over_are_reported_with_file_and_line() {
    let register = "[documents]\nLM = \"Mine\"\n[[register]]\nname = \"status\"\ntitle = \"Status\"\naddress = 0x0101\nunit = \"-\"\n\
                    access = \"read\"\nconfidence = \"manual\"\nsource = \"LM 1\"\n";
    let line = MODEL
        .lines()
        .position(|line| line.starts_with("address"))
        .unwrap()
        + 1;
    assert_eq!(
        refused(&[&like_one(register), MODEL]),
        format!(
            "0.toml:3 like: 1.toml, line {line}: address 0x0101 is taken by register[0].address -> \
             one that no other register of the model uses; or `without`\n"
        )
    );
    // A mistake of the file itself is where it is, beside one of what is taken over.
    let both = register.replace("unit = \"-\"", "unit = \"Hertz\"");
    let found = refused(&[&like_one(&both), MODEL]);
    assert_eq!(found.lines().count(), 2, "{found}");
    assert!(
        found.contains("0.toml:10 register[0].unit: `Hertz` is not an allowed value"),
        "{found}"
    );
    // What is wrong by itself is reported once, in its own file.
    let unsound = MODEL.replace("scale = 100", "scale = 0");
    assert_eq!(
        refused(&[&like_one(""), &unsound]),
        "0.toml:3 like: 1.toml has mistakes of its own -> a model without mistakes\n\
         1.toml:38 register[0].scale: 0 is out of range -> a whole number from 1 to 1000000\n"
            .replace(":38", &format!(":{}", line + 1))
    );
    let no_toml = format!("{MODEL}x =");
    let found = refused(&[
        &like_one("").replace("acme-1", "acme-4"),
        &no_toml.replace("acme-1", "acme-4"),
    ]);
    assert!(
        found.contains("there is no model `acme-4`") && found.contains("not valid TOML"),
        "{found}"
    );
}

#[test]
fn a_fact_is_replaced_whole_and_never_mixed_from_two_sources() {
    let register = "[documents]\nLM = \"Mine\"\n[[register]]\nname = \"output_frequency\"\naddress = 0x0102\n\
                    confidence = \"manual\"\nsource = \"LM 1\"\n";
    let found = refused(&[&like_one(register), MODEL]);
    for missing in ["title", "unit", "access"] {
        assert!(
            found.contains(&format!("register[0].{missing}: `{missing}` is missing")),
            "{found}"
        );
    }
    let fact = "[documents]\nLM = \"Mine\"\n[link]\nbauds = { value = [4800] }\n";
    assert!(
        refused(&[&like_one(fact), MODEL])
            .contains("link.bauds.confidence: `confidence` is missing")
    );
}

#[test]
fn a_printed_model_is_the_same_model() {
    let built_in = vendors::catalog();
    let mut texts: Vec<_> = built_in
        .ids()
        .filter_map(|id| built_in.text_of(id))
        .collect();
    for entry in std::fs::read_dir(concat!(
        env!("CARGO_MANIFEST_DIR"),
        "/../../tests/golden/models"
    ))
    .unwrap()
    {
        let path = entry.unwrap().path();
        texts.extend(
            path.extension()
                .is_some_and(|it| it == "toml")
                .then(|| std::fs::read_to_string(path).unwrap()),
        );
    }
    let models: Vec<_> = texts
        .iter()
        .filter_map(|text| Some((text, check::model(text).ok()?)))
        .collect();
    assert!(
        models.len() >= vendors::texts().len() + 2,
        "{}",
        models.len()
    );
    for (text, model) in models {
        let printed = written::text_of(&document(text, &mut Vec::new()).unwrap().into_table());
        assert_eq!(check::model(&printed).as_ref(), Ok(&model), "{printed}");
    }
    let catalog = catalog(&[EVERYTHING, LIKE]).unwrap();
    assert_eq!(
        catalog.text_of("acme-everything").as_deref(),
        Some(EVERYTHING),
        "with its comments"
    );
    let whole = catalog.text_of("acme-like").unwrap();
    let listed = Model {
        digest: 0,
        ..Model::clone(catalog.find("acme-like").unwrap())
    };
    assert_eq!(check::model(&whole), Ok(listed), "{whole}");
    assert_eq!(catalog.text_of("acme-none"), None);
}

/// The text between two of the marks of `deploy/adding-a-drive.md`, without what is not TOML.
fn of_the_guide(from: &str, to: &str) -> String {
    let text = include_str!("../../../../../deploy/adding-a-drive.md");
    let (_, rest) = text.split_once(from).unwrap();
    let (part, _) = rest.split_once(to).unwrap_or((rest, ""));
    part.split("```toml\n")
        .skip(1)
        .map(|block| block.split_once("```").unwrap().0)
        .collect::<Vec<_>>()
        .join("\n")
}

#[test]
fn the_example_of_the_guide_is_sound() {
    let model = of_the_guide("# Adding a drive", "\n## Checking it\n");
    let like = of_the_guide("\n## A drive that is like another one\n", "\n## ");
    let model = model_among("acme-flux-3", &[&model, &like]);
    let codes: Vec<_> = model.trip_codes.iter().map(|trip| trip.code).collect();
    assert_eq!((codes, model.registers.len()), (vec![9, 3], 7));
    assert!(
        !model.may_be_ordered(&[]),
        "a manual of the other drive proves no stop of this one"
    );
}
