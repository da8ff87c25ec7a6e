//! `[read]`, `[write]` and `[[barrier]]`: the limits of one exchange, and exchanges that rule out late replies.

use super::facts::{FactFile, FactReader, Origin, fact, optional, whole};
use crate::domain::address::{Address, DataTable};
use crate::domain::problem::Problem;
use crate::profile::model::{
    Barrier, BarrierRead, BlockWrite, Fact, ReadArea, ReadBoundary, ReadHoles, ReadLimits,
    RefusedWrite, WriteRules,
};
use crate::profile::words::{BOUNDARIES, HOLES, REFUSED_WRITES, TABLES};
use crate::toml_file::values::ValueKind;
use crate::toml_file::{KeyLocation, OptionalKey, RequiredKey, TableReader};

/// Maximum number of words in one read.
const READ_WORDS_MAX: u16 = 125;
/// Maximum number of registers in one write of function 10 hex.
const BLOCK_WORDS_MAX: u16 = 123;

/// `[read]`
pub(in crate::profile) struct ReadFile {
    pub max_words: FactFile<u16>,
    pub max_words_ascii: Option<FactFile<u16>>,
    pub max_bytes: Option<FactFile<u16>>,
    boundary: OptionalKey<ReadBoundary>,
    holes: Option<FactFile<ReadHoles>>,
    pub areas: Vec<AreaFile>,
}

impl ReadFile {
    pub(super) fn read(facts: &FactReader<'_>, mut reader: TableReader<'_, '_>) -> Self {
        let words = ValueKind::number(1..=READ_WORDS_MAX);
        let read = Self {
            max_words: facts.value(&mut reader, "max_words", &words),
            max_words_ascii: facts.optional_value(&mut reader, "max_words_ascii", &words),
            max_bytes: facts.optional_value(
                &mut reader,
                "max_bytes",
                &ValueKind::number(LEAST_FRAME..=256_u16),
            ),
            boundary: reader.optional("boundary", &ValueKind::one_of(&BOUNDARIES)),
            holes: facts.optional_value(&mut reader, "holes", &ValueKind::one_of(&HOLES)),
            areas: reader
                .tables("area")
                .into_iter()
                .map(|it| AreaFile::read(facts, reader.open(it)))
                .collect(),
        };
        reader.finish();
        read
    }

    /// `None` if any part is unusable.
    pub fn ready(&self) -> Option<ReadLimits> {
        let max_bytes = optional(self.max_bytes.as_ref())?;
        // A frame that is too long is refused whatever it reads.
        let fitting = max_bytes.as_ref().map(|bytes| Fact {
            value: words_in(bytes.value),
            ..bytes.clone()
        });
        let within = |words: Fact<u16>| match &fitting {
            Some(fitting) if fitting.value < words.value => fitting.clone(),
            _ => words,
        };
        let mut areas = self
            .areas
            .iter()
            .map(AreaFile::ready)
            .collect::<Option<Vec<_>>>()?;
        areas.sort_by_key(|area| (area.table, area.from));
        for area in &mut areas {
            area.max_words = within(area.max_words.clone());
        }
        Some(ReadLimits {
            max_words: within(self.max_words.ready()?),
            max_words_ascii: optional(self.max_words_ascii.as_ref())?,
            max_bytes,
            boundary: self.boundary.clone().optional()?,
            holes: optional(self.holes.as_ref())?,
            areas,
        })
    }
}

/// The shortest frame that a drive must take: a write of one word by function 10 hex.
const LEAST_FRAME: u16 = 11;
/// Bytes of a read's reply that are not words: station, function, count and check.
const REPLY_BYTES: u16 = 5;

/// The words in a reply of at most `bytes`.
const fn words_in(bytes: u16) -> u16 {
    let words = (bytes - REPLY_BYTES) / 2;
    if words < READ_WORDS_MAX {
        words
    } else {
        READ_WORDS_MAX
    }
}

/// One of `[[read.area]]`
pub(in crate::profile) struct AreaFile {
    pub table: OptionalKey<DataTable>,
    pub from: RequiredKey<u16>,
    pub to: RequiredKey<u16>,
    max_words: RequiredKey<u16>,
    origin: Option<Origin>,
}

impl AreaFile {
    fn read(facts: &FactReader<'_>, mut reader: TableReader<'_, '_>) -> Self {
        let area = Self {
            table: reader.optional("table", &ValueKind::one_of(&TABLES)),
            from: reader.required("from", &ValueKind::address()),
            to: reader.required("to", &ValueKind::address()),
            max_words: reader.required("max_words", &ValueKind::number(1..=READ_WORDS_MAX)),
            origin: facts.origin(&mut reader),
        };
        reader.finish();
        area
    }

