//! A configuration: any text gives one that keeps its rules, or problems that can be shown.

use super::{plant, text};
use std::collections::BTreeSet;
use vfd_config::config::{self, Config, PortAddress};

pub fn run(bytes: &[u8]) {
    let Some(text) = text::of(bytes) else { return };
    for dir in config::model_dirs(text) {
        assert!(
            dir.value.is_absolute() && text.get(dir.location.span.clone()).is_some(),
            "{dir:?}"
        );
    }
    let fewer = config::problems_without_some_models(text, plant::catalog());
    match config::load(text, plant::catalog()) {
        Ok(config) => {
            assert!(fewer.is_empty(), "sound, but: {fewer:?}");
            assert!(
                config.warnings.iter().all(|it| it.is_warning),
                "sound, but: {:?}",
                config.warnings
            );
            assert!(
                config.warnings.is_sorted_by_key(|it| it.span.start),
                "{:?}",
                config.warnings
            );
            check(&config);
        }
        Err(problems) => {
            text::check_file(text, &problems);
            assert!(
                problems.iter().any(|it| !it.is_warning),
                "only warnings keep it from starting: {problems:?}"
            );
            assert!(fewer.len() <= problems.len(), "{fewer:?}\n{problems:?}");
        }
    }
}

fn check(config: &Config) {
    assert!(!config.lines.is_empty());
    let mut names = BTreeSet::new();
    for line in &config.lines {
        assert!(
            line.link.baud > 0 && !line.drives.is_empty() && is_usable(&line.port),
            "{line:?}"
        );
        let stations: BTreeSet<_> = line.drives.iter().map(|drive| drive.station).collect();
        assert_eq!(
            stations.len(),
            line.drives.len(),
            "a station twice on {}",
            line.name
        );
        for drive in &line.drives {
            assert!(
                drive.model.link.stations.value.contains(&drive.station.0),
                "{}",
                drive.name
            );
            assert!(
                names.insert(drive.name.as_str()),
                "two drives are called {}",
                drive.name
            );
            if let Some(control) = &drive.control {
                assert!(
                    control.least <= control.most && !control.directions.is_empty(),
                    "{control:?}"
                );
                assert!(!control.lost_after.is_zero(), "{control:?}");
            }
        }
    }
    for listener in &config.listeners {
        let served = config
            .lines
            .iter()
            .enumerate()
            .filter(|(line, _)| listener.serves(*line));
        let units: Vec<_> = served
            .flat_map(|(_, line)| &line.drives)
            .flat_map(|drive| [drive.unit.get(), drive.uniform_unit.get()])
            .collect();
        assert_eq!(
            units.iter().collect::<BTreeSet<_>>().len(),
            units.len(),
            "a unit twice at {}",
            listener.listen
        );
    }
}

fn is_usable(port: &PortAddress) -> bool {
    match port {
        PortAddress::Device(path) => path.is_absolute(),
        PortAddress::Tcp { port, .. } | PortAddress::ModbusTcp { port, .. } => *port > 0,
    }
}
