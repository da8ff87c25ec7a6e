//! Slots, unread answers and turns over real sockets.

use super::tests::{EVERY_LINE, answer, ask, send, shared};
use super::*;
use crate::config::ListenerSettings;
use crate::daemon::exchange::router::UniformUnits;
use crate::daemon::exchange::shared::SharedPlant;
use crate::domain::command::Order;
use crate::domain::ids::UnitId;
use crate::wire::mbap;
use std::net::Ipv4Addr;
use tokio::io::{AsyncReadExt, AsyncWriteExt};
use tokio::net::{TcpListener, TcpSocket, TcpStream};
use tokio::task::LocalSet;

const READ: [u8; 5] = [3, 0, 0, 0, 1];
const HERE: Ipv4Addr = Ipv4Addr::LOCALHOST;
/// Another address of this host.
const URGENT: Ipv4Addr = Ipv4Addr::new(127, 0, 0, 2);

/// A server and where it listens.
struct Crowd {
    server: Rc<ModbusServer>,
    shared: Arc<SharedPlant>,
    totals: Arc<ModbusTotals>,
    address: SocketAddr,
}

impl Crowd {
    async fn connect_from(&self, from: Ipv4Addr) -> TcpStream {
        let socket = TcpSocket::new_v4().unwrap();
        socket.bind(SocketAddr::from((from, 0))).unwrap();
        socket.connect(self.address).await.unwrap()
    }

    /// Clients without requests, in order of connection.
    async fn silent(&self, count: usize) -> Vec<TcpStream> {
        let before = self.totals.accepted();
        let mut streams = Vec::new();
        for _ in 0..count {
            streams.push(self.connect_from(HERE).await);
        }
        while self.totals.accepted() < before + count as u64 {
            tokio::task::yield_now().await;
        }
        streams
    }

    fn messages(&self) -> Vec<LineMessage> {
        let mut all = Vec::new();
        for line in &self.shared.lines {
            let mut batch = Vec::new();
            line.inbox.take(&mut batch);
            all.extend(batch);
        }
        all
    }

    async fn are_connected(&self, count: u64) {
        while self.totals.connections() != count {
            tokio::task::yield_now().await;
        }
    }
}

/// Runs `test` with a server that has this many slots.
fn play<F: Future<Output = ()>>(
    slots: usize,
    settings: ListenerSettings,
    test: impl FnOnce(Crowd) -> F,
) {
    let runtime = tokio::runtime::Builder::new_current_thread()
        .enable_all()
        .build()
        .unwrap();
    let end = Duration::from_secs(20);
    let play = async {
        let socket = TcpListener::bind(settings.listen).await.unwrap();
        let address = socket.local_addr().unwrap();
        let shared = shared();
        let totals = Arc::new(ModbusTotals::default());
        let router = UnitRouter::new(&settings, UniformUnits::new(&shared));
        let server = Rc::new(ModbusServer::new(Arc::clone(&totals), None).with_slots(slots));
        tokio::task::spawn_local(
            Rc::clone(&server).listen(socket, ModbusListener::new(settings, router, None)),
        );
        test(Crowd {
            server,
            shared,
            totals,
            address,
        })
        .await;
    };
    let played = async { tokio::time::timeout(end, play).await };
    runtime
        .block_on(LocalSet::new().run_until(played))
        .expect("it ends in time");
}

fn with_priority() -> ListenerSettings {
    ListenerSettings {
        priority: vec!["127.0.0.2/32".parse().unwrap()],
        ..EVERY_LINE
    }
}

async fn is_closed(stream: &mut TcpStream) -> bool {
    matches!(stream.read(&mut [0; 8]).await, Ok(0) | Err(_))
}

#[test]
fn a_full_server_closes_the_one_that_was_silent_for_longest_and_priority_finds_a_place() {
    play(8, with_priority(), |crowd| async move {
        let mut clients = crowd.silent(6).await;
        assert_eq!(
            ask(&mut clients[0], 101, &READ).await,
            [3, 2, 0, 1],
            "all that is not kept for priority is taken"
        );
        let mut newcomer = crowd.connect_from(HERE).await;
        assert_eq!(ask(&mut newcomer, 101, &READ).await, [3, 2, 0, 1]);
        assert!(
            is_closed(&mut clients.remove(1)).await,
            "the second has never asked"
        );
        let mut urgent = Vec::new();
        for _ in 0..3 {
            urgent.push(crowd.connect_from(URGENT).await);
        }
        for stream in &mut urgent {
            assert_eq!(ask(stream, 101, &READ).await, [3, 2, 0, 1]);
        }
        assert!(
            is_closed(&mut clients.remove(1)).await,
            "beyond the slots kept for it, priority takes another's"
        );
        for stream in clients.iter_mut().chain([&mut newcomer]).chain(&mut urgent) {
            assert_eq!(
                ask(stream, 101, &READ).await,
                [3, 2, 0, 1],
                "nobody else was closed"
            );
        }
        assert_eq!(
            (
                crowd.totals.connections(),
                crowd.totals.dismissed(),
                crowd.totals.turned_away()
            ),
            (8, 2, 0)
        );
    });
}

