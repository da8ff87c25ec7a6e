//! Which models a drive may be, by what it answered, and what to ask it next. A model is dropped only for an answer that
//! contradicts its file: files leave registers out, so that an answer where a file has none says little.

use crate::domain::address::Address;
use crate::profile::model::{Model, ReadHoles};
use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;

/// Registers of a model that must answer before its name is given alone.
pub const TELLING: usize = 3;
/// How many answers a model must leave unexplained, before one that explains all of them takes its place.
const UNEXPLAINED: usize = 3;
/// What contradicts a model as much as one proven register that is refused.
const CONTRADICTED: usize = 2;

/// The outcome of one read.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ReadOutcome {
    /// The word of the register.
    Word(u16),
    /// The drive answered with an exception.
    Exception(u8),
    /// Something arrived that is not an answer.
    Damaged,
    /// No byte arrived.
    Silent,
}

/// A model as a scan sees it.
#[derive(Debug)]
pub struct SuspectModel {
    /// The model.
    pub model: Arc<Model>,
    /// The model leaves the factory with the setting that is tried.
    is_factory: bool,
    /// The words that it has alone at their addresses, and whether they are proven.
    words: BTreeMap<Address, bool>,
}

impl SuspectModel {
    /// A model to look for.
    pub fn new(model: &Arc<Model>, is_factory: bool) -> Self {
        Self {
            words: words(model),
            model: Arc::clone(model),
            is_factory,
        }
    }

    /// Most registers of `self` are registers of `other` too: what answers as `other` may well be `self`.
    fn is_like(&self, other: &Self) -> bool {
        let shared = self
            .words
            .keys()
            .filter(|address| other.words.contains_key(address))
            .count();
        2 * shared >= self.words.len()
    }
}

/// The words that a scan may read from a drive of `model`: one by one, so no halves of pairs.
pub fn words(model: &Model) -> BTreeMap<Address, bool> {
    let single = model
        .registers
        .iter()
        .filter(|it| it.access.can_read() && it.form.words() == 1);
    let mut words = BTreeMap::new();
    for register in single {
        *words.entry(register.address).or_default() |= register.confidence.is_proven();
    }
    words
}

/// The answers of one station.
#[derive(Clone, Debug, Default)]
pub struct StationEvidence {
    heard: BTreeMap<Address, ReadOutcome>,
    /// Addresses that no model has.
    nowhere: BTreeSet<Address>,
    /// Silences while nothing was known of the station: it may not have listened.
    early: BTreeSet<Address>,
}

impl StationEvidence {
    /// Adds an answer.
    pub fn hear(&mut self, address: Address, heard: ReadOutcome) {
        self.heard.insert(address, heard);
    }

    /// Adds the answer at an address that no model has.
    pub fn hear_nowhere(&mut self, address: Address, heard: ReadOutcome) {
        self.nowhere.insert(address);
        self.hear(address, heard);
    }

    /// Adds a silence of a station of which nothing was known then.
    pub fn was_silent(&mut self, address: Address) {
        self.early.insert(address);
        self.hear(address, ReadOutcome::Silent);
    }

    /// What was heard at `address`.
    pub fn at(&self, address: Address) -> Option<ReadOutcome> {
        self.heard.get(&address).copied()
    }

    /// The station also answers where no model has a register: an answer proves little.
    pub fn answers_anything(&self) -> bool {
        self.nowhere
            .iter()
            .any(|address| matches!(self.at(*address), Some(ReadOutcome::Word(_))))
    }

    fn refuses(&self) -> bool {
        let refused = |(address, heard): (&Address, &ReadOutcome)| {
            !matches!(heard, ReadOutcome::Word(_)) && !self.early.contains(address)
        };
        self.heard.iter().any(refused)
    }
}

/// What the answers of a station say about one model.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct ModelStanding {
    /// How much contradicts it.
    against: usize,
    /// Answers at registers that it has.
    answered: usize,
    /// Answers that its file does not explain.
    unexplained: usize,
    /// What its identity says.
    identity: Option<IdentityMatch>,
}

/// What a register that tells the model says.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum IdentityMatch {
    As,
    Other(u16),
}

impl ModelStanding {
    fn of(suspect: &SuspectModel, evidence: &StationEvidence) -> Self {
        let mut it = Self::default();
        let model = &suspect.model;
        let (mut is_odd, refuses) = (false, evidence.refuses());
        for (address, heard) in &evidence.heard {
            let proven = suspect.words.get(address).copied();
            match heard {
                ReadOutcome::Word(word) => {
                    it.word(model, *address, *word, proven.is_some(), refuses)
                }
                ReadOutcome::Damaged => {}
                ReadOutcome::Silent | ReadOutcome::Exception(_) => {
                    let is_early = evidence.early.contains(address);
                    it.against += match proven {
                        Some(true) if !is_early => CONTRADICTED,
                        Some(_) => 1,
                        None => 0,
                    };
                    // What a file says of all other addresses: sure enough for one mark, however many there are.
                    let answers = model.read.reads_holes()
                        || (*heard == ReadOutcome::Silent && !model.exceptions.is_empty());
                    is_odd |= answers && model.readable_at(*address).is_none();
                }
            }
        }
        it.against += usize::from(is_odd);
        it
    }

