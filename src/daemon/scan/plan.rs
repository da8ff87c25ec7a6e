//! What a scan tries, in which order, and how long that takes: settings, the reads that find drives, the reads that
//! distinguish models. All of it follows from the models.

use super::judge::words;
use super::survey::{FoundDrive, ScanFindings};
use crate::domain::address::Address;
use crate::domain::link::{Framing, LinkSettings, Parity};
use crate::gateway::DriveSetup;
use crate::journal::RememberedDrive;
use crate::line::timeouts::{ReplyTimeouts, RequestClass};
use crate::line::timing::LineTiming;
use crate::profile::model::{DriveQuirks, Model};
use std::cmp::Reverse;
use std::collections::BTreeSet;
use std::ops::RangeInclusive;
use std::sync::Arc;
use std::time::Duration;

/// How long the line is observed before the first frame.
pub const LISTEN: Duration = Duration::from_secs(2);
/// Most reads that one station may cost while its model is determined, however many models there are.
pub const READS_MAX: u32 = 32;
/// Most of them without an answer, and one more at a register of the likeliest model.
pub const SILENCES_MAX: u32 = 3;
/// The assumed time of an answer beyond its characters: drives need some milliseconds, adapters as many.
const ANSWERS_WITHIN: Duration = Duration::from_millis(50);
/// Time to open a port.
const OPENS_WITHIN: Duration = Duration::from_millis(200);
/// Largest request, and largest reply to it, in bytes.
const REQUEST_PDU_BYTES: usize = 5;

/// Everything that is tried.
#[derive(Clone, Debug)]
pub struct ScanPlan {
    /// In this order.
    pub settings: Vec<ScanSetting>,
    /// The stations, each once, in order.
    pub stations: Vec<u8>,
}

/// One setting of a line, and what is read with it.
#[derive(Clone, Debug)]
pub struct ScanSetting {
    /// Speed and character format.
    pub link: LinkSettings,
    /// The framing.
    pub framing: Framing,
    /// Models that may be set to this, those with it as factory setting first.
    pub candidates: Vec<Arc<Model>>,
    /// How many of them have it as factory setting.
    pub factory_count: usize,
    /// Reads of which every drive with this factory setting answers at least one.
    pub probes: Vec<ScanProbe>,
    /// Longest wait for an answer.
    pub timeout: Duration,
    /// How long after that one may still come.
    pub lateness: Duration,
}

/// A read that finds drives, and the times of those that it is meant for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ScanProbe {
    /// The address.
    pub address: Address,
    /// Longest wait for an answer.
    pub timeout: Duration,
    /// How long after that one may still come.
    pub lateness: Duration,
}

/// The user's selection.
#[derive(Clone, Debug, Default)]
pub struct ScanOptions {
    /// Every setting that some model has, not only factory settings.
    pub everything: bool,
    /// Only these speeds; empty: those of the models.
    pub bauds: Vec<u32>,
    /// Only this parity.
    pub parity: Option<Parity>,
    /// Only these stop bits.
    pub stop_bits: Option<u8>,
    /// Frames of text instead of binary ones.
    pub is_ascii: bool,
    /// The speed is set elsewhere: at the serial device server.
    pub is_network: bool,
    /// Longest wait for an answer; `None`: from the models.
    pub timeout: Option<Duration>,
}

impl ScanPlan {
    /// The plan for finding drives of `models` at `stations`.
    #[must_use]
    pub fn new(models: &[Arc<Model>], stations: Vec<u8>, wish: &ScanOptions) -> Self {
        let framing = if wish.is_ascii {
            Framing::Ascii
        } else {
            Framing::Rtu
        };
        let has_framing = |model: &&Arc<Model>| model.link.framings.value.contains(&framing);
        let models: Vec<Arc<Model>> = models
            .iter()
            .filter(has_framing)
            .map(|it| Arc::new(it.on(framing)))
            .collect();
        let links = if wish.is_network {
            vec![LinkSettings::DEFAULT]
        } else {
            links(&models, framing, wish)
        };
        let setting = |link| ScanSetting::new(&models, link, framing, wish);
        Self {
            settings: links
                .into_iter()
                .map(setting)
                .filter(|it| !it.probes.is_empty())
                .collect(),
            stations,
        }
    }

