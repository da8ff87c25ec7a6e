//! Writing a dump back: the changes are shown first, each value is read back, and the first refusal ends it.

use super::diff::{ParameterChange, RestorePlan, plan};
use super::file::{LeftOut, ParameterDump};
use super::live::{CommitNeed, GatewayDrive, ListedParameter, ParameterCatalogue};
use crate::cli::tools::consent::ask_for_consent;
use crate::cli::tools::progress::ProgressBar;
use crate::cli::tools::setup::table;
use crate::cli::tools::{CommandFailure, print};

/// The user's options.
#[derive(Clone, Copy, Debug)]
pub struct RestoreOptions {
    /// Also write what determines how the drive is reached and which source it obeys.
    pub with_link: bool,
    /// Do not ask.
    pub yes: bool,
    /// Write nothing.
    pub dry_run: bool,
}

/// Makes the drive hold the values of `wanted`.
///
/// # Errors
/// The model differs, the user does not agree, or something was refused: then the message says what was written and
/// what was not.
pub async fn restore(
    wanted: &ParameterDump,
    live: &GatewayDrive,
    wish: RestoreOptions,
) -> Result<(), CommandFailure> {
    let catalogue = live.catalogue().await?;
    if catalogue.model != wanted.model {
        let ours = &catalogue.model;
        let theirs = &wanted.model;
        return Err(CommandFailure::wrong(format!(
            "the dump is of model {theirs}, and {} is {ours}",
            live.drive
        )));
    }
    let of_interest: Vec<_> = catalogue
        .parameters
        .iter()
        .filter(|known| wanted.at(known.address).is_some())
        .cloned()
        .collect();
    let others = wanted
        .parameters
        .iter()
        .filter(|it| catalogue.may_have(it.address));
    let others = others.map(|it| ListedParameter {
        code: it.code.clone(),
        address: it.address,
        ..ListedParameter::default()
    });
    let now = live
        .dump(
            &catalogue.model,
            &of_interest.into_iter().chain(others).collect::<Vec<_>>(),
        )
        .await?;
    let plan = plan(wanted, &now, &catalogue.parameters, wish.with_link);
    print(&format!(
        "{}{}",
        not_held(wanted, &catalogue),
        shown(&plan, live, catalogue.commit.as_ref())
    ))?;
    if plan.writes.is_empty() || wish.dry_run {
        return Ok(());
    }
    if !catalogue.may_be_written {
        let why = "the drive has no `control` section, so nothing may be written to it";
        return Err(CommandFailure::failed(format!(
            "nothing was written: {why}; add one to restore its parameters"
        )));
    }
    if !wish.yes {
        ask_for_consent()?;
    }
    write(&plan.writes, live, catalogue.commit.as_ref()).await
}

/// What a copy made from `wanted` lacks, whatever is written.
fn not_held(wanted: &ParameterDump, catalogue: &ParameterCatalogue) -> String {
    let is_told = |code: &str| wanted.unreadable.iter().any(|it| it.code == code);
    let unread = catalogue
        .parameters
        .iter()
        .filter(|known| wanted.at(known.address).is_none() && !is_told(&known.code));
    let unread = unread.map(|it| LeftOut {
        what: it.code.clone(),
        reason: "it is not in the file".to_owned(),
    });
    let mut missing: Vec<_> = wanted.missing().into_iter().chain(unread).collect();
    // A file of an earlier version does not state this itself.
    for known in &catalogue.left_out {
        if !missing.contains(known) {
            missing.push(known.clone());
        }
    }
    if !catalogue.groups.is_empty()
        && !wanted
            .parameters
            .iter()
            .any(|it| catalogue.may_have(it.address))
    {
        let what = "what the model does not describe".to_owned();
        missing.push(LeftOut {
            what,
            reason: "the file holds only what the model describes".to_owned(),
        });
    }
    if missing.is_empty() {
        return String::new();
    }
    format!(
        "the file does not hold:\n{}",
        table(missing.into_iter().map(|it| [it.what, it.reason]))
    )
}

/// What would change, what is left unchanged, and what it costs.
fn shown(plan: &RestorePlan, live: &GatewayDrive, commit: Option<&CommitNeed>) -> String {
    let mut text = String::new();
    if !plan.left.is_empty() {
        let rows = plan
            .left
            .iter()
            .map(|(it, reason)| [it.code.clone(), it.shown(), reason.clone()]);
        text.push_str(&format!("left as they are:\n{}", table(rows)));
    }
    if plan.writes.is_empty() {
        text.push_str("there is nothing to write\n");
        return text;
    }
    let change = |it: &ParameterChange| {
        [
            it.new.code.clone(),
            it.new.title.clone(),
            format!("{} -> {}", it.old.shown(), it.new.shown()),
        ]
    };
    text.push_str(&format!(
        "drive {}, at standstill:\n{}",
        live.drive,
        table(plan.writes.iter().map(change))
    ));
    let stored = plan.writes.iter().filter(|change| change.is_stored).count();
    if stored > 0 {
        text.push_str(&format!(
            "{stored} of {} are stored in a memory that endures a limited number of writes (about 10,000 on some drives): \
             one write each\n",
            plan.writes.len()
        ));
    }
    text.push_str(&commit.map(announced).unwrap_or_default());
    if plan.writes.iter().any(|change| change.kind == "source") {
        text.push_str(
            "WARNING: this may hand the drive to its panel or terminals; a closed terminal may start the motor\n",
        );
    }
    if plan.writes.iter().any(|change| change.kind == "link") {
        text.push_str(
            "WARNING: with the present settings of the line the drive may no longer be reachable\n",
        );
    }
    text
}

