//! User-written files: read, and their problems rendered with their place in the text.

use super::CommandFailure;
use super::output::few;
use super::own_models::{ModelDirs, OwnModels};
use crate::config::qualified::QualifiedResults;
use crate::config::{self, Config};
use crate::daemon::commissioning::JudgedConfig;
use crate::daemon::host::user_files;
use crate::daemon::qualified_file;
use crate::domain::problem::{Problem, alternatives, nearest_names};
use crate::profile::catalog::Catalog;
use crate::profile::model::Model;
use crate::toml_file::LocatedValue;
use crate::vendors;
use annotate_snippets::{AnnotationKind, Group, Level, Renderer, Snippet};
use std::io::IsTerminal;
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// The built-in models and the operator's own in `dirs`.
///
/// # Errors
/// All problems of all their files, rendered, and what cannot be read.
pub fn catalog_with(dirs: &ModelDirs) -> Result<Catalog, CommandFailure> {
    joined(&own_models(dirs)?)
}

/// The operator's own models in `dirs`.
///
/// # Errors
/// What cannot be read.
pub fn own_models(dirs: &ModelDirs) -> Result<OwnModels, CommandFailure> {
    let mut own = OwnModels::default();
    let unread: Vec<_> = dirs
        .dirs
        .iter()
        .flat_map(|dir| own.read_dir(dir))
        .map(|unread| unread.what)
        .collect();
    if unread.is_empty() {
        Ok(own)
    } else {
        Err(CommandFailure::wrong(unread.join("\n")))
    }
}

/// The built-in models and those of `own`.
///
/// # Errors
/// All problems of all files of `own`, rendered.
pub fn joined(own: &OwnModels) -> Result<Catalog, CommandFailure> {
    join(vendors::catalog(), own).map_err(|found| CommandFailure::wrong(drawn(&found)))
}

/// `catalog` with the models of `own`, or the problems of each file.
fn join(catalog: Catalog, own: &OwnModels) -> Result<Catalog, Vec<FileFindings>> {
    let texts = own
        .files()
        .map(|(path, text)| (path.display().to_string(), text));
    catalog.with_texts(texts).map_err(|problems| {
        let found = own.files().map(|(path, text)| {
            let name = path.display().to_string();
            let of_file = problems
                .iter()
                .filter(|(file, _)| *file == name)
                .map(|(_, problem)| problem.clone());
            FileFindings {
                path: path.to_owned(),
                text: text.to_owned(),
                problems: of_file.collect(),
            }
        });
        found.filter(|found| !found.problems.is_empty()).collect()
    })
}

/// The findings in one file.
#[derive(Clone, Debug)]
pub struct FileFindings {
    /// The file.
    pub path: PathBuf,
    /// Its content.
    pub text: String,
    /// Its problems, in the order of the text.
    pub problems: Vec<Problem>,
}

/// Each file with its problems, rendered.
#[must_use]
pub fn drawn(found: &[FileFindings]) -> String {
    let drawn: Vec<_> = found
        .iter()
        .map(|it| draw(&it.path, &it.text, &it.problems))
        .collect();
    drawn.join("\n\n")
}

/// The model called `id`, a built-in one or one in `dirs`.
///
/// # Errors
/// There is none; the nearest identifiers are offered. Or see [`catalog_with`].
pub fn model(id: &str, dirs: &ModelDirs) -> Result<Arc<Model>, CommandFailure> {
    let catalog = catalog_with(dirs)?;
    catalog
        .find(id)
        .cloned()
        .ok_or_else(|| no_model(id, &catalog))
}

/// The model called `id` as one complete file.
///
/// # Errors
/// As [`model`].
pub fn model_text(id: &str, dirs: &ModelDirs) -> Result<String, CommandFailure> {
    let catalog = catalog_with(dirs)?;
    catalog.text_of(id).ok_or_else(|| no_model(id, &catalog))
}

/// The configuration in `text`, which is in no file.
///
/// # Errors
/// All its problems, a line each.
pub fn config_of(text: &str, catalog: &Catalog) -> Result<Config, CommandFailure> {
    config::load(text, catalog).map_err(|problems| {
        let listed = problems.iter().map(|problem| {
            let right = problem
                .right
                .as_ref()
                .map(|right| format!("; help: {right}"))
                .unwrap_or_default();
            format!("{}: {}{right}", problem.key, problem.what)
        });
        CommandFailure::wrong(listed.collect::<Vec<_>>().join("\n"))
    })
}

fn no_model(id: &str, catalog: &Catalog) -> CommandFailure {
    let near: Vec<_> = nearest_names(id, catalog.ids())
        .into_iter()
        .map(str::to_owned)
        .collect();
    let hint = match alternatives(&near) {
        near if near.is_empty() => "`vfd-gateway models list` shows all of them".to_owned(),
        near => format!("did you mean {near}?"),
    };
    CommandFailure::wrong(format!("no model is called {id}; {hint}"))
}

