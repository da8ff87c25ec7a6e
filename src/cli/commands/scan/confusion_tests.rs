//! The confusion matrix: the simulator plays each model, the scan says what it takes it for. A scan may name several
//! models, and never a wrong one alone.

use super::report::ScanReport;
use super::tests::{Simulated, factory_plan, model, models, played};
use crate::config::PortAddress;
use crate::daemon::scan::plan::{READS_MAX, SILENCES_MAX, ScanOptions, ScanPlan, ScanSetting};
use crate::daemon::scan::survey::{FoundDrive, ModelVerdict};
use crate::profile::model::Model;
use crate::sim::FaultPlan;
use std::fmt::Write;
use std::path::Path;
use std::sync::Arc;

/// One drive of `model` at the only setting of `plan`, and how many frames it took.
fn found(plan: &ScanPlan, model: &Arc<Model>) -> (FoundDrive, usize) {
    let mut line = Simulated::new(model, &[1], FaultPlan::default());
    line.link = plan.settings[0].link;
    let findings = played(plan, &mut line);
    let [drive] = &findings.drives[..] else {
        panic!("{}: {findings:?}", model.id)
    };
    (drive.clone(), line.frames)
}

fn names(verdict: &ModelVerdict) -> Vec<&str> {
    verdict
        .fits
        .iter()
        .map(|(fit, _)| fit.id.as_str())
        .collect()
}

/// The setting that a drive of `model` has when it is new, or can be set to if that one is not of RTU frames.
fn plan_for(all: &ScanPlan, model: &Model) -> ScanPlan {
    let has = |setting: &&ScanSetting| setting.candidates.iter().any(|it| it.id == model.id);
    let is_factory = |setting: &&ScanSetting| setting.link == model.link.played();
    let setting = all
        .settings
        .iter()
        .find(is_factory)
        .or_else(|| all.settings.iter().find(has))
        .unwrap();
    ScanPlan {
        settings: vec![setting.clone()],
        stations: vec![1],
    }
}

/// Whether only `model` is named; `None` if others are too. A wrong name alone fails.
fn is_told_alone(model: &Model, verdict: &ModelVerdict) -> bool {
    let names = names(verdict);
    assert!(
        names.contains(&model.id.as_str()),
        "{} is taken for {names:?}",
        model.id
    );
    verdict.keyword() == "probable"
}

fn frames_max(plan: &ScanPlan) -> usize {
    // Each silence costs a read of what is known to answer; one more read is of an address that no model has.
    plan.settings[0].probes.len() + (READS_MAX + 2 * SILENCES_MAX + 3) as usize
}

#[test]
fn no_model_is_taken_for_another_one() {
    let all = factory_plan("1");
    let mut text = String::from(
        "# Each model, played by the simulator at its factory setting: what `scan` says.\n",
    );
    let (mut single, mut most) = (0, 0);
    for model in models() {
        let plan = plan_for(&all, &model);
        let (drive, frames) = found(&plan, &model);
        assert!(frames <= frames_max(&plan), "{}: {frames} frames", model.id);
        single += usize::from(is_told_alone(&model, &drive.verdict));
        most = most.max(frames);
        let _ = writeln!(
            text,
            "{}: {} {}",
            model.id,
            drive.verdict.keyword(),
            names(&drive.verdict).join(", ")
        );
    }
    let count = models().len();
    let _ = writeln!(
        text,
        "# {count} models: {single} by a single name, which is right, {} among others.",
        count - single
    );
    let _ = writeln!(text, "# At most {most} frames for one station.");
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/golden/scan/confusion.txt");
    if std::env::var_os("UPDATE_GOLDEN").is_some() {
        std::fs::write(&path, &text).unwrap();
    }
    let expected = std::fs::read_to_string(&path).unwrap_or_default();
    assert_eq!(
        text,
        expected,
        "if this is meant: UPDATE_GOLDEN=1 writes {}",
        path.display()
    );
}

#[test]
fn nor_where_the_setting_says_nothing() {
    let options = ScanOptions {
        is_network: true,
        ..ScanOptions::default()
    };
    let plan = ScanPlan::new(&models(), vec![1], &options);
    for model in models() {
        let (drive, frames) = found(&plan, &model);
        assert!(frames <= frames_max(&plan), "{}: {frames} frames", model.id);
        is_told_alone(&model, &drive.verdict);
    }
}

#[test]
fn a_drive_tells_what_it_is() {
    let all = factory_plan("1");
    let a1000 = model("yaskawa-a1000");
    let plan = plan_for(&all, &a1000);
    let (drive, _) = found(&plan, &a1000);
    assert_eq!(names(&drive.verdict), ["yaskawa-a1000"]);
    assert!(
        drive.verdict.fits[0]
            .1
            .starts_with("its register product_code says so, and "),
        "{:?}",
        drive.verdict
    );
    // The same drive with the number of another one.
    let smv = model("actech-smv");
    let mut other = Model::clone(&smv);
    other.identity.as_mut().unwrap().values.value = vec![0x41];
    let (drive, _) = found(&plan_for(&all, &smv), &Arc::new(other));
    assert!(!names(&drive.verdict).contains(&"actech-smv"));
    assert_eq!(drive.verdict.other.as_deref(), Some("AC Tech MC"));
    let port = PortAddress::Device(Path::new("/dev/ttyUSB0").to_owned());
    let findings = crate::daemon::scan::survey::ScanFindings {
        drives: vec![drive],
        ..crate::daemon::scan::survey::ScanFindings::default()
    };
    let table = ScanReport {
        port: &port,
        plan: &plan,
        findings: &findings,
        echoes: false,
        date: "",
    }
    .table();
    assert!(table.contains("says that it is AC Tech MC; "), "{table}");
}

#[test]
fn a_drive_without_holding_registers_is_found() {
    for (table, function) in [("input", "0x04"), ("coil", "0x01")] {
        let model = Arc::new(without_03(table, function));
        let plan = ScanPlan::new(&[Arc::clone(&model)], vec![1], &ScanOptions::default());
        let (drive, _) = found(&plan, &model);
        assert_eq!(
            (names(&drive.verdict), drive.by_exception),
            (vec![model.id.as_str()], false),
            "{table}"
        );
    }
}

/// A model whose registers are all in `table`, which `function` reads.
fn without_03(table: &str, function: &str) -> Model {
    use crate::domain::address::{Address, DataTable};
    let table = DataTable::ALL
        .into_iter()
        .find(|it| it.keyword() == table)
        .unwrap();
    let mut model = Model::clone(&model("rockwell-powerflex-40"));
    model.functions.value =
        vec![u8::from_str_radix(function.trim_start_matches("0x"), 16).unwrap()];
    (model.run, model.watchdog, model.identity) = (None, None, None);
    model.setup.clear();
    model.status.clear();
    model.barriers.clear();
    for register in &mut model.registers {
        register.address = Address::new(table, register.address.number());
        register.range = None;
    }
    model
}
