//! A stop goes out from a gateway that may not send, too: as a single frame between those of the master that does.

use super::core::{ExchangePurpose, LineCore};
use super::drive::DriveOnLine;
use super::work::{DriveWish, WishRank};
use crate::domain::ids::DriveIndex;
use crate::domain::time::MonoTime;
use crate::line::exchange::ExchangeEnding;
use crate::wire::framing;
use crate::wire::pdu::Request;

impl LineCore {
    /// This gateway may not send at `now`: sends a stop that waits, if it is time for that.
    pub(super) fn stop_between(&mut self, now: MonoTime) {
        let Some((drive, want)) = self
            .next_between(now)
            .filter(|(at, ..)| *at <= now)
            .map(|(_, drive, want)| (drive, want))
        else {
            return;
        };
        let Some(share) = &mut self.share else { return };
        share.gap.decided(now, want.rank != WishRank::Look);
        if want.rank == WishRank::FirstStop && self.stop_all(now) {
            return;
        }
        let is_first = self.drives[drive].work.unsent_stop().is_some();
        if !self.drives[drive]
            .work
            .send(want.rank, now, &mut self.effects)
        {
            return;
        }
        if is_first {
            self.measured.stop_sent(want.at, now);
            self.drives[drive].work.stops_between(&mut self.effects);
        }
        self.open_exchange(now, (drive, want.request, ExchangePurpose::Work(want.rank)));
    }

    /// When the next stop is sent between the frames of another master, as known at `now`, if nothing more is received.
    pub(super) fn between_at(&self, now: MonoTime) -> Option<MonoTime> {
        Some(self.next_between(now)?.0.max(self.wire.may_send_from()))
    }

    fn next_between(&self, now: MonoTime) -> Option<(MonoTime, DriveIndex, DriveWish)> {
        if !self.listens() {
            return None;
        }
        let share = self.share.as_ref()?;
        let last_byte_at = self.wire.last_byte_at();
        let wants = self
            .drives
            .iter()
            .filter(|drive| drive.work.has_stop())
            .flat_map(|drive| {
                let from = share
                    .rule
                    .knowledge()
                    .stops_from(drive.work.is_stop_declared());
                let room = share.rule.makes_room().then(|| share.rule.times().room());
                let leaves_room = move |at| room.map_or(at, |room| share.gap.in_burst(at, room));
                drive.work.wants().filter_map(move |want| {
                    let due = drive.wanted_from(&want).max(from);
                    let at = match want.rank {
                        WishRank::FirstStop => share.gap.stop_at(due, last_byte_at, now),
                        WishRank::RepeatedStop => {
                            leaves_room(share.gap.again_at(due, last_byte_at, now))
                        }
                        // Another gateway reads its drives itself, and would take a read for one of a rival.
                        // One that hears nothing learns nothing by it.
                        WishRank::Look
                            if self.is_seen_by_others(drive, now) || share.rule.is_deaf() =>
                        {
                            return None;
                        }
                        WishRank::Look => leaves_room(share.gap.look_at(due, last_byte_at, now)),
                        WishRank::Step | WishRank::Trip | WishRank::Start => return None,
                    };
                    Some((at, drive.index, want))
                })
            });
        wants
            .filter(|(at, ..)| *at < MonoTime::NEVER)
            .min_by_key(|(at, _, want)| (*at, want.rank, want.at))
    }

    /// Whether another gateway reads the drive, or is active and decides when.
    fn is_seen_by_others(&self, drive: &DriveOnLine, now: MonoTime) -> bool {
        let is_led = self
            .share
            .as_ref()
            .is_some_and(|share| share.gap.is_led(now));
        is_led || drive.work.is_read_by_others(now)
    }

    /// The exchange of such a frame has ended.
    pub(super) fn between_ended(
        &mut self,
        now: MonoTime,
        drive: DriveIndex,
        rank: WishRank,
        ending: &ExchangeEnding,
    ) {
        if !self.listens() {
            return;
        }
        let last_byte_at = self.wire.last_byte_at();
        let Some(share) = &mut self.share else { return };
        share.own_bytes_at = last_byte_at;
        if matches!(
            ending,
            ExchangeEnding::Reply(_) | ExchangeEnding::Exception(_)
        ) {
            return share.gap.answered();
        }
        share.gap.unanswered();
        if rank != WishRank::Look && share.gap.may_repeat(now) {
            self.drives[drive].work.stop_again_at(now);
        }
    }

    /// The gateway shuts down while it listens. Another gateway controls the drives, unless this one would have heard it take
    /// the line, and still has control.
    pub(super) fn end_listening(&mut self, now: MonoTime) {
        let is_informed = self
            .share
            .as_ref()
            .is_some_and(|share| share.rule.knowledge().is_informed(now));
        for work in self.drives.works_mut() {
            if is_informed && work.guard().lease().is_some() {
                work.shut_down(now, &mut self.effects);
            } else {
                work.end();
            }
        }
    }

    /// Takes the `frame` of another master as a stop by somebody else, if it is a stop for drives of this line. Such a frame
    /// comes from a gateway that listens, and ends no role. Returns whether it is one. The reply to a single write repeats it:
    /// a late one to a stop of this gateway is none.
    pub(super) fn hears_stop(&mut self, now: MonoTime, frame: &[u8]) -> bool {
        if self.share.is_none() {
            return false;
        }
        let Some((_, pdu)) = framing::decode(self.timing.framing, frame) else {
            return false;
        };
        if self.is_answer_to_stop(now, frame) {
            return true;
        }
        let is_late = |drive: DriveIndex| {
            let mut own = Vec::new();
            if let Some((request, _)) = self.drives[drive].station.answered_late(&pdu, now) {
                request.encode(&mut own);
            }
            own == *pdu
        };
        let mut stopped = self.stops_in(frame);
        stopped.retain(|(drive, _)| !is_late(*drive));
        for (drive, coast) in &stopped {
            self.drives[*drive]
                .work
                .stopped_by_another(*coast, now, &mut self.effects);
        }
        if !stopped.is_empty() {
            self.awaits_answer(now, frame, Request::decode(&pdu));
        }
        !stopped.is_empty()
    }

    /// The drive answers the stop `frame` of another gateway first.
    fn awaits_answer(&mut self, now: MonoTime, frame: &[u8], request: Option<Request>) {
        let (Some(share), Some(request)) = (&mut self.share, request) else {
            return;
        };
        let asked = self
            .drives
            .iter()
            .map(|drive| drive.wait_for(&request, &self.timing))
            .max();
        // The other one waits no longer.
        let until = now + asked.unwrap_or_default() / 2;
        share.heard_stop = Some((frame.to_vec(), until));
        self.wire.hold(until);
    }

    /// Whether `frame` is the drive's answer to such a stop, which repeats it. The line is free then.
    fn is_answer_to_stop(&mut self, now: MonoTime, frame: &[u8]) -> bool {
        let Some(share) = &mut self.share else {
            return false;
        };
        let Some((_, until)) = share.heard_stop.take_if(|(stop, _)| stop == frame) else {
            return false;
        };
        if now < until {
            self.wire.release(until);
        }
        now < until
    }
}
