//! From a unit on Modbus TCP to a drive on a line.

use super::inbox::Inbox;
use crate::config::{Config, ListenerSettings};
use crate::domain::ids::DriveIndex;
use std::collections::HashMap;
use std::sync::Arc;

/// Which drive each unit of one listener leads to.
#[derive(Debug)]
pub struct Router {
    inboxes: Vec<Arc<Inbox>>,
    units: HashMap<u8, (usize, DriveIndex)>,
}

impl Router {
    /// The routes of `listener`, where the line at index n has the inbox `inboxes[n]`.
    #[must_use]
    pub fn new(config: &Config, listener: &ListenerSettings, inboxes: Vec<Arc<Inbox>>) -> Self {
        let mut units = HashMap::new();
        for (index, line) in config.lines.iter().enumerate().filter(|(index, _)| listener.serves(*index)) {
            for (drive, settings) in (0..).zip(&line.drives) {
                units.insert(settings.unit.get(), (index, DriveIndex(drive)));
            }
        }
        Self { inboxes, units }
    }

    /// The drive at `unit` and the inbox of its line.
    #[must_use]
    pub fn find(&self, unit: u8) -> Option<(&Inbox, DriveIndex)> {
        let (line, drive) = self.units.get(&unit)?;
        Some((self.inboxes.get(*line)?, *drive))
    }

    /// The inboxes of all lines.
    pub fn inboxes(&self) -> impl Iterator<Item = &Inbox> {
        self.inboxes.iter().map(Arc::as_ref)
    }
}
