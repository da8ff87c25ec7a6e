//! The settings of a serial device's driver, in the structures of the kernel.

/// `SER_RS485_ENABLED` (Linux, `linux/serial.h`).
const RS485_ENABLED: u32 = 1;
/// `SER_RS485_RTS_ON_SEND`: RTS is set while sending.
const RS485_RTS_ON_SEND: u32 = 1 << 1;
/// `SER_RS485_RTS_AFTER_SEND`: RTS is set while not sending, on boards that invert it.
const RS485_RTS_AFTER_SEND: u32 = 1 << 2;
/// `ASYNC_LOW_LATENCY` (Linux, `linux/tty_flags.h`).
const LOW_LATENCY: i32 = 1 << 13;

/// `struct serial_rs485` (Linux, `linux/serial.h`).
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Rs485 {
    flags: u32,
    delay_before_send_ms: u32,
    delay_after_send_ms: u32,
    rest: [u32; 5],
}

/// `struct serial_struct` (Linux, `linux/serial.h`). All fields but the flags are written back unchanged.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct SerialInfo {
    kind: i32,
    line: i32,
    port: u32,
    irq: i32,
    flags: i32,
    xmit_fifo_size: i32,
    custom_divisor: i32,
    baud_base: i32,
    close_delay: u16,
    io_type: u8,
    reserved: u8,
    hub6: i32,
    closing_wait: [u16; 2],
    iomem_base: usize,
    iomem_reg_shift: u16,
    port_high: u32,
    iomap_base: usize,
}

impl Rs485 {
    /// The flags, as the kernel has them.
    #[must_use]
    pub const fn flags(self) -> u32 {
        self.flags
    }

    /// Settings with the direction turned by the driver. A polarity that the board declares is kept; otherwise RTS is
    /// set while sending.
    #[must_use]
    pub const fn enabled(mut self) -> Self {
        self.flags |= RS485_ENABLED;
        if self.flags & (RS485_RTS_ON_SEND | RS485_RTS_AFTER_SEND) == 0 {
            self.flags |= RS485_RTS_ON_SEND;
        }
        self
    }

    const fn polarity(self) -> u32 {
        self.flags & (RS485_RTS_ON_SEND | RS485_RTS_AFTER_SEND)
    }

    /// Whether a driver that now holds `self` has accepted `wanted`.
    #[must_use]
    pub const fn does(self, wanted: Self) -> bool {
        self.flags & RS485_ENABLED != 0 && self.polarity() == wanted.polarity()
    }
}

impl SerialInfo {
    /// The settings to write; `None` if it is set already.
    #[must_use]
    pub const fn with_low_latency(mut self) -> Option<Self> {
        if self.flags & LOW_LATENCY != 0 {
            return None;
        }
        self.flags |= LOW_LATENCY;
        Some(self)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn structures_have_the_size_that_the_kernel_expects() {
        assert_eq!(size_of::<Rs485>(), 32);
        assert_eq!(
            size_of::<SerialInfo>(),
            if size_of::<usize>() == 8 { 72 } else { 60 }
        );
    }

    #[test]
    fn rts_is_set_to_send_unless_the_board_says_otherwise() {
        let on = Rs485::default().enabled();
        assert_eq!(on.flags, 0b011);
        let inverted = Rs485 {
            flags: RS485_RTS_AFTER_SEND,
            delay_after_send_ms: 1,
            ..Rs485::default()
        };
        assert_eq!(
            inverted.enabled(),
            Rs485 {
                flags: 0b101,
                delay_after_send_ms: 1,
                ..Rs485::default()
            }
        );
        let with_more = Rs485 {
            flags: on.flags | 1 << 4,
            ..on
        };
        assert_eq!(with_more.enabled(), with_more);
    }

    #[test]
    fn a_driver_that_keeps_something_else_does_not_do_it() {
        let wanted = Rs485::default().enabled();
        assert!(wanted.does(wanted));
        assert!(
            Rs485 {
                flags: wanted.flags | 1 << 4,
                ..wanted
            }
            .does(wanted),
            "it may hear what it sends"
        );
        assert!(!Rs485::default().does(wanted), "off");
        assert!(
            !Rs485 {
                flags: RS485_ENABLED | RS485_RTS_AFTER_SEND,
                ..wanted
            }
            .does(wanted),
            "the other way round"
        );
    }

    #[test]
    fn the_flag_is_set_once_and_the_rest_stays() {
        let info = SerialInfo {
            flags: 0b1,
            irq: 4,
            iomap_base: 7,
            ..SerialInfo::default()
        };
        let wanted = info.with_low_latency().unwrap();
        assert_eq!(
            wanted,
            SerialInfo {
                flags: 0x2001,
                ..info
            }
        );
        assert_eq!(wanted.with_low_latency(), None);
    }
}
