//! The frame expected on a line, and the frames found there.

/// The awaited frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ExpectedFrame {
    /// The addressed station.
    pub station: u8,
    /// The requested function.
    pub function: u8,
    /// Length of the normal reply frame on the wire.
    pub adu_bytes: usize,
}

/// A sound frame found in the stream.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct FoundFrame {
    /// Bytes before it that belong to no frame.
    pub noise: Vec<u8>,
    /// The frame as received, complete.
    pub adu: Vec<u8>,
}
