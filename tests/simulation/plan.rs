//! The parameters of one seed: the line, its drives, its clients, and how much goes wrong.

use super::checker::tables::{Action, Drive, Kind, Line};
use super::extras::Extras;
use fastrand::Rng;
use std::cell::LazyCell;
use std::sync::Arc;
use std::time::Duration;
use vfd_gateway::domain::command::Direction;
use vfd_gateway::domain::control::{ControlAction, ControlSettings, FailSafe};
use vfd_gateway::domain::frequency::Hertz;
use vfd_gateway::domain::ids::{DriveIndex, Name, Station, UnitId};
use vfd_gateway::domain::link::{EchoPolicy, Framing, LinkSettings, Parity};
use vfd_gateway::drive::description::{DriveDescription, DriveRatings, DriveRef, PointSettings};
use vfd_gateway::gateway::{DriveSetup, LineSetup};
use vfd_gateway::journal::RememberedDrive;
use vfd_gateway::line::timeouts::ReplyTimeouts;
use vfd_gateway::line::timing::LineTiming;
use vfd_gateway::profile::catalog::Catalog;
use vfd_gateway::profile::model::Model;
use vfd_gateway::sim::{BusDelivery, BusOptions, DriveOptions, FaultPlan, SimBus, SimDrive};
use vfd_gateway::vendors;

/// Addresses whose words carry the number of the exchange that asked for them; no drive here has any of them.
pub const PROOF: u16 = 0x7000;
/// How late after its time-out a reply may arrive.
const LATENESS: Duration = Duration::from_millis(500);

thread_local! {
    static MODELS: LazyCell<Catalog> = LazyCell::new(vendors::catalog);
}

/// The model of a kind of drive.
pub fn model_of(kind: Kind) -> Arc<Model> {
    let id = match kind {
        Kind::N700 => "hyundai-n700",
        Kind::E510 => "teco-e510",
        Kind::Fr500a => "frecon-fr500a",
    };
    MODELS.with(|models| Arc::clone(models.find(id).expect("a built-in model")))
}

/// What is drawn from a seed.
#[derive(Clone, Debug)]
pub struct Plan {
    pub line: Line,
    pub link: LinkSettings,
    pub faults: FaultPlan,
    pub clients: usize,
    pub has_mqtt: bool,
    /// Mean time between two things that clients do, and between two troubles.
    pub ask_every: Duration,
    pub trouble_every: Duration,
    /// Clients read only proof words, without a pause.
    pub only_reads: bool,
    /// There is a journal.
    pub keeps: bool,
    /// The faults beyond the line.
    pub extras: Extras,
}

impl Plan {
    /// The plan of `rng`'s seed.
    pub fn draw(rng: &mut Rng) -> Self {
        let baud = [9_600, 9_600, 19_200, 38_400][rng.usize(0..4)];
        let parity = if rng.u8(0..4) == 0 {
            Parity::Even
        } else {
            Parity::None
        };
        let link = LinkSettings {
            baud,
            parity,
            ..LinkSettings::DEFAULT
        };
        let count = rng.usize(1..=4);
        let same = rng.bool().then(|| Kind::ALL[rng.usize(0..3)]);
        let drives = (0..count)
            .map(|place| draw_drive(rng, place, same))
            .collect();
        let line = Line {
            baud: baud.into(),
            char_bits: link.bits_per_char().into(),
            drives,
        };
        Self {
            line,
            link,
            faults: draw_faults(rng),
            clients: rng.usize(1..=4),
            has_mqtt: rng.u8(0..4) == 0,
            ask_every: Duration::from_millis(rng.u64(200..2_000)),
            trouble_every: Duration::from_secs(rng.u64(5..60)),
            only_reads: false,
            keeps: false,
            extras: Extras::NONE,
        }
    }

    /// The bus with its drives, before anything goes wrong.
    pub fn bus(&self, rng: &mut Rng) -> SimBus {
        let turnaround = Duration::from_micros(rng.u64(500..8_000));
        let options = BusOptions {
            turnaround,
            delivery: BusDelivery::Replies,
            ..BusOptions::default()
        };
        let mut bus = SimBus::new(self.link, options, rng.u64(..));
        for drive in &self.line.drives {
            let ramp = Duration::from_millis(rng.u64(500..8_000));
            let options = DriveOptions {
                acceleration: ramp,
                deceleration: ramp,
                proof_words: Some(PROOF..=PROOF + 0xFF),
                ..DriveOptions::default()
            };
            bus.connect(
                Station(drive.station),
                SimDrive::new(model_of(drive.kind), options),
            );
        }
        bus
    }

