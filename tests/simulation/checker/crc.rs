//! CRC-16 of Modbus as the checker computes it: polynomial A001 hex, reflected, start FFFF hex, low byte first.

const TABLE: [u16; 256] = table();

const fn table() -> [u16; 256] {
    let mut table = [0; 256];
    let mut byte = 0;
    while byte < 256 {
        let mut register = byte as u16;
        let mut bit = 0;
        while bit < 8 {
            register = if register & 1 == 1 {
                (register >> 1) ^ 0xA001
            } else {
                register >> 1
            };
            bit += 1;
        }
        table[byte] = register;
        byte += 1;
    }
    table
}

/// The check of `body`.
pub fn of(body: &[u8]) -> u16 {
    body.iter().fold(0xFFFF_u16, |register, byte| {
        (register >> 8) ^ TABLE[usize::from((register as u8) ^ byte)]
    })
}

/// Whether the last two bytes of `frame` are the check of those before.
pub fn is_right(frame: &[u8]) -> bool {
    let Some((body, check)) = frame.split_last_chunk::<2>() else {
        return false;
    };
    of(body) == u16::from_le_bytes(*check)
}
