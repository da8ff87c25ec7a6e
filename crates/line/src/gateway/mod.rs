//! One line without I/O: its wire, its drives, and the single entry point for writes. See [`LineCore`] for its use.
//!
//! [`LineCore`] is made of parts, each with fields that no other file can touch:
//!
//! | file | what it keeps |
//! | --- | --- |
//! | `drive` | the state of one drive, and the drives of a line |
//! | `port` | whether the port is open, and why not |
//! | `health` | whether the line can be used |
//! | `flight` | the exchange on the wire |
//! | `natives` | what clients have asked, and the frames for it that wait |
//! | `turns` | whose turn it is |
//! | `broadcast` | the one stop for all drives |
//! | `share`, `roll_call` | what is known of other gateways on the line, and whether one listens |
//! | `traffic` | what those who watch the line are shown |
//! | `measured` | measured times |
//! | `outbox` | effects that are still to be executed |
//! | `work` | a drive's own work, made of parts in the same way: its `stop`, the `execution` of a command, its trips |
//!
//! It passes events between them:
//!
//! | file | what it does |
//! | --- | --- |
//! | `core` | takes each event, says when the next is due, and reports |
//! | `ask` | takes requests and commands |
//! | `decide` | picks what is sent next; `barrier` and `probe` pick what rules out late replies and shows an echo |
//! | `ended` | applies the end of an exchange; `overdue` ends a wait early and learns reply times |
//! | `state` | opens and closes the port, applies the health of the line |
//! | `standby` | shares the line with other gateways; sends stops between their frames |
//! | `overhear` | follows the traffic of another gateway |

mod ask;
mod barrier;
mod broadcast;
mod core;
mod decide;
mod digest;
mod drive;
mod ended;
mod event;
mod execution;
mod falling;
mod flight;
mod health;
mod measured;
mod natives;
mod note;
mod outbox;
mod overdue;
mod overhear;
mod port;
mod probe;
mod roll_call;
mod setup;
mod share;
mod standby;
mod state;
mod stop;
mod traffic;
mod turns;
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
