//! What a listener grants, and where its units lead to: both change while its connections stay.

use super::super::router::Router;
use crate::config::ListenerSettings;
use crate::domain::command::Rights;
use crate::guard::access;
use std::cell::RefCell;
use std::net::IpAddr;
use std::rc::Rc;

/// A listener as it is configured at present.
#[derive(Debug)]
pub struct Listener {
    /// Nothing: it is gone.
    settings: RefCell<Option<ListenerSettings>>,
    router: RefCell<Rc<Router>>,
}

/// What a listener grants to a client.
#[derive(Clone, Copy, Debug)]
pub(super) struct Granted {
    pub rights: Rights,
    /// Its reads of a uniform unit renew its lease.
    pub reads_renew: bool,
}

impl Listener {
    /// A listener with these settings, whose units lead where `router` says.
    #[must_use]
    pub fn new(settings: ListenerSettings, router: Router) -> Rc<Self> {
        Rc::new(Self { settings: RefCell::new(Some(settings)), router: RefCell::new(Rc::new(router)) })
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
        let nothing = Granted { rights: Rights { write: false, stop: false }, reads_renew: false };
        settings.as_ref().map_or(nothing, |it| Granted {
            rights: access::rights_of(peer, &it.write, it.stop.as_deref()),
            reads_renew: it.reads_renew,
        })
    }
}
