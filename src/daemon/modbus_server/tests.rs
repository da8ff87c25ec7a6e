//! The server over real sockets, with the test in the place of the lines.

use super::*;
use crate::config::ListenerSettings;
use crate::daemon::exchange::inbox::{COMMANDS_MAX, INBOX_MAX};
use crate::daemon::exchange::north_journal::NorthJournal;
use crate::daemon::exchange::router::UniformUnits;
use crate::daemon::exchange::shared::SharedPlant;
use crate::daemon::testing::Sleeper;
use crate::domain::command::{CommandAnswer, Outcome, Reason, Report};
use crate::domain::command::{CommandRequest, Order, Rights};
use crate::domain::control::ControlSettings;
use crate::domain::frequency::Hertz;
use crate::domain::ids::DriveIndex;
use crate::domain::ids::{Name, UnitId};
use crate::domain::link::Interface;
use crate::domain::native::{NativeAnswer, NativeAsk, NativeOutcome, NativeRequest};
use crate::domain::report::LineReport;
use crate::domain::standby::{LineRole, StandbyReport, StandbyTrouble};
use crate::drive::description::{DriveDescription, DriveRef, PointSettings};
use crate::drive::snapshot::DrivePresence;
use crate::drive::view::{ControlView, DriveView};
use crate::journal::WriteAttempt;
use crate::vendors;
use crate::wire::mbap;
use std::net::Ipv4Addr;
use tokio::io::{AsyncReadExt, AsyncWrite, AsyncWriteExt};
use tokio::net::{TcpListener, TcpStream};
use tokio::task::LocalSet;

pub(super) const EVERY_LINE: ListenerSettings = ListenerSettings {
    listen: SocketAddr::new(IpAddr::V4(Ipv4Addr::LOCALHOST), 0),
    allow: None,
    write: Vec::new(),
    stop: None,
    reads_renew: false,
    cached: false,
    lines: None,
    tls: None,
    units: None,
    connections_max: None,
    priority: Vec::new(),
    idle_timeout: None,
    keep_alive: None,
};

/// A server with two lines of two drives each, on units 1 to 4 and 101 to 104, of which the first of each line has
/// control. The lines have no threads: the test reads their inboxes.
pub(super) struct Plant {
    pub(super) shared: Arc<SharedPlant>,
    pub(super) answers: Arc<AnswerBox>,
    pub(super) address: SocketAddr,
}

fn name(text: &str) -> Name {
    Name::new(text).unwrap()
}

fn settings() -> ControlSettings {
    ControlSettings {
        directions: vec![crate::domain::command::Direction::Forward],
        lost_after: Duration::from_secs(30),
        native_write: Vec::new(),
        ..crate::vendors::testing::control()
    }
}

fn control() -> ControlView {
    ControlView {
        setpoint: Some(Hertz::from_millihertz(42_500)),
        ..ControlView::default()
    }
}

pub(super) fn shared() -> Arc<SharedPlant> {
    shared_with(|number| number.is_multiple_of(2))
}

/// A plant of four drives, with control for those whose number `has_control` accepts.
fn shared_with(has_control: impl Fn(u8) -> bool) -> Arc<SharedPlant> {
    let catalog = vendors::catalog();
    let model = catalog.find("hyundai-n700").unwrap();
    let drives = (0..4_u8).map(|number| DriveDescription {
        place: DriveRef {
            line: u16::from(number / 2),
            drive: DriveIndex(u16::from(number % 2)),
        },
        name: name(&format!("pump-{number}")),
        line: name("hall"),
        model: Arc::clone(model),
        unit: UnitId::new(1 + number).unwrap(),
        uniform_unit: UnitId::new(101 + number).unwrap(),
        group: None,
        pace: crate::drive::plan::PollPace::new(Duration::from_secs(60), 1.0),
        ratings: crate::drive::description::DriveRatings::default(),
        control: has_control(number).then(|| Arc::new(settings())),
        points: PointSettings::default(),
    });
    let line = |text| (name(text), Interface::Rs485);
    let shared = SharedPlant::new(vec![line("hall-1"), line("hall-2")], drives.collect());
    for drive in &shared.drives {
        show(drive, None);
    }
    Arc::new(shared)
}

