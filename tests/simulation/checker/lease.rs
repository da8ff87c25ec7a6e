//! Stops that must be sent, leases and the shutdown: L1 and O11.

use super::Checker;
use super::log::What;
use super::tables::Action;

/// PDU bytes of the longest reply: 37 words.
const LONGEST: usize = 5 + 2 * 37;

impl Checker {
    /// The bound of a declared action: the longest exchange that may have just begun on this line with its time-out, the
    /// silence, and the stops of the other drives.
    pub fn bound(&self) -> u64 {
        let silence = self.line.silence();
        let timeout = self
            .line
            .drives
            .iter()
            .map(|it| it.timeout)
            .max()
            .unwrap_or(0);
        let longest = self.line.on_wire(8 + LONGEST) + timeout + silence;
        let stop = self.line.on_wire(16) + timeout + silence;
        longest + silence + stop * (self.line.drives.len() as u64 - 1)
    }

    /// The clients behind the broker sent a heartbeat without an order.
    pub fn sign_of_life(&mut self, at: u64) {
        self.books
            .iter_mut()
            .filter(|book| book.is_of_mqtt)
            .for_each(|book| book.sign_at = at);
    }

    /// The gateway is to shut down.
    pub fn ending(&mut self, at: u64) {
        self.log
            .add(at, What::World, 0, b"the gateway is told to end");
        self.books.iter_mut().for_each(|book| book.is_ending = true);
    }

    pub(super) fn port_changed(&mut self, at: u64, is_up: bool) {
        // A declared action has to wait for the port: its time counts from there.
        for book in &mut self.books {
            // Without a port every order ends, whatever its progress.
            book.orders.iter_mut().for_each(|it| it.is_over |= !is_up);
            book.sign_at = book.sign_at.max(at);
            book.stop_due = book.stop_due.map(|_| at + self.bound);
        }
    }

    /// Checks that the declared action has begun if heartbeats were missing for too long.
    pub fn check_leases(&mut self, at: u64) {
        if !self.wire.is_up() {
            return;
        }
        for drive in 0..self.books.len() {
            let book = &self.books[drive];
            let it = &self.line.drives[drive];
            if let Some(due) = book
                .stop_due
                .map(|due| due.max(self.wire.noise_at + self.bound))
                .filter(|due| at > *due)
            {
                let text = format!(
                    "a stop of drive {drive} should have left {} ms ago",
                    (at - due) / 1_000_000
                );
                self.object("L1", || text);
                continue;
            }
            // On a jammed line there is no bound.
            let until = (book.sign_at + it.lost_after).max(self.wire.noise_at) + self.bound;
            if book.is_running
                && !book.awaits_sight
                && book.zeros == 0
                && it.on_lost != Action::Hold
                && !book.is_ending
                && at > until
            {
                let text = format!(
                    "drive {drive} runs on {} ms after its lease ended",
                    (at - book.sign_at - it.lost_after) / 1_000_000
                );
                self.object("O11", || text);
            }
        }
    }

    /// The gateway has ended.
    pub fn ended(&mut self, at: u64) {
        for drive in 0..self.books.len() {
            let book = &self.books[drive];
            let it = &self.line.drives[drive];
            // One whose owner was lost is left as it is, if that is declared: it has no owner at the end.
            let is_held =
                it.on_lost == Action::Hold && at > book.moved_at.unwrap_or(0) + it.lost_after;
            let is_left = book.is_running && it.on_shutdown != Action::Hold && !is_held;
            if is_left && self.wire.is_up() {
                self.object("O11", || {
                    format!("the gateway ended and left drive {drive} running")
                });
            }
        }
        self.check_waiting(at);
        self.check_kept();
    }
}
