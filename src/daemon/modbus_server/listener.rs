//! What a listener grants, and where its units lead to: both change while its connections stay.

use super::super::router::Router;
use crate::config::ListenerSettings;
use crate::domain::command::Rights;
use crate::guard::access;
use crate::north::modbus::RoomId;
use std::cell::{OnceCell, RefCell};
use std::net::IpAddr;
use std::rc::Rc;
use std::time::Duration;

/// A listener as it is configured at present.
#[derive(Debug)]
pub struct Listener {
    /// Nothing: it is gone.
    settings: RefCell<Option<ListenerSettings>>,
    router: RefCell<Rc<Router>>,
    room: OnceCell<RoomId>,
}

/// What a listener grants to a client.
#[derive(Clone, Copy, Debug)]
pub(super) struct Granted {
    pub rights: Rights,
    /// Its reads of a uniform unit renew its lease.
    pub reads_renew: bool,
    /// A connection without a request is closed after this time; nothing: never.
    pub idle_timeout: Option<Duration>,
}

impl Listener {
    /// A listener with these settings, whose units lead where `router` says.
    #[must_use]
    pub fn new(settings: ListenerSettings, router: Router) -> Rc<Self> {
        let (settings, router) = (RefCell::new(Some(settings)), RefCell::new(Rc::new(router)));
        Rc::new(Self { settings, router, room: OnceCell::new() })
    }

    /// Its settings are others now.
    pub fn change(&self, settings: ListenerSettings, router: Router) {
        self.settings.replace(Some(settings));
        self.router.replace(Rc::new(router));
    }

    /// It is gone: nobody is allowed any more.
    pub fn close(&self) {
        self.settings.replace(None);
    }

    pub(super) fn router(&self) -> Rc<Router> {
        Rc::clone(&self.router.borrow())
    }

    pub(super) fn allows(&self, peer: IpAddr) -> bool {
        let settings = self.settings.borrow();
        let allows = |it: &ListenerSettings| it.allow.as_deref().is_none_or(|nets| access::is_in(peer, nets));
        settings.as_ref().is_some_and(allows)
    }

    pub(super) fn grants(&self, peer: IpAddr) -> Granted {
        let settings = self.settings.borrow();
        let nothing = Granted { rights: Rights { write: false, stop: false }, reads_renew: false, idle_timeout: None };
        settings.as_ref().map_or(nothing, |it| Granted {
            rights: access::rights_of(peer, &it.write, it.stop.as_deref()),
            reads_renew: it.reads_renew,
            idle_timeout: it.idle_timeout,
        })
    }

    /// The room of its connections, which `add` makes once.
    pub(super) fn room(&self, add: impl FnOnce() -> RoomId) -> RoomId {
        *self.room.get_or_init(add)
    }

    pub(super) fn has_priority(&self, peer: IpAddr) -> bool {
        self.settings.borrow().as_ref().is_some_and(|it| access::is_in(peer, &it.priority))
    }

    pub(super) fn connections_max(&self) -> Option<usize> {
        self.settings.borrow().as_ref().and_then(|it| it.connections_max)
    }

    pub(super) fn keep_alive(&self) -> Option<Duration> {
        self.settings.borrow().as_ref().and_then(|it| it.keep_alive)
    }
}
