//! Connections to the HTTP listener on TCP: from allowed networks only, through TLS where configured, and always with a
//! place for one more, so that earlier clients cannot hold up a stop. After a reload, connections that would no longer
//! be accepted are closed.

use super::connections::{CONNECTIONS_MAX, ConnectionPatience, converse_by};
use super::front::ClientRequirements;
use super::lasting::{self, ConnectionLife, StreamSlot};
use super::taking::WriteTimeout;
use crate::daemon::exchange::rate_limited_log::RateLimitedLog;
use crate::daemon::host::clock;
use crate::domain::time::MonoTime;
use arc_swap::ArcSwap;
use axum::Router;
use axum::response::Response;
use axum::serve::Listener;
use hyper::Request;
use hyper::body::Incoming;
use hyper::service::Service;
use hyper_util::service::TowerToHyperService;
use rustls::ServerConfig;
use rustls::pki_types::CertificateDer;
use std::cell::{Cell, RefCell};
use std::collections::BTreeMap;
use std::convert::Infallible;
use std::net::IpAddr;
use std::pin::Pin;
use std::rc::Rc;
use std::sync::Arc;
use std::time::Duration;
use tokio::net::{TcpListener, TcpStream};
use tokio::sync::Notify;
use tokio::task::AbortHandle;
use tokio::time::timeout;
use tokio_rustls::TlsAcceptor;

/// Most time for a TLS handshake.
const HANDSHAKE_MAX: Duration = Duration::from_secs(5);

/// The peer of a request, as an extension for its routes.
#[derive(Clone, Copy, Debug)]
pub(super) struct PeerAddress(pub IpAddr);

