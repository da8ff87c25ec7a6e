//! The version of this program.

/// The version that every interface shows. A version that is not a release ends in `-dev`, and also names its commit if it was
/// built with `VFD_GATEWAY_BUILD`: `0.9.0-dev+g0123456789ab`.
pub const PROGRAM_VERSION: &str = env!("VFD_GATEWAY_VERSION");
