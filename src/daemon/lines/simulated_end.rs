//! The drives' end of a simulated line, with the gateway at the other: a pseudo-terminal or a TCP port.

use crate::daemon::host::pty::Pty;
use crate::daemon::host::timer::RawTimer;
use rustix::event::{PollFd, PollFlags, poll};
use rustix::io::Errno;
use std::io::{self, Read, Write};
use std::net::{SocketAddr, TcpListener, TcpStream};
use std::os::fd::{AsFd, BorrowedFd};

/// The byte stream of a simulated line. Only [`wait`](Self::wait) blocks.
pub trait LineEnd {
    /// Reads available bytes; `None` if the line is quiet or no peer is connected.
    ///
    /// # Errors
    /// What the system reports.
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<Option<usize>>;

    /// Sends `bytes`. What a full buffer does not take is lost, as on a wire without a listener.
    ///
    /// # Errors
    /// What the system reports.
    fn write(&mut self, bytes: &[u8]) -> io::Result<()>;

    /// Waits until `timer` fires or bytes arrive.
    ///
    /// # Errors
    /// What the system reports.
    fn wait(&mut self, timer: &mut RawTimer) -> io::Result<()>;
}

impl LineEnd for &Pty {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<Option<usize>> {
        match rustix::io::read(self.master(), buffer) {
            Ok(bytes) => Ok(Some(bytes)),
            // EIO: no process has the port open.
            Err(Errno::AGAIN | Errno::INTR | Errno::IO) => Ok(None),
            Err(error) => Err(error.into()),
        }
    }

    fn write(&mut self, bytes: &[u8]) -> io::Result<()> {
        match rustix::io::write(self.master(), bytes) {
            Ok(_) | Err(Errno::AGAIN | Errno::INTR | Errno::IO) => Ok(()),
            Err(error) => Err(error.into()),
        }
    }

    fn wait(&mut self, timer: &mut RawTimer) -> io::Result<()> {
        wait_for(&[self.master().as_fd()], timer)
    }
}

/// A pseudo-terminal whose drives receive only what is sent at their own speed.
#[derive(Debug)]
pub struct AtSpeed<'p> {
    /// The pseudo-terminal.
    pub pty: &'p Pty,
    /// Speed of the drives, in bit/s.
    pub baud: u32,
    /// Stop bits of the drives, 1 or 2.
    pub stop_bits: u8,
}

impl LineEnd for AtSpeed<'_> {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<Option<usize>> {
        let mut pty = self.pty;
        let read = pty.read(buffer)?;
        let fits = pty.speed()? == (self.baud, self.stop_bits);
        Ok(if fits { read } else { None })
    }

    fn write(&mut self, bytes: &[u8]) -> io::Result<()> {
        let mut pty = self.pty;
        pty.write(bytes)
    }

    fn wait(&mut self, timer: &mut RawTimer) -> io::Result<()> {
        let mut pty = self.pty;
        pty.wait(timer)
    }
}

/// A TCP port like that of a serial device server. The last client to connect gets the line: one that has vanished must
/// not block the others.
#[derive(Debug)]
pub struct TcpEnd {
    listener: TcpListener,
    client: Option<TcpStream>,
}

impl TcpEnd {
    /// Listens on `address`.
    ///
    /// # Errors
    /// The system's refusal: the address is taken, or not of this host.
    pub fn listen(address: SocketAddr) -> io::Result<Self> {
        let listener = TcpListener::bind(address)?;
        listener.set_nonblocking(true)?;
        Ok(Self {
            listener,
            client: None,
        })
    }

    /// Where it listens.
    ///
    /// # Errors
    /// What the system reports; no case is known.
    pub fn address(&self) -> io::Result<SocketAddr> {
        self.listener.local_addr()
    }

    fn take_newest(&mut self) -> io::Result<()> {
        while let Ok((client, _)) = self.listener.accept() {
            client.set_nonblocking(true)?;
            client.set_nodelay(true)?;
            self.client = Some(client);
        }
        Ok(())
    }
}

impl LineEnd for TcpEnd {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<Option<usize>> {
        self.take_newest()?;
        let Some(client) = &mut self.client else {
            return Ok(None);
        };
        match client.read(buffer) {
            Ok(bytes) if bytes > 0 => return Ok(Some(bytes)),
            Err(error)
                if matches!(
                    error.kind(),
                    io::ErrorKind::WouldBlock | io::ErrorKind::Interrupted
                ) => {}
            // The client has left.
            Ok(_) | Err(_) => self.client = None,
        }
        Ok(None)
    }

    fn write(&mut self, bytes: &[u8]) -> io::Result<()> {
        if let Some(client) = &mut self.client {
            // A client that has left is noticed when reading.
            let _ = client.write(bytes);
        }
        Ok(())
    }

    fn wait(&mut self, timer: &mut RawTimer) -> io::Result<()> {
        let descriptors: Vec<_> = [
            Some(self.listener.as_fd()),
            self.client.as_ref().map(AsFd::as_fd),
        ]
        .into_iter()
        .flatten()
        .collect();
        wait_for(&descriptors, timer)
    }
}

fn wait_for(descriptors: &[BorrowedFd<'_>], timer: &mut RawTimer) -> io::Result<()> {
    let mut fds = vec![PollFd::new(&*timer, PollFlags::IN)];
    fds.extend(
        descriptors
            .iter()
            .map(|fd| PollFd::from_borrowed_fd(*fd, PollFlags::IN)),
    );
    match poll(&mut fds, None) {
        Ok(_) | Err(Errno::INTR) => {}
        Err(error) => return Err(error.into()),
    }
    let has_fired = fds
        .first()
        .is_some_and(|fd| fd.revents().contains(PollFlags::IN));
    drop(fds);
    if has_fired {
        timer.acknowledge();
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::net::Ipv4Addr;

    #[test]
    fn who_connects_last_has_the_line() {
        let mut end = TcpEnd::listen((Ipv4Addr::LOCALHOST, 0).into()).unwrap();
        let mut timer = RawTimer::new().unwrap();
        let mut buffer = [0; 8];
        assert_eq!(end.read(&mut buffer).unwrap(), None, "nobody is there");
        let mut first = TcpStream::connect(end.address().unwrap()).unwrap();
        let mut second = TcpStream::connect(end.address().unwrap()).unwrap();
        second.write_all(b"ask").unwrap();
        let mut heard = None;
        while heard.is_none() {
            end.wait(&mut timer).unwrap();
            heard = end.read(&mut buffer).unwrap();
        }
        assert_eq!(&buffer[..3], b"ask");
        assert_eq!(
            first.read(&mut buffer).unwrap(),
            0,
            "the first is sent away"
        );
        end.write(b"reply").unwrap();
        second.read_exact(&mut buffer[..5]).unwrap();
        assert_eq!(&buffer[..5], b"reply");
        drop(second);
        end.wait(&mut timer).unwrap();
        assert_eq!(end.read(&mut buffer).unwrap(), None, "it has left");
        end.write(b"reply").unwrap();
    }
}
