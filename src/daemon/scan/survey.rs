//! The course of a scan: which stations answer, and what they probably are. It knows neither port nor clock, so that a
//! test can run it on a simulated line in simulated time.

use super::ScanError;
use super::judge::{
    ReadOutcome, RefusalCost, StationEvidence, StationJudgement, SuspectModel, nowhere,
};
use super::plan::{READS_MAX, SILENCES_MAX, ScanPlan, ScanSetting};
use crate::domain::address::Address;
use crate::profile::model::Model;
use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;

/// Sends the requests on the line.
pub trait LineAsker {
    /// Opens the line with this setting, for these stations.
    ///
    /// # Errors
    /// The line cannot be used, or another master uses it.
    fn open(
        &mut self,
        setting: &ScanSetting,
        stations: &[u8],
    ) -> impl Future<Output = Result<(), ScanError>>;

    /// Reads one register of one of them.
    ///
    /// # Errors
    /// The line is lost, or another master uses it.
    fn ask(
        &mut self,
        station: u8,
        address: Address,
    ) -> impl Future<Output = Result<ReadOutcome, ScanError>>;
}

/// An event that is shown at once.
#[derive(Debug)]
pub enum ScanEvent<'a> {
    /// A setting is started: which one, from 0.
    Setting(usize),
    /// This many stations of a round are done.
    Asked,
    /// A station answers.
    Answers(u8),
    /// The model of the drive that answers was searched for.
    Told(&'a FoundDrive),
}

/// One drive that answers.
#[derive(Clone, Debug, PartialEq)]
pub struct FoundDrive {
    /// Its setting, by its index in the plan.
    pub setting: usize,
    /// Its station number.
    pub station: u8,
    /// The drive answered with an exception, not with a word.
    pub by_exception: bool,
    /// Its model candidates.
    pub verdict: ModelVerdict,
}

/// The models that a drive may be.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct ModelVerdict {
    /// The models that fit, the most likely first, each with what speaks for it.
    pub fits: Vec<(Arc<Model>, String)>,
    /// The drive says that it is this one, which is no model.
    pub other: Option<String>,
    /// Too little was heard to give a single name.
    pub is_open: bool,
    /// The drive also answers addresses that no model has: a fit proves little.
    pub answers_anything: bool,
}

impl ModelVerdict {
    /// The confidence, in one word.
    #[must_use]
    pub fn keyword(&self) -> &'static str {
        match (self.fits.len(), self.answers_anything || self.is_open) {
            (0, _) => "unknown",
            (1, false) => "probable",
            _ => "possible",
        }
    }
}

/// The findings of a scan so far.
#[derive(Clone, Debug, Default)]
pub struct ScanFindings {
    /// Drives, in the order in which they answered.
    pub drives: Vec<FoundDrive>,
    /// Stations that sent only damaged answers, by setting.
    pub damaged: BTreeMap<usize, BTreeSet<u8>>,
    /// Every setting was tried.
    pub is_complete: bool,
}

impl ScanFindings {
    /// Whether `station` answers with a setting that differs only in stop bits: then it is the same drive.
    fn has_like(&self, plan: &ScanPlan, setting: &ScanSetting, station: u8) -> bool {
        self.drives.iter().any(|drive| {
            let link = plan.settings.get(drive.setting).map(|it| it.link);
            drive.station == station
                && link.is_some_and(|link| {
                    (link.baud, link.parity) == (setting.link.baud, setting.link.parity)
                })
        })
    }
}

