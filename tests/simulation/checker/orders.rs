//! What is ordered of drives: O1, O2, O4 and O8. A book for each drive says what may stand on the wire and why.

use super::Checker;
use super::clients::Ask;
use super::tables::{Action, Facts, Run};
use super::wire::{Exchange, Truth};

/// A command without a deadline of its own leaves within this time or never.
pub const DEADLINE: u64 = 1_000_000_000;
/// Orders that are remembered for a drive.
const ORDERS: usize = 48;
/// After so long nothing of an order can follow.
const FORGOTTEN: u64 = 60_000_000_000;
/// A stop that the drive has answered this often since anybody asked for one goes no more: an echo may be in doubt.
const REPEATS: u32 = 5;
/// Within this time a reset that has begun is over.
const RESET_TAKES: u64 = 10_000_000_000;
/// How long after a stop its frame may be one more of the same.
const REPEATED_FOR: u64 = 30_000_000_000;

/// What one request orders.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Wish {
    pub run: Option<Run>,
    /// In 0.01 Hz.
    pub setpoint: Option<u16>,
    /// A listed register with its word.
    pub register: Option<(u16, u16)>,
}

/// One order.
#[derive(Clone, Copy, Debug)]
pub struct Order {
    pub number: u64,
    pub wish: Wish,
    pub at: u64,
    /// Its first frame leaves before this moment or never.
    pub before: u64,
    /// Frames of it so far, and how many of them the drive took.
    pub sent: u32,
    pub taken: u32,
    has_run: bool,
    has_setpoint: bool,
    has_register: bool,
    /// Words of a reset that went out.
    reset_step: usize,
    /// A stop came after it, or was pending when it came.
    pub is_void: bool,
    is_over: bool,
    /// It came over MQTT.
    pub is_message: bool,
}

/// The stop of a drive.
#[derive(Clone, Copy, Debug, Default)]
struct Stop {
    /// It was accepted, or the declared action began, and no effect was shown.
    is_pending: bool,
    was_accepted_at: Option<u64>,
    is_coast: bool,
    /// The drive took it, in an exchange that was heard.
    echoed: bool,
    last_output: Option<u16>,
    zeros: u32,
}

/// What is known of one drive.
#[derive(Debug, Default)]
pub struct Book {
    orders: Vec<Order>,
    stop: Stop,
    /// Stops that came at this very moment and may turn out to change nothing.
    fresh: Vec<(u64, u64, bool)>,
    /// What the drive took last.
    run_taken: Option<Run>,
    setpoint_taken: Option<u16>,
    /// The last order of which a frame went out came at this moment.
    pub moved_at: Option<u64>,
    /// Anybody's last sign of life.
    pub sign_at: u64,
    /// The drive took RUN, and was not seen at rest since.
    pub is_running: bool,
    pub zeros: u32,
    /// When anybody's stop came last, whether a stop or a coast ever came, and how often one was answered since.
    last_stop_at: u64,
    asked: [bool; 2],
    echoes: u32,
    /// A stop came that perhaps changed nothing.
    may_stop: Option<(u64, u64)>,
    pub is_ending: bool,
    /// The last order of which a frame went out came over MQTT.
    pub is_of_mqtt: bool,
    /// When the last stop came that was a new one, and until when its frame must have left.
    pub stopped_at: Option<u64>,
    pub stop_due: Option<u64>,
    /// True readings of the output frequency with their moments, newest last.
    pub readings: [(u16, u64); 24],
    pub reading: usize,
}

/// The wish in a write to a drive's own registers.
pub fn of_native(facts: &Facts, pdu: &[u8]) -> Option<Wish> {
    let word = |at: usize| pdu.get(at..at + 2).map(|it| u16::from_be_bytes([it[0], it[1]]));
    let (address, values) = match (pdu[0], pdu.len()) {
        (6, 5) => (word(1)?, [word(3), None]),
        (16, 8) => (word(1)?, [word(6), None]),
        (16, 10) => (word(1)?, [word(6), word(8)]),
        _ => return None,
    };
    let mut wish = Wish::default();
    for (address, value) in (address..).zip(values.into_iter().flatten()) {
        match address {
            it if it == facts.run => wish.run = Some(facts.run_of(value)?),
            it if it == facts.setpoint => wish.setpoint = Some(value),
            it if it == facts.listed => wish.register = Some((it, value)),
            _ => return None,
        }
    }
    Some(wish)
}

