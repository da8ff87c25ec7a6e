//! A way to a broker that can be cut, or lets one direction through and swallows the other: TCP sees nothing wrong then.

use super::plant::{LOST_AFTER, MARGIN, Plant, RUN, Wish};
use super::raw::Raw;
use super::started::{PATIENCE, until};
use std::io::{Read, Write};
use std::net::{Ipv4Addr, Shutdown, TcpListener, TcpStream};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Condvar, Mutex};
use std::time::{Duration, Instant};

/// What stands between a broker and who connects to it.
#[derive(Clone, Default)]
pub(super) struct Relay {
    /// Both sides of every connection so far.
    ends: Arc<Mutex<Vec<TcpStream>>>,
    is_cut: Arc<AtomicBool>,
    swallows_to_broker: Arc<AtomicBool>,
    swallows_from_broker: Arc<AtomicBool>,
    /// Nothing goes on in either direction while it is true; nothing is lost.
    holds: Arc<(Mutex<bool>, Condvar)>,
}

impl Relay {
    /// Stands before the broker at `port` until the test program ends. Returns its own port.
    pub fn start(&self, port: u16) -> u16 {
        let listener = TcpListener::bind((Ipv4Addr::LOCALHOST, 0)).unwrap();
        let own = listener.local_addr().unwrap().port();
        let relay = self.clone();
        std::thread::spawn(move || {
            for near in listener.incoming().map_while(Result::ok) {
                let Ok(far) = TcpStream::connect((Ipv4Addr::LOCALHOST, port)) else {
                    continue;
                };
                let mut ends = relay.ends.lock().unwrap();
                if relay.is_cut.load(Ordering::Relaxed) {
                    continue;
                }
                ends.extend([near.try_clone().unwrap(), far.try_clone().unwrap()]);
                carry(
                    near.try_clone().unwrap(),
                    far.try_clone().unwrap(),
                    Arc::clone(&relay.swallows_to_broker),
                    Arc::clone(&relay.holds),
                );
                carry(
                    far,
                    near,
                    Arc::clone(&relay.swallows_from_broker),
                    Arc::clone(&relay.holds),
                );
            }
        });
        own
    }

    /// Ends every connection, and lets none through.
    pub fn cut(&self) {
        let mut ends = self.ends.lock().unwrap();
        self.is_cut.store(true, Ordering::Relaxed);
        for end in ends.drain(..) {
            // One that is closed already is as good.
            let _ = end.shutdown(Shutdown::Both);
        }
    }

    /// Holds everything back from now on, or lets it go.
    pub fn hold(&self, holds: bool) {
        *self.holds.0.lock().unwrap() = holds;
        self.holds.1.notify_all();
    }

    /// Lets connections through again.
    pub fn mend(&self) {
        self.is_cut.store(false, Ordering::Relaxed);
    }
}

/// Carries bytes until one side closes, and swallows them meanwhile if that is wanted.
fn carry(
    mut from: TcpStream,
    mut to: TcpStream,
    swallows: Arc<AtomicBool>,
    holds: Arc<(Mutex<bool>, Condvar)>,
) {
    std::thread::spawn(move || {
        let mut bytes = [0; 4096];
        while let Ok(count @ 1..) = from.read(&mut bytes) {
            drop(
                holds
                    .1
                    .wait_while(holds.0.lock().unwrap(), |holds| *holds)
                    .unwrap(),
            );
            if !swallows.load(Ordering::Relaxed) && to.write_all(&bytes[..count]).is_err() {
                break;
            }
        }
        // One that is closed already is as good.
        let _ = to.shutdown(Shutdown::Both);
    });
}

#[test]
fn a_way_that_carries_only_one_direction_is_down_and_the_drive_is_stopped() {
    for (version, into_broker) in [
        ("version = 5", true),
        ("version = 5", false),
        ("version = 4", false),
    ] {
        let relay = Relay::default();
        let through = |port| relay.start(port);
        let plant = Plant::with(Wish {
            mqtt: version,
            through: Some(&through),
            ..Wish::default()
        });
        let seen = plant.run_over_mqtt();
        let swallows = if into_broker {
            &relay.swallows_to_broker
        } else {
            &relay.swallows_from_broker
        };
        swallows.store(true, Ordering::Relaxed);
        plant.wait_for_write(seen, (RUN, 0), LOST_AFTER + MARGIN);
        plant.wait_until_not_ready();
        plant.wait_until_it_stands();
        swallows.store(false, Ordering::Relaxed);
        plant.wait_until_ready();
        let written = plant.written();
        assert!(
            written[seen..].iter().all(|it| *it == (RUN, 0)),
            "{version}, {into_broker}: {:?}",
            &written[seen..]
        );
        plant.assert_nothing_was_written_since(written.len());
        assert_eq!(plant.output(), Some(0), "{version}, {into_broker}");
    }
}

#[test]
fn a_run_that_waited_in_a_way_that_stood_still_starts_nothing_after_a_stop() {
    for version in ["version = 4", "version = 5"] {
        for stall in [500, 2_600, 3_200] {
            let relay = Relay::default();
            let through = |port| relay.start(port);
            let plant = Plant::with(Wish {
                mqtt: version,
                lost_after: "60s",
                through: Some(&through),
                ..Wish::default()
            });
            let case = format!("{version}, {stall} ms");
            let subscriber = plant.subscriber();
            plant.run_over_mqtt();
            relay.hold(true);
            let held = Instant::now();
            // The broker acknowledges it, and sends it into the way.
            plant.order(
                "command",
                r#"{"id": "waited", "run": "forward", "frequency_hz": 30}"#,
            );
            let mut client = Raw::connect(plant.modbus);
            plant.write_uniform(&mut client, 256, 0);
            plant.wait_until_it_stands();
            let seen = plant.written().len();
            until("the way has stood still for long enough", PATIENCE, || {
                (held.elapsed() >= Duration::from_millis(stall)).then_some(())
            });
            relay.hold(false);
            // Whatever comes behind it in the same queue, on this connection or on the next one.
            until("the gateway hears again", PATIENCE, || {
                plant.order("command", r#"{"id": "behind", "reset": false}"#);
                subscriber
                    .on("/result")
                    .iter()
                    .any(|it| it.payload.contains("behind"))
                    .then_some(())
            });
            assert!(
                !plant.written()[seen..].contains(&(RUN, 1)),
                "{case}: {:?}",
                plant.written()
            );
            for result in subscriber
                .on("drive/pump-1/result")
                .iter()
                .filter(|it| it.payload.contains("waited"))
            {
                assert!(
                    result.payload.contains("refused"),
                    "{case}: {}",
                    result.payload
                );
            }
        }
    }
}
