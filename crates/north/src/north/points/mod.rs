//! The points of a drive: what it shows, each with its names and how it is read, whatever the way out.
//!
//! `point` lists what a drive has, in the order in which it is shown; `plain` is the table of what is no register, and
//! `published` says which change of a register is news. `content` is what a point shows at a moment. `flags` is the table
//! of what is or is not so, which documents and metrics show as well.

mod content;
mod flags;
mod plain;
mod point;
mod published;

pub use flags::{DriveFlag, FLAGS, FlagGroup, alarm};

pub(super) use content::{PointContent, PointContext};
pub(super) use flags::{FlagLook, control_flags, status_flags, with_flags};
pub(super) use plain::{PlainPoint, PointForm, PointGroup, PointLook};
pub(super) use point::{DrivePoint, points_of};
pub(super) use published::{PublishedPoints, RATED_DIGITS};
