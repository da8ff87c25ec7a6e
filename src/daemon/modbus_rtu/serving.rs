//! Serving an open port: bytes to the slave, its requests to the server, and answers back.

use crate::config::SerialMasterSettings;
use crate::daemon::exchange::router::UnitRouter;
use crate::daemon::exchange::totals::SerialTotals;
use crate::daemon::host::clock;
use crate::daemon::host::sys;
use crate::daemon::host::timer::TaskTimer;
use crate::daemon::port::OpenPort;
use crate::domain::link::PortKind;
use crate::north::modbus::parse;
use crate::north::modbus::serial::{SerialSlave, SlaveCounters, SlaveRequest, SlaveSettings};
use crate::wire::mbap;
use arc_swap::ArcSwap;
use std::future::poll_fn;
use std::io;
use std::pin::pin;
use std::sync::Arc;
use std::task::Poll;
use std::time::Duration;
use tokio::net::UnixStream;
use tokio::sync::mpsc;

/// Reads of the port in one round, of 512 bytes each.
const READS_PER_ROUND: usize = 8;
/// How long a port that has more is left alone, so that a node that never stops sending takes no processor.
const FLOOD_PAUSE: Duration = Duration::from_millis(1);

/// Why a port is not served any more.
pub(super) enum ServingEnd {
    /// The server takes no more connections.
    Ended,
    /// The device or the connection to the server is gone.
    Lost(io::Error),
}

/// What a thread serves its port with.
pub(super) struct ServingTask {
    pub settings: SerialMasterSettings,
    pub router: Arc<ArcSwap<UnitRouter>>,
    pub connections: mpsc::Sender<std::os::unix::net::UnixStream>,
    pub totals: Arc<SerialTotals>,
    pub timer: TaskTimer,
}

impl ServingTask {
    /// Serves an open port until it is lost. Returns also whether a request has arrived. The loss ends the connection to
    /// the server, so that leases end as those of a lost TCP connection do.
    pub async fn serve(&mut self, device: &mut OpenPort, is_serial: bool) -> (ServingEnd, bool) {
        let is_paced = device.kind() == PortKind::Serial;
        if is_paced
            && is_serial
            && let Err(error) = sys::ask_for_real_time()
        {
            tracing::info!(master = %self.settings.name, %error, "no real-time priority; replies may come later under load");
        }
        let settings = SlaveSettings {
            link: self.settings.link,
            framing: self.settings.framing,
            answer_within: self.settings.answer_within,
            is_paced,
        };
        let mut slave = SerialSlave::new(settings, clock::now());
        let mut counted = SlaveCounters::default();
        let gone = match self.connected() {
            Ok(server) => match self.rounds(device, &server, &mut slave, &mut counted).await {
                Ok(()) => ServingEnd::Ended,
                Err(error) => ServingEnd::Lost(error),
            },
            Err(error) => ServingEnd::Lost(error),
        };
        let SlaveCounters {
            requests,
            not_in_time,
            late,
            damaged,
            foreign,
            broadcasts,
            collisions,
        } = *slave.counters();
        tracing::info!(
            master = %self.settings.name, requests, not_in_time, late, damaged, foreign, broadcasts, collisions,
            "serial port closed"
        );
        (gone, requests > 0)
    }

    fn connected(&self) -> io::Result<UnixStream> {
        let (ours, theirs) = std::os::unix::net::UnixStream::pair()?;
        ours.set_nonblocking(true)?;
        self.connections
            .try_send(theirs)
            .map_err(io::Error::other)?;
        UnixStream::from_std(ours)
    }