/// The wish in a write to a uniform unit.
pub fn of_uniform(pdu: &[u8]) -> Option<Wish> {
    let word = |at: usize| pdu.get(at..at + 2).map(|it| u16::from_be_bytes([it[0], it[1]]));
    let run = |value| {
        let table = [Run::Stop, Run::Forward, Run::Reverse, Run::Coast, Run::Reset];
        table.get(usize::from(value)).copied()
    };
    let mut wish = Wish::default();
    match (pdu[0], word(1)?) {
        (5, coil @ 0..=3) => {
            wish.run = match (coil, word(3)? != 0) {
                (0, true) => Some(Run::Forward),
                (1, true) => Some(Run::Reverse),
                (0 | 1, false) | (3, true) => Some(Run::Stop),
                (2, true) => Some(Run::Reset),
                // Reset taken back orders nothing.
                _ => return Some(wish),
            }
        }
        (6, 256) => wish.run = Some(run(word(3)?)?),
        (6, 257) => wish.setpoint = word(3),
        (6, 258) => {}
        (16, 256) => {
            wish.run = Some(run(word(6)?)?);
            wish.setpoint = word(8);
        }
        (16, 257) => wish.setpoint = word(6),
        _ => return None,
    }
    Some(wish)
}

impl Checker {
    /// A client orders something of `drive`.
    pub(super) fn order(&mut self, at: u64, _who: usize, drive: usize, wish: impl Fn(&Facts) -> Option<Wish>) -> Ask {
        let it = &self.line.drives[drive];
        match wish(it.kind.facts()).filter(|_| it.has_control) {
            Some(wish) => Ask::Order { drive, order: self.take_order(at, drive, wish, at + DEADLINE, true) },
            None => Ask::Never,
        }
    }

    /// Notes an order. One that is `cyclic` may turn out to change nothing.
    pub(super) fn take_order(&mut self, at: u64, drive: usize, wish: Wish, before: u64, cyclic: bool) -> u64 {
        self.order_count += 1;
        let number = self.order_count;
        let book = &mut self.books[drive];
        book.sign_at = at;
        if let Some(kind @ (Run::Stop | Run::Coast)) = wish.run {
            if self.line.drives[drive].kind.facts().word_of(kind).is_none() {
                return number;
            }
            (book.last_stop_at, book.echoes) = (at, 0);
            book.asked[usize::from(kind == Run::Coast)] = true;
            // Beside a stop that changes nothing, a setpoint counts.
            let is_only_setpoint = cyclic && kind == Run::Stop && wish.setpoint.is_some() && book.may_be_stopped(at);
            if !is_only_setpoint {
                book.fresh.push((number, at, kind == Run::Coast));
                if !cyclic {
                    self.settle_stops(drive);
                }
                return number;
            }
            book.may_stop.get_or_insert((number, at));
        }
        if book.orders.len() >= ORDERS {
            book.orders.retain(|it| !it.is_over && at < it.at + FORGOTTEN);
            if book.orders.len() >= ORDERS {
                book.orders.remove(0);
            }
        }
        let is_void = book.stop.is_pending && wish.register.is_none();
        let order = Order {
            number,
            wish,
            at,
            before,
            sent: 0,
            taken: 0,
            has_run: false,
            has_setpoint: false,
            has_register: false,
            reset_step: 0,
            is_void,
            is_over: false,
            is_message: !cyclic,
        };
        book.orders.push(order);
        number
    }

    /// A client orders all drives to stop. Of a drive that is stopped only its frame tells whether that changed something.
    pub(super) fn stop_all(&mut self, at: u64) -> u64 {
        self.order_count += 1;
        for (book, _) in self.books.iter_mut().zip(&self.line.drives).filter(|(_, drive)| drive.has_control) {
            (book.sign_at, book.last_stop_at, book.asked[0], book.echoes) = (at, at, true, 0);
            if book.may_be_stopped(at) {
                book.may_stop.get_or_insert((self.order_count, at));
            } else {
                book.fresh.push((self.order_count, at, false));
            }
        }
        self.order_count
    }

    /// All drives were told to stop, and that is answered.
    pub(super) fn all_stopped(&mut self, number: u64) {
        self.books.iter_mut().for_each(|book| book.fresh.retain(|(it, ..)| *it != number));
    }

