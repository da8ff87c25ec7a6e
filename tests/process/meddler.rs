//! A way to a Modbus TCP server that cuts, resets, delays, doubles and swaps. It passes whole messages on and keeps them.

use rustix::io::Errno;
use rustix::net::sockopt::set_socket_linger;
use rustix::net::{RecvFlags, listen, recv};
use std::io::{self, Read, Write};
use std::net::{Shutdown, SocketAddr, TcpListener, TcpStream};
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::sync::{Arc, Mutex, PoisonError, Weak};
use std::thread;
use std::time::Duration;

/// What happens to the answers, from now on.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Way {
    /// Nothing.
    Straight,
    /// Each arrives later by this time.
    Late(Duration),
    /// Each arrives twice.
    Twice,
    /// Each third one is held back and arrives behind the next.
    Swapped,
    /// Each seventh request is passed on, and the connection ends before its answer.
    CutBehind,
    /// Each seventh request is lost with the connection, which is reset.
    ResetBefore,
    /// None arrives.
    Swallowed,
    /// The connection ends behind each.
    ClosedBehind,
}

/// The way.
pub struct Meddler {
    pub address: SocketAddr,
    way: Arc<Mutex<Way>>,
    requests: Arc<Mutex<Vec<Vec<u8>>>>,
    /// The first packet of each connection is lost: it stands a second later.
    is_slow: Arc<AtomicBool>,
    /// Connections that are open to this side, and the most that ever were.
    open: Arc<AtomicUsize>,
    most: Arc<AtomicUsize>,
}

/// What one connection needs.
#[derive(Clone)]
struct Shared {
    way: Arc<Mutex<Way>>,
    requests: Arc<Mutex<Vec<Vec<u8>>>>,
    open: Arc<AtomicUsize>,
}

fn locked<T: Clone>(mutex: &Mutex<T>) -> T {
    mutex.lock().unwrap_or_else(PoisonError::into_inner).clone()
}

impl Meddler {
    /// A way to the server on `port` of this machine. It ends with the process.
    pub fn before(port: u16) -> Self {
        let listener = TcpListener::bind("127.0.0.1:0").unwrap();
        let address = listener.local_addr().unwrap();
        let way = Arc::new(Mutex::new(Way::Straight));
        let requests = Arc::new(Mutex::new(Vec::new()));
        let (open, most) = (Arc::new(AtomicUsize::new(0)), Arc::new(AtomicUsize::new(0)));
        let shared = Shared {
            way: Arc::clone(&way),
            requests: Arc::clone(&requests),
            open: Arc::clone(&open),
        };
        let seen = Arc::clone(&most);
        let is_slow = Arc::new(AtomicBool::new(false));
        let slow = Arc::clone(&is_slow);
        thread::spawn(move || {
            let mut before: Vec<Weak<TcpStream>> = Vec::new();
            let mut filled: Option<TcpStream> = None;
            loop {
                if filled.take().is_some() {
                    thread::sleep(Duration::from_millis(300));
                    let _ = listener.accept();
                }
                let Ok((client, _)) = listener.accept() else {
                    return;
                };
                filled = slow.load(Ordering::SeqCst).then(|| fills(&listener));
                let client = Arc::new(client);
                // On this machine the end of a connection arrives before whatever is begun after it.
                before.retain(|earlier| {
                    earlier
                        .upgrade()
                        .is_some_and(|earlier| !has_ended(&earlier))
                });
                before.push(Arc::downgrade(&client));
                seen.fetch_max(before.len(), Ordering::SeqCst);
                shared.open.fetch_add(1, Ordering::SeqCst);
                let shared = shared.clone();
                // A server of one connection frees it before the next one is passed on.
                if let Ok(server) = TcpStream::connect(("127.0.0.1", port)) {
                    thread::spawn(move || pass(&client, &server, &shared));
                } else {
                    shared.open.fetch_sub(1, Ordering::SeqCst);
                }
            }
        });
        Self {
            address,
            way,
            requests,
            is_slow,
            open,
            most,
        }
    }

    /// Changes what happens from now on.
    pub fn goes(&self, way: Way) {
        *self.way.lock().unwrap_or_else(PoisonError::into_inner) = way;
    }

    /// From now on the first packet of each connection is lost.
    pub fn loses_first_packets(&self) {
        self.is_slow.store(true, Ordering::SeqCst);
    }

    /// The PDUs of all requests that arrived here, whether or not they were passed on.
    pub fn requests(&self) -> Vec<Vec<u8>> {
        locked(&self.requests)
    }