    /// The settings of the gateway's line.
    pub fn setup(&self, first_epoch: u64) -> LineSetup {
        let drives: Vec<DriveSetup> = self.line.drives.iter().map(setup_of).collect();
        let models = drives.iter().map(|drive| drive.model.as_ref());
        let timing = LineTiming::for_models(Framing::Rtu, self.link, models, Duration::ZERO);
        LineSetup {
            timing,
            drives,
            echo: EchoPolicy::Strip,
            tells_traffic: false,
            first_epoch,
            asked_before: false,
            joins_late: false,
            standby: None,
            keeps: self.keeps,
        }
    }

    /// The drives as the north sides know them.
    pub fn descriptions(&self) -> Vec<DriveDescription> {
        (0..)
            .zip(&self.line.drives)
            .map(|(place, drive)| description_of(place, drive))
            .collect()
    }
}

fn draw_faults(rng: &mut Rng) -> FaultPlan {
    let roughness = [0, 2, 10, 40][rng.usize(0..4)];
    let mut chance = || rng.u16(0..=roughness);
    let (noise, lost, late, cut, flip, foreign, hole) = (
        chance(),
        chance(),
        chance(),
        chance(),
        chance(),
        chance(),
        chance(),
    );
    // The draws that follow stay what they are.
    let burst = rng.clone().u16(0..=roughness);
    FaultPlan {
        noise,
        lost,
        late,
        cut,
        flip,
        foreign,
        hole,
        burst,
        max_lateness: LATENESS,
        ..FaultPlan::NONE
    }
}

fn draw_drive(rng: &mut Rng, place: usize, same: Option<Kind>) -> Drive {
    let kind = same.unwrap_or_else(|| Kind::ALL[rng.usize(0..3)]);
    let number = place as u8 + 1;
    let has_coast = kind != Kind::E510;
    let mut action = || match rng.u8(0..4) {
        0 => Action::Hold,
        1 if has_coast => Action::Coast,
        _ => Action::Stop,
    };
    let on_lost = action();
    let on_shutdown = action();
    Drive {
        kind,
        station: number + 1,
        unit: number,
        uniform: 100 + number,
        poll: rng.u64(100..1_000) * 1_000_000,
        timeout: 200_000_000,
        has_control: rng.u8(0..8) > 0,
        least: 500,
        most: 5_000,
        lost_after: rng.u64(2..8) * 1_000_000_000,
        on_lost,
        on_shutdown,
    }
}

fn setup_of(drive: &Drive) -> DriveSetup {
    DriveSetup {
        station: Station(drive.station),
        model: model_of(drive.kind),
        poll: Duration::from_nanos(drive.poll),
        timeouts: ReplyTimeouts::fixed(Duration::from_nanos(drive.timeout)),
        max_lateness: LATENESS,
        control: control_of(drive).map(Arc::new),
        remembered: RememberedDrive::default(),
    }
}

fn description_of(place: u16, drive: &Drive) -> DriveDescription {
    DriveDescription {
        place: DriveRef {
            line: 0,
            drive: DriveIndex(place),
        },
        name: Name::new(&format!("d{place}")).expect("a name"),
        line: Name::new("line").expect("a name"),
        model: model_of(drive.kind),
        unit: UnitId::new(drive.unit).expect("a unit"),
        uniform_unit: UnitId::new(drive.uniform).expect("a unit"),
        group: None,
        pace: vfd_gateway::drive::plan::PollPace::new(Duration::from_nanos(drive.poll), 1.0),
        ratings: DriveRatings::default(),
        control: control_of(drive).map(Arc::new),
        points: PointSettings::default(),
    }
}

fn control_of(drive: &Drive) -> Option<ControlSettings> {
    let action = |action| match action {
        Action::Stop => FailSafe::Stop,
        Action::Coast => FailSafe::Coast,
        Action::Hold => FailSafe::Hold,
    };
    drive.has_control.then(|| ControlSettings {
        from_mqtt: true,
        from_modbus_tcp: true,
        from_page: true,
        from_sparkplug: true,
        directions: vec![Direction::Forward, Direction::Reverse],
        accept_unverified: ControlAction::ALL.to_vec(),
        native_write: vec![drive.kind.facts().listed],
        ..ControlSettings::new(
            (
                Hertz::from_centihertz(drive.least),
                Hertz::from_centihertz(drive.most),
            ),
            (
                action(drive.on_lost),
                Duration::from_nanos(drive.lost_after),
            ),
            action(drive.on_shutdown),
        )
    })
}
