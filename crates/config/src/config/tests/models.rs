//! What a configuration may say hangs on the form and the quirks of its models; and models of the operator's own.

use super::*;
use crate::config::qualified::QualifiedStanding;
use crate::domain::address::Address;
use crate::domain::units::UnitOfMeasure;
use crate::drive::description::DriveRatings;
use crate::profile::model::{
    Confidence, Fact, Model, RegisterAccess, RegisterMemory, RegisterRole,
};

const AT: &str = "line[0].drive[0]";

fn proven<T>(value: T) -> Fact<T> {
    fact(value, Confidence::Manual)
}

fn fact<T>(value: T, confidence: Confidence) -> Fact<T> {
    Fact {
        value,
        confidence,
        source: "IM 9".to_owned(),
    }
}

/// A controlled model, changed by `change`.
fn model(change: impl FnOnce(&mut Model)) -> Model {
    let mut model = Model::clone(catalog().find("acme-two").unwrap());
    change(&mut model);
    model
}

/// What is settled for the drive of `CONTROLLED` with `from` replaced by `to`, if its model is `model`.
fn settled(
    model: &Model,
    from: &str,
    to: &str,
) -> Result<(DriveRatings, Vec<u16>, bool), Vec<String>> {
    let text = with(&with(CONTROLLED, "[\"F007\"]", "[]"), from, to);
    let mut problems = Vec::new();
    let file = ConfigFile::read(&text, &mut problems).unwrap();
    let (line, drive) = (&file.lines[0], &file.lines[0].drives[0]);
    let defaults = crate::config::file::MqttDefaults::default();
    let control = crate::config::control::settle(
        (line, drive),
        Some(model),
        defaults,
        &QualifiedStanding::Never,
        &mut problems,
    );
    let ratings = ratings::settle(drive, Some(model), &mut problems);
    if problems.is_empty() {
        let control = control.flatten().unwrap();
        return Ok((
            ratings.unwrap(),
            control.native_write.clone(),
            control.allow_release,
        ));
    }
    Err(problems
        .iter()
        .map(|it| {
            format!(
                "{}: {}; {}",
                it.key,
                it.what,
                it.right.as_deref().unwrap_or("-")
            )
        })
        .collect())
}

/// A model that reports its current in percent of the rated one.
fn in_per_cent() -> Model {
    model(|it| {
        it.quirks.percent_of_rated = Some(proven(()));
        let output = it
            .registers
            .iter_mut()
            .find(|it| it.role == Some(RegisterRole::OutputFrequency))
            .unwrap();
        let mut current = output.clone();
        current.role = Some(RegisterRole::OutputCurrent);
        current.unit = UnitOfMeasure::Percent;
        current.address = 0x0102_u16.into();
        current.name = "output_current".to_owned();
        it.registers.push(current);
    })
}

#[test]
fn rated_values_are_for_models_that_report_in_per_cent_of_them() {
    let rated = |model: &Model, lines: &str| {
        settled(model, "station = 1\n", &format!("station = 1\n{lines}\n"))
            .map(|(ratings, ..)| ratings)
    };
    let model = in_per_cent();
    assert_eq!(
        rated(&model, "rated_current_a = 12.345"),
        Ok(DriveRatings {
            current_ma: Some(12_345),
            voltage_mv: None
        })
    );
    assert_eq!(
        rated(&model, "rated_current_a = 100000")
            .unwrap()
            .current_ma,
        Some(100_000_000)
    );
    assert_eq!(rated(&model, ""), Ok(DriveRatings::default()));
    for (line, problem) in [
        (
            "rated_current_a = 0",
            "rated_current_a: 0 is out of range; a number from 0.001 to 100000",
        ),
        (
            "rated_current_a = 100000.1",
            "rated_current_a: 100000.1 is out of range; a number from 0.001 to 100000",
        ),
        (
            "rated_current_a = 1.0005",
            "rated_current_a: 1.0005 is finer than 0.001; at most three decimals",
        ),
        (
            "rated_voltage_v = 400",
            "rated_voltage_v: has no effect: acme-two reports no voltage in percent of the rated one; leave it out",
        ),
    ] {
        assert_eq!(
            rated(&model, line),
            Err(vec![format!("{AT}.{problem}")]),
            "{line}"
        );
    }
    only(
        &drive_with("rated_current_a = 12.5"),
        &format!(
            "{AT}.rated_current_a: has no effect: hyundai-n700 reports no current in percent of the rated one; \
             leave it out"
        ),
    );
}

