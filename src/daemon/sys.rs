//! The one file with `unsafe`: what the libraries we use leave without a safe way in.

#![allow(unsafe_code)]

use super::timer::RawTimer;
use std::io;
use std::os::fd::AsRawFd;
use tokio::io::Interest;
use tokio::io::unix::AsyncFd;

/// Priority of the line threads among real-time threads: above ordinary work, below the kernel's own
/// interrupt threads (50).
const LINE_THREAD_PRIORITY: i32 = 20;

/// Asks the kernel to run the calling thread before all ordinary ones (`SCHED_FIFO`).
///
/// # Errors
/// The kernel's refusal, usually for want of `CAP_SYS_NICE` or of an `rtprio` limit.
pub fn ask_for_real_time() -> io::Result<()> {
    let param = libc::sched_param { sched_priority: LINE_THREAD_PRIORITY };
    // SAFETY: `param` lives through the call, which only reads it; 0 means the calling thread.
    match unsafe { libc::sched_setscheduler(0, libc::SCHED_FIFO, &raw const param) } {
        0 => Ok(()),
        _ => Err(io::Error::last_os_error()),
    }
}

/// Registers a descriptor with the runtime of the calling thread, to be told when it can be read.
///
/// # Errors
/// The kernel's refusal, for want of descriptors.
pub fn readable<T: OwnsDescriptor>(owner: T) -> io::Result<AsyncFd<T>> {
    // SAFETY: who is `OwnsDescriptor` owns one descriptor, never exchanges it and closes it only when it is
    // dropped, so `as_raw_fd` returns the same open descriptor for the lifetime of the `AsyncFd`.
    Ok(unsafe { AsyncFd::register_with_interest(owner, Interest::READABLE) }?)
}

/// Types of which it is known that they own one descriptor from their making to their end.
pub trait OwnsDescriptor: AsRawFd {}

impl OwnsDescriptor for RawTimer {}
impl OwnsDescriptor for mio_serial::SerialStream {}