/// Reads a text file of at most 1 MiB.
///
/// # Errors
/// The reason of the system or of [`user_files::text`], with the file's name.
pub fn read(path: &Path) -> Result<String, CommandFailure> {
    user_files::text(path, user_files::BYTES_MAX)
        .map_err(|error| CommandFailure::wrong(format!("{}: {error}", path.display())))
}

/// Reads a configuration, and the operator's own models that it names.
///
/// # Errors
/// All its problems and those of the model files, rendered.
pub fn configuration(path: &Path) -> Result<Config, CommandFailure> {
    let loaded = looked_through(path)?.0;
    loaded.map_err(|found| CommandFailure::wrong(drawn(&found)))
}

/// Reads a configuration as [`configuration`] does: its content, or all its problems and those of the model files. Its
/// text is returned with it.
///
/// # Errors
/// It cannot be read.
pub fn looked_through(
    path: &Path,
) -> Result<(Result<Config, Vec<FileFindings>>, String), CommandFailure> {
    let text = read(path)?;
    let built_in = vendors::catalog();
    let (own, mut problems) = own_models_of(&config::model_dirs(&text));
    let of_this = |problems| FileFindings {
        path: path.to_owned(),
        text: text.clone(),
        problems,
    };
    let (catalog, mut found) = match join(built_in.clone(), &own) {
        Ok(catalog) if problems.is_empty() => {
            let site = tried_at_site(&text);
            let site = site.as_ref().map_err(String::as_str);
            let loaded = config::load_at_site(&text, &catalog, site)
                .map_err(|problems| vec![of_this(problems)]);
            return Ok((loaded, text));
        }
        Ok(catalog) => (catalog, Vec::new()),
        Err(found) => (built_in, found),
    };
    problems.extend(config::problems_without_some_models(&text, &catalog));
    problems.sort_by_key(|problem| problem.span.start);
    found.extend((!problems.is_empty()).then(|| of_this(problems)));
    Ok((Err(found), text))
}

/// What `text` would be as the configuration in the file at `path`.
///
/// # Errors
/// The operator's own models cannot be used.
pub fn judged(path: &Path, text: &str) -> Result<JudgedConfig, CommandFailure> {
    let (own, problems) = own_models_of(&config::model_dirs(text));
    if !problems.is_empty() {
        return Err(CommandFailure::wrong(draw(path, text, &problems)));
    }
    let catalog = joined(&own)?;
    let site = tried_at_site(text);
    let config = config::load_at_site(text, &catalog, site.as_ref().map_err(String::as_str));
    Ok(JudgedConfig { catalog, config })
}

/// What was tried at the drives of the configuration in `text`: nothing without a data directory or a file in it.
fn tried_at_site(text: &str) -> Result<QualifiedResults, String> {
    config::data_dir(text).map_or_else(
        || Ok(QualifiedResults::default()),
        |dir| qualified_file::read(&dir),
    )
}

/// The model files in `dirs`, each once, and what cannot be read, at the place where the directory is named.
fn own_models_of(dirs: &[LocatedValue<PathBuf>]) -> (OwnModels, Vec<Problem>) {
    let mut own = OwnModels::default();
    let mut problems = Vec::new();
    for (
        at,
        LocatedValue {
            value: dir,
            location,
        },
    ) in dirs.iter().enumerate()
    {
        if dirs.iter().take(at).any(|earlier| earlier.value == *dir) {
            continue;
        }
        let unread = own.read_dir(dir);
        problems.extend(
            unread
                .into_iter()
                .map(|it| location.problem(it.what).right(it.right)),
        );
    }
    (own, problems)
}

/// Most lines that are named for a problem that is there several times.
const LINES_MAX: usize = 5;

/// Renders the problems of `text`, each with its place, equal ones once, and their number.
#[must_use]
pub fn draw(path: &Path, text: &str, problems: &[Problem]) -> String {
    let file = path.display().to_string();
    let text = &config::without_secrets(text);
    let renderer = if std::io::stderr().is_terminal() {
        Renderer::styled()
    } else {
        Renderer::plain()
    };
    let mut drawn: Vec<String> = folded(problems)
        .iter()
        .map(|(problem, equal)| {
            renderer.render(&[group(&file, text, problem, same_in(text, equal).as_deref())])
        })
        .collect();
    let warnings = problems.iter().filter(|problem| problem.is_warning).count();
    let counts = [
        (problems.len() - warnings, "problem"),
        (warnings, "warning"),
    ];
    let counts = counts.into_iter().filter(|(count, _)| *count > 0);
    let counts =
        counts.map(|(count, what)| format!("{count} {what}{}", if count == 1 { "" } else { "s" }));
    drawn.push(format!("{file}: {}", counts.collect::<Vec<_>>().join(", ")));
    drawn.join("\n\n")
}

