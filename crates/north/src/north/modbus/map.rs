//! The maps of the gateway's own units as a table, for documentation and tools. The words of a uniform unit come from the
//! table that reads them; the other code that answers is held to these rows by tests.

use super::own;
use super::uniform::{ABSENT, ABSENT_SIGNED, WORDS, address};
use crate::domain::units::UnitOfMeasure;

/// Which unit a row belongs to.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum MapUnit {
    /// The uniform unit of each drive.
    Uniform,
    /// The gateway itself: unit 255, and unit 0 for reads.
    Own,
}

/// Which table a row belongs to.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum MapTable {
    /// Coils: 01, 05, 0F hex.
    Coil,
    /// Discrete inputs: 02.
    Discrete,
    /// Input registers (04) and holding registers (03) with equal content.
    Word,
    /// Holding registers only: 03 and, where they are written, 06, 10, 16 and 17 hex.
    Holding,
}

/// What can be done with a row.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum MapAccess {
    /// Only read.
    Read,
    /// Read and write.
    ReadWrite,
}

/// What a row is repeated for.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum RowRepeat {
    /// The row occurs once.
    Once,
    /// For each line, at this address offset.
    Line(u16),
    /// For each drive, at this address offset.
    Drive(u16),
}

/// What a row holds.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum RowContent {
    /// A number in this many steps per unit of measure.
    Steps(u32, UnitOfMeasure),
    /// A plain number, and its behaviour at its ends.
    Number(&'static str),
    /// Numbers or bits with their meanings, separated by commas.
    Codes(&'static str),
    /// The number of a [`Reason`](crate::domain::command::Reason).
    Reason,
}

/// One value of a map.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct MapRow {
    /// Where it belongs.
    pub unit: MapUnit,
    /// Which table.
    pub table: MapTable,
    /// First address, from 0. The first of its kind if the row is repeated.
    pub address: u16,
    /// How many addresses; for a number with more than one, the high word is first.
    pub count: u16,
    /// Its name for programs; empty if it has none.
    pub key: &'static str,
    /// What it is.
    pub name: &'static str,
    /// What it holds.
    pub holds: RowContent,
    /// The word it reads as while unknown or not present; `None` if it is always known. In a signed word it is
    /// [`ABSENT_SIGNED`], else [`ABSENT`], and with more than one word all of them read as that.
    pub absent: Option<u16>,
    /// What can be done with it.
    pub access: MapAccess,
    /// What it is repeated for.
    pub each: RowRepeat,
}

pub(super) const fn row(
    unit: MapUnit,
    table: MapTable,
    address: u16,
    name: &'static str,
    holds: RowContent,
) -> MapRow {
    let absent = None;
    let access = MapAccess::Read;
    let each = RowRepeat::Once;
    MapRow {
        unit,
        table,
        address,
        count: 1,
        key: "",
        name,
        holds,
        absent,
        access,
        each,
    }
}

impl MapRow {
    pub(super) const fn words(self, count: u16) -> Self {
        Self { count, ..self }
    }

    pub(super) const fn written(self) -> Self {
        Self {
            access: MapAccess::ReadWrite,
            ..self
        }
    }

    pub(super) const fn or_absent(self) -> Self {
        Self {
            absent: Some(ABSENT),
            ..self
        }
    }

    pub(super) const fn signed(self) -> Self {
        Self {
            absent: Some(ABSENT_SIGNED),
            ..self
        }
    }

    /// Whether it holds two's complement.
    #[must_use]
    pub const fn is_signed(&self) -> bool {
        matches!(self.absent, Some(ABSENT_SIGNED))
    }
}

const fn status(address: u16, name: &'static str) -> MapRow {
    row(MapUnit::Uniform, MapTable::Discrete, address, name, YES)
}

const fn coil(unit: MapUnit, address: u16, name: &'static str, does: &'static str) -> MapRow {
    row(unit, MapTable::Coil, address, name, RowContent::Codes(does)).written()
}

