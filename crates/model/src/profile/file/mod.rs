//! A model file as written: each fact with its location, confidence and source, before any cross-checks. Each usable
//! part converts into its counterpart in the model.

mod codes;
mod commit;
#[cfg(test)]
mod declared;
mod documents;
mod exchange;
mod facts;
mod kinds;
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
#[cfg(test)]
pub(super) use declared::{declared, meanings};
pub(super) use documents::DocumentsFile;
pub(super) use exchange::{BarrierFile, BarrierForm, BlockFile, ReadFile, WriteFile};
pub(super) use facts::{FactFile, FactReader, Origin};
pub(super) use link::{LinkFile, TimingFile};
pub(super) use quirks::{AliasFile, QuirksFile};
pub(super) use reset::ResetStepFile;
pub(super) use run::{FormWord, RunFile};
pub(super) use run_word::FieldFile;
pub(super) use setup::{IdentityFile, SetupFile, WatchdogFile};
pub(super) use start::StartStepFile;
pub(super) use status::{CodeFile, ExceptionFile, StatusFile};

use super::like::LikeFile;
use super::model::{
    DriveQuirks, Model, ModelDocument, ModelIdentity, ModelWatchdog, PollClass, Register,
    SecondSource, SetupItem,
};
use super::register::{RegisterFile, RegisterSource};
use crate::domain::problem::Problem;
use crate::toml_file::declare::{KeyForm, declare_table, required, required_table, table, tables};
use crate::toml_file::values::ValueKind;
use crate::toml_file::{OptionalKey, RequiredKey, TableReader, TomlSection};
use kinds::function_code;
use std::cell::RefCell;

declare_table! {
    /// What is known before facts are read: the documents that they cite, and of which model they are.
    HeadFile is "" {
        documents: Option<DocumentsFile> = required_table(DocumentsFile::read);
        /// The name of the model, `vendor-model`; what `model = ` says in a configuration.
        id: RequiredKey<String> = required(ValueKind::parsed(
            "`vendor-model`: a to z and 0 to 9 between single dashes",
            id,
        ));
    }
}

declare_table! {
    /// These keys come before the first table.
    ModelFile is "" with facts: &FactReader<'_> {
        codes: OptionalKey<CodesFile> = table(|reader| CodesFile::of(facts, reader));
        /// The maker's name.
        vendor: RequiredKey<String> = required(ValueKind::text());
        /// The product's name.
        title: RequiredKey<String> = required(ValueKind::text());
        link: Option<LinkFile> = required_table(|reader| LinkFile::read(facts, reader));
        timing: Option<TimingFile> =
            required_table(|reader| TimingFile::read(&facts.with_defaults(), reader));
        /// The function codes that the drive serves, in decimal or as `0x10`.
        functions: FactFile<Vec<u8>> = facts.list(function_code());
        read: Option<ReadFile> = required_table(|reader| ReadFile::read(facts, reader));
        write: Option<WriteFile> = required_table(|reader| WriteFile::read(facts, reader));
        exceptions as "exception": Vec<ExceptionFile> =
            tables(|reader| ExceptionFile::read(facts, reader));
        quirks: OptionalKey<QuirksFile> = table(|reader| QuirksFile::read(facts, reader));
        barriers as "barrier": Vec<BarrierFile> = tables(|reader| BarrierFile::of(facts, reader));
        run: OptionalKey<RunFile> = table(|reader| RunFile::read(facts, reader));
        status: Vec<StatusFile> = tables(|reader| StatusFile::read(facts, reader));
        trips as "trip": Vec<CodeFile> = tables(|reader| CodeFile::read(facts, reader));
        warnings as "warning": Vec<CodeFile> = tables(|reader| CodeFile::read(facts, reader));
        commit: OptionalKey<CommitFile> = table(|reader| CommitFile::read(facts, reader));
        setup: Vec<SetupFile> = tables(|reader| SetupFile::read(facts, reader));
        identity: OptionalKey<IdentityFile> = table(|reader| IdentityFile::read(facts, reader));
        watchdog: OptionalKey<WatchdogFile> = table(|reader| WatchdogFile::read(facts, reader));
        registers as "register" after codes: Vec<RegisterFile> = registers(facts, codes);
    }
}

/// `[[register]]`, whose addresses may follow from `codes`.
fn registers<'k>(
    facts: &'k FactReader<'_>,
    codes: &OptionalKey<CodesFile>,
) -> KeyForm<'k, Vec<RegisterFile>> {
    let rule = codes.valid().and_then(|codes| codes.value.ready());
    tables(move |reader| {
        let rule = rule.as_ref();
        RegisterFile::of(&RegisterSource::Model { facts, rule }, reader)
    })
}

/// A model file with what its facts rest on.
pub(super) struct WrittenModel {
    pub head: HeadFile,
    second: Vec<SecondSource>,
    pub file: ModelFile,
}

impl WrittenModel {
    /// Reads the outermost table of a model file.
    pub fn read(section: TomlSection<'_>, problems: &mut Vec<Problem>) -> Self {
        let mut reader = TableReader::new(section, problems);
        let head = HeadFile::keys(&mut reader);
        // They are known keys; `like::WholeFile` has applied them and taken them out.
        LikeFile::keys(&mut reader);
        let (second, without_document) = <(RefCell<_>, RefCell<_>)>::default();
        let facts = FactReader {
            documents: head.documents.as_ref(),
            model: head.id.as_ref().map(|id| id.value.as_str()),
            defaults: false,
            second: &second,
            without_document: &without_document,
        };
        let file = ModelFile::read(&facts, reader);
        if let (Some(id), Some(documents)) = (&head.id, &head.documents) {
            problems.extend(documents.without_document(id, without_document.take()));
        }
        Self {
            second: second.take(),
            head,
            file,
        }
    }

    /// The model; `None` if any part of the file is unusable.
    pub fn ready(&self) -> Option<Model> {
        self.file.ready(
            self.head.id.as_ref()?.value.clone(),
            self.head.documents.as_ref()?.ready()?,
            self.second.clone(),
        )
    }
}

impl ModelFile {
    /// The model `id`, which rests on `documents`; `None` if any part of the file is unusable.
    fn ready(
        &self,
        id: String,
        documents: Vec<ModelDocument>,
        second_sources: Vec<SecondSource>,
    ) -> Option<Model> {
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
            id,
            vendor: self.vendor.as_ref()?.value.clone(),
            title: self.title.as_ref()?.value.clone(),
            documents,
            second_sources,
            link: self.link.as_ref()?.ready()?,
            timing: self.timing.as_ref()?.ready()?,
            functions: self.functions.ready()?,
            read: self.read.as_ref()?.ready()?,
            write: self.write.as_ref()?.ready()?,
            exceptions: each(&self.exceptions, ExceptionFile::ready)?,
            exception_kinds: self
                .exceptions
                .iter()
                .filter_map(ExceptionFile::ready_kind)
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