/// The certificate of the authority that clients install, as an extension for its route; `None` without one.
#[derive(Clone, Debug, Default)]
pub(super) struct AuthorityExtension(pub Option<CertificateDer<'static>>);

/// Serves `router` on `listener` until the task is dropped, always by the current `front`; `changed` is notified when
/// that is replaced. Its connections end with it.
pub(super) async fn serve(
    mut listener: TcpListener,
    router: Router,
    (front, changed): (Arc<ArcSwap<ClientRequirements>>, Arc<Notify>),
    patience: ConnectionPatience,
) {
    let house = ListenerConnections::default();
    let lasting = lasting::places();
    let log = RateLimitedLog::default();
    let places = &house.0;
    loop {
        let (stream, peer) = tokio::select! {
            accepted = Listener::accept(&mut listener) => accepted,
            () = changed.notified() => {
                places.review(&front.load());
                continue;
            }
        };
        let peer = peer.ip().to_canonical();
        let front = front.load();
        if !front.allows(peer) {
            log.say(&format!("HTTP: refused {peer}: not in `allow`"));
            continue;
        }
        let (lasting, life) = StreamSlot::new(Arc::clone(&lasting));
        let (place, seat) = ConnectionPlaces::take(places, lasting);
        let tls = front.tls();
        let guest = ConnectionRoutes {
            router: TowerToHyperService::new(router.clone()),
            peer: PeerAddress(peer),
            authority: AuthorityExtension(tls.and_then(|tls| tls.authority.clone())),
            seat: Rc::clone(&seat),
        };
        let tls = tls.map(|tls| Arc::clone(&tls.config));
        let number = place.number;
        let is_encrypted = tls.is_some();
        let task = tokio::task::spawn_local(async move {
            receive(stream, tls, guest, (patience, life)).await;
            drop(place);
        });
        let held = HeldConnection {
            seat,
            peer,
            is_encrypted,
            task: task.abort_handle(),
        };
        places.held.borrow_mut().insert(number, held);
    }
}

async fn receive(
    stream: TcpStream,
    tls: Option<Arc<ServerConfig>>,
    guest: ConnectionRoutes,
    (patience, life): (ConnectionPatience, ConnectionLife),
) {
    let life = (guest.seat.lasting.clone(), life);
    let Some(tls) = tls else {
        return converse_by(
            WriteTimeout::new(stream, patience.piece),
            guest,
            patience,
            life,
        )
        .await;
    };
    let peer = guest.peer.0;
    match timeout(HANDSHAKE_MAX, TlsAcceptor::from(tls).accept(stream)).await {
        Ok(Ok(stream)) => {
            converse_by(
                WriteTimeout::new(stream, patience.piece),
                guest,
                patience,
                life,
            )
            .await
        }
        Ok(Err(error)) => {
            tracing::debug!(%peer, %error, "TLS handshake on the HTTP listener failed")
        }
        Err(_) => tracing::debug!(%peer, "TLS handshake on the HTTP listener timed out"),
    }
}

/// All connections of a listener. They are closed when this is dropped.
#[derive(Default)]
struct ListenerConnections(Rc<ConnectionPlaces>);

impl Drop for ListenerConnections {
    fn drop(&mut self) {
        self.0.send_away(|_| true);
    }
}

/// The places of all connections.
#[derive(Debug, Default)]
struct ConnectionPlaces {
    held: RefCell<BTreeMap<u64, HeldConnection>>,
    last: Cell<u64>,
}

#[derive(Debug)]
struct HeldConnection {
    seat: Rc<ConnectionSeat>,
    peer: IpAddr,
    is_encrypted: bool,
    task: AbortHandle,
}

/// What a connection does.
#[derive(Debug)]
struct ConnectionSeat {
    /// A request waits for its answer.
    is_asking: Cell<bool>,
    /// When it connected, or last sent a request.
    seen: Cell<MonoTime>,
    /// Whether its answer is endless.
    lasting: StreamSlot,
}

/// A place that is free again when this is dropped.
#[derive(Debug)]
struct PlacePermit {
    places: Rc<ConnectionPlaces>,
    number: u64,
}

impl ConnectionPlaces {
    /// A place for one more. If all are taken, the connection that sent no request for longest and waits for no answer
    /// is closed; endless answers never take all places.
    fn take(places: &Rc<Self>, lasting: StreamSlot) -> (PlacePermit, Rc<ConnectionSeat>) {
        if places.held.borrow().len() >= CONNECTIONS_MAX {
            places.make_room();
        }
        places.last.set(places.last.get() + 1);
        let seat = ConnectionSeat {
            is_asking: Cell::new(false),
            seen: Cell::new(clock::now()),
            lasting,
        };
        (
            PlacePermit {
                places: Rc::clone(places),
                number: places.last.get(),
            },
            Rc::new(seat),
        )
    }

    /// Closes connections that would no longer be accepted: from a network that is not allowed, or without TLS where it
    /// is now required, or the other way round.
    fn review(&self, front: &ClientRequirements) {
        let is_encrypted = front.tls().is_some();
        self.send_away(|held| !front.allows(held.peer) || held.is_encrypted != is_encrypted);
    }

    fn send_away(&self, goes: impl Fn(&HeldConnection) -> bool) {
        // Closing gives the place back, which borrows the list.
        let gone: Vec<_> = self
            .held
            .borrow_mut()
            .extract_if(.., |_, held| goes(held))
            .collect();
        gone.iter().for_each(|(_, held)| held.task.abort());
    }

    fn make_room(&self) {
        let mut held = self.held.borrow_mut();
        let rank = |held: &HeldConnection| {
            (
                held.seat.lasting.is_lasting(),
                held.seat.is_asking.get(),
                held.seat.seen.get(),
            )
        };
        let first = held
            .iter()
            .min_by_key(|(_, it)| rank(it))
            .map(|(number, _)| *number);
        if let Some(gone) = first.and_then(|number| held.remove(&number)) {
            gone.task.abort();
        }
    }
}

impl Drop for PlacePermit {
    fn drop(&mut self) {
        self.places.held.borrow_mut().remove(&self.number);
    }
}

/// The routes as one connection sees them.
struct ConnectionRoutes {
    router: TowerToHyperService<Router>,
    peer: PeerAddress,
    authority: AuthorityExtension,
    seat: Rc<ConnectionSeat>,
}

impl Service<Request<Incoming>> for ConnectionRoutes {
    type Response = Response;
    type Error = Infallible;
    type Future = Pin<Box<dyn Future<Output = Result<Response, Infallible>>>>;

    fn call(&self, mut request: Request<Incoming>) -> Self::Future {
        request.extensions_mut().insert(self.peer);
        request.extensions_mut().insert(self.authority.clone());
        self.seat.is_asking.set(true);
        self.seat.seen.set(clock::now());
        let answer = self.router.call(request);
        let seat = Rc::clone(&self.seat);
        Box::pin(async move {
            let answer = answer.await;
            seat.is_asking.set(false);
            answer
        })
    }
}