    /// `None` if any part is unusable.
    fn ready(&self) -> Option<ReadArea> {
        Some(ReadArea {
            table: self.table.or(DataTable::Holding)?,
            from: self.from.as_ref()?.value,
            to: self.to.as_ref()?.value,
            max_words: fact(self.max_words.as_ref()?.value, self.origin.as_ref())?,
        })
    }
}

/// `[write]`
pub(in crate::profile) struct WriteFile {
    pub refused: FactFile<RefusedWrite>,
    pub block: Option<FactFile<BlockFile>>,
}

impl WriteFile {
    pub(super) fn read(facts: &FactReader<'_>, mut reader: TableReader<'_, '_>) -> Self {
        let block = |reader: &mut TableReader<'_, '_>| {
            whole(reader, |reader| BlockFile::read(reader, BLOCK_WORDS_MAX))
        };
        let write = Self {
            refused: facts.value(&mut reader, "refused", &ValueKind::one_of(&REFUSED_WRITES)),
            block: facts.optional(&mut reader, "block", block),
        };
        reader.finish();
        write
    }

    /// `None` if any part is unusable.
    pub(super) fn ready(&self) -> Option<WriteRules> {
        let block = match &self.block {
            None => None,
            Some(block) => Some(BlockWrite {
                address: block.value.as_ref()?.value.first()?,
                count: block.and_then(|it| Some(it.count.as_ref()?.value))?,
            }),
        };
        Some(WriteRules {
            refused: self.refused.ready()?,
            block,
        })
    }
}

/// Consecutive registers: `{ address = 0x0101, count = 2 }`
pub(in crate::profile) struct BlockFile {
    pub table: OptionalKey<DataTable>,
    pub address: RequiredKey<u16>,
    pub count: RequiredKey<u16>,
}

impl BlockFile {
    fn read(reader: &mut TableReader<'_, '_>, most: u16) -> Self {
        Self {
            table: reader.optional("table", &ValueKind::one_of(&TABLES)),
            address: reader.required("address", &ValueKind::address()),
            count: reader.required("count", &ValueKind::number(1..=most)),
        }
    }

    /// The first address; `None` if it is unusable.
    pub fn first(&self) -> Option<Address> {
        Some(Address::new(
            self.table.or(DataTable::Holding)?,
            self.address.as_ref()?.value,
        ))
    }
}

/// One of `[[barrier]]`
pub(in crate::profile) struct BarrierFile {
    pub location: KeyLocation,
    /// `None` if it has no valid form, which is already reported.
    pub form: Option<BarrierForm>,
}

/// A barrier by its form.
pub(in crate::profile) enum BarrierForm {
    Read(BlockFile),
    LoopTest(FactFile<()>),
    Refused(FactFile<u8>),
}

impl BarrierFile {
    pub(super) fn read(facts: &FactReader<'_>, mut reader: TableReader<'_, '_>) -> Self {
        let read = match reader.table("read") {
            OptionalKey::Absent => None,
            OptionalKey::Invalid => Some(BlockFile {
                table: OptionalKey::Invalid,
                address: None,
                count: None,
            }),
            OptionalKey::Valid(section) => {
                let mut reader = reader.open(section.value);
                let block = BlockFile::read(&mut reader, 125);
                reader.finish();
                Some(block)
            }
        };
        let loop_test = facts.switch(&mut reader, "loop_test");
        let refused = facts.optional_value(
            &mut reader,
            "refused_function",
            &ValueKind::number(1..=127_u8),
        );
        let location = reader.location().clone();
        let form = match (read, loop_test, refused) {
            (Some(read), None, None) => Some(BarrierForm::Read(read)),
            (None, Some(fact), None) => Some(BarrierForm::LoopTest(fact)),
            (None, None, Some(fact)) => Some(BarrierForm::Refused(fact)),
            (None, None, None) => no_form(&location, "is not a barrier", reader.problems()),
            _ => no_form(&location, "has more than one form", reader.problems()),
        };
        reader.finish();
        Self { location, form }
    }

    /// `None` if any part is unusable.
    pub(super) fn ready(&self) -> Option<Barrier> {
        Some(match self.form.as_ref()? {
            BarrierForm::Read(block) => Barrier::Read(BarrierRead {
                address: block.first()?,
                count: block.count.as_ref()?.value,
            }),
            BarrierForm::LoopTest(fact) => Barrier::Loop(fact.ready()?),
            BarrierForm::Refused(function) => Barrier::Refused(function.ready()?),
        })
    }
}

fn no_form(location: &KeyLocation, what: &str, problems: &mut Vec<Problem>) -> Option<BarrierForm> {
    problems.push(
        location
            .problem(what)
            .right("exactly one of `read`, `loop_test` and `refused_function`"),
    );
    None
}
