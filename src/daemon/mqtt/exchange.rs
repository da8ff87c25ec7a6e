//! The exchange of packets on one connection: reads, writes and pings. A [`Protocol`], which does no I/O, interprets
//! the packets.

use super::incident::{Broken, CONNECT_TIMEOUT, Cause, Incident};
use super::stream::{self, Target};
use super::wire::Wire;
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
pub trait Protocol {
    type Packet;
    /// What can be queued for the broker.
    type Request;
    /// Longest time for one write; `None` for as long as the broker may be silent.
    const FLUSH_MAX: Option<Duration>;
    /// The reason that is given if connecting times out.
    const CONNECT_OVERDUE: &str;

    /// Takes the next packet out of `bytes`; `None` if it is incomplete. The size of an incomplete packet is bounded.
    fn decode(bytes: &mut BytesMut) -> Result<Option<Self::Packet>, Broken>;
    fn encode(&self, packet: Self::Packet, bytes: &mut BytesMut) -> Result<(), Broken>;
    /// CONNECT, the first packet.
    fn connect(&self) -> Self::Packet;
    /// Processes the answer to it. Returns the keep-alive that the broker prescribes.
    fn accept(&mut self, packet: Self::Packet) -> Result<Option<Duration>, Broken>;
    /// Processes a packet. Returns the answer to it.
    fn incoming(&mut self, packet: Self::Packet) -> Result<Option<Self::Packet>, Broken>;
    /// Whether another request may be sent now.
    fn has_room(&self) -> bool;
    fn outgoing(&mut self, request: Self::Request) -> Result<Option<Self::Packet>, Broken>;
    /// A ping. It is an error if the last one was not answered.
    fn ping(&mut self) -> Result<Option<Self::Packet>, Broken>;
    /// The next incident.
    fn next_incident(&mut self) -> Option<Incident>;
    /// The connection broke: the last packet was not sent.
    fn forget_unsent(&mut self);
    fn io(error: std::io::Error) -> Broken;
    fn closed() -> Broken;
}

/// One connection, which begins with the first [`Exchange::next`].
pub struct Exchange<P: Protocol> {
    protocol: P,
    target: Target,
    requests: Receiver<P::Request>,
    wire: Option<Wire>,
    keep_alive: Duration,
    ping_at: Instant,
    is_over: bool,
}

/// The next action.
enum Turn<P: Protocol> {
    Read(P::Packet),
    Send(P::Request),
    Ping,
}

impl<P: Protocol> Exchange<P> {
    pub fn new(
        protocol: P,
        target: Target,
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
    pub async fn next(&mut self) -> Result<Incident, Broken> {
        if self.is_over {
            return Err(Broken::because("the connection is over"));
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
    pub fn rest(&mut self) -> Vec<Incident> {
        std::iter::from_fn(|| self.protocol.next_incident()).collect()
    }

    async fn advance(&mut self) -> Result<Incident, Broken> {
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
                packet = wire.read::<P>() => Turn::<P>::Read(packet?),
                Some(request) = self.requests.recv(), if has_room => Turn::Send(request),
                () = sleep_until(self.ping_at) => Turn::Ping,
            };
            match turn {
                Turn::Read(packet) => take_batch(&mut self.protocol, wire, packet).await?,
                Turn::Send(request) => {
                    let packet = self.protocol.outgoing(request)?;
                    put(packet, &self.protocol, wire)?;
                }
                Turn::Ping => {
                    self.ping_at = Instant::now() + self.keep_alive;
                    let ping = self.protocol.ping()?;
                    put(ping, &self.protocol, wire)?;
                }
            }
        }
    }

    /// Connects the stream and the protocol.
    async fn open(&mut self) -> Result<Wire, Broken> {
        let mut wire = Wire::new(stream::connect(&self.target).await?);
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
async fn take_batch<P: Protocol>(
    protocol: &mut P,
    wire: &mut Wire,
    first: P::Packet,
) -> Result<(), Broken> {
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

fn put<P: Protocol>(
    packet: Option<P::Packet>,
    protocol: &P,
    wire: &mut Wire,
) -> Result<(), Broken> {
    packet.map_or(Ok(()), |packet| wire.put(protocol, packet))
}

fn connect_overdue<P: Protocol>() -> Broken {
    Broken {
        reason: P::CONNECT_OVERDUE.to_owned(),
        is_fresh: false,
        cause: Cause::Gone,
        is_unsent: false,
    }
}