fn show(drive: &crate::daemon::exchange::shared::SharedDrive, lease: Option<(Owner, MonoTime)>) {
    let mut view = DriveView {
        line_is_up: true,
        ..DriveView::default()
    };
    view.snapshot.presence = DrivePresence::Online;
    view.control = drive
        .description
        .control
        .as_ref()
        .map(|_| ControlView { lease, ..control() });
    drive.view.store(Arc::new(view));
}

/// Keeps attempts that reached no line.
#[derive(Debug, Default)]
pub(super) struct Kept(std::sync::Mutex<Vec<(Option<DriveRef>, WriteAttempt)>>);

impl NorthJournal for Kept {
    fn keep(&self, drive: Option<DriveRef>, attempt: WriteAttempt) {
        self.0.lock().unwrap().push((drive, attempt));
    }

    fn event_taken(&self, _: u64) {}

    fn want_events(&self, _: u64) {}
}

impl Kept {
    pub(super) fn take(&self) -> Vec<(Option<DriveRef>, WriteAttempt)> {
        std::mem::take(&mut *self.0.lock().unwrap())
    }
}

fn play<F: Future<Output = ()>>(
    settings: ListenerSettings,
    test: impl FnOnce(Plant, TcpStream) -> F,
) {
    play_with(settings, None, test);
}

pub(super) fn play_with<F: Future<Output = ()>>(
    settings: ListenerSettings,
    journal: Journal,
    test: impl FnOnce(Plant, TcpStream) -> F,
) {
    play_on(shared(), settings, journal, test);
}

fn play_on<F: Future<Output = ()>>(
    shared: Arc<SharedPlant>,
    settings: ListenerSettings,
    journal: Journal,
    test: impl FnOnce(Plant, TcpStream) -> F,
) {
    let runtime = tokio::runtime::Builder::new_current_thread()
        .enable_all()
        .build()
        .unwrap();
    runtime.block_on(LocalSet::new().run_until(async {
        let listener = TcpListener::bind(settings.listen).await.unwrap();
        let address = listener.local_addr().unwrap();
        let answers = Arc::new(AnswerBox::default());
        let router = UnitRouter::new(&settings, UniformUnits::new(&shared));
        let server = Rc::new(ModbusServer::new(Arc::default(), journal));
        tokio::task::spawn_local(
            Rc::clone(&server).listen(listener, ModbusListener::new(settings, router, None)),
        );
        tokio::task::spawn_local(server.distribute(Arc::clone(&answers)));
        let stream = TcpStream::connect(address).await.unwrap();
        test(
            Plant {
                shared,
                answers,
                address,
            },
            stream,
        )
        .await;
    }));
}

pub(super) async fn send(stream: &mut (impl AsyncWrite + Unpin), requests: &[(u16, u8, &[u8])]) {
    let mut out = Vec::new();
    for (transaction, unit, pdu) in requests {
        mbap::encode(&mut out, *transaction, *unit, |out| {
            out.extend_from_slice(pdu)
        });
    }
    stream.write_all(&out).await.unwrap();
}

pub(super) async fn answer(stream: &mut (impl AsyncRead + Unpin)) -> (u16, u8, Vec<u8>) {
    let mut head = [0; mbap::HEADER_BYTES];
    stream.read_exact(&mut head).await.unwrap();
    let mut pdu = vec![0; usize::from(u16::from_be_bytes([head[4], head[5]])) - 1];
    stream.read_exact(&mut pdu).await.unwrap();
    (u16::from_be_bytes([head[0], head[1]]), head[6], pdu)
}

/// The answer to one request.
pub(super) async fn ask(
    stream: &mut (impl AsyncRead + AsyncWrite + Unpin),
    unit: u8,
    pdu: &[u8],
) -> Vec<u8> {
    send(stream, &[(7, unit, pdu)]).await;
    let (transaction, answering, pdu) = answer(stream).await;
    assert_eq!((transaction, answering), (7, unit));
    pdu
}

impl Plant {
    /// Asserts that no message waits for any line.
    pub(super) fn assert_untouched(&self) {
        for line in &self.shared.lines {
            let mut batch = Vec::new();
            line.inbox.take(&mut batch);
            assert!(batch.is_empty(), "{batch:?}");
        }
    }

