//! One drive on its line, and the drives of a line.

use super::event::LineEffect;
use super::measured::DriveMeasured;
use super::note::DriveNote;
use super::outbox::EffectOutbox;
use super::setup::{DriveSetup, LineSetup};
use super::work::{DriveWish, DriveWork, WishRank};
use crate::domain::address::Address;
use crate::domain::ids::{DriveIndex, Station};
use crate::domain::report::LineState;
use crate::domain::time::MonoTime;
use crate::drive::description::STALE_PERIODS;
use crate::drive::doubt::BlankWatch;
use crate::drive::plan::{PlaceOnLine, PollPace, PollPlan};
use crate::drive::plausible::RangePlausibility;
use crate::drive::snapshot::{DrivePresence, DriveSnapshot};
use crate::drive::view::{DriveView, OrdersView};
use crate::journal::JournalEntry;
use crate::line::barriers::DriveBarriers;
use crate::line::budget::PollBudget;
use crate::line::exchange::ExchangeEnding;
use crate::line::fault::{Fault, consequence};
use crate::line::station::{MissingReply, StationState};
use crate::line::timeouts::RequestClass;
use crate::line::timing::LineTiming;
use crate::profile::model::PollClass;
use crate::wire::pdu::Request;
use std::ops::{Index, IndexMut};
use std::time::Duration;

/// Another gateway that has not read a drive for less may have met a stop of this one.
const READ_AT_LEAST: Duration = Duration::from_secs(1);

/// One drive on its line: its setup, what the line knows of it, and its pending work.
#[derive(Debug)]
pub(super) struct DriveOnLine {
    pub(super) index: DriveIndex,
    pub(super) setup: DriveSetup,
    /// Replies that may still arrive late, and how long it has been silent.
    pub(super) station: StationState,
    /// Requests that rule out late replies.
    pub(super) barriers: DriveBarriers,
    pub(super) plan: PollPlan,
    pub(super) snapshot: DriveSnapshot,
    pub(super) plausibility: RangePlausibility,
    /// Its control: stops, commands, trips, the guard.
    pub(super) work: DriveWork,
    pub(super) measured: DriveMeasured,
    /// Blocks that read as zeros or ones.
    pub(super) blank: BlankWatch,
    /// Orders and writes taken so far, wrapping.
    orders_taken: u64,
    /// When the last one was taken, or the last write was over.
    ordered_at: MonoTime,
    /// Up to this moment a stop may not be heard.
    pub(super) deaf_until: MonoTime,
    pace: PollPace,
    /// When another gateway or master last read it.
    pub(super) overheard_at: Option<MonoTime>,
}

impl DriveOnLine {
    fn new(
        index: u16,
        line: &LineSetup,
        setup: &DriveSetup,
        budget: &PollBudget,
        now: MonoTime,
    ) -> Self {
        let drives = u32::try_from(line.drives.len()).unwrap_or(u32::MAX);
        let place = usize::from(index);
        let pace = PollPace::new(setup.poll, budget.stretch);
        let is_identified = line.timing.framing.identifies_replies();
        let plausibility = RangePlausibility::of(&setup.model);
        let work = DriveWork::new(
            DriveIndex(index),
            &setup.model,
            setup.control.clone(),
            line.first_epoch,
            now,
        );
        Self {
            index: DriveIndex(index),
            station: StationState::new(&setup.model).identified(is_identified),
            barriers: if is_identified {
                DriveBarriers::none()
            } else {
                DriveBarriers::new(&setup.model)
            },
            plan: PollPlan::new(
                &setup.model,
                pace,
                now,
                PlaceOnLine {
                    index: u32::from(index),
                    drives,
                },
            ),
            snapshot: DriveSnapshot::unread(!plausibility.holds()),
            plausibility,
            work: work.watched(line.watchdog_range(place)).polled(pace),
            measured: DriveMeasured::planned(budget.fast_age(place)),
            blank: BlankWatch::default(),
            orders_taken: 0,
            ordered_at: now,
            deaf_until: MonoTime::ZERO,
            pace,
            overheard_at: None,
            setup: setup.clone(),
        }
    }

    /// Whether it is known to be silent.
    pub(super) fn is_offline(&self) -> bool {
        self.snapshot.presence == DrivePresence::Offline
    }

