//! Files that people write: read, and their problems drawn with the place in the text.

use super::Failure;
use crate::config::{self, Config};
use crate::domain::problem::{Problem, nearest};
use crate::profile::catalog::Catalog;
use crate::profile::model::Model;
use crate::vendors;
use annotate_snippets::{AnnotationKind, Group, Level, Renderer, Snippet};
use std::io::IsTerminal;
use std::path::Path;
use std::sync::Arc;

/// The built-in models.
///
/// # Errors
/// A mistake in a model file that is built in.
pub fn catalog() -> Result<Catalog, Failure> {
    Catalog::from_texts(vendors::texts().iter().copied()).map_err(|problems| {
        let lines: Vec<_> =
            problems.iter().map(|(file, problem)| format!("{file}: {}: {}", problem.key, problem.what)).collect();
        Failure::failed(lines.join("\n"))
    })
}

/// The built-in model called `id`.
///
/// # Errors
/// There is none; the nearest identifier is offered.
pub fn model(id: &str) -> Result<Arc<Model>, Failure> {
    let catalog = catalog()?;
    catalog.find(id).cloned().ok_or_else(|| {
        let hint = nearest(id, catalog.ids()).map(|near| format!("; did you mean {near}?")).unwrap_or_default();
        Failure::wrong(format!("no model is called {id}{hint}"))
    })
}

/// Reads a text file.
///
/// # Errors
/// The system's reason, with the file's name.
pub fn read(path: &Path) -> Result<String, Failure> {
    std::fs::read_to_string(path).map_err(|error| Failure::wrong(format!("{}: {error}", path.display())))
}

/// Reads a configuration.
///
/// # Errors
/// All its problems, drawn.
pub fn configuration(path: &Path) -> Result<Config, Failure> {
    let text = read(path)?;
    config::load(&text, &catalog()?).map_err(|problems| Failure::wrong(draw(path, &text, &problems)))
}

/// Draws the problems of `text`, each with its place, and their number.
#[must_use]
pub fn draw(path: &Path, text: &str, problems: &[Problem]) -> String {
    let file = path.display().to_string();
    let text = &without_secrets(text);
    let renderer = if std::io::stderr().is_terminal() { Renderer::styled() } else { Renderer::plain() };
    let mut drawn: Vec<String> =
        problems.iter().map(|problem| renderer.render(&[group(&file, text, problem)])).collect();
    let count = problems.len();
    drawn.push(format!("{file}: {count} problem{}", if count == 1 { "" } else { "s" }));
    drawn.join("\n\n")
}

/// `text` with stars, byte for byte, in the place of what a slip of the pen may have put there: a password as a value,
/// or before the host of a URL. What is drawn may end in a log.
fn without_secrets(text: &str) -> String {
    let lines = text.split_inclusive('\n').map(|line| {
        let is_password =
            line.trim_start().strip_prefix("password").is_some_and(|rest| rest.trim_start().starts_with('='));
        let secret = if is_password {
            line.find('=').map(|at| at + 1..line.trim_end().len())
        } else {
            line.find("://").and_then(|at| Some(at + 3..line.rfind('@').filter(|end| *end > at + 3)?))
        };
        secret.map_or_else(
            || line.to_owned(),
            |span| format!("{}{}{}", &line[..span.start], "*".repeat(span.len()), &line[span.end..]),
        )
    });
    lines.collect()
}

fn group<'a>(file: &'a str, text: &'a str, problem: &'a Problem) -> Group<'a> {
    let annotation = AnnotationKind::Primary.span(problem.span.clone()).label(problem.key.as_str());
    let place = Snippet::source(text).path(file).annotation(annotation);
    let group = Level::ERROR.primary_title(problem.what.as_str()).element(place);
    match &problem.right {
        Some(right) => group.element(Level::HELP.message(right.as_str())),
        None => group,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn passwords_are_not_drawn() {
        let text = "password = \"hunter2\"\nbroker = \"mqtt://user:hünter@host\" # x\npassword_file = \"/run/pw\"\n";
        let drawn = without_secrets(text);
        assert_eq!(drawn.len(), text.len());
        assert!(!drawn.contains("hunter") && !drawn.contains("user") && !drawn.contains("ünter"), "{drawn}");
        assert!(drawn.contains("@host") && drawn.contains("/run/pw"));
    }
}