    /// Stops that came and were not answered from memory at once are new ones.
    pub(super) fn settle_stops(&mut self, drive: usize) {
        let book = &mut self.books[drive];
        for (number, at, is_coast) in book.fresh.drain(..) {
            if !book.stop.is_pending && number < u64::MAX {
                book.stopped_at = Some(at);
            }
            // Another one of the same kind may go on at its rate; that of a drive that was started since goes at once.
            if number < u64::MAX && book.is_running {
                book.stop_due = Some(at + self.bound);
            }
            // Another one of the same kind is the same, and what the drive has answered to it counts.
            let is_young = book.stop.was_accepted_at.is_some_and(|before| at < before + REPEATED_FOR);
            let has_moved = book.moved_at > book.stop.was_accepted_at;
            let is_same = is_young && !has_moved && book.stop.is_coast == is_coast;
            book.stop = Stop {
                echoed: book.stop.echoed && is_same,
                zeros: if is_same { book.stop.zeros } else { 0 },
                is_pending: true,
                was_accepted_at: Some(at),
                is_coast,
                last_output: book.stop.last_output,
                ..Stop::default()
            };
            // What came after it and moves nothing goes on, and whether it came after is not always known.
            book.orders.iter_mut().for_each(|it| it.is_void |= it.wish.register.is_none());
        }
    }

    /// Nothing may follow from this order.
    pub(super) fn void_order(&mut self, drive: usize, number: u64) {
        let orders = &mut self.books[drive].orders;
        orders.iter_mut().filter(|it| it.number == number).for_each(|it| it.is_void = true);
    }

    /// The one who ordered is gone before he was told. Only its frame tells whether a stop changed something.
    pub(super) fn nobody_is_told(&mut self, drive: usize, number: u64) {
        let book = &mut self.books[drive];
        if let Some(place) = book.fresh.iter().position(|(it, ..)| *it == number) {
            let (_, at, _) = book.fresh.remove(place);
            book.may_stop.get_or_insert((number, at));
        }
    }