#[test]
fn what_stays_in_per_cent_is_known_with_the_key_that_changes_it() {
    let missing = |ratings| shown_in_per_cent(&in_per_cent(), &ratings).collect::<Vec<_>>();
    assert_eq!(
        missing(DriveRatings::default()),
        [("current", "rated_current_a")]
    );
    assert_eq!(
        missing(DriveRatings {
            current_ma: Some(1),
            voltage_mv: None
        }),
        []
    );
    assert_eq!(
        shown_in_per_cent(&model(|_| {}), &DriveRatings::default()).count(),
        0
    );
}

#[test]
fn control_is_handed_back_only_where_the_model_can_and_the_operator_wants_it() {
    let release = |model: &Model, lines: &str| {
        let lines = format!("on_shutdown = \"hold\"\n{lines}\n");
        settled(model, "on_shutdown = \"hold\"\n", &lines).map(|(.., release)| release)
    };
    let with_release =
        |confidence| model(|it| it.run.as_mut().unwrap().release = Some(fact(0, confidence)));
    let sure = with_release(Confidence::Manual);
    let unsure = with_release(Confidence::Sibling);
    assert_eq!(release(&sure, ""), Ok(false));
    assert_eq!(release(&sure, "allow_release = true"), Ok(true));
    assert_eq!(
        release(
            &unsure,
            "allow_release = true\naccept_unverified = ['release']"
        ),
        Ok(true)
    );
    assert_eq!(release(&model(|_| {}), "allow_release = false"), Ok(false));
    for (model, lines, problem) in [
        (
            &model(|_| {}),
            "allow_release = true",
            "allow_release: acme-two has no release; leave it out",
        ),
        (
            &unsure,
            "allow_release = true",
            "allow_release: release is unproven for acme-two (sibling); \
             leave it out, or accept_unverified = [\"release\"] once you have seen it work",
        ),
        (
            &unsure,
            "accept_unverified = ['release']",
            "accept_unverified[0]: `allow_release` is not true, so there is nothing to accept; leave it out",
        ),
        (
            &sure,
            "allow_release = true\naccept_unverified = ['release']",
            "accept_unverified[0]: release is proven for acme-two (manual), so there is nothing to accept; leave it out",
        ),
    ] {
        assert_eq!(
            release(model, lines),
            Err(vec![format!("{AT}.control.{problem}")]),
            "{lines}"
        );
    }
}

#[test]
fn a_stop_that_nobody_sees_is_not_controlled() {
    let blind = model(|it| {
        it.registers
            .retain(|register| register.role != Some(RegisterRole::OutputFrequency))
    });
    let why = "acme-two cannot be controlled: its description has no output frequency that is polled, to see that a \
               stop takes effect; leave `control` out; the drive is then read-only";
    assert_eq!(
        settled(&blind, "station = 1", "station = 1"),
        Err(vec![format!("{AT}.control: {why}")])
    );
}

/// A model whose registers have stored twins: at 0x0100 a plain one, at 0x0102 a back door.
fn with_twins() -> Model {
    model(|it| {
        it.quirks.stored_alias_bit = Some(proven(15));
        let output = it
            .registers
            .iter()
            .find(|it| it.role == Some(RegisterRole::OutputFrequency))
            .unwrap()
            .clone();
        for (address, name, back_door) in [
            (0x0100, "plain", None),
            (0x0102, "door", Some("another way to run")),
        ] {
            let mut register = output.clone();
            register.address = Address::holding(address);
            (register.role, register.poll) = (None, None);
            (register.access, register.memory) =
                (RegisterAccess::ReadWrite, Some(RegisterMemory::Ram));
            (register.name, register.back_door) = (name.to_owned(), back_door.map(str::to_owned));
            it.registers.push(register);
        }
    })
}

#[test]
fn a_stored_twin_is_listed_by_its_own_address() {
    let writes = |model: &Model, list: &str| {
        settled(model, "write = []", &format!("write = {list}")).map(|(_, addresses, _)| addresses)
    };
    let twins = with_twins();
    assert_eq!(writes(&twins, "['plain']"), Ok(vec![0x0100]));
    assert_eq!(writes(&twins, "['0x8100']"), Ok(vec![0x8100]));
    assert_eq!(
        writes(&twins, "['0x8100', '0x0100']"),
        Ok(vec![0x8100, 0x0100])
    );
    let around = "takes commands; leave it out; `control` says what may be commanded, and each write \
                  there is reviewed as a command";
    for (list, problem) in [
        (
            "['0x8002']",
            format!("the stored twin of `run_command` {around}"),
        ),
        (
            "['0x8102']",
            "the stored twin of `door` is never written: another way to run; leave it out"
                .to_owned(),
        ),
        (
            "['door']",
            "`door` is never written: another way to run; leave it out".to_owned(),
        ),
        (
            "['0x8101']",
            "the stored twin of `output_frequency` cannot be written; \
             registers with the access \"write\" or \"read-write\""
                .to_owned(),
        ),
        (
            "['0x8103']",
            "acme-two has no register at `0x8103`; \
             the address of a register of the model, or of one added by `[[line.drive.register]]`"
                .to_owned(),
        ),
    ] {
        assert_eq!(
            writes(&twins, list),
            Err(vec![format!("{AT}.native.write[0]: {problem}")]),
            "{list}"
        );
    }
    let plain = model(|_| {});
    assert!(writes(&plain, "['0x8002']").unwrap_err()[0].contains("has no register at `0x8002`"));
}

