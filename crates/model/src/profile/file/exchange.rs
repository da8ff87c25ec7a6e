//! `[read]`, `[write]` and `[[barrier]]`: the limits of one exchange, and exchanges that rule out late replies.

use super::facts::{FactFile, FactReader, Origin, fact, given};
use super::kinds::function_code;
use crate::domain::address::{Address, DataTable};
use crate::profile::model::{
    Barrier, BarrierRead, BlockWrite, Fact, ReadArea, ReadBoundary, ReadHoles, ReadLimits,
    RefusedWrite, WriteRules,
};
use crate::profile::words::{BOUNDARIES, HOLES, REFUSED_WRITES, TABLES};
use crate::toml_file::declare::{declare_table, optional, required, table, tables};
use crate::toml_file::values::ValueKind;
use crate::toml_file::{OptionalKey, RequiredKey, TableReader};

/// Maximum number of words in one read.
pub(super) const READ_WORDS_MAX: u16 = 125;
/// Maximum number of registers in one write of function 10 hex.
pub(super) const BLOCK_WORDS_MAX: u16 = 123;

declare_table! {
    /// The limits of reads.
    ReadFile is "[read]" with facts: &FactReader<'_> {
        /// Most words in one read.
        max_words: FactFile<u16> = facts.value(read_words());
        /// Most words in one read by ASCII frames.
        max_words_ascii: Option<FactFile<u16>> = facts.optional_value(read_words()),
            without "as `max_words`";
        /// The longest frame in bytes, if the manual limits frames instead of words.
        max_bytes: Option<FactFile<u16>> = facts.optional_value(ValueKind::number(LEAST_FRAME..=256)),
            without "not known";
        /// A boundary that no read crosses: a change of the address's high byte.
        boundary: OptionalKey<ReadBoundary> = optional(ValueKind::one_of(&BOUNDARIES)), without "none";
        /// What a read of an address without a register shows.
        holes: Option<FactFile<ReadHoles>> = facts.optional_value(ValueKind::one_of(&HOLES)),
            without "`refused`";
        areas as "area": Vec<AreaFile> = tables(|reader| AreaFile::read(facts, reader));
    }
}

declare_table! {
    /// Ranges of addresses with a limit of their own. No read crosses the edge of one. Rows are distinguished by `from`.
    AreaFile is "[[read.area]]" with facts: &FactReader<'_> {
        /// The table that the addresses are in.
        table: OptionalKey<DataTable> = optional(ValueKind::one_of(&TABLES)),
            or DataTable::Holding, without "`holding`";
        /// The first address.
        from: RequiredKey<u16> = required(ValueKind::address());
        /// The last address.
        to: RequiredKey<u16> = required(ValueKind::address());
        /// Most words or bits in one read.
        max_words: RequiredKey<u16> = required(read_words());
        origin: Option<Origin> = facts.sources();
    }
}

declare_table! {
    /// How writes behave.
    WriteFile is "[write]" with facts: &FactReader<'_> {
        /// What a refused write looks like.
        refused: FactFile<RefusedWrite> = facts.value(ValueKind::one_of(&REFUSED_WRITES));
        /// Neighbouring registers that one frame of function 10 hex may write, or with `table = "coil"` neighbouring coils for one
        /// of function 0F hex. If setpoint and run command are in it and the fact is proven, both are sent in one frame. Every
        /// register in it is writable.
        block: Option<FactFile<BlockFile>> =
            facts.optional_parts(|reader| BlockFile::keys(BLOCK_WORDS_MAX, reader)),
            without "one register in a frame";
    }
}

declare_table! {
    /// Consecutive registers: `{ address = 0x0101, count = 2 }`
    BlockFile is "write.block" with most: u16 {
        /// The table that it is in.
        table: OptionalKey<DataTable> = optional(ValueKind::one_of(&TABLES)),
            or DataTable::Holding, without "`holding`";
        /// The first register.
        address: RequiredKey<u16> = required(ValueKind::address());
        /// How many registers there are from it on.
        count: RequiredKey<u16> = required(ValueKind::number(1..=most));
    }
}

