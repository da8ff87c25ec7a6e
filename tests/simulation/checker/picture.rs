//! Answers from memory: O13.

use super::Checker;
use super::wire::Truth;

/// A measurement is stale after this many of its poll periods.
const PERIODS: u64 = 3;
/// The value of an unknown unsigned word of the uniform map.
const ABSENT: u16 = 0xFFFF;
/// The output frequency in the uniform map, 0.01 Hz.
const OUTPUT: u16 = 4;

impl Checker {
    /// Checks that the output frequency, if it is among the words that a client received, is one that the drive gave
    /// recently.
    pub(super) fn check_picture(
        &mut self,
        at: u64,
        drive: usize,
        address: u16,
        count: u16,
        pdu: &[u8],
    ) {
        if pdu.len() != 2 + 2 * usize::from(count) {
            return self.object("O3", || {
                format!("{count} words were asked for, {} bytes came", pdu.len())
            });
        }
        self.check_run_state(at, drive, address, count, pdu);
        let Some(offset) = OUTPUT.checked_sub(address).filter(|offset| *offset < count) else {
            return;
        };
        let place = 2 + 2 * usize::from(offset);
        let word = u16::from_be_bytes([pdu[place], pdu[place + 1]]);
        self.shown(at, drive, word);
    }

    /// A client reads `word` as the output frequency of `drive`.
    pub(super) fn shown(&mut self, at: u64, drive: usize, word: u16) {
        if word == ABSENT {
            return;
        }
        self.counts.pictures += 1;
        let age = PERIODS * self.line.drives[drive].poll;
        let readings = &self.books[drive].readings;
        let is_fresh =
            |(output, moment): &(u16, u64)| *output == word && *moment > 0 && at < moment + age;
        if !readings.iter().any(is_fresh) && !self.gave_late(at, drive, word, age) {
            let text =
                format!("{word} as the output of drive {drive}, which gave {readings:?} (ns)");
            self.object("O13", || text);
        }
    }

    /// Whether the drive gave this output in a reply that was too late for its own request: the next exchange, with the
    /// same request, may have accepted it.
    fn gave_late(&self, at: u64, drive: usize, word: u16, age: u64) -> bool {
        let it = &self.line.drives[drive];
        let output = it.kind.facts().output;
        let exchanges = (0..)
            .map_while(|back| self.wire.back(back))
            .take_while(|it| at < it.at + age);
        let mut replies =
            exchanges.filter(|exchange| (exchange.station, exchange.function) == (it.station, 3));
        replies.any(|exchange| {
            let offset = output
                .checked_sub(exchange.address)
                .filter(|offset| *offset < exchange.count);
            matches!(exchange.truth, Truth::Words(_))
                && offset.is_some_and(|offset| exchange.words[usize::from(offset)] == word)
        })
    }
}