    /// The commands that `line` has received, once there are `count`.
    pub(super) async fn commands(&self, line: usize, count: usize) -> Vec<CommandRequest> {
        let mut got = Vec::new();
        while got.len() < count {
            tokio::task::yield_now().await;
            let mut batch = Vec::new();
            self.shared.lines[line].inbox.take(&mut batch);
            got.extend(batch.into_iter().filter_map(|message| match message {
                LineMessage::Command(command) => Some(command),
                _ => None,
            }));
        }
        got
    }

    /// The native request that `line` has received, once there is one.
    async fn native(&self, line: usize) -> NativeRequest {
        loop {
            tokio::task::yield_now().await;
            let mut batch = Vec::new();
            self.shared.lines[line].inbox.take(&mut batch);
            let native = batch.into_iter().find_map(|message| match message {
                LineMessage::Native(request) | LineMessage::NativeStop(request) => Some(request),
                _ => None,
            });
            if let Some(request) = native {
                return request;
            }
        }
    }

    /// Fills the inbox of `line` so that only stops and other messages that must not be lost find room.
    fn fill(&self, line: usize) {
        for _ in 0..INBOX_MAX + COMMANDS_MAX {
            self.shared.lines[line]
                .inbox
                .put(LineMessage::AskerGone(AskerId(99)))
                .unwrap();
        }
    }

    pub(super) fn tell(&self, command: &CommandRequest, report: Report, is_final: bool) {
        let CommandRequest {
            asker,
            ticket,
            drive,
            ..
        } = *command;
        let answer = CommandAnswer {
            asker,
            ticket,
            drive,
            report,
            is_final,
        };
        self.answers.put(&mut vec![LineNews::Command(answer)]);
    }
}

const DONE: Report = Report::new(Outcome::Acknowledged, Reason::None);
const RUN: [u8; 5] = [6, 1, 0, 0, 1];
const STOP: [u8; 5] = [6, 1, 0, 0, 0];

#[test]
fn each_unit_is_answered_by_its_own_kind() {
    play(EVERY_LINE, |plant, mut stream| async move {
        assert_eq!(
            ask(&mut stream, 101, &[3, 1, 1, 0, 1]).await,
            [3, 2, 0x10, 0x9A],
            "42.5 Hz"
        );
        assert_eq!(
            ask(&mut stream, 104, &[2, 0, 0, 0, 1]).await,
            [2, 1, 1],
            "online"
        );
        for unit in [255, 0] {
            assert_eq!(
                ask(&mut stream, unit, &[4, 0, 2, 0, 2]).await,
                [4, 4, 0, 2, 0, 4],
                "lines and drives"
            );
            assert_eq!(
                ask(&mut stream, unit, &[0x2B, 0x0E, 4, 0]).await[..3],
                [0x2B, 0x0E, 4]
            );
        }
        assert_eq!(
            ask(&mut stream, 0, &[5, 0, 0, 0xFF, 0]).await,
            [0x85, 1],
            "never a broadcast"
        );
        assert_eq!(ask(&mut stream, 5, &[3, 0, 0, 0, 1]).await, [0x83, 0x0A]);
        assert_eq!(ask(&mut stream, 1, &[1, 0, 0, 0, 1]).await, [0x81, 1]);
        assert_eq!(ask(&mut stream, 102, &RUN).await, [0x86, 1], "no control");
        plant.assert_untouched();
    });
}

#[test]
fn a_native_request_goes_to_its_line_and_comes_back() {
    play(EVERY_LINE, |plant, mut stream| async move {
        send(&mut stream, &[(9, 4, &[4, 1, 1, 0, 1])]).await;
        let request = plant.native(1).await;
        assert_eq!(
            (request.drive, &request.ask),
            (
                DriveIndex(1),
                &NativeAsk::Read {
                    address: 0x0101_u16.into(),
                    count: 1
                }
            )
        );
        let outcome = NativeOutcome::Words([6000].into());
        let news = NativeAnswer {
            asker: request.asker,
            ticket: request.ticket,
            outcome,
        };
        plant.answers.put(&mut vec![LineNews::Native(news)]);
        assert_eq!(answer(&mut stream).await, (9, 4, vec![4, 2, 0x17, 0x70]));
    });
}

