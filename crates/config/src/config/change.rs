//! The differences between a new configuration and the one in force: which lines continue, end and start, and the same
//! in words for people.

use super::ready::{Config, ListenerSettings, SerialMasterSettings};
use crate::domain::ids::Name;
use crate::north::titles::PartTitle;
use std::fmt;

/// The differences between two configurations.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ConfigChange {
    /// For each line of the new configuration, the index of the old line that continues as it; `None`: it is started.
    pub continues: Vec<Option<usize>>,
    /// Indices of the old lines that end: removed and restarted ones.
    pub ended: Vec<usize>,
    /// For each listener of the new configuration, the index of the old one whose socket it keeps; `None`: it is new.
    pub listeners: Vec<Option<usize>>,
    /// Keys whose change requires a restart of the gateway.
    pub needs_restart: Vec<&'static str>,
    /// The differences, in the order of the file.
    pub notes: Vec<ChangeNote>,
}

/// One difference.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ChangeNote {
    /// The kind of part.
    pub part: ConfigPart,
    /// Its name; `None` for a part that exists only once.
    pub name: Option<String>,
    /// How it changes.
    pub how: PartChange,
}

/// A part of a configuration.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum ConfigPart {
    /// `[gateway]`
    Gateway,
    /// `[standby]`
    Standby,
    /// A line.
    Line,
    /// A drive.
    Drive,
    /// A group of drives.
    Group,
    /// The connection to the broker.
    Mqtt,
    /// A Modbus TCP listener.
    ModbusTcp,
    /// A serial master.
    ModbusRtu,
    /// The HTTP listener.
    Http,
}

impl ConfigPart {
    /// The word for it.
    #[must_use]
    pub const fn keyword(self) -> &'static str {
        match self {
            Self::Gateway => "gateway",
            Self::Standby => "standby",
            Self::Line => "line",
            Self::Drive => "drive",
            Self::Group => "group",
            Self::Mqtt => "mqtt",
            Self::ModbusTcp => "modbus_tcp",
            Self::ModbusRtu => "modbus_rtu",
            Self::Http => "http",
        }
    }
}

/// How a part changes.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum PartChange {
    /// It is new.
    Added,
    /// It is removed.
    Removed,
    /// Its settings or its title differ; a line with other settings is restarted.
    Changed,
}

impl PartChange {
    /// The word for it.
    #[must_use]
    pub const fn keyword(self) -> &'static str {
        match self {
            Self::Added => "added",
            Self::Removed => "removed",
            Self::Changed => "changed",
        }
    }
}

impl ChangeNote {
    /// A difference in a part that exists only once.
    const fn of_one(part: ConfigPart, how: PartChange) -> Self {
        Self {
            part,
            name: None,
            how,
        }
    }

    /// The broker's side differs in something outside the configuration, such as its password.
    #[must_use]
    pub const fn mqtt_changed() -> Self {
        Self::of_one(ConfigPart::Mqtt, PartChange::Changed)
    }
}

impl fmt::Display for ChangeNote {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.part.keyword())?;
        if let Some(name) = &self.name {
            write!(f, " {name}")?;
        }
        write!(f, ": {}", self.how.keyword())
    }
}

impl ConfigChange {
    /// Compares `new` with `old`. Lines are identified by name, listeners by address.
    #[must_use]
    pub fn between(old: &Config, new: &Config) -> Self {
        let same_name = |name: &Name| old.lines.iter().position(|line| line.name == *name);
        let goes_on = |line: &super::LineSettings| {
            same_name(&line.name).filter(|at| old.lines.get(*at) == Some(line))
        };
        let continues: Vec<_> = new.lines.iter().map(goes_on).collect();
        let listeners = new.listeners.iter();
        let socket_of =
            |it: &ListenerSettings| old.listeners.iter().position(|old| old.listen == it.listen);
        Self {
            ended: (0..old.lines.len())
                .filter(|at| !continues.contains(&Some(*at)))
                .collect(),
            continues,
            listeners: listeners.map(socket_of).collect(),
            needs_restart: needs_restart(old, new),
            notes: change_notes(old, new),
        }
    }

    /// Names of the drives of `old` whose lines end, with the index of the line and of the drive on it.
    pub fn leaving<'c>(&'c self, old: &'c Config) -> impl Iterator<Item = (usize, &'c str)> {
        self.ended.iter().flat_map(|at| {
            let line = old.lines.get(*at);
            line.into_iter()
                .flat_map(|line| &line.drives)
                .map(|drive| (*at, drive.name.as_str()))
        })
    }
}