#[test]
fn who_waits_for_a_drive_is_not_closed_for_a_newcomer() {
    play(4, EVERY_LINE, |crowd| async move {
        let mut clients = crowd.silent(3).await;
        for stream in &mut clients {
            send(stream, &[(1, 1, &[3, 1, 1, 0, 1])]).await;
        }
        while crowd.totals.counters().requests < 3 {
            tokio::task::yield_now().await;
        }
        assert!(is_closed(&mut crowd.connect_from(HERE).await).await);
        assert_eq!(
            (crowd.totals.connections(), crowd.totals.turned_away()),
            (3, 1)
        );
    });
}

#[test]
fn a_listener_has_its_own_limit_and_those_who_leave_make_room() {
    play(
        100,
        ListenerSettings {
            connections_max: Some(2),
            ..with_priority()
        },
        |crowd| async move {
            let mut clients = crowd.silent(2).await;
            let mut third = crowd.connect_from(HERE).await;
            assert_eq!(ask(&mut third, 101, &READ).await, [3, 2, 0, 1]);
            assert!(is_closed(&mut clients[0]).await);
            drop(third);
            crowd.are_connected(1).await;
            let mut fourth = crowd.connect_from(HERE).await;
            let mut urgent = crowd.connect_from(URGENT).await;
            for stream in [&mut clients[1], &mut fourth, &mut urgent] {
                assert_eq!(ask(stream, 101, &READ).await, [3, 2, 0, 1]);
            }
        },
    );
}

#[test]
fn anyone_who_leaves_the_most_unread_is_closed_when_all_together_leave_too_much() {
    play(100, with_priority(), |crowd| async move {
        let mut clients = crowd.silent(3).await;
        let mut urgent = crowd.connect_from(URGENT).await;
        ask(&mut urgent, 101, &READ).await;
        let all: Vec<Rc<ModbusClient>> = (1..=4)
            .map(|at| Rc::clone(&crowd.server.clients.borrow()[&AskerId(at)]))
            .collect();
        for (client, share) in all.iter().zip([3, 4, 2, 6]) {
            assert!(
                !client
                    .seat
                    .leaves_unread(admission::UNREAD_MAX * share / 15),
                "all of it and no more"
            );
        }
        let last = all[2]
            .seat
            .leaves_unread(admission::UNREAD_MAX * 2 / 15 + 15);
        assert!(last);
        crowd.server.shed();
        let kept = all
            .iter()
            .map(|client| client.dismissed.get())
            .collect::<Vec<_>>();
        assert_eq!(
            kept,
            [None, Some(ClientDismissal::Unread), None, None],
            "priority comes last"
        );
        // They hold the sockets.
        drop(all);
        assert!(is_closed(&mut clients[1]).await);
        for stream in [&mut urgent, &mut clients[0]] {
            assert_eq!(ask(stream, 101, &READ).await, [3, 2, 0, 1]);
        }
    });
}

#[test]
fn one_that_never_stops_asking_takes_no_turn_of_another() {
    play(100, EVERY_LINE, |crowd| async move {
        let mut flood = crowd.connect_from(HERE).await;
        let mut other = crowd.connect_from(HERE).await;
        ask(&mut flood, 101, &READ).await;
        ask(&mut other, 101, &READ).await;
        let mut requests = Vec::new();
        for at in 0..8_000 {
            mbap::encode(&mut requests, at, 101, |out| out.extend_from_slice(&READ));
        }
        // As many whole requests as the socket takes at once.
        let taken = flood.try_write(&requests).unwrap();
        let many = taken / 12;
        assert!(many > 1_500, "{taken}");
        let before = crowd.totals.counters().requests;
        ask(&mut other, 101, &READ).await;
        let served = crowd.totals.counters().requests - before;
        assert!(
            served < 10 * READ_BYTES as u64 / 12,
            "{served} before the answer to one"
        );
        for at in 0..many {
            let (transaction, unit, pdu) = answer(&mut flood).await;
            assert_eq!(
                (usize::from(transaction), unit, &pdu[..]),
                (at, 101, &[3, 2, 0, 1][..])
            );
        }
    });
}

