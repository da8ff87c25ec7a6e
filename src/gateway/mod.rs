//! One line without I/O: its wire, its drives, and the single entry point for writes. See [`LineCore`] for its use.
//!
//! One small file per kind of event or duty:
//!
//! | file | what it does |
//! | --- | --- |
//! | `ask` | takes requests and commands |
//! | `decide` | picks what is sent next |
//! | `drive` | the state of one drive, and the drives of a line |
//! | `barrier` | rules out late replies |
//! | `ended` | applies the end of an exchange |
//! | `overdue` | ends a wait early for a stop, learns reply times |
//! | `measured` | keeps measured times |
//! | `report` | reports the line |
//! | `station` | reports one drive on its line |
//! | `port` | handles opening and closing of the port |
//! | `probe` | finds out whether the line echoes |
//! | `standby` | shares the line with other gateways |
//! | `between` | sends stops between the frames of another gateway |
//! | `overhear` | follows the traffic of another gateway |
//! | `health` | decides whether the line can be used |
//! | `traffic` | reports traffic to those who watch the line |
//! | `work` | a drive's own work: its `stop`, the `execution` of a command, its trips |

mod ask;
mod barrier;
mod between;
mod broadcast;
mod core;
mod decide;
mod drive;
mod ended;
mod event;
mod execution;
mod falling;
mod health;
mod measured;
mod natives;
mod note;
mod outbox;
mod overdue;
mod overhear;
mod port;
mod probe;
mod report;
mod roll_call;
mod setup;
mod share;
mod standby;
mod station;
mod stop;
mod traffic;
mod waiter;
mod words;
mod work;

pub use self::core::LineCore;
pub use event::{LineEffect, LineInput, LineWake, WakeReason};
pub use natives::REQUESTS_MAX;
pub use note::{DriveNote, LineNote};
pub use setup::{DriveSetup, LineSetup};
pub use stop::WAITERS_MAX;
pub use work::COMMANDS_MAX;