    /// How long the line is in use if no station answers, and how much longer if every station does.
    #[must_use]
    pub fn duration(&self) -> (Duration, Duration) {
        let stations = u32::try_from(self.stations.len()).unwrap_or(u32::MAX);
        let silent = self
            .settings
            .iter()
            .map(|setting| setting.when_silent(stations))
            .sum::<Duration>()
            + LISTEN;
        let determined = self
            .settings
            .iter()
            .map(ScanSetting::when_determined)
            .max()
            .unwrap_or_default();
        (silent, determined * stations)
    }
}

impl ScanPlan {
    /// The largest number of reads that look for drives.
    #[must_use]
    pub fn asks(&self) -> usize {
        self.asks_before(self.settings.len())
    }

    /// The largest number of reads that look for drives with the settings before the one with index `setting`.
    #[must_use]
    pub fn asks_before(&self, setting: usize) -> usize {
        self.settings
            .iter()
            .take(setting)
            .map(|it| it.probes.len() * self.stations.len())
            .sum()
    }

    /// The setting with which most drives of a known model answer; `None` if no drive does.
    #[must_use]
    pub fn most_answer(&self, findings: &ScanFindings) -> Option<usize> {
        let known = |finding: &&FoundDrive| !finding.verdict.fits.is_empty();
        let count = |number: usize| {
            findings
                .drives
                .iter()
                .filter(known)
                .filter(|it| it.setting == number)
                .count()
        };
        let most = (0..self.settings.len())
            .rev()
            .max_by_key(|number| count(*number))?;
        (count(most) > 0).then_some(most)
    }
}

impl ScanSetting {
    fn new(
        models: &[Arc<Model>],
        link: LinkSettings,
        framing: Framing,
        wish: &ScanOptions,
    ) -> Self {
        let leaves_so = |model: &Model| wish.is_network || is_factory(model, link, framing);
        let (factory, other): (Vec<Arc<Model>>, Vec<Arc<Model>>) = models
            .iter()
            .filter(|model| {
                wish.is_network || may_be_set(model, link) || wish.bauds.contains(&link.baud)
            })
            .cloned()
            .partition(|model| leaves_so(model));
        let asked = if factory.is_empty() { &other } else { &factory };
        let mut probes = probes(asked);
        for probe in &mut probes {
            probe.timeout = wish.timeout.unwrap_or(probe.timeout);
        }
        let timeout = probes
            .iter()
            .map(|probe| probe.timeout)
            .max()
            .unwrap_or_default();
        let lateness = probes
            .iter()
            .map(|probe| probe.lateness)
            .max()
            .unwrap_or_default();
        let factory_count = factory.len();
        let candidates = [factory, other].concat();
        Self {
            link,
            framing,
            candidates,
            factory_count,
            probes,
            timeout,
            lateness,
        }
    }

    /// This setting with the times of one of its probes.
    #[must_use]
    pub fn with(&self, probe: &ScanProbe) -> Self {
        Self {
            timeout: probe.timeout,
            lateness: probe.lateness,
            ..self.clone()
        }
    }

    /// Times of a line with this setting.
    #[must_use]
    pub fn timing(&self) -> LineTiming {
        let models = self.candidates.iter().map(AsRef::as_ref);
        LineTiming::for_models(self.framing, self.link, models, Duration::ZERO)
    }

    /// A station known only by its address: it is never polled.
    #[must_use]
    pub fn station(&self, station: u8) -> Option<DriveSetup> {
        let like = self
            .candidates
            .iter()
            .max_by_key(|model| model.timing.reply_char_bits.as_ref().map(|it| it.value))?;
        let model = Model {
            registers: Vec::new(),
            barriers: Vec::new(),
            status: Vec::new(),
            setup: Vec::new(),
            run: None,
            watchdog: None,
            quirks: DriveQuirks::default(),
            ..Model::clone(like)
        };
        Some(DriveSetup {
            station: crate::domain::ids::Station(station),
            model: Arc::new(model),
            poll: Duration::from_secs(3600),
            timeouts: ReplyTimeouts::fixed(self.timeout),
            max_lateness: self.lateness,
            control: None,
            remembered: RememberedDrive::default(),
        })
    }

