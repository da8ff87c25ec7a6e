//! Questions about the line: which port, which drives, what they are called.

use super::args::Args;
use super::ways::words;
use crate::cli::tools::progress::seconds;
use crate::cli::tools::questions::PersonQuestions;
use crate::cli::tools::scanning::find::{ScannedLine, find};
use crate::cli::tools::{CommandFailure, print};
use crate::config::written::{NewControl, NewDrive, NewLine};
use crate::config::{self, PortAddress};
use crate::daemon::host::adapters::{self, SerialAdapter};
use crate::domain::ids::Name;
use crate::domain::link::{Framing, LinkSettings};
use crate::profile::catalog::Catalog;
use crate::profile::model::Model;
use std::collections::{BTreeMap, BTreeSet};
use std::io::BufRead;
use std::sync::Arc;

/// What a name consists of.
const NAME_RULE: &str =
    "a name has 1 to 64 characters a-z, A-Z, 0-9, \"-\", \"_\" or \".\", not only dots";

/// The line: its port, and the drives that are named or found on it.
pub fn line<R: BufRead>(
    questions: &mut PersonQuestions<R>,
    args: &Args,
    catalog: &Catalog,
) -> Result<NewLine, CommandFailure> {
    let port = port(questions, args)?;
    let mut line = if args.drive.is_empty() {
        line_from_scan(questions, args, catalog, port)?
    } else {
        line_from_flags(args, catalog, port)?
    };
    full_scale(questions, args, &mut line.drives)?;
    Ok(line)
}

fn port<R: BufRead>(
    questions: &mut PersonQuestions<R>,
    args: &Args,
) -> Result<PortAddress, CommandFailure> {
    if let Some(port) = &args.port {
        return Ok(port.clone());
    }
    let adapters = adapters::list();
    print(&listed(&adapters))?;
    questions.ask_until(
        "Number of the port, or its path, or tcp://HOST:PORT of a serial device server",
        |answer| match answer
            .parse::<usize>()
            .ok()
            .and_then(|number| adapters.get(number.checked_sub(1)?))
        {
            Some(adapter) => Ok(PortAddress::Device(adapter.path.clone())),
            None => config::serial_port_address(answer),
        },
    )
}

/// The ports, numbered from 1, with what keeps this user from one.
fn listed(adapters: &[SerialAdapter]) -> String {
    if adapters.is_empty() {
        return "No serial port was found. Is the adapter plugged in?\n".to_owned();
    }
    let mut text = "Serial ports of this host:\n".to_owned();
    for (number, adapter) in (1..).zip(adapters) {
        let driver = adapter.driver.as_deref().unwrap_or("driver not known");
        text += &format!("  {number}) {} ({driver})\n", adapter.path.display());
        if !adapter.holders.is_empty() {
            text += &format!(
                "     in use by {}: end it first\n",
                adapter.holders.join(", ")
            );
        }
        if !adapter.may_open {
            let group = &adapter.group;
            text += &format!(
                "     this user may not open it: sudo usermod -aG {group} $USER, and sign in again\n"
            );
        }
    }
    text
}

/// What the flags say.
fn line_from_flags(
    args: &Args,
    catalog: &Catalog,
    port: PortAddress,
) -> Result<NewLine, CommandFailure> {
    let drives = args
        .drive
        .iter()
        .map(|text| given_drive(text, catalog))
        .collect::<Result<Vec<_>, _>>()?;
    let first = drives
        .first()
        .map_or(LinkSettings::DEFAULT, |drive| drive.model.link.played());
    let link = LinkSettings {
        baud: args.baud.unwrap_or(first.baud),
        parity: args.link.parity().unwrap_or(first.parity),
        stop_bits: args.link.stop_bits.unwrap_or(first.stop_bits),
        data_bits: first.data_bits,
    };
    let is_ascii = link.data_bits == 7;
    Ok(NewLine {
        name: "line-1".to_owned(),
        port,
        link,
        is_ascii,
        echoes: false,
        drives,
        notes: Vec::new(),
    })
}

fn given_drive(text: &str, catalog: &Catalog) -> Result<NewDrive, CommandFailure> {
    let wrong = || {
        CommandFailure::wrong(format!(
            "--drive {text}: expected NAME=MODEL@STATION, such as pump-1=MODEL@1 with a model of \
             `models list`"
        ))
    };
    let (name, rest) = text.split_once('=').ok_or_else(wrong)?;
    let (id, station) = rest.rsplit_once('@').ok_or_else(wrong)?;
    let station = station
        .parse()
        .ok()
        .filter(|station| (1..=247).contains(station))
        .ok_or_else(wrong)?;
    let name = Name::new(name)
        .ok_or_else(|| CommandFailure::wrong(format!("--drive {text}: {NAME_RULE}")))?;
    let model = catalog.find(id).ok_or_else(|| {
        CommandFailure::wrong(format!(
            "--drive {text}: no model is called {id}; `vfd-gateway models list` shows all of them"
        ))
    })?;
    Ok(drive(
        name.to_string(),
        Arc::clone(model),
        station,
        "as given".to_owned(),
    ))
}

