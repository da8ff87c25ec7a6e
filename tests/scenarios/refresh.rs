//! A full refresh of a line of mixed models is as short as the limits of the models allow, within 3 %.

use std::fmt::Write as _;
use std::sync::Arc;
use std::time::Duration;
use vfd_gateway::domain::link::{Framing, Interface, LinkSettings, Parity};
use vfd_gateway::line::budget::{PlannedStation, Refresh, refresh};
use vfd_gateway::line::timeouts::ReplyTimeouts;
use vfd_gateway::line::timing::Timing;
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

fn refresh_of(models: &[Arc<Model>], baud: u32) -> Refresh {
    let link = LinkSettings { baud, data_bits: 8, parity: Parity::None, stop_bits: 1 };
    let timing = Timing::for_models(Framing::Rtu, link, models.iter().map(AsRef::as_ref), Duration::ZERO);
    let stations = models.iter().map(|model| PlannedStation {
        model,
        poll: Duration::from_secs(1),
        timeouts: ReplyTimeouts::auto(&model.timing),
        max_lateness: Duration::ZERO,
    });
    refresh(&timing, stations)
}

#[test]
fn a_refresh_is_within_three_per_cent_of_the_shortest() {
    let mut table = String::new();
    let mut worst = 0;
    for baud in [9600, 19200] {
        let catalog = vendors::catalog();
        let all: Vec<_> = catalog.models().filter(|model| can(model, baud)).cloned().collect();
        for (number, models) in (1..).zip(all.chunks(DRIVES_OF_A_LINE)) {
            let Refresh { reads, time, shortest_reads, shortest_time } = refresh_of(models, baud);
            let longer = time.as_nanos() * 1000 / shortest_time.as_nanos() - 1000;
            worst = worst.max(longer);
            let [time, shortest] = [time, shortest_time].map(|it| it.as_millis());
            let names: Vec<_> = models.iter().map(|model| model.id.as_str()).collect();
            writeln!(
                table,
                "{baud} line {number}: {reads} reads {time} ms, shortest {shortest_reads} reads {shortest} ms, {longer} per mille \
                 longer ({})",
                names.join(", ")
            )
            .unwrap();
        }
    }
    println!("{table}");
    assert!(worst <= LONGER_MAX, "{table}");
}