    /// Its current view on a line in this state.
    pub(super) fn view(&self, line: LineState) -> DriveView {
        let work = &self.work;
        DriveView {
            line_is_up: line == LineState::Up,
            snapshot: self.snapshot.clone(),
            run_state: work.run_state(line == LineState::Down || self.is_offline()),
            sight: work.sight_view(),
            status: work.status_view(),
            trip: work.trips().view().clone(),
            trip_kept: work.trips_kept().clone(),
            control: work.control_view(),
            watchdog: work.watchdog().view(),
            usage: work.usage_view(),
            refused: self.plan.refused_registers().collect(),
            orders: OrdersView {
                taken: self.orders_taken,
                settled_at: (!work.has_orders()).then_some(self.ordered_at),
            },
        }
    }

    /// An order or a write for it was taken, whatever follows from it.
    pub(super) fn order_taken(&mut self, now: MonoTime) {
        self.orders_taken = self.orders_taken.wrapping_add(1);
        self.order_heard(now);
    }

    /// Another gateway ordered or wrote something at `now`. It counts as no order of this gateway's clients.
    pub(super) fn order_heard(&mut self, now: MonoTime) {
        self.ordered_at = now;
        self.work.mark_changed();
    }

    /// Whether another one reads it, as far as can be heard at `now`.
    pub(super) fn is_read_by_others(&self, now: MonoTime) -> bool {
        // A frame of this gateway may have cost the other one an exchange.
        let limit = (self.pace.period(PollClass::Fast) * STALE_PERIODS).max(READ_AT_LEAST);
        self.overheard_at.is_some_and(|at| now.since(at) < limit)
    }

    pub(super) fn port_opened(&mut self, now: MonoTime) {
        self.station.line_opened(now);
        self.barriers.port_opened();
        self.plan.port_opened(now);
        self.measured.port_opened();
        self.work.mark_changed();
    }

    /// The last request before the line was opened at `now` may be any that the drive serves.
    pub(super) fn asked_before(&mut self, now: MonoTime) {
        let timeouts = &self.setup.timeouts;
        let longest = timeouts.read.max(timeouts.write).max(timeouts.stored_write);
        self.station
            .asked_before(now + longest + self.setup.max_lateness);
    }

    /// When a wish of its work may be granted, as far as the drive is concerned.
    pub(super) fn wanted_from(&self, want: &DriveWish) -> MonoTime {
        let station = &self.station;
        match want.rank {
            WishRank::FirstStop | WishRank::RepeatedStop => want.at.max(station.pauses_until()),
            // A read-back has a rhythm of its own: a stop waits for it.
            WishRank::Look => want
                .at
                .max(station.rests_until())
                .max(station.pauses_until())
                .max(station.unmistakable_at(&want.request)),
            rank if self.is_withheld(rank) => MonoTime::NEVER,
            WishRank::Step | WishRank::Trip | WishRank::Start => want
                .at
                .max(station.may_be_asked_from())
                .max(station.unmistakable_at(&want.request)),
        }
    }

    /// No trip is read from a station whose replies may be another drive's: it would not be trusted.
    pub(super) fn is_withheld(&self, rank: WishRank) -> bool {
        rank == WishRank::Trip && self.station.is_doubtful()
    }

    /// Whether `request` may be sent to it now: it is not in a pause, and no late reply can be mistaken for the reply.
    pub(super) fn may_be_asked(&self, now: MonoTime, request: &Request) -> bool {
        now >= self.station.may_be_asked_from() && now >= self.station.unmistakable_at(request)
    }

    /// Maximum wait for the start of its reply to `request`, and the extra time of its longer characters. After a silence
    /// the full wait applies: a drive that has become slower is not given up for that. It always applies where a device
    /// between may go on waiting for the drive, while the next request waits there.
    pub(super) fn wait_for(&self, request: &Request, line: &LineTiming) -> Duration {
        if line.may_have_converter() {
            return self.full_wait(request, line);
        }
        let Self { setup, station, .. } = self;
        let class = RequestClass::of(request, &setup.model);
        let timing = &setup.model.timing;
        let learned = self.measured.reply_times.wait(class);
        let wait = if station.is_known_silent() {
            setup.timeouts.probe(class, timing, learned)
        } else if station.is_in_question() {
            setup.timeouts.of(class)
        } else {
            setup.timeouts.in_force(class, timing, learned)
        };
        wait + setup.reply_time(request, line).1
    }

