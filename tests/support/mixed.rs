//! A line of different models, with a simulated drive of each.

use super::{Rig, RigOptions};
use std::sync::Arc;
use std::time::Duration;
use vfd_gateway::domain::ids::Station;
use vfd_gateway::domain::link::{Framing, LinkSettings, PortKind};
use vfd_gateway::gateway::{DriveSetup, LineCore, LineInput, LineSetup};
use vfd_gateway::journal::RememberedDrive;
use vfd_gateway::line::timeouts::ReplyTimeouts;
use vfd_gateway::line::timing::LineTiming;
use vfd_gateway::profile::model::Model;
use vfd_gateway::sim::{BusOptions, DriveOptions, SimBus, SimDrive};

impl Rig {
    /// A line of `models` at stations 1, 2, ..., none of them under control.
    pub fn mixed(models: &[Arc<Model>], link: LinkSettings, poll: Duration) -> Self {
        let mut rig = Self::new(&RigOptions::default());
        let mut bus = SimBus::new(link, BusOptions::default(), 1);
        let mut drives = Vec::new();
        for (station, model) in (1..).map(Station).zip(models) {
            bus.connect(
                station,
                SimDrive::new(Arc::clone(model), DriveOptions::default()),
            );
            drives.push(DriveSetup {
                station,
                model: Arc::clone(model),
                poll,
                timeouts: ReplyTimeouts::auto(&model.timing),
                max_lateness: model.timing.max_lateness.value,
                control: None,
                remembered: RememberedDrive::default(),
            });
        }
        let timing = LineTiming::for_models(
            Framing::Rtu,
            link,
            models.iter().map(AsRef::as_ref),
            Duration::ZERO,
        );
        rig.setup = LineSetup {
            timing,
            drives,
            ..rig.setup
        };
        rig.bus = bus;
        rig.core = LineCore::new(rig.setup.clone(), rig.now);
        rig.core
            .handle(rig.now, LineInput::PortUp(PortKind::Serial));
        rig.settle();
        rig
    }
}
