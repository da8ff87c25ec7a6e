//! What is drawn from one seed: the drives, their client, and what goes wrong when.

use crate::support::families::walked;
use std::mem::discriminant;
use std::sync::Arc;
use std::time::Duration;
use vfd_gateway::domain::standby::OnGatewayLost;
use vfd_gateway::profile::model::{Model, OrderKind};

const MS: fn(u64) -> Duration = Duration::from_millis;
/// Drives whose status tells the direction, does not, or that have no status at all.
const MODELS: [&str; 8] = [
    "hyundai-n700",
    "hyundai-n100plus",
    "teco-e510",
    "toshiba-vf-as1",
    "frecon-fr500a",
    "toshiba-vf-s15",
    "teco-e510s",
    "delta-ms300",
];

/// What a half that takes the line may have to do. A drive that is held or adopted for good proves nothing.
const ACTIONS: [OnGatewayLost; 4] = [
    OnGatewayLost::Coast,
    OnGatewayLost::Stop,
    OnGatewayLost::Stop,
    OnGatewayLost::Adopt,
];

/// How the client gives its orders.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Form {
    /// One message; its connection says that it is alive.
    Once,
    /// The same order twice a second.
    Cyclic,
    /// The same as a write to the drive's own register.
    Native,
}

/// How it ends them.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum End {
    /// It stops each drive, and is there.
    Stop,
    /// The same with one stop for all drives.
    StopForAll,
    /// It is gone.
    Gone,
}

/// What goes wrong.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Kind {
    /// Noise that makes no frame, with pauses up to this long.
    Jam(Duration),
    /// The drives are behind a cut.
    DrivesAway,
    /// Replies of drives come damaged, cut short, or not at all.
    Noisy,
    /// A master that is no gateway reads another drive this often.
    Foreign(Duration),
    Kill(usize),
    Suspend(usize),
    Unplug(usize),
    Deaf(usize),
    Mute(usize),
    OffSpeed(usize),
    /// It hears this many thousandths of bytes wrongly.
    Mishears(usize, u64),
    /// So many of its own are heard wrongly.
    Misspeaks(usize, u64),
}

impl Kind {
    /// The half that it is a fault of.
    pub const fn half(self) -> Option<usize> {
        match self {
            Self::Jam(_) | Self::DrivesAway | Self::Noisy | Self::Foreign(_) => None,
            Self::Kill(half)
            | Self::Suspend(half)
            | Self::Unplug(half)
            | Self::Deaf(half)
            | Self::Mute(half)
            | Self::OffSpeed(half)
            | Self::Mishears(half, _)
            | Self::Misspeaks(half, _) => Some(half),
        }
    }

    /// Whether the half sends nothing that is heard.
    pub const fn is_silence(self) -> bool {
        matches!(
            self,
            Self::Kill(_) | Self::Suspend(_) | Self::Unplug(_) | Self::Mute(_)
        )
    }

    /// Whether each half hears what the other one sends.
    pub const fn leaves_ears(self) -> bool {
        self.is_silence() || matches!(self, Self::DrivesAway)
    }
}

/// One of them, with its times since the order to run.
#[derive(Clone, Copy, Debug)]
pub struct Trouble {
    pub kind: Kind,
    pub from: Duration,
    /// `None`: for ever.
    pub until: Option<Duration>,
}

/// One play.
#[derive(Clone, Debug)]
pub struct Plan {
    pub seed: u64,
    pub model: Arc<Model>,
    pub action: OnGatewayLost,
    pub lost_after: Duration,
    pub form: Form,
    pub end: End,
    /// When the client stops or is gone, since its order to run.
    pub end_at: Duration,
    /// When the second gateway is started; `None`: long before the order.
    pub listens_from: Option<Duration>,
    /// Both have a journal.
    pub remembers: bool,
    pub troubles: Vec<Trouble>,
}

/// Random numbers.
pub struct Draw(fastrand::Rng);

impl Draw {
    fn ms(&mut self, from: u64, to: u64) -> Duration {
        MS(self.0.u64(from..to))
    }

    fn of<T: Copy>(&mut self, all: &[T]) -> T {
        all[self.0.usize(0..all.len())]
    }

    fn one_of(&mut self, count: u64) -> bool {
        self.0.u64(0..count) == 0
    }

    /// A short time more often than a long one.
    fn length(&mut self) -> Duration {
        let most = self.of(&[400, 1_500, 3_000, 6_000, 15_000]);
        self.ms(20, most)
    }

