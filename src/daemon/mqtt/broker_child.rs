//! The broker as a child process, so that its memory and panics do not affect this one.

use std::io::{self, BufRead, BufReader};
use std::net::SocketAddr;
use std::os::unix::process::CommandExt;
use std::path::Path;
use std::process::{Child, ChildStdout, Command, Stdio};
use std::sync::mpsc;
use std::time::Duration;

/// Time for the child to listen.
const START_MAX: Duration = Duration::from_secs(10);
/// What the child prints before the address once it listens.
pub const ANNOUNCEMENT: &str = "listening on ";

/// A running broker. It exits when this is dropped, and when this process ends in any way: its standard input is a pipe
/// from here.
#[derive(Debug)]
pub struct BrokerChild {
    child: Child,
    address: SocketAddr,
}

impl BrokerChild {
    /// Starts this program again as a broker on a loopback address; port 0 picks a free one.
    ///
    /// # Errors
    /// The child does not start, or does not listen within 10 s. It has printed the reason on stderr.
    pub fn start(listen: SocketAddr) -> io::Result<Self> {
        Self::start_program(&std::env::current_exe()?, listen)
    }

    /// Like [`start`](Self::start), with the program named.
    ///
    /// # Errors
    /// The child does not start, or does not listen within 10 s. It has printed the reason on stderr.
    pub fn start_program(program: &Path, listen: SocketAddr) -> io::Result<Self> {
        let mut command = Command::new(program);
        command.args(["broker", "--listen", &listen.to_string()]);
        command.stdin(Stdio::piped()).stdout(Stdio::piped());
        // Ctrl-C is for us: the broker still has to accept our last messages.
        command.process_group(0);
        if std::env::var_os("RUST_LOG").is_none() {
            command.env("RUST_LOG", "warn");
        }
        let mut child = command.spawn()?;
        match announced(child.stdout.take()) {
            Ok(address) => Ok(Self { child, address }),
            Err(error) => {
                end(&mut child);
                Err(error)
            }
        }
    }

    /// The address on which it listens.
    #[must_use]
    pub const fn address(&self) -> SocketAddr {
        self.address
    }
}

impl Drop for BrokerChild {
    fn drop(&mut self) {
        end(&mut self.child);
    }
}

fn end(child: &mut Child) {
    // It may have exited by itself; either way it is reaped.
    let _ = child.kill();
    let _ = child.wait();
}

/// The address in the child's first line. Read by a thread, since a pipe has no time-out.
fn announced(stdout: Option<ChildStdout>) -> io::Result<SocketAddr> {
    let stdout = stdout.ok_or_else(|| io::Error::other("the broker has no output"))?;
    let (sender, receiver) = mpsc::channel();
    std::thread::Builder::new()
        .name("broker-start".to_owned())
        .spawn(move || {
            let mut line = String::new();
            let read = BufReader::new(stdout).read_line(&mut line);
            // The receiver is gone if it took too long.
            let _ = sender.send(read.map(|_| line));
        })?;
    let line = receiver
        .recv_timeout(START_MAX)
        .map_err(|_| io::Error::from(io::ErrorKind::TimedOut))??;
    address_in(&line).ok_or_else(|| io::Error::other("the broker did not start"))
}

fn address_in(line: &str) -> Option<SocketAddr> {
    line.strip_prefix(ANNOUNCEMENT)?.trim_end().parse().ok()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_first_line_tells_the_address() {
        assert_eq!(
            address_in("listening on 127.0.0.1:1883\n"),
            "127.0.0.1:1883".parse().ok()
        );
        assert_eq!(address_in("listening on\n"), None);
        assert_eq!(address_in(""), None);
    }

    #[test]
    fn a_child_that_says_nothing_and_ends_is_an_error() {
        let nothing =
            BrokerChild::start_program(Path::new("/bin/true"), "127.0.0.1:0".parse().unwrap());
        assert!(nothing.is_err());
    }
}
