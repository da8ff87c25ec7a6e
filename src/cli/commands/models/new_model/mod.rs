//! `models new`: a model file from a person's answers, from a drive that is read meanwhile, or from a device template; or one to
//! fill by hand, whose gaps `models check` lists.

mod facts;
mod interview;
mod live;
mod skeleton;
mod summary;
mod template;
mod trial;

use crate::cli::tools::own_models::ModelDirs;
use crate::cli::tools::questions::PersonQuestions;
use crate::cli::tools::{CommandFailure, input, print};
use crate::daemon::host::clock;
use crate::daemon::host::whole_files::{self, FileReaders};
use crate::domain::calendar;
use crate::vendors;
use interview::ModelInterview;
use live::{LiveArgs, LiveDrive};
use std::io;
use std::path::{Path, PathBuf};

/// Arguments of `models new`.
#[derive(Debug, clap::Args)]
pub struct Args {
    /// Identifier of the new model: maker-series in lower case, such as acme-flux-2
    #[arg(value_parser = identifier)]
    id: String,
    /// The file to write; default: ID.toml in this directory. Never overwritten
    #[arg(long, value_name = "FILE")]
    out: Option<PathBuf>,
    /// Take the registers from a device template of wb-mqtt-serial (JSON) instead of asking. The model is then only read
    #[arg(long, value_name = "FILE", conflicts_with = "port")]
    template: Option<PathBuf>,
    /// Ask nothing: write a skeleton with a comment at each place, to be filled with an editor
    #[arg(long, conflicts_with_all = ["port", "template"])]
    skeleton: bool,
    /// Ask nothing: write a file that begins from this model and names what to state again
    #[arg(long, value_name = "MODEL", conflicts_with_all = ["port", "template", "skeleton"])]
    like: Option<String>,
    #[command(flatten)]
    live: LiveArgs,
}

/// Checks `text` as the identifier of a model file.
fn identifier(text: &str) -> Result<String, String> {
    let is_part = |part: &str| {
        !part.is_empty()
            && part
                .bytes()
                .all(|it| it.is_ascii_lowercase() || it.is_ascii_digit())
    };
    let parts: Vec<_> = text.split('-').collect();
    if parts.len() < 2 || !parts.iter().all(|part| is_part(part)) {
        return Err(
            "maker and series in lower case, with hyphens between, such as acme-flux-2".to_owned(),
        );
    }
    match vendors::catalog().find(text) {
        Some(_) => Err(format!(
            "{text} is built in; `vfd-gateway models show {text} --toml` prints it"
        )),
        None => Ok(text.to_owned()),
    }
}

/// Asks, writes the file, checks it, and plays it.
pub fn new(args: &Args, own: &ModelDirs) -> Result<(), CommandFailure> {
    let out = args
        .out
        .clone()
        .unwrap_or_else(|| PathBuf::from(format!("{}.toml", args.id)));
    if out.exists() {
        return Err(CommandFailure::wrong(format!(
            "{} already exists and is not overwritten",
            out.display()
        )));
    }
    if let Some(base) = &args.like {
        written(&out, &skeleton::like(&args.id, &*input::model(base, own)?))?;
        return super::check_file(&out, own);
    }
    if args.skeleton {
        written(&out, &skeleton::skeleton(&args.id))?;
        return print(&format!(
            "`vfd-gateway models check {}` lists what is left to fill\n",
            out.display()
        ));
    }
    let facts = match &args.template {
        Some(file) => template::facts(&args.id, file, &input::read(file)?)?,
        None => ask_facts(args, &out)?,
    };
    let text = facts.text();
    written(&out, &text)?;
    super::check_file(&out, &ModelDirs::default())?;
    let seen = played(&args.id, &out, &text);
    let seen =
        seen.map_err(|failure| CommandFailure::failed(format!("On a simulated drive: {failure}")))?;
    print(&format!("On a simulated drive: {seen}\n"))
}

fn written(out: &Path, text: &str) -> Result<(), CommandFailure> {
    whole_files::create(out, text.as_bytes(), FileReaders::All)
        .map_err(|error| CommandFailure::failed(format!("{}: {error}", out.display())))?;
    print(&format!("\n{} is written.\n", out.display()))
}

/// Asks everything, shows what the file will say, and returns it if the person agrees.
fn ask_facts(args: &Args, out: &Path) -> Result<facts::ModelFacts, CommandFailure> {
    let mut live = LiveDrive::open(&args.live)?;
    let date = calendar::day(clock::wall());
    let questions = PersonQuestions::new(io::stdin().lock());
    let mut interview = ModelInterview {
        questions,
        live: live.as_mut(),
        has_manual: false,
    };
    let facts = interview.facts(&args.id, &date).and_then(|facts| {
        print(&summary::summary_rows(&facts))?;
        let agrees = interview
            .questions
            .yes(&format!("Write this to {}", out.display()), true)?;
        if agrees {
            Ok(facts)
        } else {
            Err(CommandFailure::wrong("nothing was written"))
        }
    });
    if let Some(live) = live {
        live.close();
    }
    facts
}

/// The model alone in a directory of its own, because others beside it may have mistakes.
fn played(id: &str, file: &Path, text: &str) -> Result<String, CommandFailure> {
    let name = file.display().to_string();
    let catalog = vendors::catalog()
        .with_texts([(name, text)])
        .map_err(|_| CommandFailure::failed("the file is not valid"))?;
    let model = catalog
        .find(id)
        .ok_or_else(|| CommandFailure::failed(format!("no model is called {id}")))?;
    let directory = crate::cli::tools::own_gateway::PrivateDirectory::new()?;
    let alone = directory.path().join("model.toml");
    std::fs::write(&alone, text)
        .map_err(|error| CommandFailure::failed(format!("{}: {error}", alone.display())))?;
    trial::play(model, directory.path().to_path_buf())
}
