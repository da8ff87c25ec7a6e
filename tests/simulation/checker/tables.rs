//! What the checker knows of drives: numbers typed from the vendors' manuals, and the configured line and drives.

/// A kind of drive.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Kind {
    /// Hyundai N700.
    N700,
    /// TECO E510.
    E510,
    /// Frecon FR500A.
    Fr500a,
}

/// What a word in the run register orders.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Run {
    Stop,
    Forward,
    Reverse,
    Coast,
    Reset,
}

/// Whether a status word means running.
type IsRunning = fn(u16) -> bool;

/// What a manual says of a kind of drive.
#[derive(Debug)]
pub struct Facts {
    /// Silence before a frame, in tenths of a character.
    pub gap_tenths: u64,
    /// Silence before a frame whatever the speed, in ns.
    pub pause: u64,
    /// The run register, and what its words order.
    pub run: u16,
    pub words: &'static [(u16, Run)],
    /// The setpoint in 0.01 Hz.
    pub setpoint: u16,
    /// The output frequency in 0.01 Hz.
    pub output: u16,
    /// The status word, and what in it means running.
    pub status: Option<(u16, IsRunning)>,
    /// The words that reset, in their order.
    pub reset: &'static [u16],
    /// Most words in one read.
    pub most_words: u16,
    /// A register that is written between others, where the configuration lists it.
    pub listed: u16,
    /// A range that clients read: first register and most words.
    pub readable: (u16, u16),
    /// The broadcast station.
    pub broadcast: Option<u8>,
}

const N700: Facts = Facts {
    gap_tenths: 45,
    pause: 0,
    run: 0x0002,
    words: &[
        (0, Run::Stop),
        (1, Run::Forward),
        (2, Run::Reverse),
        (3, Run::Coast),
        (4, Run::Reset),
    ],
    setpoint: 0x0004,
    output: 0x0101,
    status: None,
    reset: &[0, 4, 0],
    most_words: 8,
    listed: 0x020C,
    readable: (0x0201, 2),
    broadcast: Some(0xFF),
};

const E510: Facts = Facts {
    gap_tenths: 35,
    pause: 20_000_000,
    run: 0x2501,
    words: &[
        (0, Run::Stop),
        (1, Run::Forward),
        (3, Run::Reverse),
        (8, Run::Reset),
    ],
    setpoint: 0x2502,
    output: 0x2524,
    status: Some((0x2520, |word| word & 1 == 1)),
    reset: &[0, 8, 0],
    most_words: 37,
    listed: 0x000E,
    readable: (0x2523, 5),
    broadcast: None,
};

const FR500A: Facts = Facts {
    gap_tenths: 35,
    pause: 0,
    run: 0x2000,
    words: &[
        (1, Run::Forward),
        (2, Run::Reverse),
        (5, Run::Stop),
        (6, Run::Coast),
        (7, Run::Reset),
    ],
    setpoint: 0x2001,
    output: 0x3000,
    status: Some((0x2100, |word| (1..=3).contains(&word))),
    reset: &[5, 7],
    most_words: 8,
    listed: 0x0300,
    readable: (0x3000, 6),
    broadcast: Some(0),
};

impl Kind {
    pub const ALL: [Self; 3] = [Self::N700, Self::E510, Self::Fr500a];

    pub const fn facts(self) -> &'static Facts {
        match self {
            Self::N700 => &N700,
            Self::E510 => &E510,
            Self::Fr500a => &FR500A,
        }
    }
}

impl Facts {
    /// What `word` in the run register orders.
    pub fn run_of(&self, word: u16) -> Option<Run> {
        self.words
            .iter()
            .find(|(it, _)| *it == word)
            .map(|(_, run)| *run)
    }

    /// The word that orders `run`.
    pub fn word_of(&self, run: Run) -> Option<u16> {
        self.words
            .iter()
            .find(|(_, it)| *it == run)
            .map(|(word, _)| *word)
    }
}

/// The action when the owner is lost, or at shutdown.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Action {
    Stop,
    Coast,
    Hold,
}

/// One drive as configured. Times in ns.
#[derive(Clone, Copy, Debug)]
pub struct Drive {
    pub kind: Kind,
    pub station: u8,
    pub unit: u8,
    pub uniform: u8,
    pub poll: u64,
    pub timeout: u64,
    pub has_control: bool,
    /// Setpoints in 0.01 Hz.
    pub least: u16,
    pub most: u16,
    pub lost_after: u64,
    pub on_lost: Action,
    pub on_shutdown: Action,
}

/// The line and its drives. Times in ns.
#[derive(Clone, Debug)]
pub struct Line {
    pub baud: u64,
    pub char_bits: u64,
    pub drives: Vec<Drive>,
}

impl Line {
    /// Silence before each frame: the largest that a drive asks for, and 1.75 ms above 19200 bit/s. In ns.
    pub fn silence(&self) -> u64 {
        let pause = self
            .drives
            .iter()
            .map(|drive| drive.kind.facts().pause)
            .max()
            .unwrap_or(0);
        let tenths = self
            .drives
            .iter()
            .map(|drive| drive.kind.facts().gap_tenths)
            .max()
            .unwrap_or(35);
        let characters = (tenths * self.char_bits * 1_000_000_000 / (10 * self.baud)).max(pause);
        if self.baud > 19_200 {
            characters.max(1_750_000)
        } else {
            characters
        }
    }

    /// The station that stops all drives, where they are of one kind and each is under control.
    pub fn broadcast(&self) -> Option<u8> {
        let (first, others) = self.drives.split_first()?;
        let are_alike = others.iter().all(|it| it.kind == first.kind) && !others.is_empty();
        let may_be = are_alike && self.drives.iter().all(|it| it.has_control);
        first.kind.facts().broadcast.filter(|_| may_be)
    }

    /// Time of `bytes` characters.
    pub const fn on_wire(&self, bytes: usize) -> u64 {
        bytes as u64 * self.char_bits * 1_000_000_000 / self.baud
    }
}
