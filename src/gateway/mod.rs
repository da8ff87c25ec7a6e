//! [`LineCore`]: the pure whole of one line: its wire, its drives, the door for writes.
//!
//! It is given events with the time at which they happened ([`Input`]) and says what should be done
//! ([`Effect`]) and when it wants to be woken ([`Wake`]). It decides only on [`Input::Time`], so that all that
//! is known by then is taken into account; whoever drives it feeds all events first and then lets time pass.
//!
//! One small file per kind of event: `ask` requests and commands, `decide` what goes on the wire, `barrier` what settles
//! whether a late reply can still come, `ended` what follows
//! from the end of an exchange, `port` the port's coming and going. What a drive wants for itself is kept in `work`:
//! its `stop`, the `list` of steps of a command, its trips.

mod ask;
mod barrier;
mod core;
mod decide;
mod ended;
mod event;
mod list;
mod natives;
mod note;
mod port;
mod setup;
mod stop;
mod waiter;
mod work;

pub use self::core::LineCore;
pub use event::{Effect, Input, Wake, WakeReason};
pub use natives::REQUESTS_MAX;
pub use note::Note;
pub use setup::{DriveSetup, LineSetup};
pub use stop::WAITERS_MAX;
pub use work::COMMANDS_MAX;