const fn head(address: u16, name: &'static str, holds: RowContent) -> MapRow {
    row(MapUnit::Own, MapTable::Word, address, name, holds)
}

const fn line(offset: u16, count: u16, name: &'static str, holds: RowContent) -> MapRow {
    let row = head(own::LINES + offset, name, holds).or_absent();
    MapRow {
        count,
        each: RowRepeat::Line(own::LINE_WORDS),
        ..row
    }
}

const fn drive(offset: u16, name: &'static str, holds: RowContent) -> MapRow {
    MapRow {
        each: RowRepeat::Drive(own::DRIVE_WORDS),
        ..head(own::DRIVES + offset, name, holds).or_absent()
    }
}

const YES: RowContent = RowContent::Codes("1 yes");
pub(super) const COUNT: RowContent = RowContent::Number("wraps");
pub(super) const SECONDS: RowContent = RowContent::Steps(1, UnitOfMeasure::Second);
pub(super) const HUNDREDTHS: RowContent = RowContent::Steps(100, UnitOfMeasure::Hertz);
pub(super) const AGE: RowContent = RowContent::Steps(100, UnitOfMeasure::Second);
pub(super) const TRIP: RowContent = RowContent::Codes("the vendor's number, 0 none");
pub(super) const TRIPS: RowContent = RowContent::Number("stays at 65534");
pub(super) const RESERVED: RowContent = RowContent::Number("0");
pub(super) const RUN_STATES: RowContent = RowContent::Codes(
    "0 unknown, 1 stopped, 2 forward, 3 reverse, 4 tripped, 5 offline, 6 running (direction unknown), 7 stopping",
);
/// All rows: by unit, then by table, in order of address.
#[must_use]
pub const fn map() -> &'static [MapRow] {
    &MAP
}

const BIT_ROWS: usize = 19;
const OWN_ROWS: usize = 25;
const ROWS: usize = BIT_ROWS + WORDS.len() + OWN_ROWS;

const MAP: [MapRow; ROWS] = {
    let mut all = [BITS[0]; ROWS];
    let mut place = 0;
    while place < ROWS {
        let word = place.wrapping_sub(BIT_ROWS);
        let own = word.wrapping_sub(WORDS.len());
        all[place] = if place < BIT_ROWS {
            BITS[place]
        } else if word < WORDS.len() {
            WORDS[word].row
        } else {
            OWN[own]
        };
        place += 1;
    }
    all
};

/// Coils and discrete inputs of a uniform unit.
const BITS: [MapRow; BIT_ROWS] = [
    coil(
        MapUnit::Uniform,
        address::FORWARD,
        "run forward",
        "1 run, 0 stop",
    ),
    coil(
        MapUnit::Uniform,
        address::REVERSE,
        "run in reverse",
        "1 run, 0 stop",
    ),
    coil(
        MapUnit::Uniform,
        address::RESET,
        "reset a trip",
        "1 acts, reads 0",
    ),
    coil(MapUnit::Uniform, address::STOP, "stop", "1 acts, reads 0"),
    status(0, "online"),
    status(1, "running"),
    status(2, "reverse"),
    status(3, "tripped"),
    status(4, "at setpoint, within 0.1 Hz"),
    status(5, "accepts bus commands"),
    status(6, "command pending"),
    status(7, "lease held"),
    status(8, "stale"),
    status(9, "start inhibited"),
    status(10, "local control"),
    status(11, "alarm of the drive"),
    status(12, "warning of the drive"),
    status(13, "gateway on standby, another one is active"),
    row(
        MapUnit::Uniform,
        MapTable::Discrete,
        14,
        "reserved",
        RESERVED,
    )
    .words(2),
];

