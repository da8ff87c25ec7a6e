//! What is written and why: O1 and O2. Each word belongs to one order, to a stop, or to a declared action.

use super::Checker;
use super::book::Order;
use super::tables::{Action, Run};
use super::wire::{Exchange, Truth};

/// A stop that the drive has answered this often since it was requested is no longer repeated, except once for each
/// [`REPEATED_EVERY`]: after bursts and strays its echoes may be in doubt, and its state may be unknown for long.
const REPEATS: u32 = 16;
const REPEATED_EVERY: u64 = 3_000_000_000;
/// Most stops that take back a reset word that the drive keeps.
const TAKEN_BACK_EVERY: u64 = 1_000_000_000;
/// A reset that has begun ends within this time.
const RESET_TAKES: u64 = 10_000_000_000;

impl Checker {
    /// A write of ours was sent.
    pub(super) fn written(&mut self, exchange: &Exchange) {
        let Some(drive) = self
            .line
            .drives
            .iter()
            .position(|it| it.station == exchange.station)
        else {
            return;
        };
        self.counts.writes += 1;
        self.settle_stops(drive);
        let facts = self.line.drives[drive].kind.facts();
        let is_taken = matches!(exchange.truth, Truth::Holds(word) if word == exchange.values[0]);
        for place in 0..exchange.count {
            let address = exchange.address.wrapping_add(place);
            let value = exchange.values[usize::from(place)];
            let is_explained = if address == facts.run {
                match facts.run_of(value) {
                    Some(run @ (Run::Forward | Run::Reverse)) => {
                        self.run_sent(drive);
                        self.explain(exchange.at, drive, is_taken, run_part(run))
                    }
                    Some(Run::Stop | Run::Coast) => {
                        self.stop_sent(exchange.at, drive);
                        let is_explained = self.explain_stop(exchange, drive, value, is_taken);
                        let book = &mut self.books[drive];
                        book.stop_due = None;
                        book.remembered_stop = false;
                        is_explained
                    }
                    Some(Run::Reset) => self.explain_reset(drive, exchange.at, value, is_taken),
                    None => false,
                }
            } else if address == facts.setpoint {
                let is_explained = self.explain(exchange.at, drive, is_taken, setpoint_part(value));
                if is_taken {
                    self.books[drive].setpoint_taken = Some(value);
                }
                is_explained
            } else {
                self.explain(exchange.at, drive, is_taken, register_part(address, value))
            };
            if !is_explained {
                let old = self.old_order(drive, address, value, exchange.at);
                let rule = match old {
                    Some(_) => "M2",
                    None if self.books[drive].stop.is_pending => "O2",
                    None => "O1",
                };
                let text = format!(
                    "{value:04X} to {address:04X} of drive {drive} belongs to no order{}: {:?}",
                    old.map_or_else(String::new, |age| format!(
                        " but to one that does not count, issued {} ms before",
                        age / 1_000_000
                    )),
                    self.books[drive]
                );
                self.object(rule, || text);
            }
        }
    }

    /// The age of an order that this would belong to if it were not too old.
    fn old_order(&self, drive: usize, address: u16, value: u16, at: u64) -> Option<u64> {
        let facts = self.line.drives[drive].kind.facts();
        let run = (address == facts.run)
            .then(|| facts.run_of(value))
            .flatten();
        let is_it = |it: &&Order| {
            let is_setpoint = address == facts.setpoint && it.wish.setpoint == Some(value);
            it.issued_old.is_some() && (is_setpoint || (run.is_some() && it.wish.run == run))
        };
        let issued = self.books[drive]
            .orders
            .iter()
            .rev()
            .find(is_it)
            .and_then(|it| it.issued_old)?;
        Some(at.saturating_sub(issued))
    }

    /// Finds the order that a written part belongs to.
    fn explain(
        &mut self,
        at: u64,
        drive: usize,
        is_taken: bool,
        mut part: impl FnMut(&mut Order) -> bool,
    ) -> bool {
        let book = &mut self.books[drive];
        let is_fit = |it: &Order| !it.is_void && !it.is_over && (it.sent > 0 || at < it.before);
        let Some(place) = book.orders.iter_mut().position(|it| is_fit(it) && part(it)) else {
            return false;
        };
        let order = &mut book.orders[place];
        order.sent += 1;
        order.taken += u32::from(is_taken);
        // A register without a role takes no control and moves nothing.
        if order.wish.run.is_some() || order.wish.setpoint.is_some() {
            book.is_of_mqtt |= order.is_message;
            book.moved_at = book.moved_at.max(Some(order.at));
        }
        let run = order.wish.run.filter(|_| order.has_run);
        if let Some(run) = run
            && is_taken
        {
            book.run_taken = Some(run);
            book.is_running = true;
            book.zeros = 0;
        }
        true
    }

    fn explain_reset(&mut self, drive: usize, at: u64, value: u16, is_taken: bool) -> bool {
        let words = self.line.drives[drive].kind.facts().reset;
        let book = &mut self.books[drive];
        let is_next = |it: &Order| {
            it.wish.run == Some(Run::Reset)
                && !it.is_over
                && words.get(it.reset_step) == Some(&value)
        };
        let is_fit = |it: &Order| it.sent == 0 && !it.is_void && at < it.before;
        // One that has begun continues; otherwise it is the oldest that waits.
        let begun = book
            .orders
            .iter()
            .rposition(|it| it.sent > 0 && !it.is_void && is_next(it) && at < it.at + RESET_TAKES);
        let place = begun.or_else(|| book.orders.iter().position(|it| is_next(it) && is_fit(it)));
        let Some(order) = place.and_then(|place| book.orders.get_mut(place)) else {
            return false;
        };
        order.reset_step += 1;
        order.sent += 1;
        order.taken += u32::from(is_taken);
        book.is_running = false;
        true
    }