#[test]
fn a_uniform_write_is_a_command_and_answered_by_its_report() {
    play(EVERY_LINE, |plant, mut stream| async move {
        for (report, right) in [
            (DONE, RUN.to_vec()),
            (Report::refused(Reason::NotAllowed), vec![0x86, 1]),
            (Report::refused(Reason::StartInhibited), vec![0x86, 6]),
            (
                Report {
                    exception: Some(2),
                    ..Report::new(Outcome::Failed, Reason::DriveException)
                },
                vec![0x86, 2],
            ),
        ] {
            send(&mut stream, &[(7, 103, &RUN)]).await;
            let command = plant.commands(1, 1).await.remove(0);
            assert_eq!(
                command.origin.owner,
                Owner::ModbusTcp(IpAddr::V4(Ipv4Addr::LOCALHOST))
            );
            assert_eq!(
                (command.drive, command.origin.manner),
                (DriveIndex(0), OrderManner::Cyclic)
            );
            plant.tell(&command, report, true);
            assert_eq!(answer(&mut stream).await, (7, 103, right));
            plant.tell(
                &command,
                Report::new(Outcome::Confirmed, Reason::None),
                true,
            );
        }
        assert_eq!(
            ask(&mut stream, 103, &[5, 0, 3, 0, 0]).await,
            [5, 0, 3, 0, 0],
            "it orders nothing"
        );
    });
}

#[test]
fn a_write_that_also_reads_reads_what_came_of_it() {
    play(EVERY_LINE, |plant, mut stream| async move {
        send(
            &mut stream,
            &[(7, 101, &[0x17, 1, 0, 0, 2, 1, 1, 0, 1, 2, 0x0F, 0xA0])],
        )
        .await;
        let command = plant.commands(0, 1).await.remove(0);
        let mut view = DriveView::clone(&plant.shared.drives[0].view.load());
        view.control.as_mut().unwrap().setpoint = Some(Hertz::from_millihertz(40_000));
        plant.shared.drives[0].view.store(Arc::new(view));
        plant.tell(&command, DONE, false);
        assert_eq!(answer(&mut stream).await.2, [0x17, 4, 0, 0, 0x0F, 0xA0]);
    });
}

#[test]
fn stop_all_goes_to_every_drive_with_control_and_is_answered_by_the_worst() {
    play(EVERY_LINE, |plant, mut stream| async move {
        send(&mut stream, &[(7, 255, &[5, 0, 0, 0xFF, 0])]).await;
        let one = plant.commands(0, 1).await.remove(0);
        let other = plant.commands(1, 1).await.remove(0);
        for command in [&one, &other] {
            assert_eq!(
                (command.drive, &command.order),
                (DriveIndex(0), &Order::Stop { setpoint: None })
            );
        }
        assert_ne!(one.ticket, other.ticket);
        plant.tell(&one, Report::new(Outcome::Unknown, Reason::NoReply), true);
        plant.tell(&other, DONE, true);
        assert_eq!(answer(&mut stream).await.2, [0x85, 0x0B]);
    });
}

#[test]
fn each_line_finds_its_stops_of_a_stop_for_all_together() {
    play_on(
        shared_with(|_| true),
        EVERY_LINE,
        None,
        |plant, mut stream| async move {
            let sleepers = [0, 1].map(|line: usize| Sleeper::new(&plant.shared.lines[line].inbox));
            // The answer from memory shows that the stop before it was sent.
            send(
                &mut stream,
                &[(7, 255, &[5, 0, 0, 0xFF, 0]), (8, 101, &[3, 0, 0, 0, 1])],
            )
            .await;
            assert_eq!(answer(&mut stream).await, (8, 101, vec![3, 2, 0, 1]));
            assert_eq!(sleepers.map(Sleeper::found), [2, 2]);
        },
    );
}