/// The maps of the gateway's own unit.
const OWN: [MapRow; OWN_ROWS] = [
    coil(
        MapUnit::Own,
        own::STOP_ALL,
        "stop all drives",
        "1 acts, reads 0",
    ),
    head(0, "map version", RowContent::Number("1")),
    head(1, "life counter, wraps", SECONDS),
    head(2, "lines", RowContent::Number("")),
    head(3, "drives", RowContent::Number("")),
    head(4, "time since start", SECONDS).words(2),
    head(6, "reserved", RESERVED).words(10),
    line(0, 1, "line state", RowContent::Codes("0 down, 1 up")),
    line(1, 2, "requests sent", COUNT),
    line(3, 2, "right replies", COUNT),
    line(5, 2, "time-outs", COUNT),
    line(7, 2, "damaged replies", COUNT),
    line(9, 2, "exceptions of drives", COUNT),
    line(11, 2, "frames that were no answer", COUNT),
    line(13, 1, "times the port was lost", COUNT),
    line(14, 1, "requests refused, queue full", COUNT),
    line(15, 1, "reserved", RESERVED),
    drive(0, "status bits", RowContent::Codes("as uniform word 1")),
    drive(1, "run state", RUN_STATES),
    drive(2, "output frequency", HUNDREDTHS),
    drive(3, "frequency setting of the drive", HUNDREDTHS),
    drive(4, "trip code", TRIP),
    drive(
        5,
        "output current",
        RowContent::Steps(10, UnitOfMeasure::Ampere),
    ),
    drive(6, "age of the oldest polled value, 65535 more", AGE),
    drive(7, "trips that are kept", TRIPS),
];

#[cfg(test)]
mod tests {
    use super::super::ask::{BitTable, ModbusRequest, WordTable};
    use super::super::taken::{RequestAction, RequestContext};
    use super::super::testing::{self, NOW};
    use super::super::uniform::UniformUnit;
    use super::super::words::WordBuffer;
    use super::*;
    use crate::domain::command::{Owner, Reason};
    use crate::domain::report::LineReport;
    use crate::domain::standby::LineRole;
    use crate::drive::view::DriveView;
    use std::sync::Arc;

    /// Two lines and two drives.
    struct Plant(UniformUnit);

    impl own::ServedGateway for Plant {
        fn lines(&self) -> usize {
            2
        }

        fn line(&self, _: usize) -> Option<LineReport> {
            Some(LineReport::default())
        }

        fn drives(&self) -> usize {
            2
        }

        fn drive(&self, _: usize) -> Option<(&UniformUnit, Arc<DriveView>)> {
            Some((&self.0, Arc::new(testing::view())))
        }

        fn standby(&self, _: usize) -> Option<LineRole> {
            None
        }
    }

    fn plant() -> (Plant, DriveView) {
        (
            Plant(UniformUnit::new(&testing::description())),
            testing::view(),
        )
    }

    fn asked((plant, view): &(Plant, DriveView), unit: MapUnit, ask: &ModbusRequest) -> bool {
        let present = RequestContext {
            now: NOW,
            uptime_s: 0,
            owner: Owner::Mqtt,
            standby: None,
        };
        let mut words = WordBuffer::default();
        let taken = match unit {
            MapUnit::Uniform => plant.0.take(ask, view, &present, &mut words),
            MapUnit::Own => own::take(own::UNIT, ask, plant, &present, &mut words),
        };
        !matches!(
            taken,
            RequestAction::Exception(_)
                | RequestAction::Refused(Reason::NotListed | Reason::NotCapable)
        )
    }

    fn is_listed(unit: MapUnit, tables: &[MapTable], address: u16, is_written: bool) -> bool {
        map()
            .iter()
            .filter(|row| row.unit == unit && tables.contains(&row.table))
            .any(|row| {
                let (step, times) = match row.each {
                    RowRepeat::Once => (0, 1),
                    RowRepeat::Line(step) | RowRepeat::Drive(step) => (step, 2),
                };
                let mut firsts = (0..times).map(|time| row.address + time * step);
                let may = !is_written || row.access == MapAccess::ReadWrite;
                may && firsts.any(|first| (first..first + row.count).contains(&address))
            })
    }

