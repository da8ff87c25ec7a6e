//! The topics of one gateway: building them, and telling what a message's topic asks for.

use super::types::Filter;
use super::types::Settings;

/// All topics of one gateway.
#[derive(Debug)]
pub(super) struct Topics {
    prefix: String,
    /// `PREFIX/GATEWAY/`.
    base: String,
    alive: Option<String>,
}

/// What a message's topic is for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Inbound<'t> {
    /// Our own probe.
    Probe,
    /// The sign of life of the commanders.
    Alive,
    /// STOP for all drives.
    AllRun,
    /// An input of the drive with this name, which may not exist.
    Drive(&'t str, Input<'t>),
}

/// An input of a drive.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Input<'t> {
    Frequency,
    Run,
    Reset,
    Release,
    Command,
    Lease,
    ParamGet(&'t str),
    ParamSet(&'t str),
}

impl Input<'_> {
    /// Whether an empty payload means something. Elsewhere it is what clears a retained message.
    pub(super) const fn takes_empty(self) -> bool {
        matches!(self, Self::Lease | Self::ParamGet(_))
    }

    /// Whether it orders nothing.
    pub(super) const fn only_reads(self) -> bool {
        matches!(self, Self::ParamGet(_))
    }
}

impl Topics {
    pub(super) fn new(settings: &Settings) -> Self {
        let base = format!("{}/{}/", settings.prefix, settings.gateway);
        Self { prefix: settings.prefix.clone(), base, alive: settings.alive_topic.clone() }
    }

    /// What is subscribed: inputs only, so that no publication of ours comes back.
    pub(super) fn filters(&self) -> Vec<Filter> {
        const INPUTS: [&str; 10] = [
            "all/run/set",
            "drive/+/run/set",
            "drive/+/frequency/set",
            "drive/+/trip/reset",
            "drive/+/control/release",
            "drive/+/command",
            "drive/+/lease",
            "drive/+/param/+/get",
            "drive/+/param/+/set",
            "probe",
        ];
        let inputs = INPUTS.iter().map(|rest| Filter { path: self.gateway(rest), wants_retained: false });
        // What the alive topic said while we were away holds.
        let alive = self.alive.clone().map(|path| Filter { path, wants_retained: true });
        inputs.chain(alive).collect()
    }

    /// A topic of the gateway as a whole.
    pub(super) fn gateway(&self, rest: &str) -> String {
        format!("{}{rest}", self.base)
    }

    /// A topic of a line.
    pub(super) fn line(&self, name: &str, rest: &str) -> String {
        format!("{}line/{name}/{rest}", self.base)
    }

    /// A topic of a drive.
    pub(super) fn drive(&self, name: &str, rest: &str) -> String {
        format!("{}drive/{name}/{rest}", self.base)
    }

    /// What `topic` is for; nothing if it is none of those that are subscribed.
    pub(super) fn parse<'t>(&self, topic: &'t str) -> Option<Inbound<'t>> {
        if self.alive.as_deref() == Some(topic) {
            return Some(Inbound::Alive);
        }
        let rest = topic.strip_prefix(self.base.as_str())?;
        if rest == "probe" { Some(Inbound::Probe) } else { command(rest) }
    }

    /// Whether a response may go to `topic`: it lies under `allowed`, is a plain topic, and neither ours nor an
    /// input of another gateway under our prefix.
    pub(super) fn may_respond_to(&self, topic: &str, allowed: &str) -> bool {
        let is_under = topic.strip_prefix(allowed).is_some_and(|rest| rest.starts_with('/') && rest.len() > 1);
        let is_plain = topic.len() <= 1024 && !topic.chars().any(|c| matches!(c, '+' | '#') || c.is_control());
        let is_ours = topic.starts_with(&self.base) || self.alive.as_deref() == Some(topic);
        is_under && is_plain && !is_ours && !self.is_input_of_a_neighbour(topic)
    }

    fn is_input_of_a_neighbour(&self, topic: &str) -> bool {
        let below = topic.strip_prefix(self.prefix.as_str()).and_then(|rest| rest.strip_prefix('/'));
        let rest = below.and_then(|below| below.split_once('/')).map(|(_, rest)| rest);
        rest.is_some_and(|rest| rest == "probe" || command(rest).is_some())
    }
}