#[test]
fn a_listener_serves_its_lines_and_no_others() {
    play(
        ListenerSettings {
            lines: Some(vec![1]),
            ..EVERY_LINE
        },
        |plant, mut stream| async move {
            assert_eq!(ask(&mut stream, 101, &[3, 0, 0, 0, 1]).await, [0x83, 0x0A]);
            assert_eq!(ask(&mut stream, 1, &[3, 0, 0, 0, 1]).await, [0x83, 0x0A]);
            assert_eq!(ask(&mut stream, 103, &[3, 0, 0, 0, 1]).await, [3, 2, 0, 1]);
            assert_eq!(
                ask(&mut stream, 255, &[3, 3, 0xE8, 0, 1]).await,
                [3, 2, 0xFF, 0xFF]
            );
            assert_eq!(
                ask(&mut stream, 255, &[3, 3, 0xF8, 0, 1]).await[..2],
                [3, 2]
            );
            assert_eq!(
                ask(&mut stream, 255, &[3, 0, 100, 0, 1]).await,
                [3, 2, 0xFF, 0xFF]
            );
            send(&mut stream, &[(7, 255, &[0x0F, 0, 0, 0, 1, 1, 1])]).await;
            let command = plant.commands(1, 1).await.remove(0);
            plant.tell(&command, DONE, true);
            assert_eq!(answer(&mut stream).await.2, [0x0F, 0, 0, 0, 1]);
            plant.assert_untouched();
        },
    );
}

#[test]
fn a_stop_reaches_its_line_although_the_client_has_all_its_requests_in_flight() {
    play(EVERY_LINE, |plant, mut stream| async move {
        let mut requests: Vec<(u16, u8, &[u8])> = (0..16)
            .map(|number| (number, 1, &[3, 1, 1, 0, 1][..]))
            .collect();
        requests.extend([
            (16, 1, &[6, 0, 2, 0, 1][..]),
            (17, 1, &[6, 0, 2, 0, 0]),
            (18, 101, &STOP),
        ]);
        requests.push((19, 255, &[5, 0, 0, 0xFF, 0]));
        send(&mut stream, &requests).await;
        assert_eq!(
            plant.commands(0, 2).await.len(),
            2,
            "of unit 101 and of unit 255"
        );
        assert_eq!(
            answer(&mut stream).await,
            (16, 1, vec![0x86, 6]),
            "what is no stop waits its turn"
        );
    });
}

#[test]
fn a_full_inbox_is_busy_except_for_stops() {
    play(EVERY_LINE, |plant, mut stream| async move {
        plant.fill(0);
        assert_eq!(ask(&mut stream, 101, &RUN).await, [0x86, 6]);
        assert_eq!(ask(&mut stream, 1, &[3, 1, 1, 0, 1]).await, [0x83, 6]);
        // The refusal after the stop shows that the inbox was full for it, too.
        send(
            &mut stream,
            &[(6, 1, &[6, 0, 2, 0, 0]), (8, 1, &[6, 0, 2, 0, 1])],
        )
        .await;
        assert_eq!(
            answer(&mut stream).await,
            (8, 1, vec![0x86, 6]),
            "to run is no stop"
        );
        let NativeRequest {
            asker, ticket, ask, ..
        } = plant.native(0).await;
        assert_eq!(
            ask,
            NativeAsk::Write {
                address: 2_u16.into(),
                values: vec![0]
            }
        );
        plant.answers.put(&mut vec![LineNews::Native(NativeAnswer {
            asker,
            ticket,
            outcome: NativeOutcome::Written,
        })]);
        assert_eq!(answer(&mut stream).await, (6, 1, vec![6, 0, 2, 0, 0]));
        plant.fill(0);
        send(
            &mut stream,
            &[(7, 255, &[5, 0, 0, 0xFF, 0]), (9, 101, &RUN)],
        )
        .await;
        assert_eq!(answer(&mut stream).await, (9, 101, vec![0x86, 6]));
        for line in [0, 1] {
            for command in plant.commands(line, 1).await {
                plant.tell(&command, DONE, true);
            }
        }
        assert_eq!(
            answer(&mut stream).await.2,
            [5, 0, 0, 0xFF, 0],
            "every drive was reached"
        );
    });
}

/// The settings of a listener at which every client of this host may write, and whose reads renew.
fn renewing() -> ListenerSettings {
    ListenerSettings {
        write: vec!["127.0.0.0/8".parse().unwrap()],
        reads_renew: true,
        ..EVERY_LINE
    }
}

