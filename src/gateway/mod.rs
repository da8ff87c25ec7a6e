//! [`LineCore`]: the pure whole of one line: its wire, its drives, the door for writes.
//!
//! It is given events with the time at which they happened ([`Input`]) and says what should be done
//! ([`Effect`]) and when it wants to be woken ([`Wake`]). It decides only on [`Input::Time`], so that all that
//! is known by then is taken into account; whoever drives it feeds all events first and then lets time pass.
//!
//! One small file per kind of event: `ask` requests and commands, `decide` what goes on the wire, `barrier` what settles
//! whether a late reply can still come, `ended` what follows
//! from the end of an exchange, `overdue` how long a reply is waited for and until when it may come late, `measured` what
//! was seen of times, `port` the port's coming and going, `traffic` what is told to whoever watches the line, `health` whether the line can be used. What a drive wants for
//! itself is kept in `work`:
//! its `stop`, the `list` of steps of a command, its trips.

mod ask;
mod barrier;
mod broadcast;
mod core;
mod decide;
mod ended;
mod event;
mod falling;
mod health;
mod list;
mod measured;
mod natives;
mod note;
mod outbox;
mod overdue;
mod port;
mod probe;
mod setup;
mod stop;
mod traffic;
mod waiter;
mod work;

pub use self::core::LineCore;
pub use event::{Effect, Input, Wake, WakeReason};
pub use natives::REQUESTS_MAX;
pub use note::{LineNote, Note};
pub use setup::{DriveSetup, LineSetup};
pub use stop::WAITERS_MAX;
pub use work::COMMANDS_MAX;