    /// Maximum wait for the start of the drive's reply to `request` before reply times are learned: the base for
    /// declared lateness.
    pub(super) fn full_wait(&self, request: &Request, line: &LineTiming) -> Duration {
        let wait = self
            .setup
            .timeouts
            .of(RequestClass::of(request, &self.setup.model));
        wait + self.setup.reply_time(request, line).1
    }

    /// How long after the end of `request` a stop for another drive need not wait any more, if nothing was received: every
    /// reply seen so far would have arrived by then, even through an adapter that delivers it only as a whole. `None` while
    /// too few were seen.
    pub(super) fn patience(&self, request: &Request, line: &LineTiming) -> Option<Duration> {
        let worst = self
            .measured
            .reply_times
            .worst(RequestClass::of(request, &self.setup.model))?;
        Some(worst + self.setup.reply_time(request, line).0 + line.silence)
    }

    /// Until when the reply to `request`, given up at `now`, may still arrive. The lateness is relative to the full wait,
    /// however short this one was.
    pub(super) fn may_come_until(
        &self,
        now: MonoTime,
        request_end: MonoTime,
        request: &Request,
        line: &LineTiming,
    ) -> MonoTime {
        let (reply, longer) = self.setup.reply_time(request, line);
        let due = request_end + self.full_wait(request, line) + (reply - longer);
        now.max(due) + self.station.lateness(self.setup.max_lateness)
    }

    /// A write was sent and has ended with `ending`: the drive may need a pause, or hear nothing for a while.
    pub(super) fn was_written(
        &mut self,
        now: MonoTime,
        request: &Request,
        ending: &ExchangeEnding,
    ) {
        let model = &self.setup.model;
        let class = RequestClass::of(request, model);
        if class == RequestClass::Read {
            return;
        }
        self.ordered_at = now;
        self.work.mark_changed();
        self.station
            .pause_until(now + model.timing.pause_after(class == RequestClass::StoredWrite));
        let deaf = request
            .written()
            .filter_map(|address| model.deaf_after(address))
            .max();
        // Without a reply it may have been taken.
        let is_refused = matches!(ending, ExchangeEnding::Exception(_));
        if let Some(deaf) = deaf
            && !is_refused
        {
            self.station.rest_until(now + deaf);
            // A stop that is sent before is sent again then.
            self.deaf_until = self.deaf_until.max(now + deaf);
        }
    }

    /// Lets the plan learn which registers the drive answers for.
    pub(super) fn tell_plan(
        &mut self,
        now: MonoTime,
        request: &Request,
        ending: &ExchangeEnding,
        effects: &mut EffectOutbox,
    ) {
        let (address, count) = match request {
            Request::Read { address, count } => (*address, *count),
            _ => (Address::default(), 0),
        };
        let plan = &mut self.plan;
        match ending {
            ExchangeEnding::Reply(_) => plan.answered(address, count),
            ExchangeEnding::Exception(code) => {
                if let Some(refused) = plan.refused((address, count), *code, &self.setup.model, now)
                {
                    effects.push_back(LineEffect::Note(
                        self.index,
                        DriveNote::RegisterRefused(refused),
                    ));
                    self.work.mark_changed();
                }
            }
            ExchangeEnding::Silent => plan.unanswered(address, count, now),
            ExchangeEnding::Garbled => {}
        }
    }

    /// The exchange failed: a late reply may follow, and a silent drive is asked less and less often.
    pub(super) fn was_not_answered(
        &mut self,
        now: MonoTime,
        fault: Fault,
        missing: impl FnOnce() -> MissingReply,
    ) {
        let what = consequence(fault);
        let station = &mut self.station;
        if what.reply_may_come_late {
            station.reply_missing(missing(), now);
        }
        if what.backs_off {
            station.silent(now);
        }
        if what.drive_is_there {
            station.is_there();
        }
    }

    /// The drive answered. That settles missing replies, unless one of them could be mistaken for this reply: then
    /// the actual reply is `still_missing`.
    pub(super) fn answered(&mut self, now: MonoTime, still_missing: Option<MissingReply>) {
        let station = &mut self.station;
        if let Some(missing) = still_missing {
            station.is_there();
            station.reply_missing(missing, now);
        } else {
            station.answered();
        }
        self.barriers.answered(now);
    }

