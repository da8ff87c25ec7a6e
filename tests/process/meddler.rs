//! A way to a Modbus TCP server that cuts, resets, delays, doubles and swaps. It passes whole messages on and keeps them.

use rustix::io::Errno;
use rustix::net::{RecvFlags, recv};
use std::io::{self, Read, Write};
use std::net::{Shutdown, SocketAddr, TcpListener, TcpStream};
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Arc, Mutex, PoisonError};
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
    /// Each second one is held back and arrives behind the next.
    Swapped,
    /// Each seventh request is passed on, and the connection ends before its answer.
    CutBehind,
    /// Each seventh request is lost with the connection, which is reset.
    ResetBefore,
    /// None arrives.
    Swallowed,
}

/// The way.
pub struct Meddler {
    pub address: SocketAddr,
    way: Arc<Mutex<Way>>,
    requests: Arc<Mutex<Vec<Vec<u8>>>>,
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
        let shared = Shared { way: Arc::clone(&way), requests: Arc::clone(&requests), open: Arc::clone(&open) };
        let seen = Arc::clone(&most);
        thread::spawn(move || {
            let mut before: Vec<TcpStream> = Vec::new();
            for client in listener.incoming().map_while(Result::ok) {
                // On this machine the end of a connection arrives before whatever is begun after it.
                before.retain(|earlier| !has_ended(earlier));
                before.extend(client.try_clone());
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
        Self { address, way, requests, open, most }
    }

    /// Changes what happens from now on.
    pub fn goes(&self, way: Way) {
        *self.way.lock().unwrap_or_else(PoisonError::into_inner) = way;
    }

    /// The PDUs of all requests that arrived here, whether or not they were passed on.
    pub fn requests(&self) -> Vec<Vec<u8>> {
        locked(&self.requests)
    }

    /// The words that were written to `address`.
    pub fn written(&self, address: u16) -> Vec<u16> {
        let place = address.to_be_bytes();
        let writes = self.requests().into_iter().filter(|pdu| pdu[0] == 6 && pdu[1..3] == place);
        writes.map(|pdu| u16::from_be_bytes([pdu[3], pdu[4]])).collect()
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

/// Whether the other side has closed or reset the connection, or this side has shut it down.
fn has_ended(stream: &TcpStream) -> bool {
    let flags = RecvFlags::PEEK | RecvFlags::DONTWAIT;
    let mut byte = [0_u8; 1];
    !matches!(recv(stream, &mut byte[..], flags), Ok((_, 1..)) | Err(Errno::AGAIN))
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

/// Passes messages on until one side ends.
fn pass(client: &TcpStream, server: &TcpStream, shared: &Shared) {
    let _ = client.set_nodelay(true);
    let _ = server.set_nodelay(true);
    let answers = (server.try_clone(), client.try_clone(), shared.clone());
    let (Ok(from), Ok(to), of) = answers else { return };
    let back = thread::spawn(move || {
        let _ = pass_answers(from, &to, &of);
        let _ = to.shutdown(Shutdown::Both);
    });
    let _ = pass_requests(client, server, shared);
    for side in [client, server] {
        let _ = side.shutdown(Shutdown::Both);
    }
    let _ = back.join();
    // The client has closed its end, or will notice before it connects again.
    shared.open.fetch_sub(1, Ordering::SeqCst);
}

fn pass_requests(mut client: &TcpStream, mut server: &TcpStream, shared: &Shared) -> io::Result<()> {
    loop {
        let request = message(&mut client)?;
        let count = {
            let mut requests = shared.requests.lock().unwrap_or_else(PoisonError::into_inner);
            requests.push(request[7..].to_vec());
            requests.len()
        };
        match locked(&shared.way) {
            Way::ResetBefore if count % 7 == 0 => {
                // With no time to linger the end is a reset.
                let _ = rustix::net::sockopt::set_socket_linger(client, Some(Duration::ZERO));
                return Ok(());
            }
            Way::CutBehind if count % 7 == 0 => {
                server.write_all(&request)?;
                thread::sleep(Duration::from_millis(2));
                return Ok(());
            }
            _ => server.write_all(&request)?,
        }
    }
}

fn pass_answers(mut server: TcpStream, mut client: &TcpStream, shared: &Shared) -> io::Result<()> {
    let mut held: Option<Vec<u8>> = None;
    let mut count = 0;
    loop {
        let answer = message(&mut server)?;
        count += 1;
        match locked(&shared.way) {
            Way::Late(time) => {
                thread::sleep(time);
                client.write_all(&answer)?;
            }
            Way::Twice => client.write_all(&[answer.clone(), answer].concat())?,
            Way::Swapped if count % 2 == 0 && held.is_none() => held = Some(answer),
            Way::Swallowed => {}
            _ => {
                let both = [answer, held.take().unwrap_or_default()].concat();
                client.write_all(&both)?;
            }
        }
    }
}