const fn drive(name: String, model: Arc<Model>, station: u8, why: String) -> NewDrive {
    NewDrive {
        name,
        model,
        station,
        unit: None,
        full_scale_hz: None,
        why,
        control: None,
    }
}

/// Looks for drives, and asks what a scan cannot tell.
fn line_from_scan<R: BufRead>(
    questions: &mut PersonQuestions<R>,
    args: &Args,
    catalog: &Catalog,
    port: PortAddress,
) -> Result<NewLine, CommandFailure> {
    let ScannedLine {
        setting,
        drives,
        others,
        echoes,
    } = find(
        &port,
        catalog,
        &args.stations,
        args.baud,
        &args.link,
        |plan| {
            let (silent, _) = plan.duration();
            print(&format!(
                "Looking for drives on {port} (this only reads): {} at most before the first \
                 answers.\n",
                seconds(silent)
            ))
        },
    )?;
    let models = models_of(questions, args, &drives)?;
    let mut known = Vec::new();
    let mut notes = others;
    for finding in &drives {
        match models.get(&finding.station) {
            Some((model, why)) => known.push((finding.station, Arc::clone(model), why.clone())),
            None => notes.push(format!(
                "Station {} answers, but fits no model.",
                finding.station
            )),
        }
    }
    if known.is_empty() {
        return Err(CommandFailure::failed(
            "no drive was found whose model is known: see the scan's advice in docs/real-drive.md, or name drives with --drive",
        ));
    }
    let names = names(
        questions,
        args,
        &known
            .iter()
            .map(|(station, ..)| *station)
            .collect::<Vec<_>>(),
    )?;
    let drives = names
        .into_iter()
        .zip(known)
        .map(|(name, (station, model, why))| drive(name, model, station, why));
    let is_ascii = setting.framing == Framing::Ascii;
    Ok(NewLine {
        name: "line-1".to_owned(),
        port,
        link: setting.link,
        is_ascii,
        echoes,
        drives: drives.collect(),
        notes,
    })
}

type Models = BTreeMap<u8, (Arc<Model>, String)>;

/// One model for each station. Stations that fit the same models are asked about once.
fn models_of<R: BufRead>(
    questions: &mut PersonQuestions<R>,
    args: &Args,
    drives: &[crate::cli::tools::scanning::find::ScannedDrive],
) -> Result<Models, CommandFailure> {
    let mut groups: BTreeMap<Vec<String>, Vec<u8>> = BTreeMap::new();
    let mut known = Models::new();
    let mut fits = BTreeMap::new();
    for drive in drives {
        let ids: Vec<_> = drive.fits.iter().map(|model| model.id.clone()).collect();
        let preferred = args
            .model
            .iter()
            .find_map(|id| drive.fits.iter().find(|model| model.id == *id));
        match (&drive.fits[..], preferred) {
            ([], _) => (),
            (_, Some(model)) => {
                drop(known.insert(drive.station, (Arc::clone(model), "as given".to_owned())))
            }
            ([only], None) if drive.is_sure => {
                drop(known.insert(
                    drive.station,
                    (
                        Arc::clone(only),
                        "identified; compare it with the nameplate".to_owned(),
                    ),
                ));
            }
            (several, None) => {
                groups.entry(ids.clone()).or_default().push(drive.station);
                fits.insert(ids, several.to_vec());
            }
        }
    }
    for (ids, stations) in groups {
        let Some(models) = fits.get(&ids) else {
            continue;
        };
        let numbers: Vec<_> = stations.iter().map(u8::to_string).collect();
        let mut text = format!(
            "Station {} may be several models. Which is on the nameplate?\n",
            numbers.join(", ")
        );
        for (number, model) in (1..).zip(models) {
            text += &format!(
                "  {number}) {} {} ({})\n",
                model.vendor, model.title, model.id
            );
        }
        print(&text)?;
        let chosen =
            questions.ask_until("Number, or 0 to leave them out", |answer| {
                match answer.parse::<usize>() {
                    Ok(0) => Ok(None),
                    Ok(number) if number <= models.len() => Ok(models.get(number - 1)),
                    _ => Err(format!(
                        "`{answer}` is not a number from 0 to {}",
                        models.len()
                    )),
                }
            })?;
        for station in chosen.into_iter().flat_map(|_| &stations) {
            if let Some(model) = chosen {
                known.insert(
                    *station,
                    (
                        Arc::clone(model),
                        "chosen from several; compare it with the nameplate".to_owned(),
                    ),
                );
            }
        }
    }
    Ok(known)
}

