//! All tables of a model file as they are declared, for the reference of their keys.

use super::codes::CodesFile;
use super::commit::{CommitFile, CommitWordFile};
use super::documents::{DocumentFile, DocumentsFile};
use super::exchange::{
    AreaFile, BLOCK_WORDS_MAX, BarrierFile, BlockFile, READ_WORDS_MAX, ReadFile, WriteFile,
};
use super::facts::{FactReader, SourcesFile};
use super::link::{BroadcastFile, DefaultFile, LinkFile, StationsFile, TimingFile};
use super::orders::{DirectionFile, NeverFile, OrderFile};
use super::quirks::{AliasFile, QuirksFile};
use super::reset::ResetStepFile;
use super::run::RunFile;
use super::run_word::{BitFile, FieldFile};
use super::setup::{IdentityFile, SetupFile, WatchdogFile};
use super::start::{StartStepFile, UntilFile};
use super::state::StateFile;
use super::status::{CodeFile, ExceptionFile, StatusFile};
use super::{HeadFile, ModelFile};
use crate::profile::like::LikeFile;
use crate::profile::model::OrderKind;
use crate::profile::register::{
    FormFile, FullScaleFile, PartFile, RatioFile, RegisterFile, RegisterSource, ScaleByFile,
};
use crate::toml_file::declare::DeclaredTable;
use std::cell::RefCell;

/// The tables in the order of the reference. Those without brackets are shown in the table that has them.
pub fn declared() -> Vec<DeclaredTable> {
    let (second, without_document) = <(RefCell<_>, RefCell<_>)>::default();
    let facts = &FactReader {
        documents: None,
        model: None,
        defaults: false,
        second: &second,
        without_document: &without_document,
    };
    let file = ModelFile::declared(facts);
    let head = [HeadFile::declared().keys, LikeFile::declared().keys].concat();
    let outermost = DeclaredTable {
        keys: [head, file.keys].concat(),
        ..file
    };
    [
        vec![outermost],
        of_the_line(facts),
        of_orders(facts),
        of_states(facts),
        of_registers(facts),
    ]
    .concat()
}

fn of_the_line(facts: &FactReader<'_>) -> Vec<DeclaredTable> {
    vec![
        SourcesFile::declared(),
        DocumentsFile::declared(),
        DocumentFile::declared(),
        LinkFile::declared(facts),
        DefaultFile::declared(),
        StationsFile::declared(),
        BroadcastFile::declared(),
        TimingFile::declared(facts),
        ReadFile::declared(facts),
        AreaFile::declared(facts),
        WriteFile::declared(facts),
        BlockFile::declared(BLOCK_WORDS_MAX),
        ExceptionFile::declared(facts),
        BarrierFile::declared(facts),
        at("barrier.read", BlockFile::declared(READ_WORDS_MAX)),
        QuirksFile::declared(facts),
        AliasFile::declared(),
    ]
}

fn of_orders(facts: &FactReader<'_>) -> Vec<DeclaredTable> {
    vec![
        RunFile::declared(facts),
        at("run.stop", OrderFile::declared(OrderKind::Stop)),
        at("run.forward", OrderFile::declared(OrderKind::Forward)),
        at("run.reverse", OrderFile::declared(OrderKind::Reverse)),
        at("run.coast", OrderFile::declared(OrderKind::Coast)),
        at("run.reset", OrderFile::declared(OrderKind::Reset)),
        at("run.release", OrderFile::declared(OrderKind::Release)),
        ResetStepFile::declared(),
        DirectionFile::declared(),
        NeverFile::declared(facts),
        BitFile::declared(facts),
        FieldFile::declared(facts),
        StartStepFile::declared(facts),
        UntilFile::declared(),
        StateFile::declared(facts),
        SetupFile::declared(facts),
        IdentityFile::declared(facts),
        WatchdogFile::declared(facts),
    ]
}

fn of_states(facts: &FactReader<'_>) -> Vec<DeclaredTable> {
    let says =
        "The vendor's texts for warnings, as `[[trip]]`. A warning is shown and does nothing else.";
    let warnings = DeclaredTable {
        says: says.to_owned(),
        ..CodeFile::declared(facts)
    };
    vec![
        CommitFile::declared(facts),
        CommitWordFile::declared(facts),
        at("commit.store", CommitWordFile::declared(facts)),
        StatusFile::declared(facts),
        CodeFile::declared(facts),
        at("[[warning]]", warnings),
        CodesFile::declared(facts),
    ]
}

fn of_registers(facts: &FactReader<'_>) -> Vec<DeclaredTable> {
    let register = RegisterFile::declared(&RegisterSource::Model { facts, rule: None });
    vec![
        DeclaredTable {
            keys: [register.keys, FormFile::declared().keys].concat(),
            ..register
        },
        RatioFile::declared(),
        FullScaleFile::declared(),
        ScaleByFile::declared(),
        PartFile::declared(),
        at("register.plus.scale", RatioFile::declared()),
    ]
}

/// `table`, at another place.
fn at(header: &'static str, table: DeclaredTable) -> DeclaredTable {
    DeclaredTable { header, ..table }
}

/// The words of this folder with their meanings.
pub fn meanings() -> Vec<Vec<(&'static str, String)>> {
    [super::run::meanings(), super::codes::meanings()].concat()
}
