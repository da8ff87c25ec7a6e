//! Which connections have a slot, and which gives way when all are taken. It knows no socket.

use crate::domain::ids::AskerId;
use std::collections::BTreeMap;

/// The ordinary connections of one listener.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct RoomId(u64);

/// The slot of one connection; it is returned by [`ClientSlots::leave`].
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ClientSlot {
    /// A connection that may have to give way.
    Ordinary {
        /// The room it belongs to.
        room: RoomId,
        /// Its rank among the others: the lowest has been silent for longest.
        turn: u64,
    },
    /// A connection that never gives way.
    Priority,
}

/// What a new connection asks for.
#[derive(Clone, Copy, Debug)]
pub struct NewConnection {
    /// Its number, which no other connection has.
    pub asker: AskerId,
    /// Its listener's room.
    pub room: RoomId,
    /// Most ordinary connections there; `None`: as many as there are slots.
    pub room_max: Option<usize>,
    /// The connection never gives way.
    pub has_priority: bool,
}

/// What happens to a new connection.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum NewcomerEntry {
    /// The newcomer has a slot.
    Free(ClientSlot),
    /// The newcomer has the slot of this connection, which is to be closed.
    InsteadOf(ClientSlot, AskerId),
    /// All slots are taken, and no connection may be closed.
    Full,
}

/// Whether a connection is waiting for an answer. Such a connection does not give way.
pub type IsBusy<'a> = &'a dyn Fn(AskerId) -> bool;

/// The slots of all connections. Each call costs the logarithm of their number.
#[derive(Debug)]
pub struct ClientSlots {
    most: usize,
    last_room: u64,
    last_turn: u64,
    /// The ordinary ones by turn; rooms without any are absent.
    rooms: BTreeMap<RoomId, BTreeMap<u64, AskerId>>,
    ordinary: usize,
    priority: usize,
}

impl ClientSlots {
    /// Most connections, whatever the system grants: what one takes is a few kilobytes.
    pub const MOST: usize = 65_536;
    /// Slots that are reserved for priority, or a quarter of all if there are few.
    pub const RESERVED: usize = 16;
    /// Most connections that are checked for being busy before a new one is refused. A busy one has sent a request
    /// within the deadline, so those that have been silent for longer are ranked before it.
    const LOOKS_MAX: usize = 64;

    /// `most` slots, none of them taken.
    #[must_use]
    pub const fn new(most: usize) -> Self {
        Self {
            most,
            last_room: 0,
            last_turn: 0,
            rooms: BTreeMap::new(),
            ordinary: 0,
            priority: 0,
        }
    }

    /// How many slots there are.
    #[must_use]
    pub const fn most(&self) -> usize {
        self.most
    }

    /// A room for the ordinary connections of another listener.
    pub const fn add_room(&mut self) -> RoomId {
        self.last_room += 1;
        RoomId(self.last_room)
    }

    /// Gives a new connection a slot, if necessary that of the connection that has been silent for longest: of its own
    /// room if that is full, else of all.
    pub fn enter(&mut self, newcomer: NewConnection, is_busy: IsBusy<'_>) -> NewcomerEntry {
        let gone = if newcomer.has_priority {
            let has_room = self.ordinary + self.priority < self.most;
            if has_room {
                None
            } else {
                Some(self.make_room(is_busy))
            }
        } else if newcomer
            .room_max
            .is_some_and(|max| self.in_room(newcomer.room) >= max)
        {
            Some(
                self.silent_in(newcomer.room, is_busy)
                    .and_then(|turn| self.remove(newcomer.room, turn)),
            )
        } else {
            let has_room = self.ordinary + self.priority.max(self.reserved()) < self.most;
            if has_room {
                None
            } else {
                Some(self.make_room(is_busy))
            }
        };
        match gone {
            None => NewcomerEntry::Free(self.take(newcomer)),
            Some(None) => NewcomerEntry::Full,
            Some(Some(gone)) => NewcomerEntry::InsteadOf(self.take(newcomer), gone),
        }
    }

