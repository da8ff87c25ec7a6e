//! The points of a drive: what it shows, each with its names and how it is read, whatever the way out.
//!
//! `point` lists what a drive has, in the order in which it is shown; `plain` is the table of what is no register, and
//! `published` says which change of a register is news. `content` is what a point shows at a moment.

mod content;
mod plain;
mod point;
mod published;

pub(super) use content::{PointContent, PointContext};
pub(super) use plain::{PlainPoint, PointForm, PointGroup, PointLook};
pub(super) use point::{DrivePoint, points_of};
pub(super) use published::{PublishedPoints, RATED_DIGITS};