/// A client of a listener with these settings, with the listener and the server.
async fn client(
    plant: &Plant,
    settings: ListenerSettings,
) -> (TcpStream, Rc<ModbusListener>, Rc<ModbusServer>) {
    let socket = TcpListener::bind(settings.listen).await.unwrap();
    let stream = TcpStream::connect(socket.local_addr().unwrap())
        .await
        .unwrap();
    let (accepted, peer) = socket.accept().await.unwrap();
    let router = UnitRouter::new(&settings, UniformUnits::new(&plant.shared));
    let listener = ModbusListener::new(settings, router, None);
    let server = Rc::new(ModbusServer::default());
    server.admit(accepted, peer, &listener);
    (stream, listener, server)
}

#[test]
fn a_connection_stays_over_a_change_and_gets_what_is_granted_now() {
    const READ: [u8; 5] = [3, 0, 0, 0, 1];
    const RUN: [u8; 5] = [6, 1, 0, 0, 1];
    play(EVERY_LINE, |plant, first| async move {
        let (mut stream, listener, server) = client(&plant, EVERY_LINE).await;
        assert_eq!(ask(&mut stream, 101, &READ).await, [3, 2, 0, 1]);
        // Another plant: the second line alone, under the units of the first.
        let other = shared();
        let moved = SharedPlant::of(vec![Arc::clone(&other.lines[1])], Arc::default());
        let units = UniformUnits::new(&plant.shared).changed_to(&Arc::new(moved));
        let settings = ListenerSettings {
            write: vec!["127.0.0.0/8".parse().unwrap()],
            ..EVERY_LINE
        };
        listener.change(
            settings.clone(),
            UnitRouter::new(&settings, units.clone()),
            None,
        );
        server.review();
        assert_eq!(
            ask(&mut stream, 101, &READ).await,
            [0x83, 0x0A],
            "the unit is gone"
        );
        assert_eq!(ask(&mut stream, 103, &READ).await, [3, 2, 0, 1]);
        send(&mut stream, &[(9, 103, &RUN)]).await;
        let mut batch = Vec::new();
        while batch.is_empty() {
            tokio::time::sleep(Duration::from_millis(1)).await;
            other.lines[1].inbox.take(&mut batch);
        }
        assert!(
            matches!(&batch[0], LineMessage::Command(it) if it.origin.rights.write),
            "{batch:?}"
        );
        plant.assert_untouched();
        drop(first);
        // A client that is no longer allowed is disconnected.
        let settings = ListenerSettings {
            allow: Some(vec!["10.0.0.0/8".parse().unwrap()]),
            ..EVERY_LINE
        };
        listener.change(settings.clone(), UnitRouter::new(&settings, units), None);
        server.review();
        assert_eq!(stream.read(&mut [0; 8]).await.unwrap(), 0);
    });
}

#[test]
fn who_is_connected_to_a_listener_that_is_gone_is_sent_away() {
    play(EVERY_LINE, |plant, mut other| async move {
        let (mut stream, listener, server) = client(&plant, EVERY_LINE).await;
        listener.close();
        server.review();
        assert_eq!(stream.read(&mut [0; 8]).await.unwrap(), 0);
        assert_eq!(
            ask(&mut other, 101, &[3, 0, 0, 0, 1]).await,
            [3, 2, 0, 1],
            "another listener's stay"
        );
    });
}

#[test]
fn reads_renew_only_where_that_is_granted_and_only_the_lease_of_the_client() {
    const READ: [u8; 5] = [3, 0, 19, 0, 1];
    play(EVERY_LINE, |plant, mut plain| async move {
        let rights = Rights {
            write: true,
            stop: true,
        };
        let (mut renewing, ..) = client(&plant, renewing()).await;
        show(
            &plant.shared.drives[0],
            Some((Owner::Mqtt, MonoTime::NEVER)),
        );
        assert_eq!(
            ask(&mut renewing, 101, &READ).await,
            [3, 2, 0, 1],
            "of MQTT"
        );
        show(
            &plant.shared.drives[0],
            Some((Owner::ModbusTcp(plant.address.ip()), MonoTime::NEVER)),
        );
        assert_eq!(ask(&mut plain, 101, &READ).await, [3, 2, 0, 3], "its own");
        assert_eq!(ask(&mut renewing, 103, &READ).await, [3, 2, 0, 0]);
        assert_eq!(ask(&mut renewing, 101, &[3, 0, 99, 0, 1]).await, [0x83, 2]);
        plant.assert_untouched();
        send(&mut renewing, &[(1, 101, &READ), (2, 101, &READ)]).await;
        assert_eq!(answer(&mut renewing).await, (1, 101, vec![3, 2, 0, 3]));
        assert_eq!(
            answer(&mut renewing).await.0,
            2,
            "no client waits for the renewal"
        );
        let commands = plant.commands(0, 1).await;
        assert_eq!(
            (commands.len(), &commands[0].order),
            (1, &Order::Renew),
            "once for both"
        );
        assert_eq!(commands[0].origin.rights, rights);
    });
}

