//! `init`: from a port to a configuration that passes `check`. Everything is asked first, then everything is written.

mod answers;
mod args;
mod line;
mod service;
mod ways;

use crate::cli::tools::own_models::ModelDirs;
use crate::cli::tools::page_certificate::make_certificate;
use crate::cli::tools::passwords::hashed;
use crate::cli::tools::questions::PersonQuestions;
use crate::cli::tools::{CommandFailure, input, print, running};
use crate::daemon::host::whole_files::{self, FileReaders};
use crate::daemon::host::{clock, directories};
use crate::domain::calendar;
use crate::profile::catalog::Catalog;
use answers::InitAnswers;
pub use args::Args;
use service::{ServiceFacts, WANTED, WantedService};
use std::io::{self, BufRead};
use std::path::{Path, PathBuf};
use ways::InitSecrets;

/// Where the journal is by default.
const DATA_DIR: &str = "/var/lib/vfd-gateway";

/// Asks, writes, and runs the gateway if that is wanted.
pub fn init(args: &Args) -> Result<(), CommandFailure> {
    let out = absolute(&args.out)?;
    if out.exists() {
        return Err(CommandFailure::wrong(format!(
            "{} already exists and is not overwritten",
            out.display()
        )));
    }
    let can_be_service = can_be_service(args, &out)?;
    let directory = out.parent().unwrap_or(Path::new("/")).to_path_buf();
    let catalog = input::catalog_with(&ModelDirs::default())?;
    let mut questions = PersonQuestions::new(io::stdin().lock());
    let mut secrets = InitSecrets::default();
    let answers = ask_answers(&mut questions, args, &catalog, &directory, &mut secrets)?;
    let text = answers.text();
    checked(&text, &catalog)?;
    let service = service_wanted(&mut questions, args, can_be_service)?;
    let start = "Run the gateway now, in this terminal";
    let starts = service == WantedService::None
        && questions.given_or_asked(
            args.start.as_deref(),
            "--start",
            start,
            Some("no"),
            line::yes,
        )?;
    drop(questions);
    write(&out, &text, &answers, &secrets)?;
    if service != WantedService::None {
        print("\nThe service:\n")?;
        service::execute_steps(&service::steps(
            &ServiceFacts::of_host(),
            &answers.data_dir,
            service,
        ))?;
    }
    print(&format!(
        "\n{text}\n{} is written. What next:\n  vfd-gateway check -c {0}\n  vfd-gateway run -c {0}\n",
        out.display()
    ))?;
    if starts { running::run(&out) } else { Ok(()) }
}

/// Whether a service can be installed. One that is wanted by the flag and cannot is an error, before anything is asked.
fn can_be_service(args: &Args, out: &Path) -> Result<bool, CommandFailure> {
    match (args.service.as_deref(), service::why_not(out)) {
        (Some(given), Some(why)) if given != "none" => {
            Err(CommandFailure::wrong(format!("--service {given}: {why}")))
        }
        (_, why) => Ok(why.is_none()),
    }
}

/// Asked only where a service can be installed.
fn service_wanted<R: BufRead>(
    questions: &mut PersonQuestions<R>,
    args: &Args,
    can_be: bool,
) -> Result<WantedService, CommandFailure> {
    let parse = |text: &str| {
        let word = WANTED
            .into_iter()
            .find(|(word, _)| *word == text)
            .map(|(_, wanted)| wanted);
        word.ok_or_else(|| format!("`{text}` is not none, install or start"))
    };
    if !can_be {
        return Ok(WantedService::None);
    }
    let question = "The gateway as a service: none, install, or start (which installs it too)";
    questions.given_or_asked(
        args.service.as_deref(),
        "--service",
        question,
        Some("none"),
        parse,
    )
}

fn absolute(path: &Path) -> Result<PathBuf, CommandFailure> {
    std::path::absolute(path)
        .map_err(|error| CommandFailure::failed(format!("{}: {error}", path.display())))
}

