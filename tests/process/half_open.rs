//! A way to a broker that can be cut, or lets one direction through and swallows the other: TCP sees nothing wrong then.

use super::plant::{LOST_AFTER, MARGIN, Plant, RUN, Wish};
use std::io::{Read, Write};
use std::net::{Ipv4Addr, Shutdown, TcpListener, TcpStream};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex};

/// What stands between a broker and who connects to it.
#[derive(Clone, Default)]
pub(super) struct Relay {
    /// Both sides of every connection so far.
    ends: Arc<Mutex<Vec<TcpStream>>>,
    is_cut: Arc<AtomicBool>,
    swallows_to_broker: Arc<AtomicBool>,
    swallows_from_broker: Arc<AtomicBool>,
}

impl Relay {
    /// Stands before the broker at `port` until the test program ends. Returns its own port.
    pub fn start(&self, port: u16) -> u16 {
        let listener = TcpListener::bind((Ipv4Addr::LOCALHOST, 0)).unwrap();
        let own = listener.local_addr().unwrap().port();
        let relay = self.clone();
        std::thread::spawn(move || {
            for near in listener.incoming().map_while(Result::ok) {
                let Ok(far) = TcpStream::connect((Ipv4Addr::LOCALHOST, port)) else { continue };
                let mut ends = relay.ends.lock().unwrap();
                if relay.is_cut.load(Ordering::Relaxed) {
                    continue;
                }
                ends.extend([near.try_clone().unwrap(), far.try_clone().unwrap()]);
                carry(near.try_clone().unwrap(), far.try_clone().unwrap(), Arc::clone(&relay.swallows_to_broker));
                carry(far, near, Arc::clone(&relay.swallows_from_broker));
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

    /// Lets connections through again.
    pub fn mend(&self) {
        self.is_cut.store(false, Ordering::Relaxed);
    }
}

/// Carries bytes until one side closes, and swallows them meanwhile if that is wanted.
fn carry(mut from: TcpStream, mut to: TcpStream, swallows: Arc<AtomicBool>) {
    std::thread::spawn(move || {
        let mut bytes = [0; 4096];
        while let Ok(count @ 1..) = from.read(&mut bytes) {
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
    for (version, into_broker) in [("version = 5", true), ("version = 5", false), ("version = 4", false)] {
        let relay = Relay::default();
        let through = |port| relay.start(port);
        let plant = Plant::with(Wish { mqtt: version, through: Some(&through), ..Wish::default() });
        let seen = plant.run_over_mqtt();
        let swallows = if into_broker { &relay.swallows_to_broker } else { &relay.swallows_from_broker };
        swallows.store(true, Ordering::Relaxed);
        plant.wait_for_write(seen, (RUN, 0), LOST_AFTER + MARGIN);
        plant.wait_until_not_ready();
        plant.wait_until_it_stands();
        swallows.store(false, Ordering::Relaxed);
        plant.wait_until_ready();
        let written = plant.written();
        assert!(written[seen..].iter().all(|it| *it == (RUN, 0)), "{version}, {into_broker}: {:?}", &written[seen..]);
        plant.assert_nothing_was_written_since(written.len());
        assert_eq!(plant.output(), Some(0), "{version}, {into_broker}");
    }
}
