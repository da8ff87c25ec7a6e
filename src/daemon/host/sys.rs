//! The one file with `unsafe`: system calls for which our libraries have no safe wrapper.

#![allow(unsafe_code)]

use crate::daemon::host::serial_settings::{Rs485, SerialInfo};
use crate::daemon::host::timer::RawTimer;
use std::io;
use std::net::TcpStream;
use std::os::fd::{AsRawFd, BorrowedFd};
use tokio::io::Interest;
use tokio::io::unix::AsyncFd;

/// Priority of the line threads among real-time threads: above ordinary work, below the kernel's own
/// interrupt threads (50).
const LINE_THREAD_PRIORITY: i32 = 20;

/// Blocks of this size and more are allocated from the system one by one and returned when freed.
#[cfg(target_env = "gnu")]
const LARGE_BLOCK_BYTES: libc::c_int = 128 * 1024;
/// Free memory that is kept at the end of the heap.
#[cfg(target_env = "gnu")]
const UNUSED_BYTES_MAX: libc::c_int = 512 * 1024;

/// Asks the kernel to run the calling thread before all ordinary ones (`SCHED_FIFO`).
///
/// # Errors
/// The kernel's refusal, usually because `CAP_SYS_NICE` or an `rtprio` limit is missing.
pub fn ask_for_real_time() -> io::Result<()> {
    let param = libc::sched_param {
        sched_priority: LINE_THREAD_PRIORITY,
    };
    // SAFETY: `param` lives through the call, which only reads it; 0 means the calling thread.
    match unsafe { libc::sched_setscheduler(0, libc::SCHED_FIFO, &raw const param) } {
        0 => Ok(()),
        _ => Err(io::Error::last_os_error()),
    }
}

/// Has the allocator give large blocks back to the system as soon as they are freed. By default it keeps them in each
/// of its arenas: comparing a few passwords would cost hundreds of megabytes for good. Other C libraries give them back
/// anyway.
pub fn give_memory_back() {
    #[cfg(target_env = "gnu")]
    for (setting, bytes) in [
        (libc::M_MMAP_THRESHOLD, LARGE_BLOCK_BYTES),
        (libc::M_TRIM_THRESHOLD, UNUSED_BYTES_MAX),
    ] {
        // SAFETY: the call only sets a number of the allocator's own, under its own lock.
        if unsafe { libc::mallopt(setting, bytes) } == 0 {
            tracing::warn!(
                setting,
                bytes,
                "allocator refused a setting; freed memory may stay with the process"
            );
        }
    }
}

/// Registers a descriptor with the runtime of the calling thread, to be notified when it is readable.
///
/// # Errors
/// The kernel's refusal: no descriptors are left.
pub fn readable<T: OwnsDescriptor>(owner: T) -> io::Result<AsyncFd<T>> {
    // SAFETY: a type that is `OwnsDescriptor` owns one descriptor, never replaces it and closes it only when it is
    // dropped, so `as_raw_fd` returns the same open descriptor for the lifetime of the `AsyncFd`.
    Ok(unsafe { AsyncFd::register_with_interest(owner, Interest::READABLE) }?)
}

/// The descriptor of `owner`, for as long as that lives.
pub fn borrowed<T: OwnsDescriptor>(owner: &T) -> BorrowedFd<'_> {
    // SAFETY: a type that is `OwnsDescriptor` keeps its descriptor open for its lifetime, and here it is borrowed.
    unsafe { BorrowedFd::borrow_raw(owner.as_raw_fd()) }
}

/// Types that are known to own one descriptor for their whole lifetime.
pub trait OwnsDescriptor: AsRawFd {}

impl OwnsDescriptor for RawTimer {}
impl OwnsDescriptor for mio_serial::SerialStream {}
impl OwnsDescriptor for TcpStream {}

/// The driver's settings for RS-485 (`TIOCGRS485`).
///
/// # Errors
/// The driver's, usually `ENOTTY`: it has no such settings.
pub fn rs485(fd: BorrowedFd<'_>) -> io::Result<Rs485> {
    let mut held = Rs485::default();
    // SAFETY: the call writes one `struct serial_rs485`, which `held` is, and nothing else.
    done(unsafe { libc::ioctl(fd.as_raw_fd(), libc::TIOCGRS485, &raw mut held) }).map(|()| held)
}

/// Sets the driver's settings for RS-485 (`TIOCSRS485`). It may keep others, so they must be read back.
///
/// # Errors
/// As [`rs485`].
pub fn set_rs485(fd: BorrowedFd<'_>, wanted: &Rs485) -> io::Result<()> {
    let mut settings = *wanted;
    // SAFETY: the call reads one `struct serial_rs485`, which `settings` is, and writes there what the driver took.
    done(unsafe { libc::ioctl(fd.as_raw_fd(), libc::TIOCSRS485, &raw mut settings) })
}

/// The driver's settings of a serial device (`TIOCGSERIAL`).
///
/// # Errors
/// As [`rs485`].
pub fn serial_info(fd: BorrowedFd<'_>) -> io::Result<SerialInfo> {
    let mut held = SerialInfo::default();
    // SAFETY: the call writes one `struct serial_struct`, which `held` is, and nothing else.
    done(unsafe { libc::ioctl(fd.as_raw_fd(), libc::TIOCGSERIAL, &raw mut held) }).map(|()| held)
}

/// Sets the driver's settings of a serial device (`TIOCSSERIAL`).
///
/// # Errors
/// As [`rs485`], and `EPERM` for what only root may set.
pub fn set_serial_info(fd: BorrowedFd<'_>, wanted: &SerialInfo) -> io::Result<()> {
    // SAFETY: the call only reads one `struct serial_struct`, which `wanted` is.
    done(unsafe {
        libc::ioctl(
            fd.as_raw_fd(),
            libc::TIOCSSERIAL,
            std::ptr::from_ref(wanted),
        )
    })
}

/// Whether the last bit has left the transmitter (`TIOCSERGETLSR`).
///
/// # Errors
/// As [`rs485`].
pub fn is_sent(fd: BorrowedFd<'_>) -> io::Result<bool> {
    /// `TIOCSER_TEMT` (Linux, `asm-generic/ioctls.h`).
    const TRANSMITTER_EMPTY: libc::c_uint = 1;
    let mut status: libc::c_uint = 0;
    // SAFETY: the call writes one `unsigned int`, which `status` is, and nothing else.
    done(unsafe { libc::ioctl(fd.as_raw_fd(), libc::TIOCSERGETLSR, &raw mut status) })?;
    Ok(status & TRANSMITTER_EMPTY != 0)
}

fn done(result: libc::c_int) -> io::Result<()> {
    if result < 0 {
        Err(io::Error::last_os_error())
    } else {
        Ok(())
    }
}