/// Tries everything in `plan`, in its order.
///
/// # Errors
/// Those of `asker`; what was found so far stays in `findings`.
pub async fn survey(
    plan: &ScanPlan,
    asker: &mut impl LineAsker,
    findings: &mut ScanFindings,
    mut tell: impl FnMut(ScanEvent<'_>),
) -> Result<(), ScanError> {
    for (number, setting) in plan.settings.iter().enumerate() {
        tell(ScanEvent::Setting(number));
        let answered = find_stations(plan, number, asker, findings, &mut tell).await?;
        if answered.is_empty() {
            continue;
        }
        asker
            .open(setting, &answered.keys().copied().collect::<Vec<_>>())
            .await?;
        for (station, (probe, evidence)) in answered {
            let verdict = identify(setting, station, probe, evidence, asker).await?;
            let of_station =
                |drive: &&mut FoundDrive| drive.setting == number && drive.station == station;
            if let Some(finding) = findings.drives.iter_mut().find(of_station) {
                finding.verdict = verdict;
                tell(ScanEvent::Told(finding));
            }
        }
    }
    findings.is_complete = true;
    Ok(())
}

/// Requests each station until it answers. Returns those that do, with the address at which they did, and all that was
/// heard of them.
async fn find_stations(
    plan: &ScanPlan,
    number: usize,
    asker: &mut impl LineAsker,
    findings: &mut ScanFindings,
    tell: &mut impl FnMut(ScanEvent<'_>),
) -> Result<BTreeMap<u8, (Address, StationEvidence)>, ScanError> {
    let Some(setting) = plan.settings.get(number) else {
        return Ok(BTreeMap::new());
    };
    let is_new = |findings: &ScanFindings, station| !findings.has_like(plan, setting, station);
    let mut left: Vec<u8> = plan
        .stations
        .iter()
        .copied()
        .filter(|station| is_new(findings, *station))
        .collect();
    let mut answered = BTreeMap::new();
    let mut evidence: BTreeMap<u8, StationEvidence> = BTreeMap::new();
    for probe in &setting.probes {
        if left.is_empty() {
            break;
        }
        asker.open(&setting.with(probe), &left).await?;
        for station in std::mem::take(&mut left) {
            let heard = asker.ask(station, probe.address).await?;
            tell(ScanEvent::Asked);
            match heard {
                ReadOutcome::Word(_) | ReadOutcome::Exception(_) => {
                    let mut evidence = evidence.remove(&station).unwrap_or_default();
                    evidence.hear(probe.address, heard);
                    answered.insert(station, (probe.address, evidence));
                    findings.damaged.entry(number).or_default().remove(&station);
                    let by_exception = matches!(heard, ReadOutcome::Exception(_));
                    let verdict = ModelVerdict::default();
                    findings.drives.push(FoundDrive {
                        setting: number,
                        station,
                        by_exception,
                        verdict,
                    });
                    tell(ScanEvent::Answers(station));
                }
                ReadOutcome::Damaged => {
                    findings.damaged.entry(number).or_default().insert(station);
                    left.push(station);
                }
                ReadOutcome::Silent => {
                    // A slow drive may only have been late.
                    if probe.timeout >= setting.timeout {
                        evidence
                            .entry(station)
                            .or_default()
                            .was_silent(probe.address);
                    }
                    left.push(station);
                }
            }
        }
    }
    Ok(answered)
}

/// Reads what tells the models apart, until nothing more would. `probe` is known to be answered.
async fn identify(
    setting: &ScanSetting,
    station: u8,
    probe: Address,
    evidence: StationEvidence,
    asker: &mut impl LineAsker,
) -> Result<ModelVerdict, ScanError> {
    let all = setting.candidates.iter().enumerate();
    let suspects: Vec<SuspectModel> = all
        .filter(|(_, model)| model.link.stations.value.contains(&station))
        .map(|(index, model)| SuspectModel::new(model, index < setting.factory_count))
        .collect();
    let mut look = StationReads {
        asker,
        station,
        probe,
        silences: 0,
        evidence,
    };
    if let Some(nowhere) = nowhere(&suspects) {
        let heard = look.ask(nowhere).await?;
        look.evidence.hear_nowhere(nowhere, heard);
    }
    let mut judgement = StationJudgement::new(&suspects, &look.evidence);
    let mut reads = 0;
    while reads < READS_MAX && look.silences <= SILENCES_MAX {
        let Some(next) = judgement.next(&look.evidence, look.refusals()) else {
            break;
        };
        let heard = look.ask(next).await?;
        look.evidence.hear(next, heard);
        judgement = StationJudgement::new(&suspects, &look.evidence);
        reads += 1;
    }
    let is_open = !judgement.is_determined();
    let fits = judgement.fits(&look.evidence);
    Ok(ModelVerdict {
        fits,
        other: judgement.other,
        is_open,
        answers_anything: look.evidence.answers_anything(),
    })
}

/// The reads from one station.
struct StationReads<'a, A> {
    asker: &'a mut A,
    station: u8,
    /// An address that it answers.
    probe: Address,
    silences: u32,
    evidence: StationEvidence,
}

impl<A: LineAsker> StationReads<'_, A> {
    fn refusals(&self) -> RefusalCost {
        match self.silences {
            0 => RefusalCost::Cheap,
            SILENCES_MAX.. => RefusalCost::TooDear,
            _ => RefusalCost::Dear,
        }
    }

    /// Reads `address`. After a silence the station is asked for a known address, so that it does not count as gone.
    async fn ask(&mut self, address: Address) -> Result<ReadOutcome, ScanError> {
        let heard = self.asker.ask(self.station, address).await?;
        if matches!(heard, ReadOutcome::Silent | ReadOutcome::Damaged) {
            self.silences += 1;
            self.asker.ask(self.station, self.probe).await?;
        }
        Ok(heard)
    }
}