#[test]
fn a_register_of_the_configuration_is_no_way_to_a_twin() {
    let mut twins = with_twins();
    let mut added = twins.register_at(0x0100).unwrap().clone();
    added.address = Address::holding(0x8002);
    added.name = "mine".to_owned();
    twins.registers.push(added);
    let found = settled(&twins, "write = []", "write = ['mine']").unwrap_err();
    assert!(
        found[0].contains("the stored twin of `run_command` takes commands"),
        "{found:?}"
    );
}

#[test]
fn directories_of_models_are_absolute_and_stand_once() {
    let gateway = |line: &str| {
        with(
            CONTROLLED,
            "name = \"plant-a\"\n",
            &format!("name = \"plant-a\"\n{line}\n"),
        )
    };
    let found = |line: &str| {
        let dirs = model_dirs(&gateway(line));
        dirs.iter()
            .map(|dir| (dir.location.key.clone(), dir.value.display().to_string()))
            .collect::<Vec<_>>()
    };
    let first = ("gateway.model_dirs[0]".to_owned(), "/etc/a".to_owned());
    assert_eq!(found("model_dirs = ['/etc/a']"), [first]);
    assert_eq!(found("model_dirs = ['/etc/a', 'b']"), []);
    assert_eq!(found(""), []);
    assert_eq!(model_dirs("[gateway"), []);
    good(&gateway("model_dirs = []"));
    good(&gateway("model_dirs = ['/etc/a', '/etc/b']"));
    only(
        &gateway("model_dirs = ['models']"),
        "gateway.model_dirs[0]: `models` is not valid; an absolute path",
    );
    only(
        &gateway("model_dirs = ['/etc/a', '/etc/a']"),
        "gateway.model_dirs[1]: the directory /etc/a is listed twice; each directory once",
    );
}

#[test]
fn a_model_that_may_stand_in_an_unread_file_is_not_called_unknown() {
    let text = with(&drive_with("poll = '1ms'"), "hyundai-n700", "acme-nine");
    let keys = |problems: Vec<Problem>| problems.into_iter().map(|it| it.key).collect::<Vec<_>>();
    assert_eq!(
        keys(problems_without_some_models(&text, &catalog())),
        ["line[0].drive[0].poll"]
    );
    assert_eq!(
        keys(load(&text, &catalog()).unwrap_err()),
        ["line[0].drive[0].model", "line[0].drive[0].poll"]
    );
    let relative = format!("[gateway]\nmodel_dirs = ['here']\n{text}");
    assert_eq!(
        keys(load(&relative, &catalog()).unwrap_err()),
        ["gateway.model_dirs[0]", "line[0].drive[0].poll"]
    );
    assert_eq!(problems_without_some_models(MINIMAL, &catalog()), []);
}

#[test]
fn a_missing_full_scale_names_the_drives_parameter_and_hides_no_other_problem() {
    let catalog = vendors::catalog();
    let scaled: Vec<_> = catalog
        .models()
        .filter(|model| model.needs_full_scale())
        .collect();
    assert!(scaled.len() > 8, "{}", scaled.len());
    for model in scaled {
        let text = with(CONTROLLED, "[line.drive.native]\nwrite = [\"F007\"]\n", "");
        let text = with(&text, "hyundai-n700", &model.id);
        let found = load(&text, &catalog).unwrap_err();
        let missing = found
            .iter()
            .find(|it| it.key == format!("{AT}.full_scale_hz"))
            .unwrap();
        let parameter = model
            .full_scale_parameter()
            .unwrap_or_else(|| panic!("{} names none", model.id));
        assert!(
            missing.right.as_deref().unwrap().ends_with(parameter),
            "{}: {missing:?}",
            model.id
        );
        let unproven = found
            .iter()
            .filter(|it| it.key == format!("{AT}.control.accept_unverified"))
            .count();
        assert_eq!(
            unproven,
            usize::from(!model.unproven_basics().is_empty()),
            "{}: {found:?}",
            model.id
        );
    }
}
