//! A model file as written: each fact with its location, confidence and source, before any cross-checks. Each usable
//! part converts into its counterpart in the model.

mod codes;
mod commit;
mod documents;
mod exchange;
mod facts;
mod link;
mod orders;
mod quirks;
mod reset;
mod run;
mod run_word;
mod setup;
mod start;
mod state;
mod status;

pub(super) use codes::CodesFile;
pub(super) use commit::{CommitFile, CommitWordFile};
pub(super) use documents::DocumentsFile;
pub(super) use exchange::{BarrierFile, BarrierForm, BlockFile, ReadFile, WriteFile};
pub(super) use facts::{FactFile, Origin};
pub(super) use link::{LinkFile, TimingFile};
pub(super) use orders::PlacesFile;
pub(super) use quirks::{AliasFile, QuirksFile};
pub(super) use reset::ResetStepFile;
pub(super) use run::{FormWord, RunFile};
pub(super) use run_word::FieldFile;
pub(super) use setup::{IdentityFile, SetupFile, WatchdogFile};
pub(super) use start::StartStepFile;
pub(super) use status::{CodeFile, StatusFile};

use super::like::LikeFile;
use super::model::{
    DriveQuirks, Model, ModelIdentity, ModelWatchdog, PollClass, Register, SecondSource, SetupItem,
};
use super::register::RegisterFile;
use crate::domain::problem::Problem;
use crate::toml_file::values::ValueKind;
use crate::toml_file::{LocatedValue, OptionalKey, RequiredKey, TableReader, TomlSection};
use facts::FactReader;
use std::cell::RefCell;

/// A model file.
pub(super) struct ModelFile {
    pub id: RequiredKey<String>,
    vendor: RequiredKey<String>,
    title: RequiredKey<String>,
    documents: Option<DocumentsFile>,
    second: Vec<SecondSource>,
    pub link: Option<LinkFile>,
    pub timing: Option<TimingFile>,
    pub functions: FactFile<Vec<u8>>,
    pub read: Option<ReadFile>,
    pub write: Option<WriteFile>,
    pub exceptions: Vec<CodeFile>,
    pub quirks: OptionalKey<QuirksFile>,
    pub barriers: Vec<BarrierFile>,
    pub run: OptionalKey<RunFile>,
    pub status: Vec<StatusFile>,
    pub trips: Vec<CodeFile>,
    pub warnings: Vec<CodeFile>,
    pub commit: OptionalKey<CommitFile>,
    pub setup: Vec<SetupFile>,
    pub identity: OptionalKey<IdentityFile>,
    pub watchdog: OptionalKey<WatchdogFile>,
    pub codes: OptionalKey<CodesFile>,
    pub registers: Vec<RegisterFile>,
}

