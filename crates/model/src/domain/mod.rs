//! The shared vocabulary: time, ids, link settings, requests, reports. It depends on no other room.

pub mod address;
pub mod buckets;
pub mod calendar;
pub mod command;
pub mod control;
pub mod counts;
pub mod fail_safe;
pub mod frequency;
pub mod ids;
pub mod link;
pub mod native;
pub mod problem;
pub mod reason;
pub mod report;
pub mod standby;
pub mod suspicion;
pub mod time;
pub mod traffic;
pub mod units;
pub mod version;