    /// A barrier of the drive was tried.
    pub(super) fn trial_ended(&mut self, place: usize, request: &Request, ending: &ExchangeEnding) {
        let barriers = &mut self.barriers;
        match (request, ending) {
            (Request::Unserved { .. }, ExchangeEnding::Exception(_))
            | (_, ExchangeEnding::Reply(_)) => barriers.shown(place),
            (_, ExchangeEnding::Garbled) => barriers.damaged(place),
            (_, ExchangeEnding::Exception(_) | ExchangeEnding::Silent) => barriers.failed(place),
        }
    }

    pub(super) fn set_presence(
        &mut self,
        now: MonoTime,
        presence: DrivePresence,
        effects: &mut EffectOutbox,
    ) {
        if self.snapshot.presence == presence {
            return;
        }
        self.snapshot.presence = presence;
        effects.push_back(LineEffect::Presence(self.index, presence));
        effects.keep(self.index, JournalEntry::Presence(presence));
        let bases = self
            .setup
            .model
            .registers
            .iter()
            .flat_map(|register| register.form.bases());
        if presence == DrivePresence::Offline {
            self.work.out_of_sight(effects);
            self.snapshot.forget(bases);
            self.plausibility.forget();
            self.snapshot.is_implausible = !self.plausibility.holds();
        } else {
            self.plan.drive_is_back(now);
            bases.for_each(|address| self.plan.ask_for(address, now));
            self.work.mark_changed();
        }
    }
}

/// The drives of a line, in the order of the configuration.
#[derive(Debug)]
pub(super) struct LineDrives(Vec<DriveOnLine>);

impl LineDrives {
    /// The drives of `line`, with nothing known about them at `now`.
    pub(super) fn new(line: &LineSetup, budget: &PollBudget, now: MonoTime) -> Self {
        let drive = |(index, setup)| DriveOnLine::new(index, line, setup, budget, now);
        Self((0..).zip(&line.drives).map(drive).collect())
    }

    pub(super) const fn len(&self) -> usize {
        self.0.len()
    }

    /// The drive at `index`; `None` if the line has no such drive.
    pub(super) fn get(&self, index: DriveIndex) -> Option<&DriveOnLine> {
        self.0.get(index.get())
    }

    /// Mutable access to the same.
    pub(super) fn get_mut(&mut self, index: DriveIndex) -> Option<&mut DriveOnLine> {
        self.0.get_mut(index.get())
    }

    pub(super) fn iter(&self) -> std::slice::Iter<'_, DriveOnLine> {
        self.0.iter()
    }

    pub(super) fn iter_mut(&mut self) -> std::slice::IterMut<'_, DriveOnLine> {
        self.0.iter_mut()
    }

    pub(super) fn indices(&self) -> impl Iterator<Item = DriveIndex> + use<> {
        (0..u16::try_from(self.len()).unwrap_or(u16::MAX)).map(DriveIndex)
    }

    /// The work of each drive.
    pub(super) fn works(&self) -> impl Iterator<Item = &DriveWork> + Clone {
        self.0.iter().map(|drive| &drive.work)
    }

    /// Mutable access to the same.
    pub(super) fn works_mut(&mut self) -> impl Iterator<Item = &mut DriveWork> {
        self.0.iter_mut().map(|drive| &mut drive.work)
    }

    /// The drive with the number `station` on the line; `None` if it is not configured.
    pub(super) fn at_station(&self, station: Station) -> Option<DriveIndex> {
        self.0
            .iter()
            .find(|drive| drive.setup.station == station)
            .map(|drive| drive.index)
    }

    /// Whether every drive is known to be silent.
    pub(super) fn are_silent(&self) -> bool {
        self.0.iter().all(|drive| drive.station.is_known_silent())
    }
}

impl Index<DriveIndex> for LineDrives {
    type Output = DriveOnLine;

    fn index(&self, index: DriveIndex) -> &DriveOnLine {
        &self.0[index.get()]
    }
}

impl IndexMut<DriveIndex> for LineDrives {
    fn index_mut(&mut self, index: DriveIndex) -> &mut DriveOnLine {
        &mut self.0[index.get()]
    }
}
