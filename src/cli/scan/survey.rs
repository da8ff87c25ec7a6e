//! The course of a scan: who answers, and what it probably is. It knows neither port nor clock, so that a test can play it
//! on a simulated line in simulated time.

use super::plan::{Plan, SILENCES_MAX, Setting, nowhere, readable, telling};
use crate::cli::Failure;
use crate::profile::model::Model;
use std::collections::{BTreeMap, BTreeSet, VecDeque};
use std::sync::Arc;

/// What came of one read.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Heard {
    /// The word of the register.
    Word(u16),
    /// The drive answered that it will not.
    Exception(u8),
    /// Something came that is no answer.
    Damaged,
    /// Nothing came.
    Silent,
}

/// Whoever asks on the line.
pub trait Asker {
    /// Takes the line with this setting, for these stations.
    ///
    /// # Errors
    /// The line cannot be used, or somebody else uses it.
    async fn open(&mut self, setting: &Setting, stations: &[u8]) -> Result<(), Failure>;

    /// Reads one register of one of them.
    ///
    /// # Errors
    /// The line is lost, or somebody else uses it.
    async fn ask(&mut self, station: u8, address: u16) -> Result<Heard, Failure>;
}

/// Something that people want to see at once.
#[derive(Debug)]
pub enum Event<'a> {
    /// A setting is begun: which one, from 0.
    Setting(usize),
    /// So many stations of a round are done.
    Asked,
    /// A station answers.
    Answers(u8),
    /// What it is was looked for.
    Told(&'a Finding),
}

/// One drive that answers.
#[derive(Clone, Debug, PartialEq)]
pub struct Finding {
    /// With which setting, by its place in the plan.
    pub setting: usize,
    /// Its number.
    pub station: u8,
    /// It answered with an exception, not with a word.
    pub by_exception: bool,
    /// What it may be.
    pub verdict: Verdict,
}

/// What a drive may be.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Verdict {
    /// The models that fit, the likeliest first.
    pub fits: Vec<Arc<Model>>,
    /// It answers also what no model knows: what fits, proves little.
    pub answers_anything: bool,
}

impl Verdict {
    /// How sure it is, in a word.
    #[must_use]
    pub fn word(&self) -> &'static str {
        match (self.fits.len(), self.answers_anything) {
            (0, _) => "unknown",
            (1, false) => "probable",
            _ => "possible",
        }
    }
}

/// What a scan has found so far.
#[derive(Clone, Debug, Default)]
pub struct Findings {
    /// Drives, in the order in which they answered.
    pub drives: Vec<Finding>,
    /// Stations from which only damaged answers came, by setting.
    pub damaged: BTreeMap<usize, BTreeSet<u8>>,
    /// Every setting was tried.
    pub is_complete: bool,
}

impl Findings {
    /// Whether `station` answers with a setting that differs in stop bits alone: then it is the same drive.
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

/// Asks each station until it answers. Returns those that do, with the address at which they did.
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

/// Reads what tells the models apart, those first that leave the factory with this setting. `probe` is known to be
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
        if !look.fits(model, all).await? {
            has_refused = true;
            continue;
        }
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
        // Who has shown that it does not answer everything, can only be one that has all of these too.
        if !verdict.answers_anything {
            queue.retain(|other| told.iter().all(|address| readable(other, *address).is_some()));
        }
    }
    Ok(verdict)
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
    /// Whether all registers that tell `model` from the others are there, with words that they take.
    async fn fits(&mut self, model: &Model, all: &[Arc<Model>]) -> Result<bool, Failure> {
        for address in telling(model, all) {
            let heard = self.ask(address).await?;
            let Heard::Word(word) = heard else { return Ok(false) };
            if readable(model, address).is_none_or(|register| !register.takes(word)) {
                return Ok(false);
            }
        }
        Ok(true)
    }

    /// Reads `address`, once. After a silence the station is asked for what it answers, so that it does not count as gone.
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
