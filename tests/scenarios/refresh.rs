//! A full refresh of a line of mixed models is as short as the limits of the models allow, within 3 %.

use crate::support::Rig;
use std::fmt::Write as _;
use std::sync::Arc;
use std::time::Duration;
use vfd_gateway::domain::ids::DriveIndex;
use vfd_gateway::domain::link::{Framing, Interface, LinkSettings, Parity};
use vfd_gateway::line::budget::{PlannedStation, RefreshCost, refresh};
use vfd_gateway::line::timeouts::ReplyTimeouts;
use vfd_gateway::line::timing::LineTiming;
use vfd_gateway::profile::model::Model;
use vfd_gateway::vendors;

/// How much longer than the shortest a refresh may be, in thousandths.
const LONGER_MAX: u128 = 30;
const DRIVES_OF_A_LINE: usize = 8;

/// Whether it can be set to this speed and 8N1.
fn can(model: &Model, baud: u32) -> bool {
    let link = &model.link;
    link.bauds.value.contains(&baud)
        && link.parities.value.contains(&Parity::None)
        && link.stop_bits.value.contains(&1)
        && link.data_bits.value.contains(&8)
        && link.framings.value.contains(&Framing::Rtu)
        && link.interfaces.value.contains(&Interface::Rs485)
}

fn refresh_of(models: &[Arc<Model>], baud: u32) -> RefreshCost {
    let link = LinkSettings {
        baud,
        data_bits: 8,
        parity: Parity::None,
        stop_bits: 1,
    };
    let timing = LineTiming::for_models(
        Framing::Rtu,
        link,
        models.iter().map(AsRef::as_ref),
        Duration::ZERO,
    );
    let stations = models.iter().map(|model| PlannedStation {
        model,
        poll: Duration::from_secs(1),
        timeouts: ReplyTimeouts::auto(&model.timing),
        max_lateness: Duration::ZERO,
    });
    refresh(&timing, stations)
}

/// Lines of eight mixed models each: speed, number and models.
fn lines() -> Vec<(u32, usize, Vec<Arc<Model>>)> {
    let mut lines = Vec::new();
    for baud in [9600, 19200] {
        let catalog = vendors::catalog();
        let all: Vec<_> = catalog
            .models()
            .filter(|model| can(model, baud))
            .cloned()
            .collect();
        lines.extend(
            (1..)
                .zip(all.chunks(DRIVES_OF_A_LINE))
                .map(|(number, models)| (baud, number, models.to_vec())),
        );
    }
    lines
}

fn names(models: &[Arc<Model>]) -> String {
    models
        .iter()
        .map(|model| model.id.as_str())
        .collect::<Vec<_>>()
        .join(", ")
}

#[test]
fn a_refresh_is_within_three_per_cent_of_the_shortest() {
    let mut table = String::new();
    let mut worst = 0;
    for (baud, number, models) in lines() {
        let RefreshCost {
            reads,
            time,
            shortest_reads,
            shortest_time,
        } = refresh_of(&models, baud);
        let longer = time.as_nanos() * 1000 / shortest_time.as_nanos() - 1000;
        worst = worst.max(longer);
        let [time, shortest] = [time, shortest_time].map(|it| it.as_millis());
        let names = names(&models);
        writeln!(
            table,
            "{baud} line {number}: {reads} reads {time} ms, shortest {shortest_reads} reads {shortest} ms, {longer} per mille \
             longer ({names})"
        )
        .unwrap();
    }
    println!("{table}");
    assert!(worst <= LONGER_MAX, "{table}");
}

/// A line of these models at 8N1, each polled this often.
fn line(models: &[Arc<Model>], baud: u32, poll: Duration) -> Rig {
    let link = LinkSettings {
        baud,
        data_bits: 8,
        parity: Parity::None,
        stop_bits: 1,
    };
    Rig::mixed(models, link, poll)
}

#[test]
fn no_fast_poll_is_late_while_the_line_has_room() {
    let mut table = String::new();
    let mut late = 0;
    for (baud, number, models) in lines() {
        // So often that the polls nearly fill the line.
        let each_second = line(&models, baud, Duration::from_secs(1)).setup.budget();
        let poll = Duration::from_secs(1).mul_f64(each_second.use_of_line * 1.03);
        let mut rig = line(&models, baud, poll);
        let use_of_line = rig.setup.budget().use_of_line;
        writeln!(
            table,
            "{baud} line {number}: every {poll:.3?}, use {use_of_line:.3} ({})",
            names(&models)
        )
        .unwrap();
        assert!((0.8..=1.0).contains(&use_of_line), "{table}");
        rig.pass(Duration::from_secs(120));
        for (drive, model) in (0..).map(DriveIndex).zip(&models) {
            let station = rig.core.station(drive).unwrap();
            let Some(planned) = station.planned_age else {
                continue;
            };
            let is_late = station.oldest_age > planned;
            late += usize::from(is_late);
            let mark = if is_late { "LATE" } else { "" };
            let (oldest, planned) = (station.oldest_age.as_millis(), planned.as_millis());
            writeln!(
                table,
                "  {}: {oldest} ms, planned {planned} ms {mark}",
                model.id
            )
            .unwrap();
        }
    }
    println!("{table}");
    assert_eq!(late, 0, "{table}");
}