    /// The words that were written to `address`.
    pub fn written(&self, address: u16) -> Vec<u16> {
        let place = address.to_be_bytes();
        let writes = self
            .requests()
            .into_iter()
            .filter(|pdu| pdu[0] == 6 && pdu[1..3] == place);
        writes
            .map(|pdu| u16::from_be_bytes([pdu[3], pdu[4]]))
            .collect()
    }

    /// The most connections that were open at a time.
    pub fn most_connections(&self) -> usize {
        self.most.load(Ordering::SeqCst)
    }

    /// The connections that are open.
    pub fn connections(&self) -> usize {
        self.open.load(Ordering::SeqCst)
    }
}

/// A connection that fills the queue of `listener`: the system drops the first packet of the next one, which is sent again
/// after a second.
fn fills(listener: &TcpListener) -> TcpStream {
    listen(listener, 0).unwrap();
    TcpStream::connect(listener.local_addr().unwrap()).unwrap()
}

/// Whether the other side has closed or reset the connection, or this side has shut it down.
fn has_ended(stream: &TcpStream) -> bool {
    let flags = RecvFlags::PEEK | RecvFlags::DONTWAIT;
    let mut byte = [0_u8; 1];
    !matches!(
        recv(stream, &mut byte[..], flags),
        Ok((_, 1..)) | Err(Errno::AGAIN)
    )
}

/// One whole message.
fn message(stream: &mut impl Read) -> io::Result<Vec<u8>> {
    let mut message = vec![0; 6];
    stream.read_exact(&mut message)?;
    let length = usize::from(u16::from_be_bytes([message[4], message[5]]));
    message.resize(6 + length, 0);
    stream.read_exact(&mut message[6..])?;
    Ok(message)
}

/// How a connection ends.
#[derive(PartialEq, Eq)]
enum End {
    Closed,
    Reset,
}

/// Passes messages on until one side ends.
fn pass(client: &Arc<TcpStream>, server: &TcpStream, shared: &Shared) {
    let _ = client.set_nodelay(true);
    let _ = server.set_nodelay(true);
    let is_cut = Arc::new(AtomicBool::new(false));
    let Ok(from) = server.try_clone() else { return };
    let (to, of, cut) = (Arc::clone(client), shared.clone(), Arc::clone(&is_cut));
    let back = thread::spawn(move || {
        let _ = pass_answers(from, &to, &of, &cut);
        if !cut.load(Ordering::SeqCst) {
            let _ = to.shutdown(Shutdown::Both);
        }
    });
    let end = pass_requests(client, server, shared, &is_cut).unwrap_or(End::Closed);
    let _ = server.shutdown(Shutdown::Both);
    let _ = back.join();
    if end == End::Reset {
        // With no time to linger the end is a reset.
        let _ = set_socket_linger(client, Some(Duration::ZERO));
    } else {
        let _ = client.shutdown(Shutdown::Both);
    }
    shared.open.fetch_sub(1, Ordering::SeqCst);
}

fn pass_requests(
    mut client: &TcpStream,
    mut server: &TcpStream,
    shared: &Shared,
    is_cut: &AtomicBool,
) -> io::Result<End> {
    loop {
        let request = message(&mut client)?;
        let count = {
            let mut requests = shared
                .requests
                .lock()
                .unwrap_or_else(PoisonError::into_inner);
            requests.push(request[7..].to_vec());
            requests.len()
        };
        let way = locked(&shared.way);
        let ends = count % 7 == 0;
        is_cut.store(
            ends && matches!(way, Way::ResetBefore | Way::CutBehind),
            Ordering::SeqCst,
        );
        match way {
            Way::ResetBefore if ends => return Ok(End::Reset),
            Way::CutBehind if ends => {
                server.write_all(&request)?;
                // What the server answers goes nowhere.
                thread::sleep(Duration::from_millis(2));
                return Ok(End::Closed);
            }
            _ => server.write_all(&request)?,
        }
    }
}

fn pass_answers(
    mut server: TcpStream,
    mut client: &TcpStream,
    shared: &Shared,
    is_cut: &AtomicBool,
) -> io::Result<()> {
    let mut held: Option<Vec<u8>> = None;
    let mut count = 0;
    loop {
        let answer = message(&mut server)?;
        count += 1;
        if is_cut.load(Ordering::SeqCst) {
            continue;
        }
        match locked(&shared.way) {
            Way::Late(time) => {
                thread::sleep(time);
                client.write_all(&answer)?;
            }
            Way::Twice => client.write_all(&[answer.clone(), answer].concat())?,
            Way::Swapped if count % 3 == 0 && held.is_none() => held = Some(answer),
            Way::Swallowed => {}
            Way::ClosedBehind => return client.write_all(&answer),
            _ => {
                let both = [answer, held.take().unwrap_or_default()].concat();
                client.write_all(&both)?;
            }
        }
    }
}
