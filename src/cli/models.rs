//! `models`: what drives are known, with sources and confidence.

use super::{Failure, input, print};
use crate::profile::{check, summary};
use std::fmt::Write;
use std::path::PathBuf;

/// Arguments of `models`.
#[derive(Debug, clap::Args)]
pub struct Args {
    #[command(subcommand)]
    action: Option<Action>,
}

#[derive(Debug, clap::Subcommand)]
enum Action {
    /// List the built-in models (the default)
    List,
    /// Show a model with its registers, units, access, sources and confidence
    Show {
        /// Identifier, as `models list` shows it
        model: String,
    },
    /// Check a model file of your own
    Check {
        /// The file
        file: PathBuf,
    },
}

/// Lists, shows or checks.
pub fn models(args: &Args) -> Result<(), Failure> {
    match &args.action {
        None | Some(Action::List) => list(),
        Some(Action::Show { model }) => show(model),
        Some(Action::Check { file }) => check_file(file),
    }
}

fn list() -> Result<(), Failure> {
    let catalog = input::catalog()?;
    let mut text = String::new();
    for id in catalog.ids() {
        if let Some(model) = catalog.find(id) {
            let _ = writeln!(text, "{id:20} {} {}, {} registers", model.vendor, model.title, model.registers.len());
        }
    }
    print(&text)
}

fn show(id: &str) -> Result<(), Failure> {
    let model = input::model(id)?;
    print(&summary::summary(&model))
}

fn check_file(file: &std::path::Path) -> Result<(), Failure> {
    let text = input::read(file)?;
    let model = check::model(&text).map_err(|problems| Failure::wrong(input::draw(file, &text, &problems)))?;
    print(&summary::summary(&model))
}
