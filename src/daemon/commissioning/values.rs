//! Live values of a drive that a scan has found, read as its candidates describe them: a person compares them with what
//! the drive's panel shows.

use super::{Commissioning, CommissioningRefusal};
use crate::daemon::scan::ScanError;
use crate::daemon::scan::asker::PortAsker;
use crate::daemon::scan::judge::ReadOutcome;
use crate::daemon::scan::survey::LineAsker;
use crate::domain::address::Address;
use crate::domain::units::UnitOfMeasure;
use crate::profile::model::{Model, PollClass, Register};
use std::collections::BTreeMap;
use std::collections::btree_map::Entry;
use std::sync::Arc;

/// Most candidates that are compared at once.
pub const MODELS_MAX: usize = 4;
/// Most values of each.
const VALUES_MAX: usize = 6;

/// A value of a candidate.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct LiveValue {
    /// The register's name.
    pub name: String,
    /// What it is, for people.
    pub label: String,
    /// The value with its unit, or why there is none.
    pub text: Result<String, &'static str>,
}

impl Commissioning {
    /// The values of the drive at `station` as the candidates `ids` have them.
    ///
    /// # Errors
    /// Why there are none.
    pub async fn values(
        &self,
        station: u8,
        ids: &[String],
    ) -> Result<Vec<(String, Vec<LiveValue>)>, CommissioningRefusal> {
        let scan = self.done()?;
        let place = self.place()?;
        let progress = scan.progress();
        let here = scan.setting().map(|(number, _)| number);
        // Where one number answers at two settings, it is two drives; those that can be added have the usual setting.
        let mut of_station = progress
            .findings
            .drives
            .iter()
            .filter(|finding| finding.station == station);
        let finding = of_station
            .clone()
            .find(|finding| Some(finding.setting) == here)
            .or_else(|| of_station.next());
        let finding = finding.ok_or_else(|| {
            CommissioningRefusal::NotThere(format!("no drive was found at station {station}"))
        })?;
        let fits = |id: &String| {
            finding
                .verdict
                .fits
                .iter()
                .find(|(model, _)| model.id == *id)
                .map(|(model, _)| model)
        };
        let models: Vec<Arc<Model>> = ids.iter().filter_map(fits).cloned().collect();
        if models.is_empty() || models.len() != ids.len() || models.len() > MODELS_MAX {
            let what = format!(
                "1 to {MODELS_MAX} of the models that the scan names for station {station} are expected"
            );
            return Err(CommissioningRefusal::Wrong(what));
        }
        let setting = scan.plan().settings.get(finding.setting);
        let setting = setting
            .ok_or_else(|| CommissioningRefusal::NotThere("the scan is out of date".to_owned()))?;
        let mut asker = PortAsker::new(scan.port().clone());
        let read = async {
            asker.open(setting, &[station]).await?;
            read(&mut asker, station, &models).await
        };
        let heard = read.await;
        asker.close().await;
        drop(place);
        let heard = heard.map_err(|error| CommissioningRefusal::InTheWay(error.to_string()))?;
        Ok(models
            .iter()
            .map(|model| (model.id.clone(), shown(model, &heard)))
            .collect())
    }
}

type HeardAt = BTreeMap<Address, ReadOutcome>;

/// Reads what the values of all `models` consist of, each word once.
async fn read(
    asker: &mut impl LineAsker,
    station: u8,
    models: &[Arc<Model>],
) -> Result<HeardAt, ScanError> {
    let mut heard = HeardAt::new();
    for register in models.iter().flat_map(|model| telling(model)) {
        if let Entry::Vacant(place) = heard.entry(register.address) {
            place.insert(asker.ask(station, register.address).await?);
        }
    }
    Ok(heard)
}

/// The meaning of a code, or a number with its unit.
fn meant(register: &Register, word: impl Fn(Address) -> Option<u16>) -> Option<String> {
    let meaning = word(register.address)
        .and_then(|word| register.meaning(word))
        .map(str::to_owned);
    let number = || {
        register
            .value(&word)
            .map(|value| format!("{value} {}", register.unit))
    };
    meaning
        .or_else(number)
        .map(|text| text.trim_end_matches([' ', '-']).to_owned())
}

/// The values that a panel is likely to show as well: in one word, measured ones first, then those that are polled most
/// often.
fn telling(model: &Model) -> Vec<&Register> {
    let is_telling = |it: &&Register| {
        it.access.can_read() && it.form.words() == 1 && it.poll.is_some_and(PollClass::is_live)
    };
    let mut registers: Vec<_> = model.registers.iter().filter(is_telling).collect();
    let place = |of: &Register| {
        PollClass::ALL
            .iter()
            .position(|class| of.poll == Some(*class))
    };
    registers.sort_by_key(|register| (register.unit == UnitOfMeasure::None, place(register)));
    registers.truncate(VALUES_MAX);
    registers
}

fn shown(model: &Model, heard: &HeardAt) -> Vec<LiveValue> {
    let word = |address: Address| match heard.get(&address) {
        Some(ReadOutcome::Word(word)) => Some(*word),
        _ => None,
    };
    let value = |register: &Register| {
        let text = match heard.get(&register.address) {
            Some(ReadOutcome::Word(_)) => meant(register, word).ok_or("no value"),
            Some(ReadOutcome::Exception(_)) => Err("refused"),
            Some(ReadOutcome::Damaged) => Err("damaged"),
            Some(ReadOutcome::Silent) | None => Err("no reply"),
        };
        LiveValue {
            name: register.name.clone(),
            label: register.title.clone(),
            text,
        }
    };
    telling(model).into_iter().map(value).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::vendors;

    #[test]
    fn every_model_has_values_to_compare_with_its_panel() {
        let without = vendors::catalog()
            .models()
            .filter(|model| telling(model).is_empty())
            .count();
        assert_eq!(without, 0);
    }

    #[test]
    fn a_word_is_shown_as_the_candidate_scales_it_and_a_missing_one_says_why() {
        let catalog = vendors::catalog();
        let model = catalog.find("hyundai-n700").unwrap();
        let registers = telling(model);
        let heard = HeardAt::from([
            (registers[0].address, ReadOutcome::Word(5000)),
            (registers[1].address, ReadOutcome::Exception(2)),
        ]);
        let shown = shown(model, &heard);
        assert!(
            shown[0]
                .text
                .as_ref()
                .is_ok_and(|text| text.starts_with("50.00 ")),
            "{shown:?}"
        );
        assert_eq!(shown[1].text, Err("refused"));
        assert!(
            shown[2..].iter().all(|value| value.text == Err("no reply")),
            "{shown:?}"
        );
    }
}
