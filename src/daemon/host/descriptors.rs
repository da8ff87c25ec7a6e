//! How many files the process may have open, and for how many connections that leaves room.

use crate::north::modbus::ClientSlots;
use rustix::event::{EventfdFlags, eventfd};
use rustix::process::{Resource, Rlimit, getrlimit, setrlimit};
use std::cell::RefCell;
use std::os::fd::OwnedFd;

/// Files other than connections of Modbus TCP: two HTTP listeners of 64 connections each, six for each of some thirty
/// lines, journal, broker, sockets, and a reserve.
const KEPT: u64 = 384;

/// Raises the limit of open files as far as the system allows and connections need. Returns how many connections it
/// leaves room for.
#[must_use]
pub fn room_for_connections() -> usize {
    let limit = getrlimit(Resource::Nofile);
    let useful = ClientSlots::MOST as u64 + KEPT;
    let wanted = limit.maximum.unwrap_or(u64::MAX).min(useful);
    let before = limit.current.unwrap_or(u64::MAX);
    if before >= wanted {
        return connections(before);
    }
    match setrlimit(
        Resource::Nofile,
        Rlimit {
            current: Some(wanted),
            ..limit
        },
    ) {
        Ok(()) => connections(wanted),
        Err(error) => {
            tracing::warn!(%error, limit = before, "cannot raise the limit of open files");
            connections(before)
        }
    }
}

/// The connections that `files` leave room for: all but [`KEPT`], or half of them if that is more.
fn connections(files: u64) -> usize {
    let connections = files.saturating_sub(KEPT).max(files / 2);
    usize::try_from(connections)
        .unwrap_or(usize::MAX)
        .min(ClientSlots::MOST)
}

/// A spare descriptor. Released when there are no others, it lets one more connection be accepted, so that its peer is
/// known.
#[derive(Debug, Default)]
pub struct SpareDescriptor(RefCell<Option<OwnedFd>>);

impl SpareDescriptor {
    /// Releases it to the system. Returns whether it was held.
    pub fn release(&self) -> bool {
        self.0.take().is_some()
    }

    /// Opens it again unless it is held. Returns whether it is held now.
    pub fn refill(&self) -> bool {
        let mut spare = self.0.borrow_mut();
        if spare.is_none() {
            *spare = eventfd(0, EventfdFlags::CLOEXEC).ok();
        }
        spare.is_some()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn connections_leave_files_for_all_else() {
        for (files, right) in [
            (40, 20),
            (64, 32),
            (768, 384),
            (1024, 640),
            (20_000, 19_616),
            (524_288, 65_536),
            (u64::MAX, 65_536),
        ] {
            assert_eq!(connections(files), right, "{files}");
        }
    }

    #[test]
    fn the_limit_is_raised_and_reported() {
        let room = room_for_connections();
        let limit = getrlimit(Resource::Nofile);
        assert_eq!(room, connections(limit.current.unwrap_or(u64::MAX)));
        let useful = ClientSlots::MOST as u64 + KEPT;
        assert!(
            limit
                .current
                .is_none_or(|it| it >= limit.maximum.unwrap_or(u64::MAX).min(useful)),
            "{limit:?}"
        );
    }

    #[test]
    fn a_spare_descriptor_is_given_back_once() {
        let spare = SpareDescriptor::default();
        assert!(!spare.release());
        assert!(spare.refill() && spare.refill());
        assert!(spare.release() && !spare.release());
    }
}