    /// Time for `stations` that do not answer.
    fn when_silent(&self, stations: u32) -> Duration {
        let round = |probe: &ScanProbe| {
            self.exchange(probe.timeout) * stations + probe.lateness + OPENS_WITHIN
        };
        self.probes.iter().map(round).sum()
    }

    /// Time to determine the model of one station that answers, with all silences that this may cost.
    fn when_determined(&self) -> Duration {
        let is_determined_by_silence = self
            .candidates
            .iter()
            .any(|model| model.exceptions.is_empty());
        let silence = self.exchange(self.timeout) + self.lateness + self.exchange(ANSWERS_WITHIN);
        let silences = if is_determined_by_silence {
            silence * (SILENCES_MAX + 1)
        } else {
            Duration::ZERO
        };
        self.exchange(ANSWERS_WITHIN) * READS_MAX + silences
    }

    fn exchange(&self, wait: Duration) -> Duration {
        let timing = self.timing();
        // The line is silent before the request and again after the wait.
        timing.on_wire(timing.adu_bytes(REQUEST_PDU_BYTES)) * 2 + wait + timing.silence * 2
    }
}

/// `9600 8N1`, with ` ascii` if it is.
#[must_use]
pub fn setting_text(setting: &ScanSetting) -> String {
    let ascii = if setting.framing == Framing::Ascii {
        " ascii"
    } else {
        ""
    };
    format!("{}{ascii}", setting.link)
}

fn is_factory(model: &Model, link: LinkSettings, framing: Framing) -> bool {
    // A drive whose factory setting is unknown is searched at one usual setting: at all of them it would cost minutes per model.
    let factory = model.link.played();
    match framing {
        Framing::Rtu | Framing::Mbap => factory == link,
        // Data bits that only ASCII frames can have are not a factory setting.
        Framing::Ascii => {
            LinkSettings {
                data_bits: link.data_bits,
                ..factory
            } == link
        }
    }
}

fn may_be_set(model: &Model, link: LinkSettings) -> bool {
    let of = &model.link;
    of.bauds.value.contains(&link.baud)
        && of.parities.value.contains(&link.parity)
        && of.stop_bits.value.contains(&link.stop_bits)
        && of.data_bits.value.contains(&link.data_bits)
}

/// The settings to try: factory settings, then the others as far as requested. In each of the two, those come first with which
/// most models leave the factory; of equals the fastest.
fn links(models: &[Arc<Model>], framing: Framing, wish: &ScanOptions) -> Vec<LinkSettings> {
    let data_bits: &[u8] = if framing == Framing::Ascii {
        &[8, 7]
    } else {
        &[8]
    };
    let is_wanted = |link: &LinkSettings| {
        (wish.bauds.is_empty() || wish.bauds.contains(&link.baud))
            && wish.parity.is_none_or(|parity| link.parity == parity)
            && wish
                .stop_bits
                .is_none_or(|stop_bits| link.stop_bits == stop_bits)
    };
    let mut factory: Vec<LinkSettings> = Vec::new();
    for model in models {
        let known = model.link.played();
        let of_model = data_bits.iter().map(|data_bits| LinkSettings {
            data_bits: *data_bits,
            ..known
        });
        let new = of_model.filter(|link| may_be_set(model, *link) && is_wanted(link));
        factory.extend(
            new.filter(|link| !factory.contains(link))
                .collect::<Vec<_>>(),
        );
    }
    let order = |link: &LinkSettings| order(models, *link, framing);
    factory.sort_by_key(order);
    let is_restricted = !wish.bauds.is_empty() || wish.parity.is_some() || wish.stop_bits.is_some();
    if !wish.everything && !is_restricted {
        return factory;
    }
    let known = models
        .iter()
        .flat_map(|model| model.link.bauds.value.iter().copied());
    let bauds: BTreeSet<u32> = if wish.bauds.is_empty() {
        known.collect()
    } else {
        wish.bauds.iter().copied().collect()
    };
    let mut others = Vec::new();
    for baud in bauds {
        for parity in [Parity::None, Parity::Even, Parity::Odd] {
            for stop_bits in [1, 2] {
                others.extend(data_bits.iter().map(|data_bits| LinkSettings {
                    baud,
                    data_bits: *data_bits,
                    parity,
                    stop_bits,
                }));
            }
        }
    }
    let is_possible = |link: &LinkSettings| {
        wish.bauds.contains(&link.baud) || models.iter().any(|model| may_be_set(model, *link))
    };
    others.retain(|link| is_wanted(link) && is_possible(link) && !factory.contains(link));
    others.sort_by_key(order);
    [factory, others].concat()
}