/// A name for each station.
fn names<R: BufRead>(
    questions: &mut PersonQuestions<R>,
    args: &Args,
    stations: &[u8],
) -> Result<Vec<String>, CommandFailure> {
    let own: Vec<_> = stations
        .iter()
        .map(|station| format!("drive-{station}"))
        .collect();
    let given = args.names.as_ref().map(|names| names.join(","));
    let numbers: Vec<_> = stations.iter().map(u8::to_string).collect();
    let question = format!("Names of the drives at stations {}", numbers.join(", "));
    questions.given_or_asked(
        given.as_deref(),
        "--names",
        &question,
        Some(&own.join(" ")),
        |text| {
            let names: Vec<_> = text
                .split([',', ' '])
                .filter(|name| !name.is_empty())
                .map(str::to_owned)
                .collect();
            if names.len() != stations.len() {
                return Err(format!(
                    "{} names are needed, not {}",
                    stations.len(),
                    names.len()
                ));
            }
            if names.iter().collect::<BTreeSet<_>>().len() != names.len() {
                return Err("two names are the same".to_owned());
            }
            match names.iter().find(|name| Name::new(name).is_none()) {
                Some(name) => Err(format!("`{name}`: {NAME_RULE}")),
                None => Ok(names),
            }
        },
    )
}

/// The frequency that stands for 100 %, asked once for each model that needs it.
fn full_scale<R: BufRead>(
    questions: &mut PersonQuestions<R>,
    args: &Args,
    drives: &mut [NewDrive],
) -> Result<(), CommandFailure> {
    let needing = drives
        .iter()
        .map(|drive| &drive.model)
        .filter(|model| model.needs_full_scale());
    let needing: BTreeSet<_> = needing
        .map(|model| {
            let parameter = model
                .full_scale_parameter()
                .map(|it| format!(" ({it})"))
                .unwrap_or_default();
            (model.id.clone(), parameter)
        })
        .collect();
    for (id, parameter) in needing {
        let question = format!("Frequency that stands for 100 % at the {id}{parameter}, in Hz");
        let hz = questions.given_or_asked(
            args.full_scale_hz.as_deref(),
            "--full-scale-hz",
            &question,
            None,
            |text| {
                let hz = text
                    .parse::<f64>()
                    .ok()
                    .filter(|hz| (1.0..=1000.0).contains(hz));
                hz.ok_or_else(|| format!("`{text}` is not a frequency from 1 to 1000 Hz"))
            },
        )?;
        drives
            .iter_mut()
            .filter(|drive| drive.model.id == id)
            .for_each(|drive| drive.full_scale_hz = Some(hz));
    }
    Ok(())
}

/// Gives `control` to the drives. Asks whether to take orders for models whose stop is not proven: without an answer of
/// yes they are only read.
pub fn controlled<R: BufRead>(
    questions: &mut PersonQuestions<R>,
    args: &Args,
    control: &NewControl,
    drives: &mut [NewDrive],
) -> Result<(), CommandFailure> {
    let unproven: BTreeSet<_> = drives
        .iter()
        .filter(|drive| drive.model.run.is_some() && !drive.model.unproven_basics().is_empty())
        .map(|drive| drive.model.id.clone())
        .collect();
    let accepts = if unproven.is_empty() {
        true
    } else {
        let list: Vec<_> = unproven.into_iter().collect();
        let question = format!(
            "No manual proves how these are stopped: {}. Accept commands for them anyway? Watch a \
             stop take effect first",
            list.join(", ")
        );
        questions.given_or_asked(
            args.accept_unverified.as_deref(),
            "--accept-unverified",
            &question,
            Some("no"),
            yes,
        )?
    };
    for drive in drives {
        let accepts_unproven = !drive.model.unproven_basics().is_empty();
        let is_controlled = drive.model.run.is_some() && (accepts || !accepts_unproven);
        drive.control = is_controlled.then(|| NewControl {
            accepts_unproven,
            ..control.clone()
        });
    }
    Ok(())
}

/// Yes or no, as a word.
pub fn yes(text: &str) -> Result<bool, String> {
    match words(&text.to_lowercase(), &["yes", "y", "no", "n"])?.as_slice() {
        [word] => Ok(word.starts_with('y')),
        _ => Err("yes or no".to_owned()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::vendors;

    #[test]
    fn a_drive_is_named_by_name_model_and_station() {
        let catalog = vendors::catalog();
        let drive = given_drive("pump-1=hyundai-n700@3", &catalog).unwrap();
        assert_eq!((drive.name.as_str(), drive.station), ("pump-1", 3));
        for wrong in [
            "pump-1",
            "pump-1=hyundai-n700",
            "pump-1=hyundai-n700@0",
            "pump-1=none@1",
            "a b=hyundai-n700@1",
        ] {
            assert!(given_drive(wrong, &catalog).is_err(), "{wrong}");
        }
    }

    #[test]
    fn a_port_says_what_keeps_this_user_from_it() {
        let adapter = SerialAdapter {
            path: "/dev/ttyUSB0".into(),
            device: "/dev/ttyUSB0".into(),
            driver: Some("ftdi_sio".to_owned()),
            may_open: false,
            group: "dialout".to_owned(),
            holders: vec!["minicom (process 42)".to_owned()],
        };
        let text = listed(&[adapter]);
        for word in [
            "1) /dev/ttyUSB0 (ftdi_sio)",
            "minicom (process 42)",
            "usermod -aG dialout",
        ] {
            assert!(text.contains(word), "{text}");
        }
    }
}
