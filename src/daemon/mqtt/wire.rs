//! Packets on a stream, with buffers for reading and writing.
//!
//! All methods are cancel safe: no byte is lost or written twice.

use super::exchange::ProtocolState;
use super::incident::{BrokenConnection, EndCause};
use super::stream::BrokerStream;
use bytes::BytesMut;
use std::io::{Error, ErrorKind};
use tokio::io::{AsyncReadExt, AsyncWriteExt};
use tokio::time::timeout;

/// Room for each read. The codec bounds the size of an incomplete packet.
const READ_BYTES: usize = 8 * 1024;

/// A stream with its buffers.
pub struct BrokerWire {
    stream: Box<dyn BrokerStream>,
    input: BytesMut,
    output: BytesMut,
    /// Whether bytes may still be on their way to the socket.
    is_unflushed: bool,
}

impl BrokerWire {
    pub fn new(stream: Box<dyn BrokerStream>) -> Self {
        Self {
            stream,
            input: BytesMut::new(),
            output: BytesMut::new(),
            is_unflushed: false,
        }
    }

    /// The next packet.
    pub async fn read<P: ProtocolState>(&mut self) -> Result<P::Packet, BrokenConnection> {
        loop {
            if let Some(packet) = P::decode(&mut self.input)? {
                return Ok(packet);
            }
            self.input.reserve(READ_BYTES);
            match self.stream.read_buf(&mut self.input).await {
                Ok(0) if self.input.is_empty() => return Err(P::closed()),
                Ok(0) => {
                    return Err(P::io(Error::new(
                        ErrorKind::UnexpectedEof,
                        "the broker closed within a packet",
                    )));
                }
                Ok(_) => {}
                Err(error) => return Err(P::io(error)),
            }
        }
    }

    /// Appends a packet to what is to be written.
    pub fn put<P: ProtocolState>(
        &mut self,
        protocol: &P,
        packet: P::Packet,
    ) -> Result<(), BrokenConnection> {
        self.is_unflushed = true;
        protocol.encode(packet, &mut self.output)
    }

    /// Writes all of it.
    pub async fn flush<P: ProtocolState>(&mut self) -> Result<(), BrokenConnection> {
        if !self.is_unflushed {
            return Ok(());
        }
        let written = async {
            self.stream.write_all_buf(&mut self.output).await?;
            self.stream.flush().await
        };
        let written = match P::FLUSH_MAX {
            Some(longest) => timeout(longest, written).await.map_err(|_| overdue())?,
            None => written.await,
        };
        written.map_err(P::io)?;
        self.is_unflushed = false;
        Ok(())
    }
}

fn overdue() -> BrokenConnection {
    BrokenConnection {
        reason: "Flush timeout".to_owned(),
        is_fresh: false,
        cause: EndCause::Other,
        is_unsent: false,
    }
}