fn ask_answers<R: BufRead>(
    questions: &mut PersonQuestions<R>,
    args: &Args,
    catalog: &Catalog,
    directory: &Path,
    secrets: &mut InitSecrets,
) -> Result<InitAnswers, CommandFailure> {
    let mut line = line::line(questions, args, catalog)?;
    let wanted = ways::ask_interfaces(questions, args)?;
    let has = |way: &str| wanted.iter().any(|it| it == way);
    let mut page = if has("page") {
        Some(ways::page(questions, args)?)
    } else {
        None
    };
    let mut modbus = if has("modbus-tcp") {
        Some(ways::modbus(questions, args)?)
    } else {
        None
    };
    let broker = if has("mqtt") || has("home-assistant") || has("sparkplug") {
        Some(ways::broker(questions, args, &wanted, directory, secrets)?)
    } else {
        None
    };
    let from = ways::commanders(questions, args, &wanted)?;
    let commands = |way: &str| from.iter().any(|it| it == way);
    if let Some(modbus) = &mut modbus
        && commands("modbus-tcp")
    {
        modbus.write = ways::writers(questions, args)?;
    }
    if let Some(page) = page.as_mut() {
        if commands("page") {
            page.user = Some(ways::page_user(questions, args, directory, secrets)?);
        }
        if !page.listen.ip().is_loopback() {
            page.certificate = Some(
                directory
                    .join("tls")
                    .join(crate::cli::tools::page_certificate::PAGE),
            );
        }
    }
    if !from.is_empty() {
        let control = ways::control(questions, args, from)?;
        line::controlled(questions, args, &control, &mut line.drives)?;
    }
    let data_dir = questions.given_or_asked(
        args.data_dir.as_deref().and_then(Path::to_str),
        "--data-dir",
        "Directory for the journal",
        Some(DATA_DIR),
        |text| {
            if text.starts_with('/') {
                Ok(PathBuf::from(text))
            } else {
                Err(format!("`{text}` is not an absolute path"))
            }
        },
    )?;
    let date = calendar::day(clock::wall());
    Ok(InitAnswers {
        date,
        data_dir,
        line,
        page,
        modbus,
        broker,
    })
}

/// The file passes `check`, or nothing is written.
fn checked(text: &str, catalog: &Catalog) -> Result<(), CommandFailure> {
    input::config_of(text, catalog).map(drop).map_err(|why| {
        CommandFailure::wrong(format!(
            "the answers contradict each other; nothing was written:\n{why}"
        ))
    })
}

/// Secrets and certificate first, the configuration that names them last.
fn write(
    out: &Path,
    text: &str,
    answers: &InitAnswers,
    secrets: &InitSecrets,
) -> Result<(), CommandFailure> {
    if out == Path::new(service::CONFIGURATION) {
        let directory = out.parent().unwrap_or(Path::new("/"));
        std::fs::create_dir_all(directory)
            .map_err(|error| CommandFailure::failed(format!("{}: {error}", directory.display())))?;
    }
    match directories::make(&answers.data_dir) {
        Ok(_) => (),
        // The gateway controls without it, and says so.
        Err(error) => print(&format!(
            "data_dir {}: {error}\n",
            answers.data_dir.display()
        ))?,
    }
    if let Some((page, certificate)) = answers
        .page
        .as_ref()
        .and_then(|page| Some((page, page.certificate.as_ref()?)))
    {
        let directory = certificate.parent().unwrap_or(Path::new("/"));
        print(&make_certificate(directory, &[], page.listen.port())?)?;
    }
    let user = answers.page.as_ref().and_then(|page| page.user.as_ref());
    if let (Some((_, file)), Some(password)) = (user, &secrets.page) {
        secret(file, &format!("{}\n", hashed(password)?.as_str()))?;
    }
    let user = answers
        .broker
        .as_ref()
        .and_then(|broker| broker.user.as_ref());
    if let (Some((_, file)), Some(password)) = (user, &secrets.broker) {
        secret(file, &format!("{password}\n"))?;
    }
    whole_files::create(out, text.as_bytes(), FileReaders::Group)
        .map_err(|error| CommandFailure::failed(format!("{}: {error}", out.display())))
}

/// A secret of an earlier, interrupted attempt is replaced.
fn secret(file: &Path, text: &str) -> Result<(), CommandFailure> {
    whole_files::replace(file, text.as_bytes(), FileReaders::Group)
        .map_err(|error| CommandFailure::failed(format!("{}: {error}", file.display())))
}