impl ModelFile {
    /// Reads the outermost table of a model file.
    pub fn read(section: TomlSection<'_>, problems: &mut Vec<Problem>) -> Self {
        let mut reader = TableReader::new(section, problems);
        let documents = reader
            .required_table("documents")
            .map(|it| DocumentsFile::read(reader.open(it)));
        let id = reader.required(
            "id",
            &ValueKind::parsed(
                "`vendor-model`: a to z and 0 to 9 between single dashes",
                id,
            ),
        );
        let of = id.as_ref().map(|id| id.value.clone());
        // They are known keys; `like::Whole` has applied them and taken them out.
        LikeFile::read(&mut reader);
        let second = RefCell::new(Vec::new());
        let without_document = RefCell::new(Vec::new());
        let proven = &FactReader {
            documents: documents.as_ref(),
            model: of.as_deref(),
            defaults: false,
            second: &second,
            without_document: &without_document,
        };
        let chosen = &FactReader {
            defaults: true,
            ..*proven
        };
        let codes = given(&mut reader, "codes", proven, CodesFile::read);
        let rule = codes.valid().and_then(|codes| codes.value.ready());
        let file = Self {
            id,
            vendor: reader.required("vendor", &ValueKind::text()),
            title: reader.required("title", &ValueKind::text()),
            link: needed(&mut reader, "link", proven, LinkFile::read),
            timing: needed(&mut reader, "timing", chosen, TimingFile::read),
            functions: proven.list(&mut reader, "functions", &ValueKind::number(1..=127_u8)),
            read: needed(&mut reader, "read", proven, ReadFile::read),
            write: needed(&mut reader, "write", proven, WriteFile::read),
            exceptions: all(&mut reader, "exception", proven, CodeFile::read_exception),
            quirks: given(&mut reader, "quirks", proven, QuirksFile::read),
            barriers: all(&mut reader, "barrier", proven, BarrierFile::read),
            run: given(&mut reader, "run", proven, RunFile::read),
            status: all(&mut reader, "status", proven, StatusFile::read),
            trips: all(&mut reader, "trip", proven, CodeFile::read_code_or_bit),
            warnings: all(&mut reader, "warning", proven, CodeFile::read_code_or_bit),
            commit: given(&mut reader, "commit", proven, CommitFile::read),
            setup: all(&mut reader, "setup", proven, SetupFile::read),
            identity: given(&mut reader, "identity", proven, IdentityFile::read),
            watchdog: given(&mut reader, "watchdog", proven, WatchdogFile::read),
            codes,
            registers: all(&mut reader, "register", proven, |proven, mut reader| {
                let origin = proven.origin(&mut reader);
                RegisterFile::of_model(reader, origin, rule.as_ref())
            }),
            // After everything that has sources.
            second: second.take(),
            documents,
        };
        reader.finish();
        if let (Some(id), Some(documents)) = (&file.id, &file.documents) {
            problems.extend(documents.without_document(id, without_document.take()));
        }
        file
    }

    /// The model; `None` if any part of the file is unusable.
    pub fn ready(&self) -> Option<Model> {
        let ready = self
            .registers
            .iter()
            .map(|it| it.register_among(&self.registers));
        let mut registers = ready.collect::<Option<Vec<_>>>()?;
        registers.sort_by_key(|register| register.address);
        let watchdog = made(&self.watchdog, |it| it.ready(&self.registers))?;
        let identity = made(&self.identity, |it| it.ready(&self.registers))?;
        let setup = each(&self.setup, |it| it.ready(&self.registers))?;
        for register in &mut registers {
            poll_watchdog(watchdog.as_ref(), register);
            poll_what_orders_need(&setup, identity.as_ref(), register);
        }
        poll_bases(&mut registers);
        let mut run = made(&self.run, |it| it.ready(&self.registers))?;
        run.iter_mut()
            .for_each(|run| orders::bind(run, &mut registers));
        for state in run.iter().flat_map(|run| &run.states) {
            let shown = registers
                .iter_mut()
                .find(|it| it.address == state.address && it.poll.is_some());
            shown
                .into_iter()
                .for_each(|register| register.states.push(state.masked()));
        }
        Some(Model {
            id: self.id.as_ref()?.value.clone(),
            vendor: self.vendor.as_ref()?.value.clone(),
            title: self.title.as_ref()?.value.clone(),
            documents: self.documents.as_ref()?.ready()?,
            second_sources: self.second.clone(),
            link: self.link.as_ref()?.ready()?,
            timing: self.timing.as_ref()?.ready()?,
            functions: self.functions.ready()?,
            read: self.read.as_ref()?.ready()?,
            write: self.write.as_ref()?.ready()?,
            exceptions: each(&self.exceptions, CodeFile::ready)?,
            exception_kinds: self
                .exceptions
                .iter()
                .filter_map(CodeFile::ready_kind)
                .collect(),
            quirks: made(&self.quirks, QuirksFile::ready)?.unwrap_or_else(DriveQuirks::default),
            barriers: each(&self.barriers, BarrierFile::ready)?,
            run,
            status: each(&self.status, |it| it.ready(self))?,
            trip_codes: each(&self.trips, CodeFile::ready)?,
            warning_codes: each(&self.warnings, CodeFile::ready)?,
            commit: made(&self.commit, |it| it.ready(&self.registers))?.unwrap_or_default(),
            setup,
            identity,
            watchdog,
            codes: made(&self.codes, CodesFile::ready)?,
            registers,
            digest: 0,
        })
    }
}