/// What the levels behind the gateway's name command.
fn command(rest: &str) -> Option<Inbound<'_>> {
    if rest == "all/run/set" {
        return Some(Inbound::AllRun);
    }
    let (name, input) = rest.strip_prefix("drive/")?.split_once('/')?;
    Some(Inbound::Drive(name, drive_input(input)?))
}

fn drive_input(rest: &str) -> Option<Input<'_>> {
    match rest {
        "frequency/set" => Some(Input::Frequency),
        "run/set" => Some(Input::Run),
        "trip/reset" => Some(Input::Reset),
        "control/release" => Some(Input::Release),
        "command" => Some(Input::Command),
        "lease" => Some(Input::Lease),
        _ => param(rest.strip_prefix("param/")?),
    }
}

fn param(rest: &str) -> Option<Input<'_>> {
    let (code, way) = rest.split_once('/')?;
    match way {
        "get" => Some(Input::ParamGet(code)),
        "set" => Some(Input::ParamSet(code)),
        _ => None,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::north::mqtt::harness::settings;
    use crate::north::mqtt::types::Version;

    fn topics() -> Topics {
        Topics::new(&settings(Version::V5))
    }

    #[test]
    fn inputs_are_told_apart_and_nothing_else_is_one() {
        let topics = topics();
        let table = [
            ("vfd/plant/probe", Some(Inbound::Probe)),
            ("home/status", Some(Inbound::Alive)),
            ("vfd/plant/all/run/set", Some(Inbound::AllRun)),
            ("vfd/plant/drive/pump/run/set", Some(Inbound::Drive("pump", Input::Run))),
            ("vfd/plant/drive/pump/frequency/set", Some(Inbound::Drive("pump", Input::Frequency))),
            ("vfd/plant/drive/pump/trip/reset", Some(Inbound::Drive("pump", Input::Reset))),
            ("vfd/plant/drive/pump/control/release", Some(Inbound::Drive("pump", Input::Release))),
            ("vfd/plant/drive/pump/command", Some(Inbound::Drive("pump", Input::Command))),
            ("vfd/plant/drive/pump/lease", Some(Inbound::Drive("pump", Input::Lease))),
            ("vfd/plant/drive/pump/param/F007/get", Some(Inbound::Drive("pump", Input::ParamGet("F007")))),
            ("vfd/plant/drive/pump/param/F007/set", Some(Inbound::Drive("pump", Input::ParamSet("F007")))),
            ("vfd/plant/drive/pump/param/F007", None),
            ("vfd/plant/drive/pump/param/a/b/set", None),
            ("vfd/plant/drive/pump/run/state", None),
            ("vfd/plant/drive/pump", None),
            ("vfd/other/drive/pump/run/set", None),
            ("vfd/plantx/probe", None),
            ("", None),
        ];
        for (topic, expected) in table {
            assert_eq!(topics.parse(topic), expected, "{topic}");
        }
    }

    #[test]
    fn responses_stay_within_their_prefix_and_off_every_input() {
        let topics = topics();
        assert!(topics.may_respond_to("vfd/answers/me", "vfd/answers"));
        for (topic, allowed) in [
            ("vfd/answersme", "vfd/answers"),
            ("vfd/answers", "vfd/answers"),
            ("vfd/answers/", "vfd/answers"),
            ("vfd/answers/+", "vfd/answers"),
            ("vfd/answers/a\0b", "vfd/answers"),
            ("elsewhere/me", "vfd/answers"),
            ("vfd/plant/drive/pump/run/set", "vfd"),
            ("vfd/plant/status", "vfd"),
            ("vfd/other/drive/pump/run/set", "vfd"),
            ("vfd/other/all/run/set", "vfd"),
            ("home/status", "home"),
        ] {
            assert!(!topics.may_respond_to(topic, allowed), "{topic}");
        }
    }
}
