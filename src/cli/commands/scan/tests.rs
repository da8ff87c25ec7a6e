//! Whole scans of simulated lines, in simulated time: the same core as on a port, with a clock that only the test moves.

use super::report::ScanReport;
use crate::cli::tools::input;
use crate::config::{self, PortAddress};
use crate::daemon::scan::ScanError;
use crate::daemon::scan::judge::ReadOutcome;
use crate::daemon::scan::plan::{
    LISTEN, ScanOptions, ScanPlan, ScanProbe, ScanSetting, probes, stations,
};
use crate::daemon::scan::survey::{LineAsker, ScanEvent, ScanFindings, survey};
use crate::domain::address::Address;
use crate::domain::command::{OrderManner, Origin, Owner, Rights};
use crate::domain::ids::{AskerId, DriveIndex, Station, Ticket};
use crate::domain::link::{EchoPolicy, Framing, LinkSettings, Parity, PortKind};
use crate::domain::native::{NativeAsk, NativeOutcome, NativeRequest};
use crate::domain::time::MonoTime;
use crate::gateway::{LineCore, LineEffect, LineInput, LineSetup};
use crate::profile::model::Model;
use crate::sim::{BusOptions, DriveOptions, FaultPlan, SimBus, SimDrive};
use std::path::Path;
use std::sync::Arc;
use std::time::Duration;

pub(super) fn models() -> Vec<Arc<Model>> {
    let catalog = crate::vendors::catalog();
    catalog
        .ids()
        .map(|id| catalog.find(id).unwrap().clone())
        .collect()
}

pub(super) fn model(id: &str) -> Arc<Model> {
    models().into_iter().find(|model| model.id == id).unwrap()
}

/// Drives of one model at their factory setting, and the requests to them.
pub(super) struct Simulated {
    bus: SimBus,
    pub(super) link: LinkSettings,
    now: MonoTime,
    core: Option<LineCore>,
    stations: Vec<u8>,
    hears: bool,
    faulty: bool,
    pub(super) frames: usize,
}

impl Simulated {
    pub(super) fn new(model: &Arc<Model>, stations: &[u8], faults: FaultPlan) -> Self {
        let link = model.link.played();
        let options = BusOptions {
            faults,
            turnaround: Duration::from_millis(8),
            ..BusOptions::default()
        };
        let mut bus = SimBus::new(link, options, 1);
        for station in stations {
            bus.connect(
                Station(*station),
                SimDrive::new(Arc::clone(model), DriveOptions::default()),
            );
        }
        let faulty = faults != FaultPlan::default();
        Self {
            bus,
            link,
            now: MonoTime::from_millis(1),
            core: None,
            stations: Vec::new(),
            hears: false,
            faulty,
            frames: 0,
        }
    }

    /// Proceeds to the next event; at most to `until`. Returns the answer to a request, if that was it.
    fn go_on(&mut self, until: MonoTime) -> Option<NativeOutcome> {
        let core = self.core.as_mut().unwrap();
        let mut answer = None;
        while let Some(effect) = core.next_effect() {
            match effect {
                LineEffect::Transmit(frame) => {
                    assert!((1..=4).contains(&frame[1]), "only reads");
                    self.frames += 1;
                    if self.hears {
                        self.bus.receive(self.now, &frame);
                    }
                }
                LineEffect::Answer(it) => answer = Some(it.outcome),
                _ => {}
            }
        }
        if answer.is_some() {
            return answer;
        }
        let wake = core.next_wake().map_or(until, |wake| wake.at);
        let due = self.bus.next_due().unwrap_or(until);
        self.now = wake.min(due).min(until).max(self.now);
        let now = self.now;
        let mut came = Vec::new();
        self.bus
            .take_due(now, |_, bytes| came.extend_from_slice(bytes));
        if !came.is_empty() {
            core.handle(now, LineInput::Bytes(&came));
        }
        core.handle(now, LineInput::Time);
        None
    }
}

impl LineAsker for Simulated {
    async fn open(&mut self, setting: &ScanSetting, stations: &[u8]) -> Result<(), ScanError> {
        let drives = stations
            .iter()
            .filter_map(|station| setting.station(*station))
            .collect();
        let setup = LineSetup {
            timing: setting.timing(),
            drives,
            echo: EchoPolicy::Strip,
            tells_traffic: false,
            first_epoch: 1,
            asked_before: true,
            joins_late: false,
            standby: None,
            keeps: false,
        };
        self.now = self.now
            + if self.core.is_none() {
                LISTEN
            } else {
                Duration::from_millis(20)
            };
        let mut core = LineCore::new(setup, self.now);
        core.handle(self.now, LineInput::PortUp(PortKind::Serial));
        self.core = Some(core);
        self.stations = stations.to_vec();
        self.hears = setting.link == self.link;
        Ok(())
    }

