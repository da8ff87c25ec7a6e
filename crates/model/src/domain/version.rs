//! The name and version of this program.

/// The name that every interface shows.
pub const PROGRAM_NAME: &str = "vfd-gateway";
/// Where the program has its public place; empty as long as it has none.
pub const PROGRAM_REPOSITORY: &str = env!("CARGO_PKG_REPOSITORY");

/// The version that every interface shows. A version that is not a release ends in `-dev`, and also names its commit if it was
/// built with `VFD_GATEWAY_BUILD`: `0.9.0-dev+g0123456789ab`.
pub const PROGRAM_VERSION: &str = env!("VFD_GATEWAY_VERSION");
