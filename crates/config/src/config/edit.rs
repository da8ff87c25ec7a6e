//! Changes to the text of a configuration file that leave everything else in it as it is: comments, order, layout.
//!
//! A part is inserted as text, at a place that the spans of the parsed file give. Then both texts are parsed and
//! compared: a change that would alter anything else is refused.

use super::written::{NewControl, NewLine};
use std::ops::Range;
use toml::de::{DeTable, DeValue};
use toml::{Table, Value};

/// A changed text.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct EditedText {
    /// All of it.
    pub text: String,
    /// What was inserted, in bytes.
    pub added: Range<usize>,
}

/// Why a text cannot be changed. Then a person has to do it.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum CannotEdit {
    /// It is no TOML.
    #[error("the file is not valid TOML: {0}")]
    NoToml(String),
    /// There is no such drive.
    #[error("the file has no drive `{0}`")]
    NoDrive(String),
    /// The drive has a control section already.
    #[error("the drive `{0}` has a [line.drive.control] already; change it in the file")]
    HasControl(String),
    /// Lines or drives are written in a way that leaves no place for more.
    #[error(
        "the file writes `{0}` inline, not under a header of its own; add this in the file: {1}"
    )]
    Inline(&'static str, String),
    /// The change would alter something else.
    #[error("in this file the change would alter something else; add this in the file: {0}")]
    Alters(String),
}

/// `text` with `line` behind its last line.
///
/// # Errors
/// Why it cannot be inserted.
pub fn with_line(text: &str, line: &NewLine) -> Result<EditedText, CannotEdit> {
    let parsed = parsed(text)?;
    let part = line.text();
    let place = match parsed.get("line").map(|value| value.get_ref()) {
        None => text.len(),
        Some(DeValue::Array(lines)) => {
            let last = lines
                .iter()
                .last()
                .filter(|last| is_header(text, last.span()));
            let last = last.ok_or_else(|| CannotEdit::Inline("line", part.clone()))?;
            end_of(text, &parsed, "line", last.span().start)
        }
        Some(_) => return Err(CannotEdit::Inline("line", part)),
    };
    let edited = inserted(text, place, &part);
    let without = |new: &mut Table| {
        let lines = new.get_mut("line").and_then(Value::as_array_mut);
        let is_empty = lines.is_none_or(|lines| lines.pop().is_none() || lines.is_empty());
        if is_empty && !parsed.contains_key("line") {
            new.remove("line");
        }
    };
    alters_nothing(text, edited, without, part)
}

/// `text` with `control` for the drive called `name`.
///
/// # Errors
/// Why it cannot be inserted.
pub fn with_control(
    text: &str,
    name: &str,
    control: &NewControl,
) -> Result<EditedText, CannotEdit> {
    let parsed = parsed(text)?;
    let part = control.text();
    let (place, drive) =
        drive_of(&parsed, name).ok_or_else(|| CannotEdit::NoDrive(name.to_owned()))?;
    let DeValue::Table(keys) = drive.get_ref() else {
        return Err(CannotEdit::NoDrive(name.to_owned()));
    };
    if keys.contains_key("control") {
        return Err(CannotEdit::HasControl(name.to_owned()));
    }
    if !is_header(text, drive.span()) {
        return Err(CannotEdit::Inline("drive", part));
    }
    let edited = inserted(
        text,
        end_of(text, &parsed, "line.drive", drive.span().start),
        &part,
    );
    let without = |new: &mut Table| {
        let drive = new
            .get_mut("line")
            .and_then(|lines| lines.get_mut(place.0)?.get_mut("drive")?.get_mut(place.1));
        if let Some(drive) = drive.and_then(Value::as_table_mut) {
            drive.remove("control");
        }
    };
    alters_nothing(text, edited, without, part)
}

fn parsed(text: &str) -> Result<DeTable<'_>, CannotEdit> {
    let parsed =
        DeTable::parse(text).map_err(|error| CannotEdit::NoToml(error.message().to_owned()))?;
    Ok(parsed.into_inner())
}

type SpannedValue<'a> = toml::Spanned<DeValue<'a>>;

