//! The simulated plant of the demo: one drive each of some vendors, on as few lines as their settings allow.

use crate::domain::control::ControlAction;
use crate::domain::ids::Station;
use crate::domain::link::{Framing, Interface, LinkSettings};
use crate::profile::model::{Model, RunCommand};
use crate::toml_file::words::{PARITIES, word_for};
use crate::vendors;
use std::fmt::Write as _;
use std::path::Path;
use std::sync::Arc;

/// The drives' names, which are followed by their stations, and their groups.
const NAMES: [(&str, &str); 5] = [
    ("pump", "utilities"),
    ("fan", "utilities"),
    ("mixer", "process"),
    ("belt", "process"),
    ("mill", "process"),
];
/// Rated current and voltage of every drive, as simulated.
const RATED_CURRENT_A: f64 = 11.0;
const RATED_VOLTAGE_V: f64 = 400.0;

/// Who may command the demo's drives.
pub(super) const FROM: [&str; 3] = ["mqtt", "modbus-tcp", "page"];

/// One drive of the demo.
#[derive(Debug)]
pub struct DemoDrive {
    /// Its name.
    pub name: String,
    /// Its station number.
    pub station: Station,
    /// The group in which the page shows it.
    pub group: &'static str,
    /// Its model.
    pub model: Arc<Model>,
}

/// One line of the demo.
#[derive(Debug)]
pub struct DemoLine {
    /// Its name.
    pub name: String,
    /// Speed, parity and stop bits.
    pub link: LinkSettings,
    /// The drives on it.
    pub drives: Vec<DemoDrive>,
}

/// A drive of each model of the demo, on the first line that all its drives can be set to.
pub(super) fn lines() -> Vec<DemoLine> {
    let catalog = vendors::catalog();
    let models = vendors::in_demo().iter().filter_map(|id| catalog.find(id));
    let mut lines: Vec<DemoLine> = Vec::new();
    for ((number, (name, group)), model) in (1..).zip(NAMES).zip(models) {
        let name = format!("{name}-{number}");
        let drive = DemoDrive {
            name,
            station: Station(number),
            group,
            model: Arc::clone(model),
        };
        match lines
            .iter_mut()
            .find_map(|line| Some((common(line, &drive.model)?, line)))
        {
            Some((link, line)) => {
                line.link = link;
                line.drives.push(drive);
            }
            None => {
                let name = format!("line-{}", lines.len() + 1);
                let link = drive.model.link.played();
                lines.push(DemoLine {
                    name,
                    link,
                    drives: vec![drive],
                });
            }
        }
    }
    lines
}

/// The fastest setting that `model` shares with every drive of `line`; `None` if there is none.
fn common(line: &DemoLine, model: &Model) -> Option<LinkSettings> {
    let all = || {
        line.drives
            .iter()
            .map(|drive| drive.model.as_ref())
            .chain([model])
    };
    let share = |can: &dyn Fn(&Model) -> bool| all().all(can);
    let first = &line.drives.first()?.model.link;
    let both = share(&|it| {
        it.link.framings.value.contains(&Framing::Rtu)
            && it.link.data_bits.value.contains(&8)
            && it.link.interfaces.value.contains(&Interface::Rs485)
    });
    let bauds = first.bauds.value.iter().copied();
    let baud = bauds
        .filter(|baud| share(&|it| it.link.bauds.value.contains(baud)))
        .max()?;
    let mut parities = first.parities.value.iter().copied();
    let parity = parities.find(|parity| share(&|it| it.link.parities.value.contains(parity)))?;
    let mut stop_bits = first.stop_bits.value.iter().copied();
    let stop_bits = stop_bits.find(|bits| share(&|it| it.link.stop_bits.value.contains(bits)))?;
    both.then_some(LinkSettings {
        baud,
        data_bits: 8,
        parity,
        stop_bits,
    })
}