    /// Takes the slot of the ordinary connection that has been silent for longest, which is to be closed; `None` if
    /// none may be closed.
    pub fn make_room(&mut self, is_busy: IsBusy<'_>) -> Option<AskerId> {
        let silent = self
            .rooms
            .keys()
            .filter_map(|room| Some((self.silent_in(*room, is_busy)?, *room)));
        let (turn, room) = silent.min()?;
        self.remove(room, turn)
    }

    /// The connection at `slot` has sent a request: it gives way after all others. Returns its new slot.
    #[must_use]
    pub fn active(&mut self, slot: ClientSlot) -> ClientSlot {
        let ClientSlot::Ordinary { room, turn } = slot else {
            return slot;
        };
        let Some(order) = self.rooms.get_mut(&room) else {
            return slot;
        };
        let Some(asker) = order.remove(&turn) else {
            return slot;
        };
        self.last_turn += 1;
        order.insert(self.last_turn, asker);
        ClientSlot::Ordinary {
            room,
            turn: self.last_turn,
        }
    }

    /// The connection at `slot` was closed. One that had to give way no longer has a slot, which does no harm.
    pub fn leave(&mut self, slot: ClientSlot) {
        match slot {
            ClientSlot::Ordinary { room, turn } => {
                self.remove(room, turn);
            }
            ClientSlot::Priority => self.priority = self.priority.saturating_sub(1),
        }
    }

    fn reserved(&self) -> usize {
        Self::RESERVED.min(self.most / 4)
    }

    fn in_room(&self, room: RoomId) -> usize {
        self.rooms.get(&room).map_or(0, BTreeMap::len)
    }

    fn take(&mut self, newcomer: NewConnection) -> ClientSlot {
        if newcomer.has_priority {
            self.priority += 1;
            return ClientSlot::Priority;
        }
        self.last_turn += 1;
        self.ordinary += 1;
        self.rooms
            .entry(newcomer.room)
            .or_default()
            .insert(self.last_turn, newcomer.asker);
        ClientSlot::Ordinary {
            room: newcomer.room,
            turn: self.last_turn,
        }
    }

    /// The turn of the one in `room` that has been silent for longest and is waiting for nothing.
    fn silent_in(&self, room: RoomId, is_busy: IsBusy<'_>) -> Option<u64> {
        let first = self.rooms.get(&room)?.iter().take(Self::LOOKS_MAX);
        first
            .into_iter()
            .find(|(_, asker)| !is_busy(**asker))
            .map(|(turn, _)| *turn)
    }

    fn remove(&mut self, room: RoomId, turn: u64) -> Option<AskerId> {
        let order = self.rooms.get_mut(&room)?;
        let asker = order.remove(&turn)?;
        if order.is_empty() {
            self.rooms.remove(&room);
        }
        self.ordinary -= 1;
        Some(asker)
    }
}

