//! Native reads answered from what was read before, where a listener allows that (`cached`).
//!
//! An answer from memory is what the drive sent in one frame, no older than the poll period of each of its registers, and
//! no older than the last order for the drive. That is stricter than the age at which a value counts as stale, three
//! periods: a client that asks for a register by its address wants to know how it is now, so it gets what a poll in time
//! would have brought, and when polls are late it asks the drive itself.

use super::words::WordBuffer;
use crate::domain::address::Address;
use crate::domain::time::MonoTime;
use crate::drive::description::DriveDescription;
use crate::drive::view::{DriveView, OrdersView};
use crate::profile::model::Model;
use std::time::Duration;

/// Fills `words` with those of a read of `count` registers from `address` on, and returns their age at `now`; `None` if the
/// drive has to be asked. `orders` is how many orders and writes were given for the drive, by any client, before `view` was
/// looked at: while its line has not taken them all, they may not show yet.
#[must_use]
pub fn recall(
    drive: &DriveDescription,
    view: &DriveView,
    orders: u64,
    (address, count): (Address, u16),
    now: MonoTime,
    words: &mut WordBuffer,
) -> Option<Duration> {
    let OrdersView { taken, settled_at } = view.orders;
    if taken != orders || !view.is_online() {
        return None;
    }
    let settled_at = settled_at?;
    let at = view.snapshot.reading(address)?.at;
    let age = now.since(at);
    let mut next = address;
    let is_complete = words.fill(0, count, |_| {
        let here = next;
        next = drive.model.next_address(here);
        // What arrived at the same moment came in one frame.
        view.snapshot
            .reading(here)
            .filter(|reading| reading.at == at)
            .map(|reading| reading.raw)
    });
    let may_be = at > settled_at
        && is_complete
        && longest_age(drive, address, count).is_some_and(|most| age <= most);
    may_be.then_some(age)
}

/// The shortest poll period of the registers in a read; `None` if one is not polled, or not read as a whole.
fn longest_age(drive: &DriveDescription, first: Address, count: u16) -> Option<Duration> {
    let model: &Model = &drive.model;
    let addresses =
        std::iter::successors(Some(first), |address| Some(model.next_address(*address)));
    let periods = addresses
        .take(count.into())
        .map(|it| Some(drive.pace.period(model.polled_at(it, first, count)?)));
    periods.collect::<Option<Vec<_>>>()?.into_iter().min()
}

#[cfg(test)]
mod tests {
    use super::super::testing::{NOW, description, view};
    use super::*;

    const PERIOD: Duration = Duration::from_secs(1);
    const FIRST: Address = Address::holding(0x0101);

    /// The drive of the other tests, whose last order was over a second before its words were read.
    fn settled() -> DriveView {
        let mut view = view();
        view.orders = OrdersView {
            taken: 3,
            settled_at: Some(NOW.before(PERIOD)),
        };
        view
    }

    fn recalled(
        view: &DriveView,
        orders: u64,
        (address, count): (Address, u16),
        now: MonoTime,
    ) -> Option<Vec<u16>> {
        let mut words = WordBuffer::default();
        let age = recall(
            &description(),
            view,
            orders,
            (address, count),
            now,
            &mut words,
        )?;
        assert_eq!(age, now.since(NOW));
        Some(words.as_slice().to_vec())
    }

    #[test]
    fn the_words_of_one_frame_are_remembered_for_one_period() {
        let view = settled();
        assert_eq!(
            recalled(&view, 3, (FIRST, 3), NOW),
            Some(vec![4250, 1234, 380])
        );
        assert_eq!(
            recalled(&view, 3, (FIRST, 1), NOW + PERIOD),
            Some(vec![4250])
        );
        assert_eq!(
            recalled(
                &view,
                3,
                (FIRST, 1),
                NOW + PERIOD + Duration::from_millis(1)
            ),
            None
        );
        assert_eq!(
            recalled(&view, 3, (FIRST, 11), NOW),
            None,
            "beyond what was read"
        );
        assert_eq!(
            recalled(&view, 3, (Address::holding(0x0100), 2), NOW),
            None,
            "before it"
        );
        assert_eq!(
            recalled(
                &view,
                3,
                (
                    Address::new(crate::domain::address::DataTable::Input, 0x0101),
                    1
                ),
                NOW
            ),
            None
        );
    }

    #[test]
    fn words_of_two_frames_are_no_answer() {
        let mut view = settled();
        view.snapshot.take(
            0x0103_u16.into(),
            &[381],
            NOW.before(Duration::from_millis(40)),
        );
        assert_eq!(recalled(&view, 3, (FIRST, 2), NOW), Some(vec![4250, 1234]));
        assert_eq!(recalled(&view, 3, (FIRST, 3), NOW), None);
    }

    #[test]
    fn what_is_not_newer_than_every_order_is_no_answer() {
        let mut view = settled();
        assert_eq!(
            recalled(&view, 4, (FIRST, 1), NOW),
            None,
            "an order that the line has not taken"
        );
        view.orders.settled_at = Some(NOW);
        assert_eq!(
            recalled(&view, 3, (FIRST, 1), NOW),
            None,
            "an order of the same moment"
        );
        view.orders.settled_at = None;
        assert_eq!(
            recalled(&view, 3, (FIRST, 1), NOW),
            None,
            "an order in progress"
        );
    }

    #[test]
    fn a_drive_that_cannot_be_asked_is_not_remembered() {
        let mut view = settled();
        view.line_is_up = false;
        assert_eq!(recalled(&view, 3, (FIRST, 1), NOW), None);
        view = settled();
        view.snapshot.presence = crate::drive::snapshot::DrivePresence::Offline;
        assert_eq!(recalled(&view, 3, (FIRST, 1), NOW), None);
    }

    #[test]
    fn what_is_not_polled_is_not_remembered() {
        let mut view = settled();
        // The run command is not polled: nothing keeps it fresh.
        view.snapshot.take(2_u16.into(), &[1], NOW);
        assert_eq!(recalled(&view, 3, (Address::holding(2), 1), NOW), None);
    }
}