    fn explain_stop(
        &mut self,
        exchange: &Exchange,
        drive: usize,
        value: u16,
        is_taken: bool,
    ) -> bool {
        let it = self.line.drives[drive];
        let facts = it.kind.facts();
        let turns = self.motors[drive].is_running();
        let is_coast = facts.run_of(value) == Some(Run::Coast);
        let action = if is_coast {
            Action::Coast
        } else {
            Action::Stop
        };
        let book = &mut self.books[drive];
        let was_running = std::mem::take(&mut book.is_running) && book.zeros == 0;
        if is_taken {
            book.run_taken = facts.run_of(value);
        }
        // An order that was accepted and never sent has taken the lease as well.
        let waited = book
            .orders
            .iter()
            .filter(|it| it.wish.run.is_some() || it.wish.setpoint.is_some())
            .map(|it| it.at);
        let is_over = |ordered: u64| exchange.at >= ordered + it.lost_after;
        let is_over = |ordered: u64| book.is_orphaned || is_over(ordered);
        let is_lost = it.on_lost == action && book.moved_at.into_iter().chain(waited).any(is_over);
        let is_ending = book.is_ending && it.on_shutdown == action;
        let has_moved = book.moved_at > book.stop.was_accepted_at;
        // A reset begins with a stop as well, but never while the motor turns. One that was accepted at the very end goes on.
        let may_reset = is_ending || self.motors[drive].stands();
        if may_reset && !is_coast && self.explain_reset(drive, exchange.at, value, is_taken) {
            return true;
        }
        let book = &mut self.books[drive];
        if !book.stop.is_pending && ((is_lost && has_moved && was_running) || is_ending) {
            book.fresh.push((u64::MAX, exchange.at, is_coast));
            self.settle_stops(drive);
            return true;
        }
        if !is_coast
            && (self.explain_reset(drive, exchange.at, value, is_taken)
                || self.repeats_end_of_reset(drive, exchange.at, value)
                || self.takes_back(drive, exchange.at))
        {
            return true;
        }
        let book = &mut self.books[drive];
        if book.stop.is_pending && book.stop.is_coast == is_coast {
            return true;
        }
        if let Some((number, at)) = book
            .may_stop
            .filter(|(_, at)| Some(*at) > book.stop.was_accepted_at)
        {
            book.may_stop = None;
            book.fresh.push((number, at, is_coast));
            self.settle_stops(drive);
            return true;
        }
        // Until it is answered correctly and without doubt, it is repeated at its rate.
        let since = exchange.at.saturating_sub(book.last_stop_at);
        let repeats = REPEATS + u32::try_from(since / REPEATED_EVERY).unwrap_or(u32::MAX - REPEATS);
        let is_explained = is_lost || (book.asked[usize::from(is_coast)] && book.echoes <= repeats);
        // One that was answered from memory, and is sent after all because the motor turns, is new.
        if is_explained && (has_moved || (turns && !book.stop.is_pending)) {
            book.fresh.push((u64::MAX, exchange.at, is_coast));
            self.settle_stops(drive);
        }
        is_explained
    }

    /// Whether a stop that is written at `at` takes a reset back. One that was ordered just before is that stop as well, and
    /// the next one that takes a reset back is not too soon after it.
    fn takes_back(&mut self, drive: usize, at: u64) -> bool {
        let before = self.motors[drive].clone();
        let takes_back = self.motors[drive].takes_back(at, TAKEN_BACK_EVERY, self.stood.1);
        if at <= self.books[drive].last_stop_at + self.bound {
            self.motors[drive] = before;
        }
        takes_back
    }

    /// The stop that ends a reset is sent up to four times. If the drive has not accepted it, it is sent again whenever
    /// the motor is seen at standstill: the reset word must not stay.
    fn repeats_end_of_reset(&mut self, drive: usize, at: u64, value: u16) -> bool {
        let words = self.line.drives[drive].kind.facts().reset;
        let book = &mut self.books[drive];
        let is_last = |it: &&mut Order| {
            let is_left = at >= it.at + RESET_TAKES && it.taken as usize == words.len();
            it.wish.run == Some(Run::Reset) && it.reset_step == words.len() && !is_left
        };
        let Some(order) = book.orders.iter_mut().rev().find(is_last) else {
            return false;
        };
        order.sent += 1;
        words.last() == Some(&value) && order.sent as usize <= words.len() + 3
    }
}

fn run_part(run: Run) -> impl FnMut(&mut Order) -> bool {
    move |it| {
        let is_it = it.wish.run == Some(run) && !it.has_run;
        it.has_run |= is_it;
        is_it
    }
}

fn setpoint_part(value: u16) -> impl FnMut(&mut Order) -> bool {
    move |it| {
        let is_it = it.wish.setpoint == Some(value) && !it.has_setpoint;
        it.has_setpoint |= is_it;
        is_it
    }
}

fn register_part(address: u16, value: u16) -> impl FnMut(&mut Order) -> bool {
    move |it| {
        let is_it = it.wish.register == Some((address, value)) && !it.has_register;
        it.has_register |= is_it;
        is_it
    }
}
