//! The words of a uniform unit: one row defines what a word is, how it is read, and whether a drive has it.

use super::super::map::{
    AGE, COUNT, HUNDREDTHS, MapRow, MapTable, MapUnit, RESERVED, RUN_STATES, RowContent, SECONDS,
    TRIP, TRIPS, row,
};
use super::column::{ABSENT, ABSENT_SIGNED, MeasurementSource, unit_of};
use super::words::{WordContext, life};
use super::{MAP_VERSION, UniformUnit, address, status};
use crate::drive::usage::UsagePart;
use crate::profile::model::RegisterRole::{
    self, DcLinkVoltage, FrequencySetting, OutputCurrent, OutputFrequency, OutputPower,
    OutputVoltage, RunHours, Temperature, Torque,
};

/// One row of words.
pub(in super::super) struct WordRow {
    /// What it is.
    pub(in super::super) row: MapRow,
    from: WordSource,
    has: Capability,
}

/// Where a word comes from.
#[derive(Clone, Copy)]
enum WordSource {
    /// This reads it.
    State(fn(&UniformUnit, &WordContext<'_>) -> u16),
    /// The measurement with this role, with its number of steps per unit.
    Measurement(RegisterRole, WordSteps),
    /// This sum of what the drive has used, in this many steps per unit.
    Usage(UsagePart, u32),
}

/// How a measurement becomes a word, or two.
#[derive(Clone, Copy)]
enum WordSteps {
    Unsigned(u32),
    /// Without its sign, in hundredths.
    Frequency,
    Signed(u32),
    /// Whole numbers in two words, the high one first.
    Long,
}

/// Whether a drive has it.
#[derive(Clone, Copy)]
enum Capability {
    Always,
    /// The drive has the measurement.
    Measurement,
    /// The drive reports that it is tripped.
    Tripped,
    /// Its trips are read.
    Trips,
    /// Something of it is polled.
    Polled,
    /// The drive has a control section.
    Control,
    /// The drive has the sum.
    Usage,
}

const TENTHS: WordSteps = WordSteps::Unsigned(10);
const FINE: WordSteps = WordSteps::Unsigned(100);
const SIGNED_TENTHS: WordSteps = WordSteps::Signed(10);
const OUTCOMES: RowContent = RowContent::Codes(
    "0 none so far, 1 refused, 2 expired, 3 superseded, 4 failed, 5 unknown, 6 acknowledged, 7 confirmed",
);
const RUN_VALUES: RowContent =
    RowContent::Codes("0 stop, 1 forward, 2 reverse, 3 coast, 4 reset, 5 release, 6 take");
const OWNERS: RowContent = RowContent::Codes(
    "0 none, 1 MQTT, 2 another Modbus TCP client, 3 this client, 4 a tool at the gateway's host, 5 an operator on the page, \
     6 a Sparkplug host",
);
const ALARMS: RowContent = RowContent::Codes(
    "bit 0 a stop had no effect, 1 fail-safe due or done, 2 stale data, 3 line down, 4 may still run, 5 output outside \
     limits, 6 stopped elsewhere",
);
const CAPABILITIES: RowContent =
    RowContent::Codes("bit 0 forward, 1 reverse, 2 coast, 3 reset, 4 setpoint, 5 release, 6 take");

type Read = fn(&UniformUnit, &WordContext<'_>) -> u16;

const fn state(
    address: u16,
    key: &'static str,
    name: &'static str,
    holds: RowContent,
    read: Read,
) -> WordRow {
    let row = row(MapUnit::Uniform, MapTable::Word, address, name, holds);
    WordRow {
        row: MapRow { key, ..row },
        from: WordSource::State(read),
        has: Capability::Always,
    }
}

const fn control(
    address: u16,
    key: &'static str,
    name: &'static str,
    holds: RowContent,
    read: Read,
) -> WordRow {
    let row = row(MapUnit::Uniform, MapTable::Holding, address, name, holds);
    WordRow {
        row: MapRow { key, ..row },
        from: WordSource::State(read),
        has: Capability::Always,
    }
}

const fn measured(
    address: u16,
    key: &'static str,
    name: &'static str,
    role: RegisterRole,
    steps: WordSteps,
) -> WordRow {
    let per_unit = match steps {
        WordSteps::Unsigned(count) | WordSteps::Signed(count) => count,
        WordSteps::Frequency => 100,
        WordSteps::Long => 1,
    };
    let row = row(
        MapUnit::Uniform,
        MapTable::Word,
        address,
        name,
        RowContent::Steps(per_unit, unit_of(role)),
    );
    let row = match steps {
        WordSteps::Unsigned(_) | WordSteps::Frequency => row.or_absent(),
        WordSteps::Signed(_) => row.signed(),
        WordSteps::Long => row.or_absent().words(2),
    };
    WordRow {
        row: MapRow { key, ..row },
        from: WordSource::Measurement(role, steps),
        has: Capability::Measurement,
    }
}

const fn used(
    address: u16,
    key: &'static str,
    name: &'static str,
    part: UsagePart,
    steps: u32,
) -> WordRow {
    let holds = RowContent::Steps(steps, part.unit());
    let row = row(MapUnit::Uniform, MapTable::Word, address, name, holds);
    let row = row.or_absent().words(2);
    WordRow {
        row: MapRow { key, ..row },
        from: WordSource::Usage(part, steps),
        has: Capability::Usage,
    }
}

impl WordRow {
    const fn written(self) -> Self {
        Self {
            row: self.row.written(),
            ..self
        }
    }

    const fn words(self, count: u16) -> Self {
        Self {
            row: self.row.words(count),
            ..self
        }
    }

    /// The word reads absent where the drive does not have it.
    const fn where_it_has(self, has: Capability) -> Self {
        Self {
            row: self.row.or_absent(),
            has,
            ..self
        }
    }

    /// The word at `address`, which belongs to this row.
    pub(super) fn read(&self, address: u16, unit: &UniformUnit, look: &WordContext<'_>) -> u16 {
        match self.from {
            WordSource::State(read) => read(unit, look),
            WordSource::Measurement(role, steps) => {
                let fresh = unit
                    .sources
                    .measurement(role)
                    .and_then(|column| column.fresh(look.view, look.present.now));
                match steps {
                    WordSteps::Unsigned(steps) => {
                        fresh.map_or(ABSENT, |value| value.unsigned(steps.into()))
                    }
                    WordSteps::Frequency => {
                        fresh.map_or(ABSENT, |value| value.magnitude().unsigned(100))
                    }
                    WordSteps::Signed(steps) => {
                        fresh.map_or(ABSENT_SIGNED, |value| value.signed(steps.into()))
                    }
                    WordSteps::Long => self.long(address, fresh.map(|value| value.in_steps(1))),
                }
            }
            WordSource::Usage(part, steps) => {
                let used = if unit.sources.usage.has(part) {
                    look.view.usage.steps(part, steps.into())
                } else {
                    None
                };
                let used = used.map(|used| used.min(u64::from(u32::MAX - 1)));
                self.long(address, used.and_then(|used| i64::try_from(used).ok()))
            }
        }
    }

    /// The word at `address` of a number of two words; absent if it is not known or does not fit.
    fn long(&self, address: u16, number: Option<i64>) -> u16 {
        let whole = number
            .and_then(|number| u32::try_from(number).ok())
            .unwrap_or(u32::MAX);
        let is_high = address == self.row.address;
        if is_high {
            (whole >> 16) as u16
        } else {
            (whole & 0xFFFF) as u16
        }
    }

    /// What its measurement comes from; `None` if the drive does not have it, or it is no measurement.
    pub(super) fn column<'u>(&self, unit: &'u UniformUnit) -> Option<&'u MeasurementSource> {
        match self.from {
            WordSource::State(_) | WordSource::Usage(..) => None,
            WordSource::Measurement(role, ..) => unit.sources.measurement(role),
        }
    }

    /// Whether it can ever hold anything but its mark of absence, with this drive.
    pub(super) fn is_of(&self, unit: &UniformUnit) -> bool {
        let sources = &unit.sources;
        match self.has {
            Capability::Always => true,
            Capability::Measurement => self.column(unit).is_some(),
            Capability::Tripped => sources.has_trips || unit.reported & status::bit::TRIPPED != 0,
            Capability::Trips => sources.has_trips,
            Capability::Polled => !sources.polled.is_empty(),
            Capability::Control => sources.has_control,
            Capability::Usage => {
                matches!(self.from, WordSource::Usage(part, _) if sources.usage.has(part))
            }
        }
    }
}

/// All words, in order of address.
pub(in super::super) const WORDS: &[WordRow] = &[
    state(
        0,
        "map_version",
        "map version",
        RowContent::Number("1"),
        |_, _| MAP_VERSION,
    ),
    state(
        1,
        "status",
        "status bits",
        RowContent::Codes("bit n is discrete input n"),
        UniformUnit::status_word,
    ),
    state(2, "run_state", "run state", RUN_STATES, |_, look| {
        status::run_state(look.view).number()
    }),
    state(3, "trip_code", "trip code", TRIP, UniformUnit::trip_code)
        .where_it_has(Capability::Tripped),
    measured(
        4,
        "output_frequency",
        "output frequency",
        OutputFrequency,
        WordSteps::Frequency,
    ),
    measured(
        5,
        "setpoint",
        "frequency setting of the drive",
        FrequencySetting,
        WordSteps::Frequency,
    ),
    measured(6, "current", "output current", OutputCurrent, TENTHS),
    measured(7, "voltage", "output voltage", OutputVoltage, TENTHS),
    measured(8, "dc_voltage", "DC link voltage", DcLinkVoltage, TENTHS),
    measured(9, "power", "output power", OutputPower, TENTHS),
    measured(10, "torque", "torque", Torque, SIGNED_TENTHS),
    measured(11, "temperature", "temperature", Temperature, SIGNED_TENTHS),
    state(
        12,
        "age",
        "age of the oldest polled value, 65535 more",
        AGE,
        UniformUnit::oldest_age,
    )
    .where_it_has(Capability::Polled),
    state(
        13,
        "trips",
        "trips that are kept",
        TRIPS,
        UniformUnit::trips_kept,
    )
    .where_it_has(Capability::Trips),
    state(
        14,
        "last_trip_code",
        "code of the last of them",
        TRIP,
        UniformUnit::last_trip,
    )
    .where_it_has(Capability::Trips),
    state(
        15,
        "status_mask",
        "status bits that this drive can report",
        RowContent::Codes("mask of word 1"),
        UniformUnit::status_mask,
    ),
    state(16, "life", "life counter, wraps", SECONDS, |_, look| {
        life(look.present)
    }),
    state(17, "alarms", "alarms", ALARMS, |unit, look| {
        status::alarms(&unit.sources, look.view, look.present.now)
    }),
    state(
        18,
        "lease_left",
        "lease left",
        SECONDS,
        UniformUnit::lease_left,
    ),
    state(
        19,
        "owner",
        "owner of the lease",
        OWNERS,
        UniformUnit::lease_owner,
    ),
    state(
        20,
        "min_frequency",
        "lowest setpoint",
        HUNDREDTHS,
        |unit, _| unit.limits[0],
    )
    .where_it_has(Capability::Control),
    state(
        21,
        "max_frequency",
        "highest setpoint",
        HUNDREDTHS,
        |unit, _| unit.limits[1],
    )
    .where_it_has(Capability::Control),
    measured(22, "run_hours", "run hours", RunHours, WordSteps::Long),
    measured(
        24,
        "current_fine",
        "output current, finer",
        OutputCurrent,
        FINE,
    ),
    measured(25, "power_fine", "output power, finer", OutputPower, FINE),
    state(
        26,
        "capabilities",
        "capabilities",
        CAPABILITIES,
        |unit, _| unit.capabilities,
    ),
    state(27, "", "reserved", RESERVED, |_, _| 0).words(5),
    used(32, "energy_used", "energy used", UsagePart::Energy, 10),
    used(
        34,
        "running_hours",
        "time of running",
        UsagePart::RunningHours,
        10,
    ),
    used(36, "starts", "starts", UsagePart::Starts, 1),
    used(
        38,
        "total_trips",
        "trips, earlier processes included",
        UsagePart::Trips,
        1,
    ),
    control(
        address::RUN,
        "run_command",
        "run command",
        RUN_VALUES,
        |unit, look| unit.intent(look.view),
    )
    .written(),
    control(
        address::SETPOINT,
        "frequency_command",
        "frequency setpoint",
        HUNDREDTHS,
        UniformUnit::setpoint,
    )
    .written()
    .where_it_has(Capability::Control),
    control(
        address::RENEW,
        "",
        "write any value: renew the lease; reads lease left",
        SECONDS,
        UniformUnit::lease_left,
    )
    .written(),
    control(
        259,
        "outcome",
        "outcome of the drive's last command",
        OUTCOMES,
        UniformUnit::last_outcome,
    ),
    control(260, "commands", "commands", COUNT, UniformUnit::commands),
    control(
        261,
        "reason",
        "reason of the drive's last command",
        RowContent::Reason,
        UniformUnit::last_reason,
    ),
];

/// Words from 0 on that 03 and 04 read: those before control.
pub(super) const PICTURE_WORDS: u16 = {
    let mut row = 0;
    while WORDS[row + 1].row.address < address::RUN {
        row += 1;
    }
    WORDS[row].row.address + WORDS[row].row.count
};
/// The last word of control.
pub(super) const CONTROL_LAST: u16 = WORDS[WORDS.len() - 1].row.address;

const WORD_COUNT: usize = (PICTURE_WORDS + CONTROL_LAST - address::RUN + 1) as usize;

/// Which row each word is of: first the view, then control.
const PLACES: [u8; WORD_COUNT] = {
    let mut places = [0; WORD_COUNT];
    let mut row = 0;
    while row < WORDS.len() {
        let MapRow { address, count, .. } = WORDS[row].row;
        let mut offset = 0;
        while offset < count {
            places[index(address + offset)] = row as u8;
            offset += 1;
        }
        row += 1;
    }
    places
};

const fn index(address: u16) -> usize {
    if address < PICTURE_WORDS {
        address as usize
    } else {
        (PICTURE_WORDS + address - address::RUN) as usize
    }
}

/// The row of the word at `address`; `None` outside of the map.
pub(super) fn row_at(address: u16) -> Option<&'static WordRow> {
    let is_there = address < PICTURE_WORDS || (address::RUN..=CONTROL_LAST).contains(&address);
    let place = is_there.then(|| PLACES.get(index(address))).flatten()?;
    WORDS.get(usize::from(*place))
}