#[test]
fn only_who_may_have_left_something_at_a_line_says_goodbye_there() {
    play(100, EVERY_LINE, |crowd| async move {
        let mut reader = crowd.connect_from(HERE).await;
        ask(&mut reader, 101, &READ).await;
        drop(reader);
        crowd.are_connected(0).await;
        assert!(crowd.messages().is_empty());
        for pdu in [&[3, 1, 1, 0, 1][..], &[6, 0, 2, 0, 0]] {
            let mut native = crowd.connect_from(HERE).await;
            let asked = crowd.totals.counters().requests + 1;
            send(&mut native, &[(1, 1, pdu)]).await;
            while crowd.totals.counters().requests < asked {
                tokio::task::yield_now().await;
            }
            drop(native);
            crowd.are_connected(0).await;
            let messages = crowd.messages();
            let [asked, left @ ..] = &messages[..] else {
                panic!("{messages:?}")
            };
            assert!(matches!(
                asked,
                LineMessage::Native(_) | LineMessage::NativeStop(_)
            ));
            assert!(matches!(
                left,
                [LineMessage::AskerGone(_), LineMessage::AskerGone(_)]
            ));
        }
    });
}

#[test]
fn only_the_units_that_are_listed_answer() {
    let units = [103, 2].map(|unit| UnitId::new(unit).unwrap());
    let settings = ListenerSettings {
        units: Some(units.to_vec()),
        write: vec!["127.0.0.0/8".parse().unwrap()],
        ..EVERY_LINE
    };
    play(100, settings, |crowd| async move {
        let mut stream = crowd.connect_from(HERE).await;
        assert_eq!(ask(&mut stream, 103, &READ).await, [3, 2, 0, 1]);
        for unit in [1, 3, 101, 102, 104] {
            assert_eq!(ask(&mut stream, unit, &READ).await, [0x83, 0x0A], "{unit}");
            assert_eq!(
                ask(&mut stream, unit, &[6, 1, 0, 0, 0]).await,
                [0x86, 0x0A],
                "{unit}"
            );
        }
        assert!(crowd.messages().is_empty());
        for (drive, is_shown) in [(0, false), (1, true), (2, true), (3, false)] {
            let [high, low] = (1000_u16 + 8 * drive).to_be_bytes();
            let answer = ask(&mut stream, 255, &[3, high, low, 0, 1]).await;
            assert_eq!(
                answer != [3, 2, 0xFF, 0xFF],
                is_shown,
                "drive {drive}: {answer:?}"
            );
        }
        // A stop for all is for the drives that are served here and have control.
        let asked = crowd.totals.counters().requests + 1;
        send(&mut stream, &[(7, 255, &[5, 0, 0, 0xFF, 0])]).await;
        while crowd.totals.counters().requests < asked {
            tokio::task::yield_now().await;
        }
        let messages = crowd.messages();
        let [LineMessage::Command(stop)] = &messages[..] else {
            panic!("{messages:?}")
        };
        assert_eq!(
            (stop.order.clone(), stop.drive.get()),
            (Order::Stop { setpoint: None }, 0)
        );
        // Native reads of the drive whose native unit is listed reach its line.
        send(&mut stream, &[(8, 2, &[3, 1, 1, 0, 1])]).await;
        loop {
            tokio::task::yield_now().await;
            if matches!(crowd.messages()[..], [LineMessage::Native(_)]) {
                break;
            }
        }
    });
}

#[test]
fn an_idle_time_out_of_the_listener_holds_at_once() {
    play(
        100,
        ListenerSettings {
            idle_timeout: Some(Duration::from_millis(50)),
            ..EVERY_LINE
        },
        |crowd| async move {
            let mut stream = crowd.connect_from(HERE).await;
            send(&mut stream, &[(1, 101, &READ)]).await;
            assert_eq!(answer(&mut stream).await.2, [3, 2, 0, 1]);
            assert!(is_closed(&mut stream).await);
            // An incomplete request is not counted.
            let mut slow = crowd.connect_from(HERE).await;
            slow.write_all(&[0, 1]).await.unwrap();
            assert!(
                tokio::time::timeout(Duration::from_millis(200), slow.read(&mut [0; 8]))
                    .await
                    .is_err()
            );
        },
    );
}