impl Default for ClientSlots {
    fn default() -> Self {
        Self::new(Self::MOST)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn newcomer(number: u64, room: RoomId) -> NewConnection {
        NewConnection {
            asker: AskerId(number),
            room,
            room_max: None,
            has_priority: false,
        }
    }

    fn nobody(_: AskerId) -> bool {
        false
    }

    fn slot(entry: NewcomerEntry) -> ClientSlot {
        match entry {
            NewcomerEntry::Free(slot) | NewcomerEntry::InsteadOf(slot, _) => slot,
            NewcomerEntry::Full => panic!("no slot"),
        }
    }

    fn gone(entry: NewcomerEntry) -> Option<u64> {
        if let NewcomerEntry::InsteadOf(_, asker) = entry {
            Some(asker.0)
        } else {
            None
        }
    }

    #[test]
    fn the_one_that_was_silent_for_longest_gives_way() {
        let mut slots = ClientSlots::new(4);
        let room = slots.add_room();
        let first: Vec<_> = (0..3)
            .map(|number| slot(slots.enter(newcomer(number, room), &nobody)))
            .collect();
        let last = slots.active(first[0]);
        assert_eq!(
            gone(slots.enter(newcomer(3, room), &nobody)),
            Some(1),
            "the first has asked since"
        );
        slots.leave(last);
        assert!(matches!(
            slots.enter(newcomer(4, room), &nobody),
            NewcomerEntry::Free(_)
        ));
        slots.leave(first[1]);
        assert_eq!(slots.active(first[1]), first[1], "who gave way has no slot");
        assert_eq!(
            gone(slots.enter(newcomer(5, room), &nobody)),
            Some(2),
            "and gives back none"
        );
    }

    #[test]
    fn who_waits_for_an_answer_does_not_give_way() {
        let mut slots = ClientSlots::new(4);
        let room = slots.add_room();
        for number in 0..3 {
            slots.enter(newcomer(number, room), &nobody);
        }
        assert_eq!(
            gone(slots.enter(newcomer(3, room), &|asker| asker.0 != 1)),
            Some(1)
        );
        assert_eq!(
            slots.enter(newcomer(4, room), &|_| true),
            NewcomerEntry::Full
        );
        assert_eq!(slots.make_room(&|_| true), None);
        assert_eq!(slots.make_room(&nobody), Some(AskerId(0)));
    }

    #[test]
    fn priority_has_places_of_its_own_and_never_gives_way() {
        let mut slots = ClientSlots::new(100);
        let room = slots.add_room();
        let entries = (0..100).map(|number| slots.enter(newcomer(number, room), &nobody));
        assert_eq!(
            entries
                .filter(|it| matches!(it, NewcomerEntry::Free(_)))
                .count(),
            84
        );
        let urgent = |number| NewConnection {
            has_priority: true,
            ..newcomer(number, room)
        };
        for number in 100..116 {
            assert_eq!(
                slots.enter(urgent(number), &|_| true),
                NewcomerEntry::Free(ClientSlot::Priority),
                "though all others wait"
            );
        }
        assert_eq!(slots.enter(urgent(116), &|_| true), NewcomerEntry::Full);
        for number in 117..201 {
            assert_eq!(
                gone(slots.enter(urgent(number), &nobody)),
                Some(number - 101),
                "an ordinary one"
            );
        }
        assert_eq!(slots.enter(urgent(201), &nobody), NewcomerEntry::Full);
        assert_eq!(
            slots.enter(newcomer(202, room), &nobody),
            NewcomerEntry::Full
        );
        slots.leave(ClientSlot::Priority);
        assert_eq!(
            slots.enter(urgent(203), &nobody),
            NewcomerEntry::Free(ClientSlot::Priority)
        );
    }

    #[test]
    fn a_full_room_makes_room_itself_and_full_places_wherever_silence_was_longest() {
        let mut slots = ClientSlots::new(8);
        let small = slots.add_room();
        let other = slots.add_room();
        let of_small = |number| NewConnection {
            room_max: Some(2),
            ..newcomer(number, small)
        };
        for number in 0..4 {
            slots.enter(newcomer(number, other), &nobody);
        }
        slots.enter(of_small(4), &nobody);
        slots.enter(of_small(5), &nobody);
        assert_eq!(gone(slots.enter(of_small(6), &nobody)), Some(4));
        assert_eq!(gone(slots.enter(newcomer(7, other), &nobody)), Some(0));
        let urgent = NewConnection {
            has_priority: true,
            ..of_small(8)
        };
        assert_eq!(
            slots.enter(urgent, &nobody),
            NewcomerEntry::Free(ClientSlot::Priority),
            "its room does not count it"
        );
        assert_eq!(
            gone(slots.enter(
                NewConnection {
                    room_max: Some(0),
                    ..newcomer(9, small)
                },
                &nobody
            )),
            Some(5)
        );
    }

    #[test]
    fn twenty_thousand_find_a_place() {
        let mut slots = ClientSlots::new(20_000);
        let room = slots.add_room();
        let mut last = None;
        for number in 0..40_000 {
            let entry = slots.enter(newcomer(number, room), &nobody);
            assert_eq!(
                gone(entry),
                number.checked_sub(20_000 - ClientSlots::RESERVED as u64)
            );
            last = Some(slots.active(slot(entry)));
        }
        slots.leave(last.unwrap());
        assert_eq!(slots.ordinary, 20_000 - ClientSlots::RESERVED - 1);
    }

    #[derive(Clone, Debug)]
    enum Event {
        Enter {
            room: usize,
            has_priority: bool,
            busy: u64,
        },
        Ask(prop::sample::Index),
        Leave(prop::sample::Index),
        Short {
            busy: u64,
        },
    }

    fn event() -> impl Strategy<Value = Event> {
        let busy = || prop_oneof![3 => Just(0), 1 => any::<u64>(), 1 => Just(u64::MAX)];
        prop_oneof![
            6 => (0..2_usize, prop::bool::weighted(0.2), busy())
                .prop_map(|(room, has_priority, busy)| Event::Enter { room, has_priority, busy }),
            4 => any::<prop::sample::Index>().prop_map(Event::Ask),
            2 => any::<prop::sample::Index>().prop_map(Event::Leave),
            1 => busy().prop_map(|busy| Event::Short { busy }),
        ]
    }

    /// A connection as the test knows it: a list is in the order of their silence, longest first.
    #[derive(Clone, Copy, Debug)]
    struct Known {
        asker: u64,
        room: usize,
        slot: ClientSlot,
    }

    proptest! {
        #[test]
        fn places_are_as_many_as_there_are_and_the_right_one_gives_way(
            most in 1..24_usize,
            events in prop::collection::vec(event(), 0..120),
        ) {
            let mut slots = ClientSlots::new(most);
            let rooms = [slots.add_room(), slots.add_room()];
            let maxima = [Some(5), None];
            let reserved = ClientSlots::RESERVED.min(most / 4);
            let mut known: Vec<Known> = Vec::new();
            for (number, event) in (0_u64..).zip(events) {
                let is_priority = |it: &Known| it.slot == ClientSlot::Priority;
                let priority = known.iter().filter(|it| is_priority(it)).count();
                let ordinary = known.len() - priority;
                let may_go = |it: &Known, room: Option<usize>, busy: u64| {
                    !is_priority(it) && room.is_none_or(|room| room == it.room) && busy >> (it.asker % 64) & 1 == 0
                };
                match event {
                    Event::Enter { room, has_priority, busy } => {
                        let in_room = known.iter().filter(|it| !is_priority(it) && it.room == room).count();
                        let is_room_full = !has_priority && maxima[room].is_some_and(|max| in_room >= max);
                        let kept = if has_priority { priority } else { priority.max(reserved) };
                        let is_full = is_room_full || ordinary + kept >= most;
                        let whose = is_room_full.then_some(room);
                        let right = known.iter().position(|it| may_go(it, whose, busy)).filter(|_| is_full);
                        let newcomer = NewConnection { asker: AskerId(number), room: rooms[room], room_max: maxima[room], has_priority };
                        let entry = slots.enter(newcomer, &|asker| busy >> (asker.0 % 64) & 1 == 1);
                        prop_assert_eq!(entry == NewcomerEntry::Full, is_full && right.is_none());
                        prop_assert_eq!(gone(entry), right.map(|at| known[at].asker));
                        if let Some(at) = right {
                            let gone = known.remove(at);
                            // Its task exits later, or sent a last request.
                            prop_assert_eq!(slots.active(gone.slot), gone.slot);
                            slots.leave(gone.slot);
                        }
                        if entry != NewcomerEntry::Full {
                            known.push(Known { asker: number, room, slot: slot(entry) });
                        }
                    }
                    Event::Ask(which) if !known.is_empty() => {
                        let mut asking = known.remove(which.index(known.len()));
                        asking.slot = slots.active(asking.slot);
                        known.push(asking);
                    }
                    Event::Leave(which) if !known.is_empty() => {
                        slots.leave(known.remove(which.index(known.len())).slot);
                    }
                    Event::Short { busy } => {
                        let right = known.iter().position(|it| may_go(it, None, busy));
                        let gone = slots.make_room(&|asker| busy >> (asker.0 % 64) & 1 == 1);
                        prop_assert_eq!(gone.map(|it| it.0), right.map(|at| known.remove(at).asker));
                    }
                    Event::Ask(_) | Event::Leave(_) => {}
                }
                prop_assert!(known.len() <= most);
                prop_assert_eq!(slots.ordinary + slots.priority, known.len());
                prop_assert_eq!(slots.rooms.values().map(BTreeMap::len).sum::<usize>(), slots.ordinary);
            }
        }
    }
}