    fn word(&mut self, model: &Model, address: Address, word: u16, is_own: bool, refuses: bool) {
        if let Some(identity) = model.identity.as_ref().filter(|it| it.address == address) {
            self.identity = Some(if identity.is_right(word) {
                IdentityMatch::As
            } else {
                IdentityMatch::Other(word & identity.mask)
            });
        }
        let proves = match model.read.holes.as_ref().map(|it| it.value) {
            None | Some(ReadHoles::Refused) => true,
            Some(ReadHoles::Zero) => word != 0,
            Some(ReadHoles::Read) => false,
        };
        if is_own {
            self.answered += usize::from(proves);
            self.against += usize::from(
                model
                    .fields_at(address)
                    .any(|register| !register.takes(word)),
            );
        } else if refuses && proves && model.readable_at(address).is_none() {
            self.unexplained += 1;
        }
    }

    fn is_out(self) -> bool {
        self.against >= CONTRADICTED || matches!(self.identity, Some(IdentityMatch::Other(_)))
    }

    /// The name that the identity of `suspect` gives the drive, if nothing else contradicts that model.
    fn names_other(self, suspect: &SuspectModel) -> Option<&str> {
        match self.identity {
            Some(IdentityMatch::Other(word)) if self.against == 0 => {
                suspect.model.identity.as_ref()?.other(word)
            }
            _ => None,
        }
    }

    /// The best is the least.
    fn rank(self) -> impl Ord {
        (
            self.identity.is_none(),
            self.unexplained,
            self.against,
            std::cmp::Reverse(self.answered),
        )
    }
}

/// What it costs to ask a station for a register that it does not have.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum RefusalCost {
    /// The drive answers with an exception, as far as is known.
    Cheap,
    /// The drive does not answer, which takes a time-out.
    Dear,
    /// The drive has cost as many time-outs as it may.
    TooDear,
}