/// The `[[line]]` tables of a configuration for `lines`, each on its device, with drives that obey `from`.
pub fn configuration<'a>(
    lines: impl IntoIterator<Item = (&'a DemoLine, &'a Path)>,
    from: &[&str],
) -> String {
    let mut text = String::new();
    let mut unit = 0;
    for (line, device) in lines {
        let LinkSettings {
            baud,
            parity,
            stop_bits,
            ..
        } = line.link;
        // Writing to a String cannot fail.
        let _ = write!(
            text,
            "\n[[line]]\nname = \"{}\"\nport = \"{}\"\nbaud = {baud}\nparity = \"{}\"\nstop_bits = {stop_bits}\n",
            line.name,
            device.display(),
            word_for(&PARITIES, &parity)
        );
        for drive in &line.drives {
            unit += 1;
            drive_section(&mut text, drive, unit, from);
        }
    }
    text
}

fn drive_section(text: &mut String, drive: &DemoDrive, unit: u8, from: &[&str]) {
    let DemoDrive {
        name,
        station,
        group,
        model,
    } = drive;
    let _ = write!(
        text,
        "\n[[line.drive]]\nname = \"{name}\"\nmodel = \"{}\"\nstation = {station}\nunit = {unit}\n\
         uniform_unit = {}\ngroup = \"{group}\"\npoll = \"1s\"\n",
        model.id,
        u16::from(unit) + 100
    );
    if model.quirks.percent_of_rated.is_some() {
        let _ = write!(
            text,
            "rated_current_a = {RATED_CURRENT_A:.1}\nrated_voltage_v = {RATED_VOLTAGE_V:.1}\n"
        );
    }
    if model.run.is_none() {
        return;
    }
    let unproven: Vec<_> = unproven(model)
        .map(|action| format!("\"{}\"", action.keyword()))
        .collect();
    let directions = if model.run.as_ref().is_some_and(|run| run.reverse.is_some()) {
        "\"forward\", \"reverse\""
    } else {
        "\"forward\""
    };
    let _ = write!(
        text,
        "\n[line.drive.control]\nfrom = {from:?}\nfrequency_hz = {{ min = 5.0, max = 50.0 }}\n\
         directions = [{directions}]\non_commander_lost = \"stop\"\nlost_after = \"5s\"\non_shutdown = \"stop\"\n\
         accept_unverified = [{}]\n",
        unproven.join(", ")
    );
}

/// The actions that `model` has and does not prove. The simulator plays them as described, so the demo accepts all of
/// them except the release, which no client is offered here.
fn unproven(model: &Model) -> impl Iterator<Item = ControlAction> + '_ {
    let basic = (!model.unproven_basics().is_empty()).then_some(ControlAction::Basic);
    let unproven = model
        .run
        .iter()
        .flat_map(RunCommand::unproven)
        .map(|(action, _)| action);
    let unproven = basic.into_iter().chain(unproven);
    unproven.filter(|action| *action != ControlAction::Release)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::config;
    use std::collections::BTreeSet;

    #[test]
    fn every_drive_is_of_another_vendor_and_the_configuration_is_taken() {
        let lines = lines();
        let catalog = vendors::catalog();
        let drives = || lines.iter().flat_map(|line| &line.drives);
        let shown: BTreeSet<_> = drives().map(|drive| drive.model.vendor.clone()).collect();
        let all = vendors::in_demo().len();
        assert_eq!((shown.len(), drives().count()), (all, all));
        let text = format!(
            "[gateway]\nname = \"demo\"\n{}\n[mqtt]\nbroker = \"embedded\"\n\n[[modbus_tcp]]\nlisten = \"127.0.0.1:0\"\n\
             write = [\"127.0.0.1/32\"]\n\n[http]\nlisten = \"127.0.0.1:0\"\n{}",
            configuration(
                lines.iter().map(|line| (line, Path::new("/dev/pts/1"))),
                &FROM
            ),
            super::super::user()
        );
        if let Err(problems) = config::load(&text, &catalog) {
            panic!("{text}\n{problems:?}");
        }
    }
}