    async fn ask(&mut self, station: u8, address: Address) -> Result<ReadOutcome, ScanError> {
        let place = self.stations.iter().position(|it| *it == station).unwrap();
        let origin = Origin {
            owner: Owner::Local,
            rights: Rights::NONE,
            manner: OrderManner::Once,
        };
        let deadline = self.now + Duration::from_secs(20);
        let request = NativeRequest {
            asker: AskerId::LOCAL,
            ticket: Ticket(0),
            drive: DriveIndex(u16::try_from(place).unwrap()),
            origin,
            ask: NativeAsk::Read { address, count: 1 },
            deadline,
        };
        let core = self.core.as_mut().unwrap();
        let damage = |core: &LineCore| core.counters().garbled + core.counters().noise_bytes;
        let before = damage(core);
        core.handle(self.now, LineInput::Native(request));
        core.handle(self.now, LineInput::Time);
        let outcome = loop {
            if let Some(outcome) = self.go_on(deadline) {
                break outcome;
            }
        };
        let is_damaged = damage(self.core.as_ref().unwrap()) > before;
        Ok(match outcome {
            NativeOutcome::Words(words) => ReadOutcome::Word(words[0]),
            NativeOutcome::DriveException { code, .. } => ReadOutcome::Exception(code),
            NativeOutcome::NoReply if is_damaged => ReadOutcome::Damaged,
            NativeOutcome::NoReply => ReadOutcome::Silent,
            other => panic!("{other:?} for station {station} at {address}"),
        })
    }
}

pub(super) fn played(plan: &ScanPlan, asker: &mut Simulated) -> ScanFindings {
    let runtime = tokio::runtime::Builder::new_current_thread()
        .build()
        .unwrap();
    let mut findings = ScanFindings::default();
    let mut last = 0;
    let done = runtime.block_on(survey(plan, asker, &mut findings, |event| {
        if let ScanEvent::Setting(number) = event {
            last = number;
        }
    }));
    done.ok().unwrap();
    assert_eq!(last + 1, plan.settings.len());
    findings
}

pub(super) fn factory_plan(numbers: &str) -> ScanPlan {
    ScanPlan::new(
        &models(),
        stations(numbers).unwrap(),
        &ScanOptions::default(),
    )
}

fn configuration(plan: &ScanPlan, findings: &ScanFindings) -> String {
    let port = PortAddress::Device(Path::new("/dev/ttyUSB0").to_owned());
    let scan = ScanReport {
        port: &port,
        plan,
        findings,
        echoes: false,
        date: "2026-01-31",
    };
    scan.configuration().unwrap()
}

/// The bound that is promised for a line at factory settings on which nothing answers.
const PROMISED: Duration = Duration::from_secs(480);
/// What 32 drives may add, if all of them answer nothing that they do not have.
const PROMISED_MORE: Duration = Duration::from_secs(1200);

#[test]
fn an_unknown_line_is_known_in_bounded_time_whatever_hangs_there() {
    let plan = factory_plan("1-32");
    let (silent, additional) = plan.duration();
    assert!(
        silent < PROMISED && additional < PROMISED_MORE,
        "reckoned: {silent:?} and {additional:?}"
    );
    let all: Vec<u8> = (1..=32).collect();
    let catalog = crate::vendors::catalog();
    // One that refuses, one that shows 0, one that costs the most silences, and one with an identity.
    for id in ["teco-e510", "siemens-g120", "weg-cfw300", "actech-smv"] {
        let model = model(id);
        let mut line = Simulated::new(&model, &all, FaultPlan::default());
        let findings = played(&plan, &mut line);
        let took = line.now.since(MonoTime::ZERO);
        assert!(
            took < silent + additional,
            "{}: {took:?} of {silent:?} and {additional:?}",
            model.id
        );
        assert_eq!(findings.drives.len(), 32, "{}", model.id);
        for drive in &findings.drives {
            let is_named = drive.verdict.fits.iter().any(|(fit, _)| fit.id == model.id);
            assert!(
                is_named,
                "{} at station {}: {:?}",
                model.id,
                drive.station,
                drive.verdict.keyword()
            );
            assert_eq!(plan.settings[drive.setting].link, model.link.played());
        }
        // What nobody can read from the drive is left to its owner.
        let text =
            configuration(&plan, &findings).replace("# full_scale_hz =", "full_scale_hz = 50");
        if let Err(problems) = config::load(&text, &catalog) {
            panic!(
                "{}\n{}",
                input::draw(Path::new("made"), &text, &problems),
                text
            );
        }
    }
}

