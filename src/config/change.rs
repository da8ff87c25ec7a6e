//! What a new configuration changes of the one in force: which lines go on as they are, which end and which start, and
//! the same in words for people.

use super::ready::{Config, ListenerSettings};
use crate::domain::ids::Name;
use std::fmt;

/// What a new configuration changes.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Change {
    /// For each line of the new configuration the index of the old one that goes on as it; nothing: it is started.
    pub continues: Vec<Option<usize>>,
    /// Indices of the old lines that end: those that are removed, and those that are started anew.
    pub ended: Vec<usize>,
    /// For each listener of the new configuration the index of the old one whose socket it keeps; nothing: it is new.
    pub listeners: Vec<Option<usize>>,
    /// What takes a restart of the gateway, by its key.
    pub needs_restart: Vec<&'static str>,
    /// What is different, in the order of the file.
    pub told: Vec<ChangeNote>,
}

/// One difference.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ChangeNote {
    /// Of what kind the thing is.
    pub part: ConfigPart,
    /// What it is called; nothing where there is only one.
    pub name: Option<String>,
    /// What becomes of it.
    pub how: How,
}

/// A part of a configuration.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum ConfigPart {
    /// `[gateway]`
    Gateway,
    /// A line.
    Line,
    /// A drive.
    Drive,
    /// The connection to the broker.
    Mqtt,
    /// A Modbus TCP listener.
    ModbusTcp,
    /// The HTTP listener.
    Http,
}

impl ConfigPart {
    /// The word for it.
    #[must_use]
    pub const fn word(self) -> &'static str {
        match self {
            Self::Gateway => "gateway",
            Self::Line => "line",
            Self::Drive => "drive",
            Self::Mqtt => "mqtt",
            Self::ModbusTcp => "modbus_tcp",
            Self::Http => "http",
        }
    }
}

/// What becomes of a part.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum How {
    /// It is new.
    Added,
    /// It is gone.
    Removed,
    /// Its settings are others; a line starts anew.
    Changed,
}

impl How {
    /// The word for it.
    #[must_use]
    pub const fn word(self) -> &'static str {
        match self {
            Self::Added => "added",
            Self::Removed => "removed",
            Self::Changed => "changed",
        }
    }
}

impl ChangeNote {
    /// The broker's side is different in something that stands in no configuration, such as its password.
    #[must_use]
    pub const fn mqtt_changed() -> Self {
        Self { part: ConfigPart::Mqtt, name: None, how: How::Changed }
    }
}

impl fmt::Display for ChangeNote {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.part.word())?;
        if let Some(name) = &self.name {
            write!(f, " {name}")?;
        }
        write!(f, ": {}", self.how.word())
    }
}

impl Change {
    /// What `new` changes of `old`. Lines are told apart by their names, listeners by their addresses.
    #[must_use]
    pub fn between(old: &Config, new: &Config) -> Self {
        let same_name = |name: &Name| old.lines.iter().position(|line| line.name == *name);
        let goes_on = |line: &super::LineSettings| same_name(&line.name).filter(|at| old.lines.get(*at) == Some(line));
        let continues: Vec<_> = new.lines.iter().map(goes_on).collect();
        let listeners = new.listeners.iter();
        let socket_of = |it: &ListenerSettings| old.listeners.iter().position(|old| old.listen == it.listen);
        Self {
            ended: (0..old.lines.len()).filter(|at| !continues.contains(&Some(*at))).collect(),
            continues,
            listeners: listeners.map(socket_of).collect(),
            needs_restart: needs_restart(old, new),
            told: told(old, new),
        }
    }

    /// Names of the drives of `old` whose lines end, with the index of the line and theirs on it.
    pub fn leaving<'c>(&'c self, old: &'c Config) -> impl Iterator<Item = (usize, &'c str)> {
        self.ended.iter().flat_map(|at| {
            let line = old.lines.get(*at);
            line.into_iter().flat_map(|line| &line.drives).map(|drive| (*at, drive.name.as_str()))
        })
    }
}

/// The name is in every topic and every record, and the directory holds what was recorded under it, in a journal of its
/// size.
fn needs_restart(old: &Config, new: &Config) -> Vec<&'static str> {
    let has_other_journal = old.journal != new.journal;
    let old = &old.gateway;
    let new = &new.gateway;
    let differ = [
        ("gateway.name", old.name != new.name),
        ("gateway.data_dir", old.data_dir != new.data_dir),
        ("journal.max_size", has_other_journal),
    ];
    differ.into_iter().filter(|(_, differs)| *differs).map(|(key, _)| key).collect()
}

fn told(old: &Config, new: &Config) -> Vec<ChangeNote> {
    let mut told = Vec::new();
    if old.gateway != new.gateway {
        told.push(ChangeNote { part: ConfigPart::Gateway, name: None, how: How::Changed });
    }
    compare(&mut told, ConfigPart::Line, &lines(old), &lines(new));
    compare(&mut told, ConfigPart::Drive, &drives(old), &drives(new));
    one(&mut told, ConfigPart::Mqtt, old.mqtt.as_ref(), new.mqtt.as_ref());
    compare(&mut told, ConfigPart::ModbusTcp, &listeners(old), &listeners(new));
    one(&mut told, ConfigPart::Http, old.http.as_ref(), new.http.as_ref());
    told
}

type Named<T> = Vec<(String, T)>;

fn lines(config: &Config) -> Named<&super::LineSettings> {
    config.lines.iter().map(|line| (line.name.to_string(), line)).collect()
}

/// Each with its line: one that moves to another is changed.
fn drives(config: &Config) -> Named<(&super::DriveSettings, &str)> {
    config
        .lines
        .iter()
        .flat_map(|line| line.drives.iter().map(|drive| (drive.name.to_string(), (drive, line.name.as_str()))))
        .collect()
}

/// Each with the names of its lines: their indices may be others though they are the same.
fn listeners(config: &Config) -> Named<(ListenerSettings, Option<Vec<&str>>)> {
    let named = |listener: &ListenerSettings| {
        let names = listener
            .lines
            .as_ref()
            .map(|lines| lines.iter().filter_map(|at| config.lines.get(*at)).map(|line| line.name.as_str()).collect());
        (listener.listen.to_string(), (ListenerSettings { lines: None, ..listener.clone() }, names))
    };
    config.listeners.iter().map(named).collect()
}

/// In the order of `new`; what is removed comes last.
fn compare<T: PartialEq>(told: &mut Vec<ChangeNote>, part: ConfigPart, old: &Named<T>, new: &Named<T>) {
    let mut tell = |name: &String, how| told.push(ChangeNote { part, name: Some(name.clone()), how });
    for (name, value) in new {
        match old.iter().find(|(other, _)| other == name) {
            None => tell(name, How::Added),
            Some((_, other)) if other != value => tell(name, How::Changed),
            Some(_) => {}
        }
    }
    for (name, _) in old.iter().filter(|(name, _)| new.iter().all(|(other, _)| other != name)) {
        tell(name, How::Removed);
    }
}

fn one<T: PartialEq>(told: &mut Vec<ChangeNote>, part: ConfigPart, old: Option<&T>, new: Option<&T>) {
    let how = match (old, new) {
        (None, Some(_)) => How::Added,
        (Some(_), None) => How::Removed,
        (old, new) if old != new => How::Changed,
        _ => return,
    };
    told.push(ChangeNote { part, name: None, how });
}
