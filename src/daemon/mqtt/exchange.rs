//! The exchange of packets on one connection: reads, writes and pings. A [`ProtocolState`], which does no I/O, interprets
//! the packets.

use super::incident::{BrokenConnection, CONNECT_TIMEOUT, ConnectionIncident, EndCause};
use super::stream::{self, BrokerTarget};
use super::wire::BrokerWire;
use bytes::BytesMut;
use std::future::poll_fn;
use std::pin::pin;
use std::task::Poll;
use std::time::Duration;
use tokio::sync::mpsc::Receiver;
use tokio::time::{Instant, sleep_until, timeout};

/// Packets that are read before they are answered together.
const BATCH_MAX: usize = 9;

/// The state of a connection in one version of the protocol.
pub trait ProtocolState {
    type Packet;
    /// What can be queued for the broker.
    type Request;
    /// Longest time for one write; `None` for as long as the broker may be silent.
    const FLUSH_MAX: Option<Duration>;
    /// The reason that is given if connecting times out.
    const CONNECT_OVERDUE: &str;

    /// Takes the next packet out of `bytes`; `None` if it is incomplete. The size of an incomplete packet is bounded.
    fn decode(bytes: &mut BytesMut) -> Result<Option<Self::Packet>, BrokenConnection>;
    fn encode(&self, packet: Self::Packet, bytes: &mut BytesMut) -> Result<(), BrokenConnection>;
    /// CONNECT, the first packet.
    fn connect(&self) -> Self::Packet;
    /// Processes the answer to it. Returns the keep-alive that the broker prescribes.
    fn accept(&mut self, packet: Self::Packet) -> Result<Option<Duration>, BrokenConnection>;
    /// Processes a packet. Returns the answer to it.
    fn incoming(&mut self, packet: Self::Packet) -> Result<Option<Self::Packet>, BrokenConnection>;
    /// Whether another request may be sent now.
    fn has_room(&self) -> bool;
    fn outgoing(
        &mut self,
        request: Self::Request,
    ) -> Result<Option<Self::Packet>, BrokenConnection>;
    /// A ping. It is an error if the last one was not answered.
    fn ping(&mut self) -> Result<Option<Self::Packet>, BrokenConnection>;
    /// The next incident.
    fn next_incident(&mut self) -> Option<ConnectionIncident>;
    /// The connection broke: the last packet was not sent.
    fn forget_unsent(&mut self);
    fn io(error: std::io::Error) -> BrokenConnection;
    fn closed() -> BrokenConnection;
}

/// One connection, which begins with the first [`BrokerExchange::next`].
pub struct BrokerExchange<P: ProtocolState> {
    protocol: P,
    target: BrokerTarget,
    requests: Receiver<P::Request>,
    wire: Option<BrokerWire>,
    keep_alive: Duration,
    ping_at: Instant,
    is_over: bool,
}

/// The next action.
enum ExchangeTurn<P: ProtocolState> {
    Read(P::Packet),
    Send(P::Request),
    Ping,
}

impl<P: ProtocolState> BrokerExchange<P> {
    pub fn new(
        protocol: P,
        target: BrokerTarget,
        requests: Receiver<P::Request>,
        keep_alive: Duration,
    ) -> Self {
        let ping_at = Instant::now() + keep_alive;
        Self {
            protocol,
            target,
            requests,
            wire: None,
            keep_alive,
            ping_at,
            is_over: false,
        }
    }

    /// Waits for the next incident. Cancel safe. After an error the connection is over.
    pub async fn next(&mut self) -> Result<ConnectionIncident, BrokenConnection> {
        if self.is_over {
            return Err(BrokenConnection::because("the connection is over"));
        }
        let next = self.advance().await;
        if next.is_err() {
            self.is_over = true;
            self.wire = None;
            self.protocol.forget_unsent();
        }
        next
    }

    /// What was received but not yet returned.
    pub fn rest(&mut self) -> Vec<ConnectionIncident> {
        std::iter::from_fn(|| self.protocol.next_incident()).collect()
    }

    async fn advance(&mut self) -> Result<ConnectionIncident, BrokenConnection> {
        loop {
            if self.wire.is_none() {
                let opened = timeout(CONNECT_TIMEOUT, self.open()).await;
                self.wire = Some(opened.map_err(|_| connect_overdue::<P>())??);
            }
            let Some(wire) = &mut self.wire else { continue };
            // Before a packet is reported as sent.
            wire.flush::<P>().await?;
            if let Some(incident) = self.protocol.next_incident() {
                return Ok(incident);
            }
            let has_room = self.protocol.has_room();
            // Unbiased, so that neither direction starves the other.
            let turn = tokio::select! {
                packet = wire.read::<P>() => ExchangeTurn::<P>::Read(packet?),
                Some(request) = self.requests.recv(), if has_room => ExchangeTurn::Send(request),
                () = sleep_until(self.ping_at) => ExchangeTurn::Ping,
            };
            match turn {
                ExchangeTurn::Read(packet) => take_batch(&mut self.protocol, wire, packet).await?,
                ExchangeTurn::Send(request) => {
                    let packet = self.protocol.outgoing(request)?;
                    put(packet, &self.protocol, wire)?;
                }
                ExchangeTurn::Ping => {
                    self.ping_at = Instant::now() + self.keep_alive;
                    let ping = self.protocol.ping()?;
                    put(ping, &self.protocol, wire)?;
                }
            }
        }
    }

    /// Connects the stream and the protocol.
    async fn open(&mut self) -> Result<BrokerWire, BrokenConnection> {
        let mut wire = BrokerWire::new(stream::connect(&self.target).await?);
        wire.put(&self.protocol, self.protocol.connect())?;
        wire.flush::<P>().await?;
        let answer = wire.read::<P>().await?;
        if let Some(prescribed) = self.protocol.accept(answer)?
            && !prescribed.is_zero()
        {
            self.keep_alive = prescribed;
        }
        self.ping_at = Instant::now() + self.keep_alive;
        Ok(wire)
    }
}

/// Processes a packet and those that are already available. If the end of the stream follows, none is answered: writing
/// could lose what is still unread.
async fn take_batch<P: ProtocolState>(
    protocol: &mut P,
    wire: &mut BrokerWire,
    first: P::Packet,
) -> Result<(), BrokenConnection> {
    let mut packet = first;
    for count in 1.. {
        let answer = protocol.incoming(packet)?;
        put(answer, protocol, wire)?;
        if count == BATCH_MAX {
            break;
        }
        let mut next = pin!(wire.read::<P>());
        packet = match poll_fn(|cx| Poll::Ready(next.as_mut().poll(cx))).await {
            Poll::Ready(next) => next?,
            Poll::Pending => break,
        };
    }
    Ok(())
}

fn put<P: ProtocolState>(
    packet: Option<P::Packet>,
    protocol: &P,
    wire: &mut BrokerWire,
) -> Result<(), BrokenConnection> {
    packet.map_or(Ok(()), |packet| wire.put(protocol, packet))
}

fn connect_overdue<P: ProtocolState>() -> BrokenConnection {
    BrokenConnection {
        reason: P::CONNECT_OVERDUE.to_owned(),
        is_fresh: false,
        cause: EndCause::Gone,
        is_unsent: false,
    }
}