#[test]
fn a_zero_proves_nothing_where_holes_show_zero() {
    let text = include_str!("../../../../tests/golden/models/exchange.toml");
    let mut of_zeros = crate::profile::check::model(text).unwrap();
    of_zeros
        .registers
        .retain(|register| matches!(register.name.as_str(), "status" | "output_frequency"));
    of_zeros
        .exceptions
        .clone_from(&model("teco-e510").exceptions);
    let mut refusing = of_zeros.clone();
    refusing.read.holes = None;
    for (candidate, word) in [(refusing, "probable"), (of_zeros, "possible")] {
        let candidate = Arc::new(candidate);
        let all = [models(), vec![Arc::clone(&candidate)]].concat();
        let plan = ScanPlan::new(&all, vec![1], &ScanOptions::default());
        let findings = played(
            &plan,
            &mut Simulated::new(&candidate, &[1], FaultPlan::default()),
        );
        let [drive] = &findings.drives[..] else {
            panic!("one drive: {findings:?}")
        };
        assert!(
            drive
                .verdict
                .fits
                .iter()
                .any(|(fit, _)| fit.id == candidate.id),
            "{word}"
        );
        assert_eq!(drive.verdict.keyword(), word);
    }
}

#[test]
fn nobody_answering_takes_what_was_said() {
    let plan = factory_plan("1-32");
    let mut line = Simulated::new(&model("hyundai-n700"), &[], FaultPlan::default());
    let findings = played(&plan, &mut line);
    let (silent, _) = plan.duration();
    assert!(
        line.now.since(MonoTime::ZERO) <= silent,
        "{:?} of {silent:?}",
        line.now
    );
    assert!(findings.drives.is_empty() && findings.is_complete);
}

#[test]
fn the_factory_settings_are_those_of_the_models() {
    let plan = factory_plan("1");
    let links: Vec<_> = plan
        .settings
        .iter()
        .map(|setting| setting.link.to_string())
        .collect();
    let expected = [
        "19200 8E1",
        "9600 8N1",
        "19200 8N2",
        "9600 8N2",
        "115200 8N1",
        "19200 8N1",
        "4800 8N1",
    ];
    assert_eq!(links, expected);
    for setting in &plan.settings {
        let factory: Vec<_> = models()
            .into_iter()
            .filter(|it| it.link.played() == setting.link)
            .collect();
        for model in &factory {
            let answers = |probe: &ScanProbe| {
                model.readable_at(probe.address).is_some() || !model.exceptions.is_empty()
            };
            assert!(
                setting.probes.iter().any(answers),
                "{} at {}",
                model.id,
                setting.link
            );
        }
        assert!(setting.probes.len() <= factory.len());
    }
}

#[test]
fn what_most_models_leave_the_factory_with_is_tried_first() {
    let wishes = [false, true]
        .into_iter()
        .flat_map(|is_ascii| [(is_ascii, false), (is_ascii, true)]);
    for (is_ascii, everything) in wishes {
        let plan = ScanPlan::new(
            &models(),
            vec![1],
            &ScanOptions {
                is_ascii,
                everything,
                ..ScanOptions::default()
            },
        );
        let takes =
            |model: &Arc<Model>| !is_ascii || model.link.framings.value.contains(&Framing::Ascii);
        let all: Vec<_> = models().into_iter().filter(takes).collect();
        let count = |setting: &ScanSetting| {
            let is_like = |known: LinkSettings| {
                let LinkSettings {
                    baud,
                    parity,
                    stop_bits,
                    ..
                } = setting.link;
                let has_bits = is_ascii || known.data_bits == setting.link.data_bits;
                (known.baud, known.parity, known.stop_bits) == (baud, parity, stop_bits) && has_bits
            };
            all.iter()
                .filter_map(|model| model.link.factory())
                .filter(|known| is_like(*known))
                .count()
        };
        let tried: Vec<_> = plan
            .settings
            .iter()
            .map(|it| (count(it), it.link.baud, it.factory_count == 0))
            .collect();
        for pair in tried.windows(2) {
            let ((before, faster, is_other), (after, slower, is_later_other)) = (pair[0], pair[1]);
            if is_other == is_later_other {
                assert!(
                    before > after || (before == after && faster >= slower),
                    "{tried:?}"
                );
            } else {
                assert!(is_later_other, "factory settings come first: {tried:?}");
            }
        }
    }
    assert!(
        factory_plan("1").settings[0].link != model("hitachi-x200").link.played(),
        "one model has it"
    );
}

