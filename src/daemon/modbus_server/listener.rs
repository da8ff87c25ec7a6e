//! What a listener grants, and where its units lead to. Both may change while its connections stay open.

use super::security::ListenerSecurity;
use crate::config::ListenerSettings;
use crate::daemon::exchange::router::UnitRouter;
use crate::daemon::exchange::totals::ReadTotals;
use crate::domain::command::Rights;
use crate::domain::ids::CommanderName;
use crate::guard::access;
use crate::north::modbus::RoomId;
use std::cell::{OnceCell, RefCell};
use std::net::IpAddr;
use std::rc::Rc;
use std::sync::Arc;
use std::time::Duration;

/// A listener as it is configured at present.
#[derive(Debug)]
pub struct ModbusListener {
    /// `None` if it was removed.
    settings: RefCell<Option<ListenerSettings>>,
    router: RefCell<Arc<UnitRouter>>,
    /// `None` if connections are not encrypted.
    security: RefCell<Option<Rc<ListenerSecurity>>>,
    room: OnceCell<RoomId>,
    reads: Arc<ReadTotals>,
}

/// What a listener grants to a client.
#[derive(Clone, Copy, Debug)]
pub(super) struct ListenerGrant {
    /// Whether requests are answered at all.
    pub may_ask: bool,
    pub rights: Rights,
    /// Whether its reads of a uniform unit renew its lease.
    pub reads_renew: bool,
    /// A connection without a request is closed after this time; `None` for never.
    pub idle_timeout: Option<Duration>,
}

impl ModbusListener {
    /// A listener with these settings, whose units `router` routes. `security` is what was read for the settings' TLS.
    #[must_use]
    pub fn new(
        settings: ListenerSettings,
        router: UnitRouter,
        security: Option<ListenerSecurity>,
    ) -> Rc<Self> {
        let name = settings.listen.to_string();
        Self::called(name, settings, router, security)
    }

    /// A listener for the serial master `name`.
    #[must_use]
    pub fn of_master(
        name: CommanderName,
        settings: ListenerSettings,
        router: UnitRouter,
    ) -> Rc<Self> {
        Self::called(name.to_string(), settings, router, None)
    }

    fn called(
        name: String,
        settings: ListenerSettings,
        router: UnitRouter,
        security: Option<ListenerSecurity>,
    ) -> Rc<Self> {
        Rc::new(Self {
            reads: Arc::new(ReadTotals::new(name)),
            settings: RefCell::new(Some(settings)),
            router: RefCell::new(Arc::new(router)),
            security: RefCell::new(security.map(Rc::new)),
            room: OnceCell::new(),
        })
    }

    /// Replaces its settings.
    pub fn change(
        &self,
        settings: ListenerSettings,
        router: UnitRouter,
        security: Option<ListenerSecurity>,
    ) {
        self.settings.replace(Some(settings));
        self.router.replace(Arc::new(router));
        self.security.replace(security.map(Rc::new));
    }

    /// Removes it: no client is allowed any more.
    pub fn close(&self) {
        self.settings.replace(None);
    }

    /// Where its units lead to.
    pub fn router(&self) -> Arc<UnitRouter> {
        Arc::clone(&self.router.borrow())
    }

    /// Counts of its native reads.
    #[must_use]
    pub const fn reads(&self) -> &Arc<ReadTotals> {
        &self.reads
    }

    /// The TLS of new connections; `None` if they are not encrypted.
    pub(super) fn security(&self) -> Option<Rc<ListenerSecurity>> {
        self.security.borrow().clone()
    }

    /// Whether a connection that was accepted with `security` may continue: only if it would still be accepted.
    pub(super) fn goes_on(&self, security: Option<&ListenerSecurity>) -> bool {
        match (self.security.borrow().as_deref(), security) {
            (None, None) => true,
            (Some(now), Some(then)) => now.trusts_as(then),
            _ => false,
        }
    }

    pub(super) fn allows(&self, peer: IpAddr) -> bool {
        let settings = self.settings.borrow();
        let allows = |it: &ListenerSettings| {
            it.allow
                .as_deref()
                .is_none_or(|nets| access::is_in(peer, nets))
        };
        settings.as_ref().is_some_and(allows)
    }

    /// What a client at `peer` is granted, with the `role` of its certificate if it presented one.
    pub(super) fn grants(&self, peer: IpAddr, role: Option<&str>) -> ListenerGrant {
        let settings = self.settings.borrow();
        let rights = settings.as_ref().and_then(|it| {
            let by_address = access::rights_of(peer, &it.write, it.stop.as_deref());
            match (&it.tls, role) {
                (None, None) => Some(by_address),
                (Some(tls), Some(role)) => access::rights_in_role(by_address, role, &tls.roles),
                _ => None,
            }
        });
        ListenerGrant {
            may_ask: rights.is_some(),
            rights: rights.unwrap_or(Rights::NONE),
            reads_renew: settings.as_ref().is_some_and(|it| it.reads_renew),
            idle_timeout: settings.as_ref().and_then(|it| it.idle_timeout),
        }
    }

    /// Whether native reads may be answered from memory.
    pub(super) fn remembers(&self) -> bool {
        self.settings.borrow().as_ref().is_some_and(|it| it.cached)
    }

    /// The room of its connections, which `add` creates once.
    pub(super) fn room(&self, add: impl FnOnce() -> RoomId) -> RoomId {
        *self.room.get_or_init(add)
    }

    pub(super) fn has_priority(&self, peer: IpAddr) -> bool {
        self.settings
            .borrow()
            .as_ref()
            .is_some_and(|it| access::is_in(peer, &it.priority))
    }

    pub(super) fn connections_max(&self) -> Option<usize> {
        self.settings
            .borrow()
            .as_ref()
            .and_then(|it| it.connections_max)
    }

    pub(super) fn keep_alive(&self) -> Option<Duration> {
        self.settings.borrow().as_ref().and_then(|it| it.keep_alive)
    }
}