    fn troubles(&mut self) -> Vec<Trouble> {
        let from = self.ms(4_000, 8_000);
        let half = self.0.usize(0..2);
        let lasts = self.length();
        let one = |kind, until| vec![Trouble { kind, from, until }];
        let ends = Some(from + lasts);
        match self.0.u8(0..14) {
            0 => one(Kind::Jam(Duration::ZERO), ends),
            1 => one(Kind::Jam(MS(self.of(&[10, 60, 300]))), ends),
            2 => one(Kind::DrivesAway, ends),
            3 => one(Kind::Noisy, ends),
            4 => one(
                Kind::Foreign(self.ms(150, 700)),
                ends.filter(|_| self.one_of(2)),
            ),
            5 => one(Kind::Kill(half), ends.filter(|_| !self.one_of(3))),
            6 => one(Kind::Suspend(half), ends),
            7 => one(Kind::Unplug(half), ends),
            8 => one(Kind::Deaf(half), ends.filter(|_| self.one_of(2))),
            9 => one(Kind::Mute(half), ends.filter(|_| self.one_of(2))),
            10 => one(Kind::OffSpeed(half), ends.filter(|_| self.one_of(2))),
            11 => one(
                Kind::Mishears(half, self.of(&[5, 40, 300])),
                ends.filter(|_| self.one_of(2)),
            ),
            12 => one(
                Kind::Misspeaks(half, self.of(&[5, 40, 300])),
                ends.filter(|_| self.one_of(2)),
            ),
            // A blip of the cabinet's supply.
            _ => {
                let backs = [self.ms(500, 3_000), self.ms(500, 3_000)];
                (0..2)
                    .map(|half| Trouble {
                        kind: Kind::Kill(half),
                        from,
                        until: Some(from + backs[half]),
                    })
                    .collect()
            }
        }
    }
}

impl Plan {
    /// The half that is deaf or babbles for ever, if that is all that goes wrong.
    pub fn ill(&self) -> Option<usize> {
        match self.troubles[..] {
            [
                Trouble {
                    kind: Kind::Deaf(half) | Kind::OffSpeed(half),
                    until: None,
                    ..
                },
            ] => Some(half),
            _ => None,
        }
    }

    /// When the half that has the line first falls silent for good, or for so long that the other one has to do what is
    /// declared within `bound`, and nothing else stands in the way.
    pub fn falls_silent(&self, bound: Duration) -> Option<Duration> {
        let first = self.troubles.iter().min_by_key(|it| it.from)?;
        let is_long = first.until.is_none_or(|until| until > first.from + bound);
        let is_alone = self
            .troubles
            .iter()
            .filter(|it| it.from < first.from + bound)
            .count()
            == 1;
        let acts = self.action != OnGatewayLost::Adopt && self.listens_from.is_none();
        let is_silent = first.kind.is_silence() && first.kind.half() == Some(0);
        (is_silent && is_long && is_alone && acts).then_some(first.from)
    }

    pub fn of(seed: u64) -> Self {
        let mut draw = Draw(fastrand::Rng::with_seed(seed));
        let id = draw.of(&MODELS);
        let model = walked()
            .iter()
            .find(|model| model.id == id)
            .expect("it is built in");
        let has_coast = model.order(OrderKind::Coast).is_some();
        let mut troubles = draw.troubles();
        if draw.one_of(2) {
            let more = draw.troubles();
            // One fault of a kind at a time.
            let is_there = |it: &Trouble| {
                troubles
                    .iter()
                    .any(|other| discriminant(&other.kind) == discriminant(&it.kind))
            };
            let more: Vec<_> = more.into_iter().filter(|it| !is_there(it)).collect();
            troubles.extend(more);
        }
        let first = troubles.iter().map(|it| it.from).min().unwrap_or_default();
        let listens_from = draw
            .one_of(4)
            .then(|| first.saturating_sub(draw.ms(100, 3_500)));
        Self {
            seed,
            model: Arc::clone(model),
            action: draw.of(if has_coast { &ACTIONS } else { &ACTIONS[1..] }),
            lost_after: draw.ms(2_000, 6_000),
            form: draw.of(&[Form::Once, Form::Cyclic, Form::Native]),
            end: draw.of(&[End::Stop, End::StopForAll, End::Gone]),
            end_at: draw.ms(3_000, 20_000),
            listens_from,
            remembers: draw.one_of(2),
            troubles,
        }
    }
}
