//! What is looked for in the bytes of a line, and what is found there.

/// The frame that is waited for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Expected {
    /// The station that was asked.
    pub station: u8,
    /// The function that was asked for.
    pub function: u8,
    /// Length of the normal reply frame as it stands on the wire.
    pub adu_bytes: usize,
}

/// A sound frame found in the stream.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Found {
    /// Bytes before the frame that belong to none.
    pub noise: Vec<u8>,
    /// The whole frame as it stood on the wire.
    pub adu: Vec<u8>,
}
