//! State that all connections share: their slots, and the memory that unread answers take.

use super::{ModbusClient, ModbusListener, ModbusServer};
use crate::domain::ids::AskerId;
use crate::north::modbus::{ClientSlot, ClientSlots, NewConnection, NewcomerEntry};
use std::cell::{Cell, RefCell};
use std::fmt;
use std::net::IpAddr;
use std::rc::Rc;

/// Most bytes of unread answers of all clients together. The connection bounds what one client may leave; this bounds
/// thousands of them.
pub(super) const UNREAD_MAX: usize = 8 * 1024 * 1024;
/// Clients with the most unread answers are closed until this many bytes are left, so that it is not repeated for each
/// answer.
const UNREAD_KEPT: usize = UNREAD_MAX / 4 * 3;

/// Why the server ends a connection that has done nothing wrong.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum ClientDismissal {
    Unwanted,
    MadeRoom,
    Unread,
}

impl fmt::Display for ClientDismissal {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Unwanted => "its listener was removed or no longer allows it",
            Self::MadeRoom => "it was silent longest when another client needed its slot",
            Self::Unread => "it had the most unread answers when all clients together had too many",
        })
    }
}

/// State that all connections share.
#[derive(Debug, Default)]
pub(super) struct ClientAdmission {
    pub(super) slots: RefCell<ClientSlots>,
    /// Bytes that wait for clients to read them.
    unread: Cell<usize>,
}

/// The slot of one connection. It is freed when this is dropped.
#[derive(Debug)]
pub(super) struct ClientSeat {
    admission: Rc<ClientAdmission>,
    pub(super) asker: AskerId,
    slot: Cell<ClientSlot>,
    unread: Cell<usize>,
}

impl ClientSeat {
    /// Notes a request of the connection.
    pub(super) fn active(&self) {
        self.slot
            .set(self.admission.slots.borrow_mut().active(self.slot.get()));
    }

    /// Sets how many bytes wait for the client. Returns whether too many wait for all clients together.
    pub(super) fn leaves_unread(&self, bytes: usize) -> bool {
        let before = self.unread.replace(bytes);
        let all = self
            .admission
            .unread
            .get()
            .saturating_sub(before)
            .saturating_add(bytes);
        self.admission.unread.set(all);
        all > UNREAD_MAX
    }
}

impl Drop for ClientSeat {
    fn drop(&mut self) {
        self.leaves_unread(0);
        self.admission.slots.borrow_mut().leave(self.slot.get());
    }
}

impl ModbusServer {
    /// A slot for a new client, if need be that of the client that was silent longest; `None` if there is none.
    pub(super) fn seat(&self, peer: IpAddr, listener: &ModbusListener) -> Option<ClientSeat> {
        self.last.set(self.last.get() + 1);
        let asker = AskerId(self.last.get());
        let newcomer = {
            let mut slots = self.admission.slots.borrow_mut();
            let room = listener.room(|| slots.add_room());
            let room_max = listener.connections_max();
            let has_priority = listener.has_priority(peer);
            NewConnection {
                asker,
                room,
                room_max,
                has_priority,
            }
        };
        let entry = self
            .admission
            .slots
            .borrow_mut()
            .enter(newcomer, &|asker| self.is_busy(asker));
        let slot = match entry {
            NewcomerEntry::Free(slot) => slot,
            NewcomerEntry::InsteadOf(slot, gone) => {
                self.dismiss(gone, ClientDismissal::MadeRoom);
                slot
            }
            NewcomerEntry::Full => return None,
        };
        let admission = Rc::clone(&self.admission);
        let slot = Cell::new(slot);
        Some(ClientSeat {
            admission,
            asker,
            slot,
            unread: Cell::default(),
        })
    }

    /// Closes the client that was silent longest. Returns whether there is one that may be closed.
    pub(super) fn make_room(&self) -> bool {
        let gone = self
            .admission
            .slots
            .borrow_mut()
            .make_room(&|asker| self.is_busy(asker));
        gone.inspect(|gone| self.dismiss(*gone, ClientDismissal::MadeRoom))
            .is_some()
    }

    /// Closes the clients with the most unread answers until few enough bytes wait; those with priority last.
    pub(super) fn shed(&self) {
        let clients = self.clients.borrow();
        let mut greedy: Vec<_> = clients
            .values()
            .filter(|client| client.seat.unread.get() > 0)
            .collect();
        let has_priority = |client: &ModbusClient| client.seat.slot.get() == ClientSlot::Priority;
        greedy.sort_by_key(|client| {
            (
                has_priority(client),
                std::cmp::Reverse(client.seat.unread.get()),
            )
        });
        for client in greedy {
            if self.admission.unread.get() <= UNREAD_KEPT {
                break;
            }
            client.seat.leaves_unread(0);
            client.dismiss(ClientDismissal::Unread);
            self.totals.closed_early();
        }
    }

    fn is_busy(&self, asker: AskerId) -> bool {
        self.clients
            .borrow()
            .get(&asker)
            .is_some_and(|client| client.machine.borrow().is_busy())
    }

    fn dismiss(&self, asker: AskerId, why: ClientDismissal) {
        if let Some(client) = self.clients.borrow().get(&asker) {
            client.dismiss(why);
            self.totals.closed_early();
        } else if self.handshakes.dismiss(asker) {
            self.totals.closed_early();
        }
    }
}