/// `pdu` with `bytes` more bytes. A message carries 253 bytes of a PDU, so one word too many truncates the block.
fn longer(pdu: &[u8], bytes: usize) -> Vec<u8> {
    [pdu, &vec![0; bytes]].concat()
}

#[test]
fn what_is_wrong_in_itself_has_its_exception_at_every_unit_and_reaches_no_line() {
    // Functions that all units have, and those that native units lack.
    let of_all: Vec<(Vec<u8>, u8)> = vec![
        (vec![3, 0, 0, 0, 0], 3),
        (vec![3, 0, 0, 0, 126], 3),
        (vec![3, 0xFF, 0xFF, 0, 2], 2),
        (vec![4, 0, 0, 0, 126], 3),
        (vec![4, 0xFF, 0x84, 0, 125], 2),
        (vec![6, 1, 0, 0], 3),
        (vec![8, 0, 1, 0, 0], 1),
        (vec![8, 0, 10, 0, 0], 1),
        (longer(&[0x10, 1, 0, 0, 124, 248], 247), 3),
        (longer(&[0x10, 1, 0, 0, 2, 3], 4), 3),
        (longer(&[0x10, 1, 0, 0, 2, 4], 3), 3),
        (longer(&[0x10, 0xFF, 0xFF, 0, 2, 4], 4), 2),
        (vec![7], 1),
        (vec![0x14, 7, 6, 0, 1, 0, 0, 0, 1], 1),
        (vec![0x18, 0, 0], 1),
        (vec![0x41], 1),
    ];
    let of_some: Vec<(Vec<u8>, u8)> = vec![
        (vec![1, 0, 0, 7, 0xD1], 3),
        (vec![1, 0, 0, 0, 0], 3),
        (vec![1, 0xFF, 0xFF, 0, 2], 2),
        (vec![2, 0, 0, 7, 0xD1], 3),
        (vec![5, 0, 0, 0, 1], 3),
        (vec![5, 0, 0, 0xFF, 1], 3),
        (longer(&[0x0F, 0, 0, 7, 0xB1, 247], 247), 3),
        (longer(&[0x0F, 0, 0, 0, 9, 1], 1), 3),
        (longer(&[0x0F, 0xFF, 0xFF, 0, 2, 1], 1), 2),
        (vec![0x16, 1, 0, 0, 0, 0], 3),
        (longer(&[0x17, 0, 0, 0, 1, 1, 0, 0, 122, 244], 243), 3),
        (longer(&[0x17, 0, 0, 0, 126, 1, 0, 0, 1, 2], 2), 3),
        (longer(&[0x17, 0xFF, 0xFF, 0, 2, 1, 0, 0, 1, 2], 2), 2),
        (longer(&[0x17, 0, 0, 0, 1, 0xFF, 0xFF, 0, 2, 4], 4), 2),
        (vec![0x2B, 0x0E, 1], 3),
        (vec![0x2B, 0x0D, 1, 0], 1),
    ];
    play(renewing(), |plant, mut stream| async move {
        for (pdu, code) in &of_all {
            for unit in [1, 101, 255] {
                assert_eq!(
                    ask(&mut stream, unit, pdu).await,
                    [pdu[0] | 0x80, *code],
                    "{unit}: {pdu:02X?}"
                );
            }
        }
        for (pdu, code) in &of_some {
            for unit in [101, 255] {
                assert_eq!(
                    ask(&mut stream, unit, pdu).await,
                    [pdu[0] | 0x80, *code],
                    "{unit}: {pdu:02X?}"
                );
            }
        }
        plant.assert_untouched();
    });
}