    #[test]
    fn just_what_is_listed_is_read() {
        let plant = plant();
        for unit in [MapUnit::Uniform, MapUnit::Own] {
            for address in 0..=u16::MAX {
                for (table, tables) in [
                    (WordTable::Holding, &[MapTable::Word, MapTable::Holding][..]),
                    (WordTable::Input, &[MapTable::Word]),
                ] {
                    let listed = is_listed(unit, tables, address, false);
                    let ask = ModbusRequest::ReadWords {
                        table,
                        address,
                        count: 1,
                    };
                    assert_eq!(
                        asked(&plant, unit, &ask),
                        listed,
                        "{unit:?} {table:?} {address}"
                    );
                }
                for (table, listed) in [
                    (BitTable::Coils, MapTable::Coil),
                    (BitTable::Discrete, MapTable::Discrete),
                ] {
                    let listed = is_listed(unit, &[listed], address, false);
                    let ask = ModbusRequest::ReadBits {
                        table,
                        address,
                        count: 1,
                    };
                    assert_eq!(
                        asked(&plant, unit, &ask),
                        listed,
                        "{unit:?} {table:?} {address}"
                    );
                }
            }
        }
    }

    #[test]
    fn just_what_is_listed_is_written() {
        let plant = plant();
        for unit in [MapUnit::Uniform, MapUnit::Own] {
            for address in 0..=u16::MAX {
                let listed = is_listed(unit, &[MapTable::Word, MapTable::Holding], address, true);
                let ask = ModbusRequest::WriteWord { address, value: 1 };
                assert_eq!(asked(&plant, unit, &ask), listed, "{unit:?} {address}");
                let listed = is_listed(unit, &[MapTable::Coil], address, true);
                let ask = ModbusRequest::WriteCoil { address, on: true };
                assert_eq!(asked(&plant, unit, &ask), listed, "{unit:?} coil {address}");
            }
        }
    }

    /// A drive of a model that shows nothing, before it was read.
    #[test]
    fn a_row_reads_absent_just_where_it_says_so() {
        let mut drive = testing::description();
        drive.control = None;
        Arc::make_mut(&mut drive.model).registers.clear();
        let uniform = UniformUnit::new(&drive);
        let view = DriveView::default();
        let present = RequestContext {
            now: NOW,
            uptime_s: 7,
            owner: Owner::Mqtt,
            standby: None,
        };
        let is_word = |row: &&MapRow| matches!(row.table, MapTable::Word | MapTable::Holding);
        for row in map()
            .iter()
            .filter(is_word)
            .filter(|row| row.unit == MapUnit::Uniform)
        {
            for address in row.address..row.address + row.count {
                let word = uniform.word(address, &view, &present).unwrap();
                let is_absent = [ABSENT, ABSENT_SIGNED].contains(&word);
                assert_eq!(is_absent.then_some(word), row.absent, "{row:?}");
                assert_eq!(uniform.has(address), row.absent.is_none(), "{row:?}");
            }
        }
        let (full, view) = plant();
        for row in map()
            .iter()
            .filter(|row| row.unit == MapUnit::Uniform && row.absent.is_some())
        {
            let word = full.0.word(row.address, &view, &present).unwrap();
            // Nothing was accepted so far.
            let is_given = row.address != address::SETPOINT;
            assert_eq!(Some(word) != row.absent, is_given, "{row:?}");
            assert!(full.0.has(row.address), "{row:?}");
        }
    }

    #[test]
    fn rows_are_in_order_and_never_overlap() {
        for pair in map().windows(2) {
            let place = |row: &MapRow| (row.unit, row.table, row.address);
            assert!(place(&pair[0]) < place(&pair[1]), "{pair:?}");
            let is_same =
                place(&pair[0]).0 == place(&pair[1]).0 && place(&pair[0]).1 == place(&pair[1]).1;
            assert!(
                !is_same || pair[0].address + pair[0].count <= pair[1].address,
                "{pair:?}"
            );
        }
    }
}
