//! The built-in models against what their documents say, typed a second time, and against every frame that is known.

mod evidence;
mod frames;
mod frecon;
mod n100plus;
mod n700;
mod stop_bits;
mod tables;
mod teco;
mod toshiba;

use super::texts;
use crate::domain::address::Address;
use crate::domain::control::ControlAction;
use crate::domain::link::{Framing, Interface, LinkSettings, Parity};
use crate::domain::units::UnitOfMeasure;
use crate::profile::catalog::Catalog;
use crate::profile::model::{
    Barrier, BarrierRead, CodeText, Confidence, Fact, IndicatedState, Model, PollClass, Register,
    RegisterAccess, RegisterMemory, RegisterRole, RunForm,
};
use crate::profile::summary::summary;
use std::ops::RangeInclusive;
use std::sync::{Arc, LazyLock};
use std::time::Duration;

const NOTHING: [u16; 0] = [];

/// Read once: every frame looks for its model.
static CATALOG: LazyLock<Catalog> = LazyLock::new(super::catalog);

fn model(id: &str) -> Arc<Model> {
    CATALOG.find(id).unwrap().clone()
}

fn parts<T: Clone>(fact: &Fact<T>) -> (T, Confidence) {
    (fact.value.clone(), fact.confidence)
}

fn maybe<T: Clone>(fact: Option<&Fact<T>>) -> Option<(T, Confidence)> {
    fact.map(parts)
}

const fn ms(count: u64) -> Duration {
    Duration::from_millis(count)
}

/// Address, code, scale, unit, access and confidence of a register.
type Row = (
    u16,
    Option<&'static str>,
    u32,
    UnitOfMeasure,
    RegisterAccess,
    Confidence,
);

#[track_caller]
fn assert_registers(model: &Model, rows: &[Row]) {
    let row = |it: &Register| {
        (
            it.address.number(),
            it.code.clone(),
            it.scale,
            it.unit,
            it.access,
            it.confidence,
        )
    };
    let found: Vec<_> = model.registers.iter().map(row).collect();
    let expected: Vec<_> = rows
        .iter()
        .map(|it| (it.0, it.1.map(str::to_owned), it.2, it.3, it.4, it.5))
        .collect();
    for (found, expected) in found.iter().zip(&expected) {
        assert_eq!(found, expected);
    }
    assert_eq!(found.len(), expected.len());
}

/// Where each role is; a role that several registers have comes several times.
fn roles(model: &Model) -> Vec<(RegisterRole, u16)> {
    let mut roles: Vec<_> = model
        .registers
        .iter()
        .filter_map(|it| Some((it.role?, it.address.number())))
        .collect();
    roles.sort_unstable();
    roles
}

#[track_caller]
fn assert_roles(model: &Model, expected: &[(RegisterRole, u16)]) {
    let mut expected = expected.to_vec();
    expected.sort_unstable();
    assert_eq!(roles(model), expected);
}

/// The addresses of the registers for which `is` holds.
fn addresses(model: &Model, is: impl Fn(&Register) -> bool) -> Vec<u16> {
    model
        .registers
        .iter()
        .filter(|register| is(register))
        .map(|register| register.address.number())
        .collect()
}

fn polled(model: &Model, class: PollClass) -> Vec<u16> {
    addresses(model, |register| register.poll == Some(class))
}

fn back_doors(model: &Model) -> Vec<u16> {
    addresses(model, |register| register.back_door.is_some())
}

fn in_memory(model: &Model, memory: RegisterMemory) -> Vec<u16> {
    addresses(model, |register| register.memory == Some(memory))
}

fn signed(model: &Model) -> Vec<u16> {
    addresses(model, |register| register.signed)
}

fn ranges(model: &Model) -> Vec<(u16, RangeInclusive<i32>)> {
    model
        .registers
        .iter()
        .filter_map(|it| Some((it.address.number(), it.range.clone()?)))
        .collect()
}

/// What the words of the register at `address` mean.
fn meanings(model: &Model, address: u16) -> Vec<(u16, &str)> {
    let mut meanings: Vec<_> = model
        .register_at(address)
        .unwrap()
        .meanings
        .iter()
        .map(|(code, text)| (*code, text.as_str()))
        .collect();
    meanings.sort_unstable();
    meanings
}

/// Flag, register, mask, values and confidence.
type StatusRow = (IndicatedState, u16, u16, Vec<u16>, Confidence);

fn status(model: &Model) -> Vec<StatusRow> {
    model
        .status
        .iter()
        .map(|it| {
            (
                it.flag,
                it.address.number(),
                it.mask,
                it.values.clone(),
                it.confidence,
            )
        })
        .collect()
}

fn codes(texts: &[CodeText]) -> Vec<u16> {
    texts.iter().map(|text| text.code).collect()
}

/// Set-up in its order: what is set, where, the right words and how sure that is.
fn setup(model: &Model) -> Vec<(&str, Option<u16>, &[u16], Confidence)> {
    model
        .setup
        .iter()
        .map(|it| {
            (
                it.what.as_str(),
                it.address.map(Address::number),
                &it.values.value[..],
                it.values.confidence,
            )
        })
        .collect()
}

/// Stop, forward, reverse, coast, reset, release.
type RunWords = [Option<(u16, Confidence)>; 6];

