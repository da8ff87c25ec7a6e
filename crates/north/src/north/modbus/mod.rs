//! Modbus TCP from the side of one client: parsing requests, what each kind of unit makes of them, forming answers,
//! and the connection around it.
//!
//! A request becomes an [`ModbusRequest`] whatever its unit is. A *native* unit turns it into a request to the drive
//! ([`native`]); a *uniform* unit answers reads from the view of its drive and turns writes into orders ([`uniform`]);
//! unit 255 is the gateway itself ([`own`]). The outcome is an [`ModbusAnswer`].

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

pub use answer::ModbusAnswer;
pub use ask::{BitTable, ModbusRequest, PackedBits, WordTable};
pub use attempts::UnsentAttempt;
pub use commands::{CallCommands, EndedCall, ReadBehind};
pub use connection::{IsStop, ModbusConnection, UnitCall};
pub use counters::ConnectionCounters;
pub use limits::{CloseReason, ConnectionLimits};
pub use map::{MapAccess, MapRow, MapTable, MapUnit, RowContent, RowRepeat, map};
pub use refusal::{exception_for, exception_of, worst};
pub use request::parse;
pub use slots::{ClientSlot, ClientSlots, NewConnection, NewcomerEntry, RoomId};
pub use taken::{RequestAction, RequestContext, RequestedOrder};
pub use uniform::{UniformUnit, address, presses_stop};
pub use words::WordBuffer;