/// How many models are known to leave the factory with `link`, then its speed; the smallest comes first.
fn order(
    models: &[Arc<Model>],
    link: LinkSettings,
    framing: Framing,
) -> (Reverse<usize>, Reverse<u32>, u8, u8, bool) {
    let is_known =
        |model: &&Arc<Model>| model.link.factory().is_some() && is_factory(model, link, framing);
    let count = models.iter().filter(is_known).count();
    (
        Reverse(count),
        Reverse(link.baud),
        8 - link.data_bits,
        link.stop_bits,
        link.parity != Parity::None,
    )
}

/// Few reads, one of which each of `models` answers. A drive whose exceptions are known answers whatever it is asked; of
/// others it is unknown what they do about an address that they do not have. Holding registers are preferred: few drives
/// lack function 03.
pub fn probes(models: &[Arc<Model>]) -> Vec<ScanProbe> {
    let answers = |(model, words): &Known<'_>, address| {
        words.contains(&address) || !model.exceptions.is_empty() || model.read.reads_holes()
    };
    let mut left: Vec<Known<'_>> = models
        .iter()
        .map(|model| (model, words(model).into_keys().collect()))
        .collect();
    let mut probes = Vec::new();
    while !left.is_empty() {
        let addresses: BTreeSet<Address> = left
            .iter()
            .flat_map(|(_, words)| words.iter().copied())
            .collect();
        let count = |address: Address| left.iter().filter(|it| answers(it, address)).count();
        // Of equal ones the lowest.
        let Some(address) = addresses
            .into_iter()
            .rev()
            .max_by_key(|address| count(*address))
        else {
            break;
        };
        let (found, others): (Vec<_>, Vec<_>) =
            left.into_iter().partition(|it| answers(it, address));
        let waits = found
            .iter()
            .map(|(model, _)| ReplyTimeouts::auto(&model.timing).of(RequestClass::Read));
        let lateness = found
            .iter()
            .map(|(model, _)| model.timing.max_lateness.value)
            .max()
            .unwrap_or_default();
        probes.push(ScanProbe {
            address,
            timeout: waits.max().unwrap_or_default(),
            lateness,
        });
        left = others;
    }
    probes
}

/// A model, and the addresses that it has.
type Known<'a> = (&'a Arc<Model>, BTreeSet<Address>);

/// Stations in text form: `1-32`, `1,3,7-9`.
///
/// # Errors
/// What is wrong, and what would be correct.
pub fn stations(text: &str) -> Result<Vec<u8>, String> {
    let wrong = || {
        format!(
            "{text} names no stations: numbers from 1 to 247 and ranges of them, such as 1-32 or 1,3,7-9"
        )
    };
    let mut all = BTreeSet::new();
    for part in text.split(',') {
        let (first, last) = part.split_once('-').unwrap_or((part, part));
        let number = |text: &str| {
            text.trim()
                .parse::<u8>()
                .ok()
                .filter(|number| (1..=247).contains(number))
        };
        let first = number(first).ok_or_else(wrong)?;
        let last = number(last).ok_or_else(wrong)?;
        if first > last {
            return Err(wrong());
        }
        all.extend(RangeInclusive::new(first, last));
    }
    Ok(all.into_iter().collect())
}
