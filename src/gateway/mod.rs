//! One line without I/O: its wire, its drives, and the one way in for writes. [`LineCore`] tells how it is driven.
//!
//! One small file per kind of event or duty:
//!
//! | file | what it does |
//! | --- | --- |
//! | `ask` | takes requests and commands |
//! | `decide` | picks what goes on the wire next |
//! | `drive` | what belongs to one drive, and the drives of a line |
//! | `barrier` | settles whether a late reply can still come |
//! | `ended` | applies the end of an exchange |
//! | `overdue` | ends a wait early for a stop, learns reply times |
//! | `measured` | keeps measured times |
//! | `station` | reports one drive on its line |
//! | `port` | the port opens and closes |
//! | `probe` | finds out whether the line echoes |
//! | `health` | decides whether the line can be used |
//! | `traffic` | reports traffic to those who watch the line |
//! | `work` | what a drive wants for itself: its `stop`, the `list` of steps of a command, its trips |

mod ask;
mod barrier;
mod broadcast;
mod core;
mod decide;
mod drive;
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
mod station;
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