/// The settings of the drive's own watchdog are polled at least once a minute.
fn poll_watchdog(watchdog: Option<&ModelWatchdog>, register: &mut Register) {
    let is_part =
        |it: &ModelWatchdog| it.time == register.address || it.action == Some(register.address);
    if watchdog.is_some_and(is_part) && matches!(register.poll, None | Some(PollClass::Hourly)) {
        register.poll = Some(PollClass::Minutely);
    }
}

/// The settings on which orders rest are polled at least once a minute, so that a wrong one is shown before an order is
/// refused; the drive's identity is polled every hour.
fn poll_what_orders_need(
    setup: &[SetupItem],
    identity: Option<&ModelIdentity>,
    register: &mut Register,
) {
    let is_needed =
        |item: &SetupItem| item.address == Some(register.address) && !item.needed_for.is_empty();
    if setup.iter().any(is_needed) && matches!(register.poll, None | Some(PollClass::Hourly)) {
        register.poll = Some(PollClass::Minutely);
    }
    if identity.is_some_and(|identity| identity.address == register.address) {
        register.poll = Some(register.poll.unwrap_or(PollClass::Hourly));
    }
}

/// What a value depends on is polled with the slow ones: it may be changed at the drive.
fn poll_bases(registers: &mut [Register]) {
    let bases: Vec<_> = registers
        .iter()
        .flat_map(|register| register.form.bases())
        .collect();
    for register in registers
        .iter_mut()
        .filter(|it| it.access.can_read() && bases.contains(&it.address))
    {
        if matches!(
            register.poll,
            None | Some(PollClass::Minutely | PollClass::Hourly)
        ) {
            register.poll = Some(PollClass::Slow);
        }
    }
}

/// The required table `key`, read by `read`.
fn needed<T>(
    reader: &mut TableReader<'_, '_>,
    key: &'static str,
    facts: &FactReader<'_>,
    read: impl FnOnce(&FactReader<'_>, TableReader<'_, '_>) -> T,
) -> Option<T> {
    reader
        .required_table(key)
        .map(|it| read(facts, reader.open(it)))
}

/// The optional table `key`, read by `read`.
fn given<T>(
    reader: &mut TableReader<'_, '_>,
    key: &'static str,
    facts: &FactReader<'_>,
    read: impl FnOnce(&FactReader<'_>, TableReader<'_, '_>) -> T,
) -> OptionalKey<T> {
    match reader.table(key) {
        OptionalKey::Absent => OptionalKey::Absent,
        OptionalKey::Invalid => OptionalKey::Invalid,
        OptionalKey::Valid(LocatedValue { value, location }) => OptionalKey::Valid(LocatedValue {
            value: read(facts, reader.open(value)),
            location,
        }),
    }
}

/// The tables `[[key]]`, each read by `read`.
fn all<T>(
    reader: &mut TableReader<'_, '_>,
    key: &'static str,
    facts: &FactReader<'_>,
    read: impl Fn(&FactReader<'_>, TableReader<'_, '_>) -> T,
) -> Vec<T> {
    reader
        .tables(key)
        .into_iter()
        .map(|section| read(facts, reader.open(section)))
        .collect()
}

/// `Some(None)` if the table is left out; `None` if it is unusable.
fn made<T, U>(given: &OptionalKey<T>, make: impl FnOnce(&T) -> Option<U>) -> Option<Option<U>> {
    match given {
        OptionalKey::Absent => Some(None),
        OptionalKey::Invalid => None,
        OptionalKey::Valid(written) => make(&written.value).map(Some),
    }
}

fn each<T, U>(parts: &[T], make: impl Fn(&T) -> Option<U>) -> Option<Vec<U>> {
    parts.iter().map(make).collect()
}

fn id(text: &str) -> Option<String> {
    let part = |part: &str| {
        !part.is_empty()
            && part
                .bytes()
                .all(|b| b.is_ascii_lowercase() || b.is_ascii_digit())
    };
    (text.contains('-') && text.len() <= 64 && text.split('-').all(part)).then(|| text.to_owned())
}