/// Settings that require a restart: the name is in every topic and record, and the directory holds the journal, of its
/// configured size.
fn needs_restart(old: &Config, new: &Config) -> Vec<&'static str> {
    let has_other_journal = old.journal != new.journal;
    let old = &old.gateway;
    let new = &new.gateway;
    let differ = [
        ("gateway.name", old.name != new.name),
        ("gateway.data_dir", old.data_dir != new.data_dir),
        ("journal.max_size", has_other_journal),
    ];
    differ
        .into_iter()
        .filter(|(_, differs)| *differs)
        .map(|(key, _)| key)
        .collect()
}

fn change_notes(old: &Config, new: &Config) -> Vec<ChangeNote> {
    let mut notes = Vec::new();
    if (&old.gateway, &old.titles.gateway) != (&new.gateway, &new.titles.gateway) {
        let how = PartChange::Changed;
        notes.push(ChangeNote::of_one(ConfigPart::Gateway, how));
    }
    let into = &mut notes;
    one(into, ConfigPart::Standby, &old.standby, &new.standby);
    compare(into, ConfigPart::Line, &lines(old), &lines(new));
    compare(into, ConfigPart::Drive, &drives(old), &drives(new));
    compare(into, ConfigPart::Group, &groups(old), &groups(new));
    one(into, ConfigPart::Mqtt, &old.mqtt, &new.mqtt);
    compare(
        into,
        ConfigPart::ModbusTcp,
        &listeners(old),
        &listeners(new),
    );
    compare(into, ConfigPart::ModbusRtu, &masters(old), &masters(new));
    one(into, ConfigPart::Http, &old.http, &new.http);
    notes
}

type Named<T> = Vec<(String, T)>;

/// Settings with the title beside them.
type Titled<'c, T> = (T, Option<&'c PartTitle>);

fn lines(config: &Config) -> Named<Titled<'_, &super::LineSettings>> {
    let titled = |line: &super::LineSettings| config.titles.lines.get(line.name.as_str());
    let lines = config.lines.iter();
    lines
        .map(|line| (line.name.to_string(), (line, titled(line))))
        .collect()
}

/// Each with its line: a drive that moves to another line is changed.
fn drives(config: &Config) -> Named<Titled<'_, (&super::DriveSettings, &str)>> {
    let mut named = Vec::new();
    for line in &config.lines {
        for drive in &line.drives {
            let title = config.titles.drives.get(drive.name.as_str());
            let of_drive = (drive, line.name.as_str());
            named.push((drive.name.to_string(), (of_drive, title)));
        }
    }
    named
}

fn groups(config: &Config) -> Named<&PartTitle> {
    let groups = config.titles.groups.iter();
    groups.map(|(name, title)| (name.clone(), title)).collect()
}

/// The names of lines that are served; `None` for all.
type Served<'c> = Option<Vec<&'c str>>;

/// What `listener` grants, and the names of its lines: equal lines may have other indices.
fn served<'c>(config: &'c Config, listener: &ListenerSettings) -> (ListenerSettings, Served<'c>) {
    let name = |at: &usize| config.lines.get(*at).map(|line| line.name.as_str());
    let mut listener = listener.clone();
    let lines = listener.lines.take();
    let names = lines.map(|lines| lines.iter().filter_map(name).collect());
    (listener, names)
}

fn listeners(config: &Config) -> Named<(ListenerSettings, Served<'_>)> {
    let listeners = config.listeners.iter();
    let named = |it: &ListenerSettings| (it.listen.to_string(), served(config, it));
    listeners.map(named).collect()
}

fn masters(config: &Config) -> Named<(SerialMasterSettings, Served<'_>)> {
    let named = |master: &SerialMasterSettings| {
        let mut master = master.clone();
        let (serving, names) = served(config, &master.serving);
        master.serving = serving;
        (master.name.to_string(), (master, names))
    };
    config.serial_masters.iter().map(named).collect()
}

/// In the order of `new`; removed parts are last.
fn compare<T: PartialEq>(
    notes: &mut Vec<ChangeNote>,
    part: ConfigPart,
    old: &Named<T>,
    new: &Named<T>,
) {
    let mut tell = |name: &String, how| {
        notes.push(ChangeNote {
            part,
            name: Some(name.clone()),
            how,
        })
    };
    for (name, value) in new {
        match old.iter().find(|(other, _)| other == name) {
            None => tell(name, PartChange::Added),
            Some((_, other)) if other != value => tell(name, PartChange::Changed),
            Some(_) => {}
        }
    }
    for (name, _) in old
        .iter()
        .filter(|(name, _)| new.iter().all(|(other, _)| other != name))
    {
        tell(name, PartChange::Removed);
    }
}

fn one<T: PartialEq>(
    notes: &mut Vec<ChangeNote>,
    part: ConfigPart,
    old: &Option<T>,
    new: &Option<T>,
) {
    let how = match (old, new) {
        (None, Some(_)) => PartChange::Added,
        (Some(_), None) => PartChange::Removed,
        (old, new) if old != new => PartChange::Changed,
        _ => return,
    };
    notes.push(ChangeNote::of_one(part, how));
}
