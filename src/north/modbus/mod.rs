//! Modbus TCP from the side of one client: parsing requests, what each kind of unit makes of them, forming answers,
//! and the connection around it.
//!
//! A request becomes an [`Ask`] whatever its unit is. A *native* unit turns it into a request to the drive
//! ([`native`]); a *uniform* unit answers reads from the view of its drive and turns writes into orders ([`uniform`]);
//! unit 255 is the gateway itself ([`own`]). The outcome is an [`Answer`].

mod answer;
mod ask;
mod attempts;
mod commands;
mod connection;
mod counters;
mod function;
mod identity;
mod limits;
mod map;
pub mod memory;
pub mod native;
pub mod own;
mod refusal;
mod request;
pub mod serial;
pub mod sheet;
mod slots;
mod taken;
#[cfg(test)]
mod testing;
pub mod uniform;
mod words;

pub use answer::Answer;
pub use ask::{Ask, BitTable, Bits, WordTable};
pub use attempts::UnsentAttempt;
pub use commands::{Commands, Ended, ReadBehind};
pub use connection::{Call, Connection, IsStop};
pub use counters::Counters;
pub use limits::{CloseReason, Limits};
pub use map::{Each, Holds, MapAccess, MapRow, MapTable, MapUnit, map};
pub use refusal::{exception_for, exception_of, worst};
pub use request::parse;
pub use slots::{Entry, Newcomer, RoomId, Slot, Slots};
pub use taken::{Ordered, Present, Taken};
pub use uniform::{Uniform, address, presses_stop};
pub use words::Words;
