//! What this gateway knows of a line that it shares with others.

use super::setup::{DriveSetup, LineSetup};
use crate::domain::command::Direction;
use crate::domain::control::{ControlSettings, FailSafe};
use crate::domain::ids::Station;
use crate::domain::standby::OnGatewayLost;
use crate::domain::time::MonoTime;
use crate::line::gap::MasterGaps;
use crate::line::overheard::RequestListener;
use crate::line::roll_call::{OwedAnswer, RollCall};
use crate::line::standby::{SIGNALS_WITHIN, StandbyRule};
use crate::profile::model::{FractionWhole, Model};
use crate::wire::pdu::Request;
use crate::wire::signal::{Signal, SignalKind, SignalWord};

/// The share of this gateway in a line.
#[derive(Debug)]
pub(super) struct LineShare {
    pub rule: StandbyRule,
    pub listener: RequestListener,
    /// Unanswered requests of others in a row, per drive.
    pub unanswered: Vec<u8>,
    /// Another gateway was heard since this one was started: what it remembers of the orders then is out of date.
    pub has_heard_other: bool,
    /// A drive has answered since the line was taken over.
    pub is_confirmed: bool,
    /// Until when the line is to be handed over, as soon as nothing is under way.
    pub yields_until: Option<MonoTime>,
    /// While this gateway is active: whether another one listens.
    pub roll_call: Option<RollCall>,
    /// The answer that it owes as a listener.
    pub answer: Option<OwedAnswer>,
    /// Where a stop fits while another one sends.
    pub gap: MasterGaps,
    /// It gave the line up by itself, and no other gateway was heard since.
    pub gave_way: bool,
    /// The signal that is on its way to the port.
    pub signal: Option<SignalKind>,
    /// When it last said that it is active.
    pub role_said_at: MonoTime,
    /// The stop of another gateway that was heard last while this one is active, and until when its answer may come.
    pub heard_stop: Option<(Vec<u8>, MonoTime)>,
    /// What is still to be sent before the line is handed over; `None`: that is not known yet.
    pub to_tell: Option<Vec<SignalWord>>,
    /// The digest of this gateway's drives was sent, and the question that follows it was not asked yet.
    pub told_digest: bool,
    /// A digest of its drives.
    pub digest: u16,
    /// Whether the drives of the other gateway differ; `None` while that is not known.
    pub differs: Option<bool>,
    /// A station that is no drive of this gateway, and when it was last talked to.
    pub stranger: Option<(Station, MonoTime)>,
    /// When a sound frame was last heard.
    pub sound_at: MonoTime,
    /// When the last exchange of its own between the frames of others had ended: its bytes end no silence.
    pub own_bytes_at: MonoTime,
    /// The number of this start of the gateway in its signals.
    sender: u16,
    pub take_overs: u64,
    pub given_up: u64,
    pub rivals: u64,
    pub kept: u64,
}

impl LineShare {
    /// The share in the line of `setup`; `None` if no other gateway shares it.
    pub fn of(setup: &LineSetup) -> Option<Self> {
        Some(Self {
            rule: StandbyRule::new(setup.standby?, setup.first_epoch),
            listener: RequestListener::default(),
            unanswered: vec![0; setup.drives.len()],
            has_heard_other: false,
            is_confirmed: false,
            yields_until: None,
            roll_call: None,
            answer: None,
            gap: MasterGaps::new(setup.standby?.answer_after, setup.first_epoch),
            gave_way: false,
            signal: None,
            role_said_at: MonoTime::ZERO,
            heard_stop: None,
            to_tell: None,
            told_digest: false,
            digest: digest(setup),
            differs: None,
            stranger: None,
            sound_at: MonoTime::ZERO,
            own_bytes_at: MonoTime::ZERO,
            sender: sender(setup.first_epoch),
            take_overs: 0,
            given_up: 0,
            rivals: 0,
            kept: 0,
        })
    }

    /// The request of a signal of this gateway, which is sent next.
    pub fn signal(&mut self, kind: SignalKind) -> Request {
        self.signal = Some(kind);
        Signal {
            kind,
            sender: self.sender,
        }
        .request()
    }

    /// Whether `signal` is a copy of one of this gateway.
    pub const fn is_own(&self, signal: Signal) -> bool {
        signal.sender == self.sender
    }