    async fn rounds(
        &mut self,
        device: &mut OpenPort,
        server: &UnixStream,
        slave: &mut SerialSlave,
        counted: &mut SlaveCounters,
    ) -> io::Result<()> {
        let mut buffer = [0; 512];
        let mut answers = Vec::new();
        let ends = self.connections.clone();
        let mut ended = pin!(ends.closed());
        loop {
            let router = self.router.load_full();
            // A broadcast is not addressed to a unit.
            let is_ours = |unit: u8| unit > 0 && router.find(unit).is_some();
            answered(server, &mut answers, slave)?;
            // Last before a frame: nothing is sent on top of bytes that have just arrived.
            let has_more = drain(device, &mut buffer, slave, &is_ours)?;
            slave.tick(clock::now(), &is_ours);
            while let Some(request) = slave.next_request() {
                if !request.is_awaited && !is_stop(&router, &request) {
                    continue;
                }
                let mut message = Vec::new();
                mbap::encode(&mut message, request.number, request.unit, |out| {
                    out.extend_from_slice(&request.pdu)
                });
                match server.try_write(&message) {
                    Ok(written) if written == message.len() => {}
                    // The socket holds far more than one request; this server reads no more.
                    Ok(_) => return Err(io::ErrorKind::WriteZero.into()),
                    Err(error) => return Err(error),
                }
            }
            if let Some(frame) = slave.next_frame(clock::now()) {
                device.write_frame(&frame)?;
            }
            self.totals.add(counted, slave.counters());
            *counted = *slave.counters();
            if let Some(wake) = slave.next_wake() {
                self.timer.arm(wake)?;
            }
            if has_more {
                tokio::time::sleep(FLOOD_PAUSE).await;
                continue;
            }
            if self.wait(device, server, ended.as_mut()).await? {
                return Ok(());
            }
        }
    }

    /// Waits until something happens. Returns whether the server has stopped taking the port's connections.
    async fn wait(
        &mut self,
        device: &mut OpenPort,
        server: &UnixStream,
        mut ended: std::pin::Pin<&mut impl Future<Output = ()>>,
    ) -> io::Result<bool> {
        poll_fn(|cx| {
            if ended.as_mut().poll(cx).is_ready() {
                return Poll::Ready(Ok(true));
            }
            let fired = self.timer.poll_fired(cx).is_ready();
            let has_bytes = device.poll_readable(cx)?.is_ready();
            let has_answer = server.poll_read_ready(cx)?.is_ready();
            if fired || has_bytes || has_answer {
                Poll::Ready(Ok(false))
            } else {
                Poll::Pending
            }
        })
        .await
    }
}

/// Whether `request` orders something to stop.
fn is_stop(router: &UnitRouter, request: &SlaveRequest) -> bool {
    parse(&request.pdu).is_ok_and(|ask| router.is_stop(request.unit, &ask))
}

/// Takes the answers of the server.
fn answered(server: &UnixStream, answers: &mut Vec<u8>, slave: &mut SerialSlave) -> io::Result<()> {
    let mut buffer = [0; 512];
    loop {
        match server.try_read(&mut buffer) {
            Ok(0) => return Err(io::ErrorKind::UnexpectedEof.into()),
            Ok(read) => answers.extend_from_slice(buffer.get(..read).unwrap_or_default()),
            Err(error) if error.kind() == io::ErrorKind::WouldBlock => return Ok(()),
            Err(error) => return Err(error),
        }
        while let Some(message) = mbap::decode(answers).map_err(io::Error::other)? {
            slave.answer(message.transaction, message.pdu);
            let bytes = message.adu_bytes;
            answers.drain(..bytes);
        }
    }
}

/// Reads until the port is empty, as often as a round allows; returns whether there may be more.
fn drain(
    device: &mut OpenPort,
    buffer: &mut [u8],
    slave: &mut SerialSlave,
    is_ours: &dyn Fn(u8) -> bool,
) -> io::Result<bool> {
    for _ in 0..READS_PER_ROUND {
        let Some(bytes) = device.read_now(buffer)? else {
            return Ok(false);
        };
        if bytes == 0 {
            return Err(io::ErrorKind::UnexpectedEof.into());
        }
        slave.received(
            clock::now(),
            buffer.get(..bytes).unwrap_or_default(),
            is_ours,
        );
    }
    Ok(true)
}