/// Shows a drive that was read at this moment, after its line had taken `taken` orders.
fn shows_reading(drive: &crate::daemon::exchange::shared::SharedDrive, taken: u64) {
    let now = clock::now();
    let mut view = DriveView {
        line_is_up: true,
        ..DriveView::default()
    };
    view.snapshot.presence = DrivePresence::Online;
    view.snapshot.take(0x0101_u16.into(), &[4250], now);
    view.orders.taken = taken;
    view.orders.settled_at = Some(now.before(Duration::from_secs(1)));
    drive.view.store(Arc::new(view));
}

const READ_OUTPUT: [u8; 5] = [3, 1, 1, 0, 1];

#[test]
fn a_native_read_is_answered_from_memory_only_where_that_is_granted() {
    play(
        ListenerSettings {
            cached: true,
            ..EVERY_LINE
        },
        |plant, mut stream| async move {
            shows_reading(&plant.shared.drives[1], 0);
            assert_eq!(ask(&mut stream, 2, &READ_OUTPUT).await, [3, 2, 0x10, 0x9A]);
            plant.assert_untouched();
            // A register that was not read.
            send(&mut stream, &[(8, 2, &[3, 1, 0x12, 0, 1])]).await;
            assert!(!plant.native(0).await.writes());
        },
    );
    play(EVERY_LINE, |plant, mut stream| async move {
        shows_reading(&plant.shared.drives[1], 0);
        send(&mut stream, &[(7, 2, &READ_OUTPUT)]).await;
        assert!(!plant.native(0).await.writes(), "the line is asked");
    });
}

#[test]
fn a_listener_answers_native_reads_from_what_it_heard() {
    play(EVERY_LINE, |plant, mut stream| async move {
        let report = |role| {
            let standby = StandbyReport {
                role,
                take_overs: 0,
                given_up: 0,
                rivals: 0,
                hears_other: true,
                listener: None,
                kept: 0,
                trouble: StandbyTrouble::default(),
            };
            LineReport {
                standby: Some(standby),
                ..LineReport::default()
            }
        };
        plant.shared.lines[0].set_report(report(LineRole::Listening));
        shows_reading(&plant.shared.drives[1], 0);
        assert_eq!(ask(&mut stream, 2, &READ_OUTPUT).await, [3, 2, 0x10, 0x9A]);
        plant.assert_untouched();
        plant.shared.lines[0].set_report(report(LineRole::Active));
        send(&mut stream, &[(8, 2, &READ_OUTPUT)]).await;
        assert!(
            !plant.native(0).await.writes(),
            "who may ask the drive asks it"
        );
    });
}

#[test]
fn an_order_that_its_line_has_not_taken_forbids_an_answer_from_memory() {
    let write = [6, 0, 4, 0, 1];
    play(
        ListenerSettings {
            cached: true,
            ..EVERY_LINE
        },
        |plant, mut stream| async move {
            shows_reading(&plant.shared.drives[0], 0);
            assert_eq!(ask(&mut stream, 1, &READ_OUTPUT).await, [3, 2, 0x10, 0x9A]);
            // Written and read without waiting.
            send(
                &mut stream,
                &[(7, 1, &write), (8, 1, &READ_OUTPUT), (9, 2, &READ_OUTPUT)],
            )
            .await;
            let mut asked = Vec::new();
            while asked.len() < 3 {
                tokio::task::yield_now().await;
                let mut batch = Vec::new();
                plant.shared.lines[0].inbox.take(&mut batch);
                asked.extend(batch.into_iter().map(|message| match message {
                    LineMessage::Native(request) => (request.drive.get(), request.writes()),
                    message => panic!("{message:?}"),
                }));
            }
            assert_eq!(asked, [(0, true), (0, false), (1, false)]);
            shows_reading(&plant.shared.drives[0], 1);
            assert_eq!(
                ask(&mut stream, 1, &READ_OUTPUT).await,
                [3, 2, 0x10, 0x9A],
                "the line has taken it"
            );
        },
    );
}