    /// A listener heard at `now` a `signal` that ended at `at`. If the line is handed over, it is taken if it `may_accept` that.
    /// Returns the station that was asked before it and did not answer.
    pub fn heard_signal(
        &mut self,
        now: MonoTime,
        at: MonoTime,
        signal: Signal,
        may_accept: bool,
    ) -> Option<Station> {
        // Another listener does not send on its own.
        if self.is_own(signal) || signal.kind.is_of_listener() {
            return None;
        }
        let is_attentive = self.rule.is_attentive(now);
        self.another_leads(at);
        match signal.kind {
            SignalKind::HandOver => {
                self.gap.led(at);
                if may_accept {
                    self.rule.handed_over(at)
                } else {
                    self.rule.refused(at)
                }
            }
            SignalKind::Question if is_attentive => {
                self.answer = Some(OwedAnswer::to_question(
                    now,
                    at,
                    self.rule.times().answer_after,
                ));
            }
            SignalKind::Active
            | SignalKind::Question
            | SignalKind::Listening
            | SignalKind::Differs => {}
        }
        self.listener.silent()
    }

    /// A listener heard another gateway say at `at` what only an active one says.
    pub fn another_leads(&mut self, at: MonoTime) {
        self.another_sends(at);
        self.gap.led(at + SIGNALS_WITHIN);
    }

    /// A listener heard another gateway, or its drives answer it, at `at`.
    pub fn another_sends(&mut self, at: MonoTime) {
        self.has_heard_other = true;
        self.gave_way = false;
        self.rule.heard(at);
    }
}

/// The number of a start with this first epoch.
fn sender(first_epoch: u64) -> u16 {
    // Fibonacci hashing: epochs differ in some of their bits.
    u16::try_from(first_epoch.wrapping_mul(0x9E37_79B9_7F4A_7C15) >> 48).unwrap_or_default()
}

/// A digest of what the gateways of a line must have in common: its drives, their limits and what is declared for them. It is
/// made of numbers and words of the configuration, so that it is the same in each version and however a list is ordered.
fn digest(setup: &LineSetup) -> u16 {
    let of_drive = |drive: &DriveSetup| {
        let control = drive.control.as_deref().map(of_control).unwrap_or_default();
        format!(
            "{} {} {} {control}",
            drive.station.0,
            drive.model.id,
            full_scales(&drive.model)
        )
    };
    let mut drives: Vec<_> = setup.drives.iter().map(of_drive).collect();
    drives.sort();
    // FNV-1a.
    let hash = drives
        .join("\n")
        .bytes()
        .fold(0xCBF2_9CE4_8422_2325_u64, |hash, byte| {
            (hash ^ u64::from(byte)).wrapping_mul(0x0100_0000_01B3)
        });
    u16::try_from((hash ^ (hash >> 16) ^ (hash >> 32) ^ (hash >> 48)) & 0xFFFF).unwrap_or_default()
}

fn of_control(control: &ControlSettings) -> String {
    let ControlSettings {
        least,
        most,
        directions,
        lost_after,
        on_gateway_lost,
        ..
    } = control;
    let [forward, reverse] =
        [Direction::Forward, Direction::Reverse].map(|it| u8::from(directions.contains(&it)));
    let actions = [control.on_commander_lost, control.on_shutdown]
        .map(FailSafe::keyword)
        .join(" ");
    let on_gateway_lost = on_gateway_lost.map_or("none", OnGatewayLost::keyword);
    let (bus, outside) = (control.bus.keyword(), control.on_output_outside.keyword());
    let (least, most, lost_after) = (
        least.millihertz(),
        most.millihertz(),
        lost_after.as_millis(),
    );
    format!(
        "{least} {most} {forward} {reverse} {lost_after} {actions} {on_gateway_lost} {bus} {outside}"
    )
}

/// The full scales that the configuration states for registers of `model`, in millihertz.
fn full_scales(model: &Model) -> String {
    let scales = model
        .registers
        .iter()
        .filter_map(|register| register.form.full_scale.as_ref());
    let stated = scales.filter_map(|scale| match scale.of {
        FractionWhole::Fixed(hertz) => Some(hertz.millihertz().to_string()),
        FractionWhole::Configured | FractionWhole::Register(_) => None,
    });
    stated.collect::<Vec<_>>().join(",")
}
