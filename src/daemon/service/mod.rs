//! The gateway as a service: start, building from the configuration, reload, shutdown, and notification of the service
//! manager.

pub mod build;
pub mod conversations;
pub(super) mod embedded_broker;
pub mod north;
pub mod north_sides;
pub mod notify;
pub mod own_lock;
pub mod reload;
pub mod reload_request;
pub mod run;
pub mod signals;
pub(super) mod stall;
pub mod start_error;
