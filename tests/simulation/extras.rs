//! Kinds of trouble beyond the line: other parties at the drives, drives that refuse to stop, stalled connections,
//! wrong clocks. Each world draws some of those that are enabled.

use fastrand::Rng;

/// A kind of trouble beyond the line.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u8)]
pub enum Extra {
    /// Panel, terminals, another master and the drive itself start, stop, reverse, trip, reset and restart.
    Others,
    /// Drives refuse to stop for a while.
    RefusedStops,
    /// The path between gateway and broker stalls, and waiting messages arrive afterwards, in order.
    BrokerStalls,
    /// The clocks of gateway and clients are wrong, and jump.
    Clocks,
    /// Connections of Modbus TCP clients stall.
    ClientStalls,
    /// The gateway's process is suspended.
    Standstills,
}

/// Kinds whose worlds still show unfixed violations. They are drawn only on request.
pub const AWAITED: &[Extra] = &[];

impl Extra {
    pub const ALL: [Self; 6] = [
        Self::Others,
        Self::RefusedStops,
        Self::BrokerStalls,
        Self::Clocks,
        Self::ClientStalls,
        Self::Standstills,
    ];
    const NAMES: [&str; 6] = [
        "others",
        "refused-stops",
        "broker-stalls",
        "clocks",
        "client-stalls",
        "standstills",
    ];
}

/// Some kinds.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Extras(u8);

impl Extras {
    pub const NONE: Self = Self(0);
    pub const ALL: Self = Self((1 << Extra::ALL.len()) - 1);

    /// The enabled kinds.
    pub fn on() -> Self {
        AWAITED
            .iter()
            .fold(Self::ALL, |all, extra| Self(all.0 & !(1 << *extra as u8)))
    }

    /// The kinds that `text` names: `all`, `none`, `on`, or names separated by commas.
    pub fn named(text: &str) -> Option<Self> {
        match text {
            "all" => return Some(Self::ALL),
            "none" => return Some(Self::NONE),
            "on" => return Some(Self::on()),
            _ => {}
        }
        text.split(',').try_fold(Self::NONE, |all, name| {
            let place = Extra::NAMES.iter().position(|it| *it == name)?;
            Some(Self(all.0 | 1 << place))
        })
    }

    /// Half of these, as `rng` draws them.
    pub fn drawn(self, rng: &mut Rng) -> Self {
        Self(self.0 & rng.u8(..))
    }

    pub const fn has(self, extra: Extra) -> bool {
        self.0 & (1 << extra as u8) != 0
    }

    pub fn is_none(self) -> bool {
        self == Self::NONE
    }
}