/// Its factory setting is nobody's to know: a usual one is tried, and all others on request.
#[test]
fn a_model_without_a_factory_setting_is_looked_for_at_a_usual_one() {
    let v20 = model("siemens-v20");
    assert_eq!(v20.link.factory(), None);
    let links = |everything| {
        let wish = ScanOptions {
            everything,
            ..ScanOptions::default()
        };
        ScanPlan::new(&[Arc::clone(&v20)], vec![1], &wish)
            .settings
            .iter()
            .map(|it| it.link.to_string())
            .collect::<Vec<_>>()
    };
    assert_eq!(links(false), ["9600 8N1"]);
    let of_model = &v20.link;
    let all =
        of_model.bauds.value.len() * of_model.parities.value.len() * of_model.stop_bits.value.len();
    assert_eq!(links(true).len(), all);
    assert!(
        links(true).contains(&"9600 8E1".to_owned())
            && links(true).contains(&"38400 8E1".to_owned())
    );
}

#[test]
fn everything_else_is_tried_on_request_and_after_the_factories() {
    let all = ScanPlan::new(
        &models(),
        vec![1],
        &ScanOptions {
            everything: true,
            ..ScanOptions::default()
        },
    );
    let factory = factory_plan("1");
    let links: Vec<_> = all.settings.iter().map(|setting| setting.link).collect();
    let first: Vec<_> = factory
        .settings
        .iter()
        .map(|setting| setting.link)
        .collect();
    assert_eq!(links[..first.len()], first[..]);
    assert!(
        links
            .iter()
            .enumerate()
            .all(|(at, link)| !links[..at].contains(link))
    );
    for model in models() {
        for baud in &model.link.bauds.value {
            assert!(
                links.iter().any(|link| link.baud == *baud),
                "{} at {baud}",
                model.id
            );
        }
    }
    let wish = ScanOptions {
        bauds: vec![9600],
        parity: Some(Parity::Even),
        stop_bits: Some(1),
        ..ScanOptions::default()
    };
    let one = ScanPlan::new(&models(), vec![1], &wish);
    assert_eq!(
        one.settings
            .iter()
            .map(|it| it.link.to_string())
            .collect::<Vec<_>>(),
        ["9600 8E1"]
    );
    let network = ScanPlan::new(
        &models(),
        vec![1],
        &ScanOptions {
            is_network: true,
            ..ScanOptions::default()
        },
    );
    assert_eq!(
        (network.settings.len(), network.settings[0].candidates.len()),
        (1, models().len())
    );
    let ascii = ScanPlan::new(
        &models(),
        vec![1],
        &ScanOptions {
            is_ascii: true,
            ..ScanOptions::default()
        },
    );
    let takes_ascii = |model: &Arc<Model>| model.link.framings.value.contains(&Framing::Ascii);
    assert!(
        ascii
            .settings
            .iter()
            .all(|it| it.candidates.iter().all(takes_ascii))
    );
    let of_delta = ascii
        .settings
        .iter()
        .find(|it| it.link.to_string() == "9600 7N2");
    assert!(
        of_delta
            .unwrap()
            .candidates
            .iter()
            .any(|model| model.id == "delta-vfd-el")
    );
}

#[test]
fn damaged_answers_are_distinguished_from_silence() {
    let plan = factory_plan("3");
    let mut line = Simulated::new(&model("frecon-fr500a"), &[3], "flip=1000".parse().unwrap());
    assert!(line.faulty);
    let findings = played(&plan, &mut line);
    let at = plan
        .settings
        .iter()
        .position(|setting| setting.link.to_string() == "9600 8N2")
        .unwrap();
    assert!(findings.drives.is_empty(), "{:?}", findings.drives);
    assert!(findings.damaged[&at].contains(&3));
    let port = PortAddress::Device(Path::new("/dev/ttyUSB0").to_owned());
    let scan = ScanReport {
        port: &port,
        plan: &plan,
        findings: &findings,
        echoes: false,
        date: "",
    };
    assert!(
        scan.table()
            .contains("9600 8N2: something answers as station 3, but damaged"),
        "{}",
        scan.table()
    );
    assert_eq!(scan.configuration(), None);
    assert_eq!(scan.json()["damaged"][0]["station"], 3);
}

#[test]
fn stations_are_numbers_and_ranges() {
    assert_eq!(stations("1-3"), Ok(vec![1, 2, 3]));
    assert_eq!(stations("7,1-2,2"), Ok(vec![1, 2, 7]));
    assert_eq!(stations("1-247").unwrap().len(), 247);
    for wrong in ["", "0", "248", "3-1", "1-", "a", "1;2"] {
        assert!(stations(wrong).unwrap_err().contains("1-32"), "{wrong}");
    }
}

#[test]
fn few_reads_find_every_model() {
    let all = models();
    let probes = probes(&all);
    assert!(probes.len() < all.len(), "{probes:?}");
}
