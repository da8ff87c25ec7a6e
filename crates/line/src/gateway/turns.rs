//! Whose turn it is on the line: clients or polls, a command or others, and the drive whose wait was cut short last.

use super::work::WishRank;
use crate::domain::ids::DriveIndex;

/// Maximum number of consecutive overdue polls that precede native reads: a poll plan that fills the line is stretched,
/// and clients keep a share.
const AGED_POLLS_MAX: u8 = 3;

/// The turns on one line.
#[derive(Debug)]
pub(super) struct LineTurns {
    /// The drive whose wait was just cut short because others are to be stopped: their stops are sent before its own.
    cut_short: Option<DriveIndex>,
    /// Native reads and polls alternate: whether it is the polls' turn.
    is_polls_turn: bool,
    /// Consecutive polls that were overdue.
    aged_polls: u8,
    /// A command has begun and nothing else has had an exchange since: if others wait, they get one before the next begins.
    is_others_turn: bool,
}

impl LineTurns {
    pub const fn new() -> Self {
        Self {
            cut_short: None,
            is_polls_turn: true,
            aged_polls: 0,
            is_others_turn: false,
        }
    }

    /// The wait for `drive` was cut short for the stop of another drive.
    pub const fn was_cut_short(&mut self, drive: DriveIndex) {
        self.cut_short = Some(drive);
    }

    pub fn is_cut_short(&self, drive: DriveIndex) -> bool {
        self.cut_short == Some(drive)
    }

    /// The next exchange has begun.
    pub const fn exchange_opened(&mut self) {
        self.cut_short = None;
    }

    /// The last rank of the drives' own work that goes before everything else.
    pub const fn last_rank_first(&self) -> WishRank {
        if self.is_others_turn {
            WishRank::Trip
        } else {
            WishRank::Start
        }
    }

    /// A wish of `rank` is sent.
    pub fn work_was_taken(&mut self, rank: WishRank) {
        self.is_others_turn |= rank == WishRank::Start;
    }

    /// Others are asked whether they wait.
    pub const fn others_have_theirs(&mut self) {
        self.is_others_turn = false;
    }

    /// Whether clients go before overdue polls, of which there were many.
    pub const fn is_clients_share(&self) -> bool {
        self.aged_polls >= AGED_POLLS_MAX
    }

    /// An overdue poll is sent.
    pub const fn aged_poll_was_taken(&mut self) {
        self.aged_polls = self.aged_polls.saturating_add(1);
    }

    /// No overdue poll is sent.
    pub const fn no_aged_poll(&mut self) {
        self.aged_polls = 0;
    }

    /// Whether a poll goes before a client's read this time; next time it is the other way round.
    pub const fn take_polls_turn(&mut self) -> bool {
        let is_polls_turn = self.is_polls_turn;
        self.is_polls_turn = !is_polls_turn;
        is_polls_turn
    }
}