declare_table! {
    /// Exchanges after which no late reply to an earlier request can follow, best first. A row has exactly one of these keys.
    BarrierFile is "[[barrier]]" at location with facts: &FactReader<'_> {
        /// A read. It proves something if its length differs from that of the read whose reply is missing, so two of different
        /// lengths are better than one. All its registers are readable.
        read: OptionalKey<BlockFile> = table(|reader| BlockFile::read(READ_WORDS_MAX, reader));
        /// The drive answers function 08, subfunction 0, with the data of the request: `loop_test = { confidence = ..., source =
        /// ... }`. `functions` lists `0x08`.
        loop_test: Option<FactFile<()>> = facts.switch();
        /// A function that the drive does not serve and refuses with exception 01. It is tried before it is relied on.
        refused as "refused_function": Option<FactFile<u8>> = facts.optional_value(function_code());
    }
}

fn read_words() -> ValueKind<'static, u16> {
    ValueKind::number(1..=READ_WORDS_MAX)
}

impl ReadFile {
    /// `None` if any part is unusable.
    pub fn ready(&self) -> Option<ReadLimits> {
        let max_bytes = given(&self.max_bytes)?;
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
            max_words_ascii: given(&self.max_words_ascii)?,
            max_bytes,
            boundary: self.boundary.clone().optional()?,
            holes: given(&self.holes)?,
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

impl AreaFile {
    /// `None` if any part is unusable.
    fn ready(&self) -> Option<ReadArea> {
        Some(ReadArea {
            table: self.table()?,
            from: self.from.as_ref()?.value,
            to: self.to.as_ref()?.value,
            max_words: fact(self.max_words.as_ref()?.value, self.origin.as_ref())?,
        })
    }
}

impl WriteFile {
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

impl BlockFile {
    /// The first address; `None` if it is unusable.
    pub fn first(&self) -> Option<Address> {
        Some(Address::new(self.table()?, self.address.as_ref()?.value))
    }
}

/// A barrier by its form.
pub enum BarrierForm<'f> {
    Read(&'f BlockFile),
    LoopTest(&'f FactFile<()>),
    Refused(&'f FactFile<u8>),
}

impl BarrierFile {
    /// Reads a barrier, which has one form.
    pub(super) fn of(facts: &FactReader<'_>, mut reader: TableReader<'_, '_>) -> Self {
        let barrier = Self::keys(facts, &mut reader);
        let forms = [
            !matches!(barrier.read, OptionalKey::Absent),
            barrier.loop_test.is_some(),
            barrier.refused.is_some(),
        ];
        let what = match forms.iter().filter(|is_given| **is_given).count() {
            0 => Some("is not a barrier"),
            1 => None,
            _ => Some("has more than one form"),
        };
        if let Some(what) = what {
            let problem = barrier.location.problem(what);
            let right = "exactly one of `read`, `loop_test` and `refused_function`";
            reader.problems().push(problem.right(right));
        }
        reader.finish();
        barrier
    }

    /// Its form; `None` if it has no usable one.
    pub fn form(&self) -> Option<BarrierForm<'_>> {
        match (&self.read, &self.loop_test, &self.refused) {
            (OptionalKey::Valid(read), None, None) => Some(BarrierForm::Read(&read.value)),
            (OptionalKey::Absent, Some(fact), None) => Some(BarrierForm::LoopTest(fact)),
            (OptionalKey::Absent, None, Some(fact)) => Some(BarrierForm::Refused(fact)),
            _ => None,
        }
    }

    /// `None` if any part is unusable.
    pub(super) fn ready(&self) -> Option<Barrier> {
        Some(match self.form()? {
            BarrierForm::Read(block) => Barrier::Read(BarrierRead {
                address: block.first()?,
                count: block.count.as_ref()?.value,
            }),
            BarrierForm::LoopTest(fact) => Barrier::Loop(fact.ready()?),
            BarrierForm::Refused(function) => Barrier::Refused(function.ready()?),
        })
    }
}