    /// A write of ours went out.
    pub(super) fn written(&mut self, exchange: &Exchange) {
        let Some(drive) = self.line.drives.iter().position(|it| it.station == exchange.station) else { return };
        self.counts.writes += 1;
        self.settle_stops(drive);
        let facts = self.line.drives[drive].kind.facts();
        let is_taken = matches!(exchange.truth, Truth::Holds(word) if word == exchange.values[0]);
        for place in 0..exchange.count {
            let (address, value) = (exchange.address.wrapping_add(place), exchange.values[usize::from(place)]);
            let is_explained = if address == facts.run {
                match facts.run_of(value) {
                    Some(run @ (Run::Forward | Run::Reverse)) => {
                        self.explain(exchange.at, drive, is_taken, run_part(run))
                    }
                    Some(Run::Stop | Run::Coast) => {
                        let is_explained = self.explain_stop(exchange, drive, value, is_taken);
                        self.books[drive].stop_due = None;
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
                let rule = if self.books[drive].stop.is_pending { "O2" } else { "O1" };
                let text = format!(
                    "{value:04X} to {address:04X} of drive {drive} belongs to no order: {:?}",
                    self.books[drive]
                );
                self.object(rule, || text);
            }
        }
    }

    /// Finds the order that a written part belongs to.
    fn explain(&mut self, at: u64, drive: usize, is_taken: bool, mut part: impl FnMut(&mut Order) -> bool) -> bool {
        let book = &mut self.books[drive];
        let is_fit = |it: &Order| !it.is_void && !it.is_over && (it.sent > 0 || at < it.before);
        let Some(place) = book.orders.iter_mut().position(|it| is_fit(it) && part(it)) else { return false };
        let order = &mut book.orders[place];
        order.sent += 1;
        order.taken += u32::from(is_taken);
        book.is_of_mqtt = order.is_message;
        let (moved_at, run) = (order.at, order.wish.run.filter(|_| order.has_run));
        book.moved_at = book.moved_at.max(Some(moved_at));
        if let Some(run) = run
            && is_taken
        {
            (book.run_taken, book.is_running, book.zeros) = (Some(run), true, 0);
        }
        true
    }

    fn explain_reset(&mut self, drive: usize, at: u64, value: u16, is_taken: bool) -> bool {
        let words = self.line.drives[drive].kind.facts().reset;
        let book = &mut self.books[drive];
        let is_next =
            |it: &Order| it.wish.run == Some(Run::Reset) && !it.is_over && words.get(it.reset_step) == Some(&value);
        let is_fit = |it: &Order| it.sent > 0 || (!it.is_void && at < it.before);
        // One that has begun goes on; else it is the oldest that waits.
        let begun =
            book.orders.iter().rposition(|it| it.sent > 0 && !it.is_void && is_next(it) && at < it.at + RESET_TAKES);
        let place = begun.or_else(|| book.orders.iter().position(|it| is_next(it) && is_fit(it)));
        let Some(order) = place.and_then(|place| book.orders.get_mut(place)) else { return false };
        order.reset_step += 1;
        order.sent += 1;
        order.taken += u32::from(is_taken);
        book.is_running = false;
        true
    }

    fn explain_stop(&mut self, exchange: &Exchange, drive: usize, value: u16, is_taken: bool) -> bool {
        let it = self.line.drives[drive];
        let facts = it.kind.facts();
        let is_coast = facts.run_of(value) == Some(Run::Coast);
        let action = if is_coast { Action::Coast } else { Action::Stop };
        let book = &mut self.books[drive];
        book.is_running = false;
        if is_taken {
            book.run_taken = facts.run_of(value);
        }
        if !is_coast
            && (self.explain_reset(drive, exchange.at, value, is_taken)
                || self.repeats_end_of_reset(drive, exchange.at, value))
        {
            return true;
        }
        let book = &mut self.books[drive];
        if book.stop.is_pending && book.stop.is_coast == is_coast {
            return true;
        }
        if let Some((number, at)) = book.may_stop.filter(|(_, at)| Some(*at) > book.stop.was_accepted_at) {
            book.may_stop = None;
            book.fresh.push((number, at, is_coast));
            self.settle_stops(drive);
            return true;
        }
        // An order that was accepted and never sent has taken the lease as well.
        let waited =
            book.orders.iter().filter(|it| it.wish.run.is_some() || it.wish.setpoint.is_some()).map(|it| it.at);
        let is_over = |ordered: u64| exchange.at >= ordered + it.lost_after;
        let is_lost = it.on_lost == action && book.moved_at.into_iter().chain(waited).any(is_over);
        let is_ending = book.is_ending && it.on_shutdown == action;
        let has_moved = book.moved_at > book.stop.was_accepted_at;
        if (is_lost && has_moved) || is_ending {
            book.fresh.push((u64::MAX, exchange.at, is_coast));
            self.settle_stops(drive);
            return true;
        }
        // Until it is answered as it should be, and that is in no doubt, it goes on at its rate.
        is_lost || (book.asked[usize::from(is_coast)] && book.echoes <= REPEATS)
    }

    /// The stop that ends a reset goes up to four times.
    fn repeats_end_of_reset(&mut self, drive: usize, at: u64, value: u16) -> bool {
        let words = self.line.drives[drive].kind.facts().reset;
        let book = &mut self.books[drive];
        let is_last = |it: &&mut Order| {
            it.wish.run == Some(Run::Reset) && it.reset_step == words.len() && at < it.at + RESET_TAKES
        };
        let Some(order) = book.orders.iter_mut().rev().find(is_last) else { return false };
        order.sent += 1;
        words.last() == Some(&value) && order.sent as usize <= words.len() + 3
    }

    /// A request that may have ordered something is answered with an exception.
    pub(super) fn order_excepted(&mut self, at: u64, drive: usize, number: u64, code: u8) {
        let lost_after = self.line.drives[drive].lost_after;
        let book = &mut self.books[drive];
        book.fresh.retain(|(it, ..)| *it != number || matches!(code, 4 | 0x0B));
        let Some(order) = book.orders.iter_mut().find(|it| it.number == number) else { return };
        let is_refused = matches!(code, 1 | 2 | 3 | 6);
        order.is_over |= is_refused || code == 4;
        // What a stop or the end of a lease has cut is told so, also when a frame of it is out.
        let is_lost = at >= order.at + lost_after;
        if is_refused && order.sent > 0 && !order.is_void && book.last_stop_at < order.at && !book.is_ending && !is_lost
        {
            let text = format!("refused with {code:02X} after {} frames: {order:?}", order.sent);
            self.object("O8", || text);
        }
    }

    /// A request that ordered something is answered as done.
    pub(super) fn order_succeeded(&mut self, _at: u64, drive: usize, number: u64) {
        let book = &mut self.books[drive];
        if let Some(place) = book.fresh.iter().position(|(it, ..)| *it == number) {
            // It changed nothing, or joined a stop that was answered.
            book.fresh.remove(place);
            return;
        }
        let Some(order) = book.orders.iter_mut().find(|it| it.number == number) else {
            return self.stop_succeeded(drive);
        };
        order.is_over = true;
        let order = *order;
        let wish = order.wish;
        let is_motion = matches!(wish.run, Some(Run::Forward | Run::Reverse));
        let is_stop = matches!(wish.run, Some(Run::Stop | Run::Coast));
        let is_in_force = (!is_motion || order.has_run || wish.run == book.run_taken)
            && wish.setpoint.is_none_or(|it| order.has_setpoint || Some(it) == book.setpoint_taken || is_stop);
        let ends_reset = wish.run == Some(Run::Reset);
        // Where a write stayed without an answer, only what the drive shows afterwards counts.
        let shown = self.wire.newest().filter(|it| it.station == self.line.drives[drive].station && it.function == 3);
        let shown = shown.filter(|it| it.is_true).map(|it| it.words[0]);
        let is_shown = match (wish.register, wish.setpoint) {
            (Some((_, word)), _) => shown == Some(word),
            (None, Some(word)) if !is_motion => shown == Some(word),
            _ => shown.is_some(),
        };
        let is_taken = order.taken == order.sent || (ends_reset && order.taken > 0) || is_shown;
        if !(is_in_force && is_taken) {
            let text = format!(
                "told as done, but the drive did not take it: {order:?}, {:?} {:?}",
                book.run_taken, book.setpoint_taken
            );
            self.object("O4", || text);
        }
    }

    fn stop_succeeded(&mut self, drive: usize) {
        let book = &self.books[drive];
        let is_taken = matches!(book.run_taken, Some(Run::Stop | Run::Coast)) || book.stop.echoed;
        if !is_taken && book.stop.is_pending {
            let text = format!("a stop is told as done that drive {drive} did not take: {:?}", book.stop);
            self.object("O4", || text);
        }
    }

    /// A reply was heard.
    pub(super) fn answered(&mut self, at: u64, exchange: &Exchange) {
        let Some(drive) = self.line.drives.iter().position(|it| it.station == exchange.station) else { return };
        if !exchange.is_true {
            self.counts.mistakable += 1;
            return;
        }
        let facts = self.line.drives[drive].kind.facts();
        self.counts.replies += 1;
        let book = &mut self.books[drive];
        match (exchange.function, exchange.truth) {
            (3, Truth::Words(_)) => {
                let word = |register: u16| {
                    let offset = register.checked_sub(exchange.address).filter(|it| *it < exchange.count)?;
                    Some(exchange.words[usize::from(offset)])
                };
                if let Some(output) = word(facts.output) {
                    book.shows_output(at, output);
                }
                if let Some((register, is_running)) = facts.status
                    && let Some(status) = word(register)
                {
                    book.shows_status(is_running(status));
                }
            }
            (6, Truth::Holds(value)) if exchange.address == facts.run && value == exchange.values[0] => {
                let is_stop = matches!(facts.run_of(value), Some(Run::Stop | Run::Coast));
                book.echoes += u32::from(is_stop);
                book.stop.echoed |= is_stop;
            }
            _ => {}
        }
    }
}

impl Book {
    /// A stop may be in force already: the drive took one, and no order to run could still be sent. What came at this
    /// very moment may have been refused, which is not known before the end of the moment.
    fn may_be_stopped(&self, at: u64) -> bool {
        let may_come = |it: &Order| if it.sent > 0 { !it.has_run } else { at < it.before };
        let starts = |it: &Order| matches!(it.wish.run, Some(Run::Forward | Run::Reverse));
        let is_open = |it: &Order| !it.is_over && !it.is_void && starts(it) && it.at < at;
        let is_ordered = self.orders.iter().any(|it| is_open(it) && may_come(it));
        let is_stopped = !matches!(self.run_taken, Some(Run::Forward | Run::Reverse)) || self.zeros >= 2;
        !self.stop.is_pending && is_stopped && !is_ordered
    }

    fn shows_output(&mut self, at: u64, output: u16) {
        self.readings[self.reading % 24] = (output, at);
        self.reading += 1;
        self.zeros = if output == 0 { self.zeros + 1 } else { 0 };
        self.is_running &= self.zeros < 2;
        let stop = &mut self.stop;
        stop.zeros = if output == 0 { stop.zeros + 1 } else { 0 };
        let falls = stop.last_output.is_some_and(|last| output < last);
        stop.last_output = Some(output);
        if stop.zeros >= 2 {
            // A drive that was out of sight is read first, and at standstill there is nothing to stop.
            self.stop_due = None;
        }
        if stop.zeros >= 2 || (stop.echoed && (output == 0 || falls)) {
            stop.is_pending = false;
        }
    }

    fn shows_status(&mut self, is_running: bool) {
        if !is_running && self.stop.echoed {
            self.stop.is_pending = false;
        }
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
