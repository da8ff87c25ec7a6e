//! The course of a scan: which stations answer, and what they probably are. It knows neither port nor clock, so that a
//! test can run it on a simulated line in simulated time.

use super::plan::{Plan, SILENCES_MAX, Setting, nowhere, readable, telling};
use crate::cli::Failure;
use crate::profile::model::{Holes, Model};
use std::collections::{BTreeMap, BTreeSet, VecDeque};
use std::sync::Arc;

/// The outcome of one read.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Heard {
    /// The word of the register.
    Word(u16),
    /// The drive answered with an exception.
    Exception(u8),
    /// Something arrived that is not an answer.
    Damaged,
    /// No byte arrived.
    Silent,
}

/// Sends the requests on the line.
pub trait Asker {
    /// Opens the line with this setting, for these stations.
    ///
    /// # Errors
    /// The line cannot be used, or another master uses it.
    async fn open(&mut self, setting: &Setting, stations: &[u8]) -> Result<(), Failure>;

    /// Reads one register of one of them.
    ///
    /// # Errors
    /// The line is lost, or another master uses it.
    async fn ask(&mut self, station: u8, address: u16) -> Result<Heard, Failure>;
}

/// An event that is shown at once.
#[derive(Debug)]
pub enum Event<'a> {
    /// A setting is started: which one, from 0.
    Setting(usize),
    /// This many stations of a round are done.
    Asked,
    /// A station answers.
    Answers(u8),
    /// Its model was searched for.
    Told(&'a Finding),
}

/// One drive that answers.
#[derive(Clone, Debug, PartialEq)]
pub struct Finding {
    /// Its setting, by its index in the plan.
    pub setting: usize,
    /// Its station number.
    pub station: u8,
    /// It answered with an exception, not with a word.
    pub by_exception: bool,
    /// Its model candidates.
    pub verdict: Verdict,
}

/// The models that a drive may be.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Verdict {
    /// The models that fit, the most likely first.
    pub fits: Vec<Arc<Model>>,
    /// It also answers addresses that no model has: a fit proves little.
    pub answers_anything: bool,
}

impl Verdict {
    /// The confidence, in one word.
    #[must_use]
    pub fn word(&self) -> &'static str {
        match (self.fits.len(), self.answers_anything) {
            (0, _) => "unknown",
            (1, false) => "probable",
            _ => "possible",
        }
    }
}

/// The findings of a scan so far.
#[derive(Clone, Debug, Default)]
pub struct Findings {
    /// Drives, in the order in which they answered.
    pub drives: Vec<Finding>,
    /// Stations that sent only damaged answers, by setting.
    pub damaged: BTreeMap<usize, BTreeSet<u8>>,
    /// Every setting was tried.
    pub is_complete: bool,
}

impl Findings {
    /// Whether `station` answers with a setting that differs only in stop bits: then it is the same drive.
    fn has_like(&self, plan: &Plan, setting: &Setting, station: u8) -> bool {
        self.drives.iter().any(|drive| {
            let link = plan.settings.get(drive.setting).map(|it| it.link);
            drive.station == station
                && link.is_some_and(|link| (link.baud, link.parity) == (setting.link.baud, setting.link.parity))
        })
    }
}