/// The drive called `name`, with the indexes of its line and of it.
fn drive_of<'t, 'a>(
    file: &'t DeTable<'a>,
    name: &str,
) -> Option<((usize, usize), &'t SpannedValue<'a>)> {
    let lines = file.get("line")?.get_ref().as_array()?;
    lines.iter().enumerate().find_map(|(line, table)| {
        let drives = table
            .get_ref()
            .as_table()?
            .get("drive")?
            .get_ref()
            .as_array()?;
        let is_it = |drive: &SpannedValue<'a>| {
            drive
                .get_ref()
                .as_table()
                .and_then(|keys| keys.get("name")?.get_ref().as_str())
                == Some(name)
        };
        let at = drives.iter().position(is_it)?;
        Some(((line, at), drives.get(at)?))
    })
}

/// Whether the table at `span` has a header, so that more can follow.
fn is_header(text: &str, span: Range<usize>) -> bool {
    text.get(span).is_some_and(|it| it.starts_with("[["))
}

/// The end of the section at `path` whose header is at `start`: behind its last line that is neither empty nor a comment,
/// because a comment in front of a header belongs to that.
fn end_of(text: &str, file: &DeTable<'_>, path: &str, start: usize) -> usize {
    let mut headers = Vec::new();
    collect(text, file, "", &mut headers);
    let inner = format!("{path}.");
    let next = headers
        .iter()
        .filter(|(at, of)| *at > start && !of.starts_with(&inner))
        .map(|(at, _)| *at)
        .min();
    let end = next.map_or(text.len(), |at| {
        text.get(..at)
            .and_then(|it| it.rfind('\n'))
            .map_or(at, |it| it + 1)
    });
    let mut place = start;
    let mut at = 0;
    for line in text.get(..end).unwrap_or(text).split_inclusive('\n') {
        at += line.len();
        let said = line.trim();
        if at > start && !said.is_empty() && !said.starts_with('#') {
            place = at;
        }
    }
    place
}

/// The place and path of every header of `table`.
fn collect(text: &str, table: &DeTable<'_>, path: &str, headers: &mut Vec<(usize, String)>) {
    for (key, value) in table {
        let path = if path.is_empty() {
            key.get_ref().to_string()
        } else {
            format!("{path}.{}", key.get_ref())
        };
        let has_header =
            |value: &SpannedValue<'_>| text.get(value.span()).is_some_and(|it| it.starts_with('['));
        match value.get_ref() {
            DeValue::Table(inner) => {
                if has_header(value) {
                    headers.push((value.span().start, path.clone()));
                }
                collect(text, inner, &path, headers);
            }
            DeValue::Array(rows) => {
                for row in rows {
                    let DeValue::Table(inner) = row.get_ref() else {
                        continue;
                    };
                    if is_header(text, row.span()) {
                        headers.push((row.span().start, path.clone()));
                    }
                    collect(text, inner, &path, headers);
                }
            }
            _ => (),
        }
    }
}

/// `part` in `text` at `place`, with the line ends of the text.
fn inserted(text: &str, place: usize, part: &str) -> EditedText {
    let (before, after) = text.split_at_checked(place).unwrap_or((text, ""));
    let end = if text.contains("\r\n") { "\r\n" } else { "\n" };
    let mut new = before.to_owned();
    if !new.is_empty() && !new.ends_with('\n') {
        new.push_str(end);
    }
    // A file that begins with the part needs no empty line before it.
    let part = if new.is_empty() {
        part.trim_start()
    } else {
        part
    };
    let start = new.len();
    new.push_str(&part.replace('\n', end));
    let added = start..new.len();
    new.push_str(after);
    EditedText { text: new, added }
}

/// `edited` if it differs from `text` only by what `without` takes out.
fn alters_nothing(
    text: &str,
    edited: EditedText,
    without: impl FnOnce(&mut Table),
    part: String,
) -> Result<EditedText, CannotEdit> {
    let (Ok(old), Ok(mut new)) = (text.parse::<Table>(), edited.text.parse::<Table>()) else {
        return Err(CannotEdit::Alters(part));
    };
    if old == new {
        return Err(CannotEdit::Alters(part));
    }
    without(&mut new);
    if old == new {
        Ok(edited)
    } else {
        Err(CannotEdit::Alters(part))
    }
}
