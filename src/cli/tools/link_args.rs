//! Settings of a serial line, as arguments of the tools that open one themselves.

use crate::domain::link::{DirectionControl, LinkSettings, Parity};

/// Parity, stop bits, and direction control.
#[derive(Clone, Debug, Default, clap::Args)]
pub struct LinkArgs {
    /// Parity of the line; default: the model's factory setting, or all in a scan
    #[arg(long, value_enum)]
    parity: Option<ParityArg>,
    /// Stop bits of the line; default: the model's factory setting, or both in a scan
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u8).range(1..=2))]
    pub stop_bits: Option<u8>,
    /// What switches the direction of an RS-485 adapter; most adapters do it themselves
    #[arg(long, value_enum, default_value_t = DirectionArg::Adapter)]
    rs485: DirectionArg,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum)]
enum ParityArg {
    None,
    Even,
    Odd,
}

#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, clap::ValueEnum)]
enum DirectionArg {
    #[default]
    Adapter,
    Kernel,
    Rts,
}

impl LinkArgs {
    /// The parity and the stop bits of `link`.
    #[must_use]
    pub const fn of(link: LinkSettings) -> Self {
        let parity = match link.parity {
            Parity::None => ParityArg::None,
            Parity::Even => ParityArg::Even,
            Parity::Odd => ParityArg::Odd,
        };
        Self {
            parity: Some(parity),
            stop_bits: Some(link.stop_bits),
            rs485: DirectionArg::Adapter,
        }
    }

    /// The parity, if one is given.
    #[must_use]
    pub fn parity(&self) -> Option<Parity> {
        self.parity.map(|parity| match parity {
            ParityArg::None => Parity::None,
            ParityArg::Even => Parity::Even,
            ParityArg::Odd => Parity::Odd,
        })
    }

    /// The direction control.
    #[must_use]
    pub const fn direction(&self) -> DirectionControl {
        match self.rs485 {
            DirectionArg::Adapter => DirectionControl::Adapter,
            DirectionArg::Kernel => DirectionControl::Kernel,
            DirectionArg::Rts => DirectionControl::Rts,
        }
    }

    /// The direction control, as written in a configuration.
    #[must_use]
    pub const fn direction_word(&self) -> &'static str {
        match self.rs485 {
            DirectionArg::Adapter => "adapter",
            DirectionArg::Kernel => "kernel",
            DirectionArg::Rts => "rts",
        }
    }

    /// Whether parity or stop bits are given.
    #[must_use]
    pub const fn is_given(&self) -> bool {
        self.parity.is_some() || self.stop_bits.is_some()
    }
}