/// Tries everything in `plan`, in its order.
///
/// # Errors
/// Those of `asker`; what was found so far stays in `findings`.
pub async fn survey(
    plan: &Plan,
    asker: &mut impl Asker,
    findings: &mut Findings,
    mut tell: impl FnMut(Event<'_>),
) -> Result<(), Failure> {
    for (number, setting) in plan.settings.iter().enumerate() {
        tell(Event::Setting(number));
        let answered = look(plan, number, asker, findings, &mut tell).await?;
        if answered.is_empty() {
            continue;
        }
        asker.open(setting, &answered.keys().copied().collect::<Vec<_>>()).await?;
        for (station, probe) in answered {
            let verdict = identify(setting, station, probe, asker).await?;
            let of_station = |drive: &&mut Finding| drive.setting == number && drive.station == station;
            if let Some(finding) = findings.drives.iter_mut().find(of_station) {
                finding.verdict = verdict;
                tell(Event::Told(finding));
            }
        }
    }
    findings.is_complete = true;
    Ok(())
}

/// Requests each station until it answers. Returns those that do, with the address at which they did.
async fn look(
    plan: &Plan,
    number: usize,
    asker: &mut impl Asker,
    findings: &mut Findings,
    tell: &mut impl FnMut(Event<'_>),
) -> Result<BTreeMap<u8, u16>, Failure> {
    let Some(setting) = plan.settings.get(number) else { return Ok(BTreeMap::new()) };
    let is_new = |findings: &Findings, station| !findings.has_like(plan, setting, station);
    let mut left: Vec<u8> = plan.stations.iter().copied().filter(|station| is_new(findings, *station)).collect();
    let mut answered = BTreeMap::new();
    for probe in &setting.probes {
        if left.is_empty() {
            break;
        }
        asker.open(setting, &left).await?;
        for station in std::mem::take(&mut left) {
            let heard = asker.ask(station, *probe).await?;
            tell(Event::Asked);
            match heard {
                Heard::Word(_) | Heard::Exception(_) => {
                    answered.insert(station, *probe);
                    findings.damaged.entry(number).or_default().remove(&station);
                    let by_exception = matches!(heard, Heard::Exception(_));
                    let verdict = Verdict::default();
                    findings.drives.push(Finding { setting: number, station, by_exception, verdict });
                    tell(Event::Answers(station));
                }
                Heard::Damaged => {
                    findings.damaged.entry(number).or_default().insert(station);
                    left.push(station);
                }
                Heard::Silent => left.push(station),
            }
        }
    }
    Ok(answered)
}

/// Reads the registers that distinguish the models, those first that have this factory setting. `probe` is known to be
/// answered.
async fn identify(setting: &Setting, station: u8, probe: u16, asker: &mut impl Asker) -> Result<Verdict, Failure> {
    let has_number = |model: &&Arc<Model>| model.link.stations.value.contains(&station);
    let all: Vec<Arc<Model>> = setting.candidates.iter().filter(has_number).cloned().collect();
    let all = &all[..];
    let mut look = Look { asker, station, probe, silences: 0, known: BTreeMap::new() };
    let mut verdict = Verdict::default();
    let mut has_refused = false;
    let mut queue: VecDeque<&Arc<Model>> = all.iter().collect();
    while let Some(model) = queue.pop_front() {
        if look.silences >= SILENCES_MAX {
            break;
        }
        let fit = look.fits(model, all).await?;
        if fit == Fit::No {
            has_refused = true;
            continue;
        }
        verdict.answers_anything |= fit == Fit::ProvesNothing;
        verdict.fits.push(Arc::clone(model));
        let told = telling(model, all);
        if verdict.fits.len() > 1 || verdict.answers_anything {
            continue;
        }
        if !has_refused
            && all.len() > 1
            && let Some(nowhere) = nowhere(all)
        {
            verdict.answers_anything = matches!(look.ask(nowhere).await?, Heard::Word(_));
        }
        // A station that has shown that it does not answer everything can only be one that has all of these too.
        if !verdict.answers_anything {
            queue.retain(|other| told.iter().all(|address| readable(other, *address).is_some()));
        }
    }
    Ok(verdict)
}

/// How a drive's words fit a model.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Fit {
    No,
    /// All of them are 0, as a drive of this model shows any address.
    ProvesNothing,
    Yes,
}

/// The reads from one station.
struct Look<'a, A> {
    asker: &'a mut A,
    station: u8,
    /// An address that it answers.
    probe: u16,
    silences: u32,
    known: BTreeMap<u16, Heard>,
}

impl<A: Asker> Look<'_, A> {
    /// Whether all registers that distinguish `model` from the others exist, with words that they accept.
    async fn fits(&mut self, model: &Model, all: &[Arc<Model>]) -> Result<Fit, Failure> {
        let mut fit = if model.read.reads_holes() { Fit::ProvesNothing } else { Fit::Yes };
        for address in telling(model, all) {
            let heard = self.ask(address).await?;
            let Heard::Word(word) = heard else { return Ok(Fit::No) };
            if readable(model, address).is_none_or(|register| !register.takes(word)) {
                return Ok(Fit::No);
            }
            if word != 0 && model.read.holes.as_ref().is_some_and(|holes| holes.value == Holes::Zero) {
                fit = Fit::Yes;
            }
        }
        Ok(fit)
    }

    /// Reads `address`, once. After a silence the station is asked for a known address, so that it does not count as
    /// gone.
    async fn ask(&mut self, address: u16) -> Result<Heard, Failure> {
        if let Some(heard) = self.known.get(&address) {
            return Ok(*heard);
        }
        let heard = self.asker.ask(self.station, address).await?;
        if matches!(heard, Heard::Silent | Heard::Damaged) {
            self.silences += 1;
            self.asker.ask(self.station, self.probe).await?;
        }
        self.known.insert(address, heard);
        Ok(heard)
    }
}
