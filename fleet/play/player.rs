//! Threads that run gateways and consumers, each on a connection of its own.

use super::board::Board;
use super::consumer::Consumer;
use super::gateway::Gateway;
use std::cell::RefCell;
use std::io;
use std::rc::Rc;
use std::sync::Arc;
use std::thread::{Builder, JoinHandle};
use std::time::Duration;
use tokio::sync::Notify;
use tokio::task::LocalSet;
use tokio::time::{sleep, timeout};
use vfd_gateway::daemon::mqtt::{
    BrokerConversation, BrokerKeeps, ClientCounters, ClientPacket, ClientRival, ConnectionSettings,
    converse,
};
use vfd_gateway::domain::time::MonoTime;
use vfd_gateway::north::broker::{BrokerEvent, Publication, Qos};
use vfd_gateway::north::clock::ClockMoment;

/// How often it is checked why a client is not connected.
const LOOK_EVERY: Duration = Duration::from_millis(500);
/// Longest time for a broker to forget a session.
const FORGET_MAX: Duration = Duration::from_secs(10);

/// The role of a client.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Role {
    Gateway,
    Consumer,
}

/// A client: its role, number and name.
#[derive(Clone, Debug)]
pub struct Place {
    pub role: Role,
    pub number: usize,
    pub bell: Arc<Notify>,
}

/// A thread that runs all of `places` until each has finished.
pub fn thread(board: Arc<Board>, places: Vec<Place>) -> io::Result<JoinHandle<()>> {
    let runtime = tokio::runtime::Builder::new_current_thread()
        .enable_all()
        .build()?;
    Builder::new().name("fleet".to_owned()).spawn(move || {
        let all = LocalSet::new();
        for place in places {
            all.spawn_local(play(Arc::clone(&board), place));
        }
        runtime.block_on(all);
    })
}

async fn play(board: Arc<Board>, place: Place) {
    let number = place.number;
    let over = Rc::new(Notify::new());
    let settings = match place.role {
        Role::Gateway => board.plan.gateways.get(number).cloned(),
        Role::Consumer => board.plan.consumers.get(number).cloned(),
    };
    let Some(settings) = settings else { return };
    match place.role {
        Role::Gateway => {
            sleep(ramp(number, board.plan.connects_per_second)).await;
            let talk = Gateway::new(Arc::clone(&board), number, Rc::clone(&over));
            talk_until_over(&board, settings, talk, &place.bell, &over).await;
        }
        Role::Consumer => {
            let talk = Consumer::new(Arc::clone(&board), number, Rc::clone(&over));
            talk_until_over(&board, settings, talk, &place.bell, &over).await;
        }
    }
}

/// When client `number` connects.
fn ramp(number: usize, per_second: u32) -> Duration {
    Duration::from_secs_f64(number as f64 / f64::from(per_second.max(1)))
}

async fn talk_until_over<T: BrokerConversation>(
    board: &Board,
    settings: ConnectionSettings,
    talk: T,
    bell: &Notify,
    over: &Notify,
) {
    let talk = RefCell::new(talk);
    let counters = ClientCounters::default();
    let look = async {
        loop {
            sleep(LOOK_EVERY).await;
            board.note(&counters.reason.take());
        }
    };
    tokio::select! {
        () = converse(settings, &talk, bell, &counters, over.notified()) => {}
        () = look => {}
    }
}

/// Makes the broker forget the session of `settings`, so that no messages of an earlier simulation arrive and none are
/// left.
pub async fn forget(settings: ConnectionSettings) {
    let settings = ConnectionSettings {
        keeps: BrokerKeeps::Nothing,
        ..settings
    };
    let over = Rc::new(Notify::new());
    let talk = RefCell::new(Visitor {
        over: Rc::clone(&over),
    });
    let counters = ClientCounters::default();
    let bell = Notify::new();
    // An unreachable broker is reported later, with a reason.
    let _ = timeout(
        FORGET_MAX,
        converse(settings, &talk, &bell, &counters, over.notified()),
    )
    .await;
}

/// Connects and disconnects.
struct Visitor {
    over: Rc<Notify>,
}

impl BrokerConversation for Visitor {
    fn will(&self) -> Publication {
        let topic = "fleet/visitor".to_owned();
        let payload = Vec::new();
        let qos = Qos::AtMostOnce;
        Publication {
            topic,
            payload,
            retain: false,
            qos,
            expiry: None,
            correlation: None,
            token: None,
        }
    }

    fn handle(&mut self, _: ClockMoment, event: BrokerEvent<'_>) {
        if matches!(event, BrokerEvent::Connected(_)) {
            self.over.notify_one();
        }
    }

    fn tick(&mut self, _: ClockMoment) {}

    fn next_wake(&self) -> Option<MonoTime> {
        None
    }

    fn next_packet(&mut self, _: ClockMoment) -> Option<ClientPacket> {
        None
    }

    fn contested(&mut self, _: Option<ClientRival>) {}

    fn farewell(&mut self, _: ClockMoment) -> Vec<Publication> {
        Vec::new()
    }
}
