//! Counts of what has happened in a world.

use super::checker::Counts;
use super::trouble::Trouble;

/// The counts.
#[derive(Clone, Copy, Debug, Default)]
pub struct Tally {
    pub worlds: u64,
    pub exchanges: u64,
    pub virtual_ns: u64,
    pub client_events: u64,
    pub clients_gone: u64,
    pub messages: u64,
    pub kills: u64,
    /// Actions of other parties, and stalls of each path.
    pub others: u64,
    pub broker_stalls: u64,
    pub client_stalls: u64,
    pub standstills: u64,
    pub clock_steps: u64,
    pub troubles: [u64; Trouble::COUNT],
    pub late: u64,
    pub lost: u64,
    pub collisions: u64,
    pub checked: Counts,
    /// How much longer than required the shortest silence was, in ns.
    pub shortest_excess: u64,
}

impl Tally {
    /// Adds the counts of another world.
    pub fn add(&mut self, other: &Self) {
        let mine = &mut self.checked;
        let its = &other.checked;
        for (to, from) in [
            (&mut self.worlds, other.worlds),
            (&mut self.exchanges, other.exchanges),
            (&mut self.virtual_ns, other.virtual_ns),
            (&mut self.client_events, other.client_events),
            (&mut self.clients_gone, other.clients_gone),
            (&mut self.messages, other.messages),
            (&mut self.kills, other.kills),
            (&mut self.others, other.others),
            (&mut self.broker_stalls, other.broker_stalls),
            (&mut self.client_stalls, other.client_stalls),
            (&mut self.standstills, other.standstills),
            (&mut self.clock_steps, other.clock_steps),
            (&mut mine.states, its.states),
            (&mut self.late, other.late),
            (&mut self.lost, other.lost),
            (&mut self.collisions, other.collisions),
            (&mut mine.requests, its.requests),
            (&mut mine.answers, its.answers),
            (&mut mine.exceptions, its.exceptions),
            (&mut mine.words_checked, its.words_checked),
            (&mut mine.pictures, its.pictures),
            (&mut mine.writes, its.writes),
            (&mut mine.replies, its.replies),
            (&mut mine.mistakable, its.mistakable),
            (&mut mine.results, its.results),
        ] {
            *to += from;
        }
        self.troubles
            .iter_mut()
            .zip(other.troubles)
            .for_each(|(to, from)| *to += from);
        self.shortest_excess = self.shortest_excess.min(other.shortest_excess);
    }
}
