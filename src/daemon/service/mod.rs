//! The gateway as a service: start, building from the configuration, reload, shutdown, and notification of the service
//! manager.

pub mod build;
pub mod conversations;
pub(super) mod embedded_broker;
pub mod north;
pub mod notify;
pub mod reload;
pub mod run;
pub mod signals;
pub mod start_error;