/// What follows the writes.
fn announced(commit: &CommitNeed) -> String {
    let CommitNeed {
        stores,
        what,
        is_sent,
    } = commit;
    match (is_sent, stores) {
        (true, true) => format!("then all parameters are stored, by one write of {what}\n"),
        (true, false) => format!("then they take effect, by one write of {what}\n"),
        (false, true) => format!(
            "WARNING: the drive loses them with its power unless {what} stores them, which is \
             unproven and is not written\n"
        ),
        (false, false) => {
            format!(
                "WARNING: they may have no effect before {what} is written, which is unproven and \
                 is not done\n"
            )
        }
    }
}

async fn write(
    writes: &[ParameterChange],
    live: &GatewayDrive,
    commit: Option<&CommitNeed>,
) -> Result<(), CommandFailure> {
    let commit = commit.filter(|commit| commit.is_sent);
    let mut bar = ProgressBar::new(writes.len());
    for (at, change) in writes.iter().enumerate() {
        bar.to(at, &change.new.code);
        let refused = match live.write(change.new.address, change.new.raw).await {
            Ok(None) => continue,
            Ok(Some(refused)) => refused,
            Err(failure) => failure.to_string(),
        };
        bar.end();
        let without = match commit {
            Some(commit) if at > 0 => lacking(commit),
            _ => "",
        };
        return Err(CommandFailure::failed(format!(
            "{}{without}",
            ended(writes, at, &refused)
        )));
    }
    bar.end();
    let Some(commit) = commit else {
        return print(&format!("{} written and read back\n", writes.len()));
    };
    match live.commit().await? {
        None => {
            let done = if commit.stores {
                "stored"
            } else {
                "put into effect"
            };
            print(&format!("{} written, read back and {done}\n", writes.len()))
        }
        Some(refused) => {
            let what = &commit.what;
            let text = format!(
                "{what}: {refused}; {} written and read back{}",
                writes.len(),
                lacking(commit)
            );
            Err(CommandFailure::failed(text))
        }
    }
}

/// What the written parameters lack without the word that follows them.
const fn lacking(commit: &CommitNeed) -> &'static str {
    if commit.stores {
        "; what was written is not stored: the drive loses it with its power"
    } else {
        "; what was written may have no effect"
    }
}

/// The message for when the write at place `at` was refused.
fn ended(writes: &[ParameterChange], at: usize, refused: &str) -> String {
    let codes = |of: &[ParameterChange]| {
        of.iter()
            .map(|it| it.new.code.as_str())
            .collect::<Vec<_>>()
            .join(", ")
    };
    let done = writes.get(..at).unwrap_or_default();
    let left = writes.get(at + 1..).unwrap_or_default();
    let code = writes
        .get(at)
        .map(|it| it.new.code.as_str())
        .unwrap_or_default();
    let written = if done.is_empty() {
        "nothing was written".to_owned()
    } else {
        format!("written: {}", codes(done))
    };
    let rest = if left.is_empty() {
        String::new()
    } else {
        format!("; not tried: {}", codes(left))
    };
    format!("{code}: {refused}; {written}{rest}")
}

#[cfg(test)]
mod tests {
    use super::super::file::Parameter;
    use super::*;

    #[test]
    fn what_follows_the_writes_is_told_before_them() {
        let said = |stores, is_sent| {
            announced(&CommitNeed {
                stores,
                what: "save".to_owned(),
                is_sent,
            })
        };
        assert_eq!(
            said(true, true),
            "then all parameters are stored, by one write of save\n"
        );
        assert_eq!(
            said(false, true),
            "then they take effect, by one write of save\n"
        );
        assert!(said(true, false).contains("loses them with its power unless save stores them"));
        assert!(said(false, false).contains("may have no effect before save"));
    }

    #[test]
    fn the_end_says_what_was_written_and_what_was_not() {
        let change = |code: &str| {
            let parameter = |raw| Parameter {
                code: code.to_owned(),
                address: 1,
                raw,
                text: None,
                title: String::new(),
            };
            ParameterChange {
                old: parameter(0),
                new: parameter(1),
                is_stored: true,
                kind: "plain".to_owned(),
            }
        };
        let writes = [change("A"), change("B"), change("C")];
        assert_eq!(
            ended(&writes, 0, "refused"),
            "A: refused; nothing was written; not tried: B, C"
        );
        assert_eq!(
            ended(&writes, 1, "refused"),
            "B: refused; written: A; not tried: C"
        );
        assert_eq!(ended(&writes, 2, "refused"), "C: refused; written: A, B");
    }
}
