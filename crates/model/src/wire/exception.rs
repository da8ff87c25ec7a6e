//! Exception codes of the Modbus application protocol (V1.1b3, section 7).

/// The function or the action is not supported or not allowed.
pub const ILLEGAL_FUNCTION: u8 = 0x01;
/// A register does not exist, or the range passes the end of the address space.
pub const ILLEGAL_DATA_ADDRESS: u8 = 0x02;
/// A value or a quantity is not possible.
pub const ILLEGAL_DATA_VALUE: u8 = 0x03;
/// The drive refused, or failed while it tried.
pub const SERVER_DEVICE_FAILURE: u8 = 0x04;
/// Not now: another client holds control, or a queue is full.
pub const SERVER_DEVICE_BUSY: u8 = 0x06;
/// No such unit, or its line is down.
pub const GATEWAY_PATH_UNAVAILABLE: u8 = 0x0A;
/// The drive did not answer in time.
pub const GATEWAY_TARGET_FAILED: u8 = 0x0B;

/// The standard's name of `code`; `None` for codes that it does not define.
#[must_use]
pub const fn name(code: u8) -> Option<&'static str> {
    Some(match code {
        ILLEGAL_FUNCTION => "illegal function",
        ILLEGAL_DATA_ADDRESS => "illegal data address",
        ILLEGAL_DATA_VALUE => "illegal data value",
        SERVER_DEVICE_FAILURE => "server device failure",
        0x05 => "acknowledge",
        SERVER_DEVICE_BUSY => "server device busy",
        0x08 => "memory parity error",
        GATEWAY_PATH_UNAVAILABLE => "gateway path unavailable",
        GATEWAY_TARGET_FAILED => "gateway target device failed to respond",
        _ => return None,
    })
}
