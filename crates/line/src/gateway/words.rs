//! Words that a drive has sent: what they change in its picture, its plan and its own work.

use super::drive::DriveOnLine;
use super::event::LineEffect;
use super::note::DriveNote;
use super::outbox::EffectOutbox;
use super::work::WordsOrigin;
use crate::domain::address::Address;
use crate::domain::time::MonoTime;
use crate::drive::doubt::READ_AGAIN_AFTER;
use crate::drive::plausible::PlausibilityVerdict;
use crate::profile::model::{Model, PollClass};

impl DriveOnLine {
    /// Words that the drive showed to us: the picture takes what is polled, the drive's own work the rest.
    pub(super) fn take_words(
        &mut self,
        now: MonoTime,
        read_at: MonoTime,
        read: (Address, &[u16]),
        effects: &mut EffectOutbox,
    ) {
        let (address, words) = read;
        if self
            .blank
            .doubts(&self.setup.model, &self.snapshot, read, read_at)
        {
            for place in address.onwards().take(words.len()) {
                self.plan.ask_for(place, now + READ_AGAIN_AFTER);
            }
            return;
        }
        let count = u16::try_from(words.len()).unwrap_or(u16::MAX);
        for (place, word) in address.onwards().zip(words) {
            if let Some(class) = self.setup.model.polled_at(place, address, count) {
                if class == PollClass::Fast
                    && let Some(last) = self.snapshot.reading(place)
                {
                    self.measured.aged(now.since(last.at), now);
                }
                // A reply that had to wait for the silence after it is as old as its last byte.
                self.snapshot.take(place, &[*word], read_at);
            }
        }
        if !self.is_believed(now, read, effects) {
            return;
        }
        if let Some(output) = self.work.impossible_output(address, words) {
            self.snapshot.forget([output]);
        }
        let reading = WordsOrigin {
            at: read_at,
            is_its_own: !self.station.is_doubtful(),
        };
        let changed = self.work.take_words(address, words, reading, now, effects);
        if reading.is_its_own {
            self.work.take_usage(&self.snapshot, read_at, effects);
        }
        if let Some(changed) = changed {
            self.plan.ask_for(changed, now);
        }
    }

    /// Whether the drive has shown that it is one of its model. As long as it has not, nothing follows from its words.
    fn is_believed(
        &mut self,
        now: MonoTime,
        (address, words): (Address, &[u16]),
        effects: &mut EffectOutbox,
    ) -> bool {
        match self.plausibility.take(address, words) {
            Some(PlausibilityVerdict::Holds) => self.plan.drive_is_back(now),
            Some(PlausibilityVerdict::Fails(register, held)) => {
                effects.push_back(LineEffect::Note(
                    self.index,
                    DriveNote::Implausible { register, held },
                ));
            }
            None => {}
        }
        let holds = self.plausibility.holds();
        if self.snapshot.is_implausible == holds {
            self.work.mark_changed();
        }
        self.snapshot.is_implausible = !holds;
        holds
    }

    /// Words that a client's read brought. Each poll group that lies in it was read in one frame, as a poll reads it, and
    /// counts as polled. Of a group that was read in part nothing is taken: its words belong together.
    pub(super) fn take_read(
        &mut self,
        now: MonoTime,
        read_at: MonoTime,
        read: (Address, &[u16]),
        effects: &mut EffectOutbox,
    ) {
        let (mut address, mut words) = read;
        while !words.is_empty() {
            let (run, next) = run_from(&self.setup.model, address, words.len());
            let (here, others) = words.split_at(run);
            let count = u16::try_from(run).unwrap_or(u16::MAX);
            for group in self.plan.was_read(address, count, read_at) {
                let polled = group
                    .address
                    .offset_from(address)
                    .map(usize::from)
                    .and_then(|first| {
                        let end = first.checked_add(group.count.into())?;
                        here.get(first..end)
                    });
                if let Some(polled) = polled {
                    self.take_words(now, read_at, (group.address, polled), effects);
                }
            }
            (address, words) = (next, others);
        }
    }
}

/// How many of `words` words from `address` on have consecutive addresses as the drive counts them, at least 1, and the
/// address after those.
fn run_from(model: &Model, address: Address, words: usize) -> (usize, Address) {
    let mut next = model.next_address(address);
    let mut run = 1;
    let mut last = address;
    while run < words && last.checked_add(1) == Some(next) {
        (last, next) = (next, model.next_address(next));
        run += 1;
    }
    (run, next)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::vendors;

    #[test]
    fn a_run_ends_where_the_drive_counts_on_in_decimal_digits() {
        let catalog = vendors::catalog();
        let at = Address::holding;
        let run = |model: &str, address, words| {
            run_from(catalog.find(model).unwrap(), at(address), words)
        };
        let (decimal, plain) = ("toshiba-vf-s15", "hyundai-n700");
        assert_eq!(run(plain, 0xFE08, 12), (12, at(0xFE14)));
        assert_eq!(run(decimal, 0xFE08, 12), (2, at(0xFE10)));
        assert_eq!(run(decimal, 0xFE10, 10), (10, at(0xFE20)));
        assert_eq!(run(decimal, 0xFE09, 2), (1, at(0xFE10)));
        assert_eq!(run(decimal, 0xFE99, 2), (1, at(0xFF00)));
        assert_eq!(run(plain, 0xFFFF, 1).0, 1);
    }
}