fn run_words(model: &Model) -> RunWords {
    let run = model.run.as_ref().unwrap();
    [
        Some(&run.stop),
        Some(&run.forward),
        run.reverse.as_ref(),
        run.coast.as_ref(),
        run.reset.as_ref(),
        run.release.as_ref(),
    ]
    .map(maybe)
}

fn barrier_read(address: u16, count: u16) -> Barrier {
    Barrier::Read(BarrierRead {
        address: address.into(),
        count,
    })
}

#[test]
fn run_state_and_trips_are_in_the_fast_class_of_every_model() {
    for model in CATALOG.models() {
        let class = |register: &Register| register.poll;
        let output = model.register_for(RegisterRole::OutputFrequency);
        // What a drive that takes orders does must be seen.
        let is_seen = output.map_or(model.run.is_none(), |it| class(it) == Some(PollClass::Fast));
        assert!(is_seen, "{}", model.id);
        for flag in [
            IndicatedState::Running,
            IndicatedState::Stopping,
            IndicatedState::Reverse,
            IndicatedState::Tripped,
        ] {
            let register = model
                .status_flag(flag)
                .map(|flag| model.readable_at(flag.address).unwrap());
            assert!(
                register.is_none_or(|it| class(it) == Some(PollClass::Fast)),
                "{} {flag:?}",
                model.id
            );
        }
        let Some(trip) = model.trip_register() else {
            continue;
        };
        let wanted = if trip.role == Some(RegisterRole::TripCount) {
            PollClass::Second
        } else {
            PollClass::Fast
        };
        assert_eq!(class(trip), Some(wanted), "{}: {}", model.id, trip.name);
    }
}

#[test]
fn every_file_is_sound_and_named_after_its_model() {
    let all = Catalog::from_texts(texts().iter().copied()).unwrap_or_else(|problems| {
        let text = |file: &str| texts().iter().find(|(name, _)| *name == file).unwrap().1;
        let lines = problems.iter().map(|(file, it)| {
            format!(
                "{file}:{}: {}: {}; right: {:?}",
                it.place_in(text(file)).0,
                it.key,
                it.what,
                it.right
            )
        });
        panic!("{}", lines.collect::<Vec<_>>().join("\n"))
    });
    assert_eq!(
        all.ids().collect::<Vec<_>>(),
        CATALOG.ids().collect::<Vec<_>>()
    );
    assert!(CATALOG.ids().all(|id| CATALOG.find(id) == all.find(id)));
}

#[test]
fn every_summary_is_as_it_was_reviewed() {
    for id in CATALOG.ids() {
        let found = summary(&model(id));
        let path = format!(
            "{}/../../tests/golden/models/{id}.txt",
            env!("CARGO_MANIFEST_DIR")
        );
        if std::env::var_os("UPDATE_GOLDEN").is_some() {
            std::fs::write(&path, &found).unwrap();
        }
        assert_eq!(found, std::fs::read_to_string(&path).unwrap(), "{path}");
    }
}

#[test]
fn every_file_of_the_folders_is_built_in() {
    let folder = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("src/vendors");
    let inside = |path: std::path::PathBuf| {
        std::fs::read_dir(path)
            .into_iter()
            .flatten()
            .map(|it| it.unwrap().path())
    };
    let files = inside(folder.clone())
        .flat_map(inside)
        .filter(|path| path.extension().is_some_and(|it| it == "toml"));
    let mut files: Vec<_> = files
        .map(|path| path.strip_prefix(&folder).unwrap().display().to_string())
        .collect();
    let mut built_in: Vec<_> = texts().iter().map(|(file, _)| *file).collect();
    files.sort_unstable();
    built_in.sort_unstable();
    assert_eq!(files, built_in);
}

#[test]
fn what_stop_forward_and_setpoint_rest_on_is_proven_or_has_to_be_accepted() {
    for (id, unproven) in [
        ("frecon-fr500a", &[][..]),
        ("hyundai-n100plus", &[]),
        ("hyundai-n700", &[]),
        ("teco-e510", &["stop"]),
        (
            "teco-e510s",
            &["stop", "forward", "the run command's register"],
        ),
        ("toshiba-vf-as1", &["stop"]),
        ("toshiba-vf-s15", &["stop"]),
    ] {
        let model = model(id);
        let found: Vec<_> = model
            .unproven_basics()
            .iter()
            .map(|basic| basic.what)
            .collect();
        assert_eq!(found, unproven, "{id}");
        assert_eq!(model.may_be_ordered(&[]), unproven.is_empty(), "{id}");
        assert!(model.may_be_ordered(&[ControlAction::Basic]), "{id}");
    }
}

#[test]
fn no_jog_is_ever_a_command() {
    for id in CATALOG.ids() {
        let model = model(id);
        let Some(run) = &model.run else { continue };
        let RunForm::Bits { bits, .. } = &run.form else {
            continue;
        };
        let dangerous = bits.iter().filter(|bit| {
            use crate::profile::model::BitMeaning::{Jog, Other, Trip};
            matches!(bit.meaning, Jog | Other | Trip)
        });
        for bit in dangerous {
            for (word, _) in run_words(&model).into_iter().flatten() {
                let holds = (word & 1 << bit.bit.value != 0) != bit.is_inverted;
                assert!(!holds, "{id}: {word:04X} has bit {}", bit.bit.value);
            }
        }
    }
}