/// What is known of a station so far.
#[derive(Debug)]
pub struct StationJudgement<'a> {
    /// The models that may be it, the best first.
    left: Vec<(&'a SuspectModel, ModelStanding)>,
    /// The first model that only its identity rules out.
    kin: Option<(&'a SuspectModel, ModelStanding)>,
    /// What a register of a model says that fits otherwise: the name of another drive.
    pub other: Option<String>,
}

impl<'a> StationJudgement<'a> {
    /// Judges all `suspects` by `evidence`.
    pub fn new(suspects: &'a [SuspectModel], evidence: &StationEvidence) -> Self {
        let all = suspects
            .iter()
            .map(|suspect| (suspect, ModelStanding::of(suspect, evidence)));
        let (out, mut left): (Vec<_>, Vec<_>) = all.partition(|(_, standing)| standing.is_out());
        left.sort_by_key(|(_, standing)| standing.rank());
        if evidence.answers_anything()
            && left
                .iter()
                .any(|(suspect, _)| suspect.model.read.reads_holes())
        {
            left.retain(|(suspect, _)| suspect.model.read.reads_holes());
        }
        if let Some(best @ (suspect, standing)) = left.first().copied() {
            let is_sure = standing.identity.is_some()
                && standing.answered >= TELLING
                && !evidence.answers_anything();
            left.retain(|rival| {
                let is_best = std::ptr::eq(rival.0, suspect);
                is_best
                    || !(is_explained_better(best, *rival)
                        || (is_sure && rival.1.identity.is_none()))
            });
        }
        let mut kin = out
            .into_iter()
            .filter_map(|(suspect, it)| Some((suspect, it, it.names_other(suspect)?)));
        let kin = kin.next();
        let other = kin
            .filter(|(_, it, _)| it.answered >= TELLING)
            .map(|(_, _, name)| name.to_owned());
        Self {
            left,
            kin: kin.map(|(suspect, it, _)| (suspect, it)),
            other,
        }
    }

    /// The models that may be it with what speaks for each, the best first. None as long as no register answered.
    pub fn fits(&self, evidence: &StationEvidence) -> Vec<(Arc<Model>, String)> {
        let is_seen = self.left.iter().any(|(_, standing)| standing.answered > 0);
        let fitting = self
            .left
            .iter()
            .filter(|(_, it)| it.answered > 0 || (!is_seen && evidence.answers_anything()));
        fitting
            .map(|(suspect, standing)| (Arc::clone(&suspect.model), why(suspect, *standing)))
            .collect()
    }

    /// Whether the best one has shown enough.
    pub fn is_determined(&self) -> bool {
        self.left
            .first()
            .is_some_and(|(suspect, it)| it.answered >= TELLING.min(suspect.words.len()))
    }

    /// The address to read next; `None` if nothing would tell more.
    pub fn next(&self, evidence: &StationEvidence, refusals: RefusalCost) -> Option<Address> {
        let is_new = |address: &Address| evidence.at(*address).is_none();
        let fits_better = |it: &ModelStanding| {
            self.left
                .first()
                .is_none_or(|(_, best)| best.answered < it.answered)
        };
        if let Some((kin, _)) = self
            .kin
            .filter(|(_, it)| it.answered < TELLING && fits_better(it))
            && let Some(next) = kin.words.keys().copied().find(is_new)
        {
            return Some(next);
        }
        let (best, standing) = *self.left.first()?;
        if standing.answered >= TELLING
            && let Some(identity) = best
                .model
                .identity
                .as_ref()
                .map(|it| it.address)
                .filter(is_new)
        {
            return Some(identity);
        }
        let addresses: BTreeSet<Address> = self
            .left
            .iter()
            .flat_map(|(suspect, _)| suspect.words.keys().copied())
            .filter(is_new)
            .collect();
        let value = |address: Address| match standing.answered {
            0 if refusals == RefusalCost::TooDear => 0,
            0 => self.splits(address),
            _ => self.tells(address, refusals),
        };
        // Of equal ones the lowest.
        let most = addresses
            .into_iter()
            .rev()
            .max_by_key(|address| value(*address))?;
        (value(most) > 0).then_some(most)
    }

    /// How many models an answer at `address` speaks for, those with this factory setting first.
    fn splits(&self, address: Address) -> usize {
        let has = self
            .left
            .iter()
            .filter(|(suspect, _)| suspect.words.contains_key(&address));
        has.map(|(suspect, _)| if suspect.is_factory { 4 } else { 1 })
            .sum()
    }

    /// How much an answer at `address` tells between the best model and the others.
    fn tells(&self, address: Address, refusals: RefusalCost) -> usize {
        let Some((best, standing)) = self.left.first().copied() else {
            return 0;
        };
        let rivals = || self.left.iter().skip(1);
        if best.words.contains_key(&address) {
            let lacking = rivals().filter(|(it, _)| !it.words.contains_key(&address));
            let gain = |(it, rival): &(&SuspectModel, ModelStanding)| match (
                it.is_like(best),
                rival.unexplained,
            ) {
                (false, 0..UNEXPLAINED) => 8,
                (true, 0) => 2,
                _ => 0,
            };
            return lacking.map(gain).sum::<usize>() + usize::from(standing.answered < TELLING);
        }
        let weight = |(it, _): &(&SuspectModel, ModelStanding)| match it.words.get(&address) {
            Some(true) => 8,
            Some(false) => 5,
            None => 0,
        };
        let gain: usize = rivals().map(weight).sum();
        match refusals {
            RefusalCost::Cheap => gain,
            RefusalCost::Dear => gain.div_ceil(8),
            RefusalCost::TooDear => 0,
        }
    }
}

/// `best` explains everything, `rival` does not, and is no drive of its kind.
fn is_explained_better(
    best: (&SuspectModel, ModelStanding),
    rival: (&SuspectModel, ModelStanding),
) -> bool {
    let is_whole = best.1.answered >= TELLING && best.1.against == 0;
    is_whole && rival.1.unexplained >= best.1.unexplained + UNEXPLAINED && !rival.0.is_like(best.0)
}

fn why(suspect: &SuspectModel, standing: ModelStanding) -> String {
    let mut why = match standing.answered {
        1 => "1 register fits".to_owned(),
        count => format!("{count} registers fit"),
    };
    if standing.identity == Some(IdentityMatch::As)
        && let Some(identity) = &suspect.model.identity
    {
        let name = suspect
            .model
            .readable_at(identity.address)
            .map(|it| it.name.as_str())
            .unwrap_or_default();
        why = format!("its register {name} says so, and {why}");
    }
    if standing.unexplained > 0 {
        why.push_str(&format!(", {} more answer", standing.unexplained));
    }
    if standing.against > 0 {
        why.push_str(", one does not");
    }
    why
}

/// An address that none of `suspects` has.
pub fn nowhere(suspects: &[SuspectModel]) -> Option<Address> {
    let is_free = |number: &u16| {
        suspects.iter().all(|it| {
            it.model.register_at(*number).is_none() && it.model.readable_at(*number).is_none()
        })
    };
    (0..0x7000_u16).rev().find(is_free).map(Address::holding)
}
