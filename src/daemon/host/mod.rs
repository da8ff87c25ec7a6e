//! What the operating system provides: clocks, files, locks, secrets, terminals, serial drivers, limits.

pub mod about;
pub mod adapters;
pub mod archive;
pub mod authority;
pub mod clock;
pub mod descriptors;
pub mod directories;
pub mod file_identity;
pub mod own_lock;
pub mod pem_files;
pub mod pty;
pub(super) mod random;
pub mod recent_log;
pub mod secret_files;
pub mod serial_settings;
pub(super) mod stall;
pub mod sys;
pub mod timer;
pub mod user_files;
pub mod whole_files;