/// Each problem, with those that say the same of the same key in other tables of a list.
fn folded(problems: &[Problem]) -> Vec<(&Problem, Vec<&Problem>)> {
    let without_places = |key: &str| {
        key.chars()
            .filter(|c| !c.is_ascii_digit())
            .collect::<String>()
    };
    let said = |problem: &Problem| {
        (
            problem.is_warning,
            without_places(&problem.key),
            problem.what.clone(),
            problem.right.clone(),
        )
    };
    let mut folded: Vec<(&Problem, Vec<&Problem>)> = Vec::new();
    for problem in problems {
        match folded
            .iter_mut()
            .find(|(first, _)| said(first) == said(problem))
        {
            Some((_, equal)) => equal.push(problem),
            None => folded.push((problem, Vec::new())),
        }
    }
    folded
}

/// Where else a problem is; `None` if nowhere.
fn same_in(text: &str, equal: &[&Problem]) -> Option<String> {
    let lines: Vec<_> = equal
        .iter()
        .map(|problem| problem.place_in(text).0.to_string())
        .collect();
    let what = if lines.len() == 1 { "line" } else { "lines" };
    (!lines.is_empty()).then(|| format!("the same in {what} {}", few(&lines, LINES_MAX)))
}

fn group<'a>(
    file: &'a str,
    text: &'a str,
    problem: &'a Problem,
    same: Option<&'a str>,
) -> Group<'a> {
    let annotation = AnnotationKind::Primary
        .span(problem.span.clone())
        .label(problem.key.as_str());
    let location = Snippet::source(text).path(file).annotation(annotation);
    let level = if problem.is_warning {
        Level::WARNING
    } else {
        Level::ERROR
    };
    let group = level.primary_title(problem.what.as_str()).element(location);
    let help = problem
        .right
        .iter()
        .map(|right| Level::HELP.message(right.as_str()));
    let note = same.map(|same| Level::NOTE.message(same));
    help.chain(note).fold(group, Group::element)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::daemon::testing::Dir;

    #[test]
    fn what_is_no_file_or_much_too_long_is_not_read() {
        let dir = Dir::new();
        let long = dir.join("long");
        std::fs::File::create(&long)
            .unwrap()
            .set_len(user_files::BYTES_MAX + 1)
            .unwrap();
        for (path, why) in [
            (&*dir, "a regular file is needed"),
            (&*long, "1048576 bytes are the most"),
        ] {
            for failure in [read(path).err(), configuration(path).err()] {
                let text = failure.unwrap().to_string();
                assert!(
                    text.contains(why) && text.contains(&path.display().to_string()),
                    "{text}"
                );
            }
        }
    }

    #[test]
    fn thirty_two_equal_problems_are_drawn_once() {
        let drive = |station: u32| {
            format!(
                "[[line.drive]]\nname = \"p{station}\"\nmodel = \"hyundai-n7000\"\nstation = {station}\n"
            )
        };
        let drives: String = (1..=32).map(drive).collect();
        let text = format!("[[line]]\nname = \"hall\"\nport = \"/dev/ttyUSB0\"\n{drives}");
        let problems = config::load(&text, &vendors::catalog()).unwrap_err();
        let drawn = draw(Path::new("plant.toml"), &text, &problems);
        assert_eq!(drawn.matches("-->").count(), 1, "{drawn}");
        assert!(
            drawn.contains("the same in lines 10, 14, 18, 22, 26 and 26 more"),
            "{drawn}"
        );
        assert!(drawn.ends_with("plant.toml: 32 problems"), "{drawn}");
    }

    #[test]
    fn the_problems_of_any_text_can_be_drawn() {
        let catalog = vendors::catalog();
        let problems_of = |folder, text: &str| match folder {
            "config" => config::load(text, &catalog).err().unwrap_or_default(),
            _ => crate::profile::check::model(text).err().unwrap_or_default(),
        };
        let mut drawn = 0;
        for folder in ["config", "model"] {
            let corpus = Path::new(env!("CARGO_MANIFEST_DIR"))
                .join("fuzz/corpus")
                .join(folder);
            for entry in std::fs::read_dir(corpus).unwrap() {
                let path = entry.unwrap().path();
                let Ok(text) = read(&path) else { continue };
                let problems = problems_of(folder, &text);
                let errors = problems
                    .iter()
                    .filter(|problem| !problem.is_warning)
                    .count();
                let drawn_problems = draw(&path, &text, &problems);
                assert!(
                    errors == 0 || drawn_problems.contains(&format!("{errors} problem")),
                    "{drawn_problems}"
                );
                drawn += problems.len();
            }
        }
        assert!(drawn > 100, "{drawn} problems");
    }
}
