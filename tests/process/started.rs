//! A program that a test has started: its output line by line, and its end.

use rustix::event::{PollFd, PollFlags, poll};
use rustix::fs::{OFlags, fcntl_getfl, fcntl_setfl};
use rustix::io::Errno;
use std::io::{BufRead, BufReader, Write};
use std::os::fd::OwnedFd;
use std::process::{Child, ChildStdin, Command, ExitStatus, Stdio};
use std::sync::{Arc, Condvar, Mutex, MutexGuard};
use std::time::{Duration, Instant};

/// Longer than anything should take on a busy machine; a test that waits for it fails.
pub const PATIENCE: Duration = Duration::from_secs(20);

/// A running program. It is killed when this is dropped.
pub struct Started {
    name: String,
    child: Child,
    /// Open as long as this is, for programs that end with their input.
    input: Option<ChildStdin>,
    output: Arc<Output>,
}

/// What was printed so far.
#[derive(Default)]
struct Output {
    said: Mutex<Said>,
    more: Condvar,
}

/// The lines of stdout and stderr, in order of arrival, and the ends from which more may come.
#[derive(Default)]
struct Said {
    lines: Vec<String>,
    ends: Vec<End>,
}

/// One of them, which is read without waiting.
struct End {
    pipe: OwnedFd,
    /// A line that is not complete.
    rest: Vec<u8>,
    is_open: bool,
}

impl Output {
    /// The lines of all that was printed up to this moment: what the program has done before somebody asks is there.
    fn so_far(&self) -> MutexGuard<'_, Said> {
        let mut said = self.said.lock().unwrap();
        let before = (said.lines.len(), said.is_open());
        said.take_what_is_there();
        if before != (said.lines.len(), said.is_open()) {
            self.more.notify_all();
        }
        said
    }
}

impl Said {
    fn take_what_is_there(&mut self) {
        for end in &mut self.ends {
            end.take_what_is_there(&mut self.lines);
        }
    }

    fn is_open(&self) -> bool {
        self.ends.iter().any(|end| end.is_open)
    }
}

impl End {
    fn new(pipe: OwnedFd) -> Self {
        // The flag is that of this end alone: whoever writes still waits for room.
        fcntl_setfl(&pipe, fcntl_getfl(&pipe).unwrap() | OFlags::NONBLOCK).unwrap();
        Self {
            pipe,
            rest: Vec::new(),
            is_open: true,
        }
    }

    fn take_what_is_there(&mut self, lines: &mut Vec<String>) {
        let mut bytes = [0; 16 * 1024];
        while self.is_open {
            match rustix::io::read(&self.pipe, &mut bytes) {
                Ok(0) => self.is_open = false,
                Ok(count) => self.take(&bytes[..count], lines),
                Err(Errno::INTR) => {}
                Err(_) => return,
            }
        }
        if !self.rest.is_empty() {
            lines.push(text(&std::mem::take(&mut self.rest)));
        }
    }

    fn take(&mut self, bytes: &[u8], lines: &mut Vec<String>) {
        for part in bytes.split_inclusive(|byte| *byte == b'\n') {
            self.rest.extend_from_slice(part);
            if let Some(line) = self.rest.strip_suffix(b"\n") {
                lines.push(text(line));
                self.rest.clear();
            }
        }
    }
}

fn text(line: &[u8]) -> String {
    String::from_utf8_lossy(line.strip_suffix(b"\r").unwrap_or(line)).into_owned()
}

impl Started {
    /// Starts `command` with its output caught and nothing on its stdin.
    pub fn new(command: Command) -> Self {
        Self::with_input(command, Stdio::null())
    }

    /// Starts `command` at a keyboard that [`type_line`](Self::type_line) types on.
    pub fn at_a_keyboard(command: Command) -> Self {
        Self::with_input(command, Stdio::piped())
    }

    /// Starts `command` with `terminal` as its stdin.
    pub fn at_a_terminal(command: Command, terminal: std::fs::File) -> Self {
        Self::with_input(command, terminal.into())
    }

    fn with_input(mut command: Command, input: Stdio) -> Self {
        let name = command.get_program().to_string_lossy().into_owned();
        command
            .stdin(input)
            .stdout(Stdio::piped())
            .stderr(Stdio::piped());
        let mut child = command
            .spawn()
            .unwrap_or_else(|error| panic!("cannot start {name}: {error}; run tests/run"));
        let output = Arc::new(Output::default());
        collect(
            [
                child.stdout.take().unwrap().into(),
                child.stderr.take().unwrap().into(),
            ],
            &output,
        );
        let input = child.stdin.take();
        Self {
            name,
            child,
            input,
            output,
        }
    }

    /// Starts `command` before a reader that takes one line of its output and leaves, as `head` does.
    pub fn before_a_reader_that_leaves(mut command: Command) -> (Self, String) {
        let name = command.get_program().to_string_lossy().into_owned();
        command
            .stdin(Stdio::null())
            .stdout(Stdio::piped())
            .stderr(Stdio::piped());
        let mut child = command
            .spawn()
            .unwrap_or_else(|error| panic!("cannot start {name}: {error}"));
        let mut line = String::new();
        BufReader::new(child.stdout.take().unwrap())
            .read_line(&mut line)
            .unwrap();
        drop(child.stderr.take());
        (
            Self {
                name,
                child,
                input: None,
                output: Arc::default(),
            },
            line,
        )
    }

    /// Waits for a line of which `found` makes something, and returns that.
    pub fn wait_for<T>(&self, what: &str, found: impl FnMut(&str) -> Option<T>) -> T {
        match self.look_for(0, found) {
            Some(it) => it,
            None => panic!("{} never said {what}; it said:\n{}", self.name, self.text()),
        }
    }

    /// Waits for a line behind `seen` others of which `found` makes something; nothing if none comes, at the latest when
    /// nobody is left who could say it.
    pub fn look_for<T>(
        &self,
        mut seen: usize,
        mut found: impl FnMut(&str) -> Option<T>,
    ) -> Option<T> {
        let until = Instant::now() + PATIENCE;
        let mut said = self.output.so_far();
        loop {
            if let Some(it) = said.lines[seen..].iter().find_map(|line| found(line)) {
                return Some(it);
            }
            seen = said.lines.len();
            let left = until.saturating_duration_since(Instant::now());
            if left.is_zero() || !said.is_open() {
                return None;
            }
            said = self.output.more.wait_timeout(said, left).unwrap().0;
        }
    }

    /// How many lines there are so far.
    pub fn lines(&self) -> usize {
        self.output.so_far().lines.len()
    }

    /// What `found` makes of the lines so far.
    pub fn find_all<T>(&self, found: impl FnMut(&String) -> Option<T>) -> Vec<T> {
        self.output
            .so_far()
            .lines
            .iter()
            .filter_map(found)
            .collect()
    }

    /// Presses the keys of `text` and Enter.
    pub fn type_line(&mut self, text: &str) {
        let input = self.input.as_mut().expect("it was started at a keyboard");
        writeln!(input, "{text}").unwrap();
    }

    /// Its input ends.
    pub fn end_of_input(&mut self) {
        self.input = None;
    }

    /// The number of the process.
    pub fn id(&self) -> u32 {
        self.child.id()
    }

    /// Whether nobody is left who could print something.
    pub fn is_silent(&self) -> bool {
        !self.output.so_far().is_open()
    }

    /// Everything that was printed so far.
    pub fn text(&self) -> String {
        self.output.so_far().lines.join("\n")
    }

    /// The same, with a last line that has no end yet.
    pub fn text_so_far(&self) -> String {
        let said = self.output.so_far();
        let rests = said
            .ends
            .iter()
            .map(|end| text(&end.rest))
            .filter(|rest| !rest.is_empty());
        said.lines
            .iter()
            .cloned()
            .chain(rests)
            .collect::<Vec<_>>()
            .join("\n")
    }

    /// Whether the program has ended.
    pub fn has_ended(&mut self) -> bool {
        self.child.try_wait().unwrap().is_some()
    }

    /// Asks the program to end.
    pub fn terminate(&self) {
        self.signal("TERM");
    }

    /// Presses Ctrl-C.
    pub fn interrupt(&self) {
        self.signal("INT");
    }

    /// Ends the program without a chance to do anything, and waits until it is gone.
    pub fn kill(&mut self) {
        self.child.kill().unwrap();
        self.child.wait().unwrap();
    }

    /// The shell's own `kill` needs neither a package nor unsafe code.
    pub fn signal(&self, signal: &str) {
        let kill = format!("kill -{signal} {}", self.child.id());
        assert!(
            Command::new("sh")
                .args(["-c", &kill])
                .status()
                .unwrap()
                .success(),
            "{kill}"
        );
    }

    /// Waits for the end of the program.
    pub fn end_within(&mut self, within: Duration) -> ExitStatus {
        let until = Instant::now() + within;
        loop {
            if let Some(status) = self.child.try_wait().unwrap() {
                return status;
            }
            assert!(
                Instant::now() < until,
                "{} still runs after {within:?}; it said:\n{}",
                self.name,
                self.text()
            );
            std::thread::sleep(Duration::from_millis(5));
        }
    }
}

impl Drop for Started {
    fn drop(&mut self) {
        // One that has ended already is as good.
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

/// Takes what comes from `pipes` as it comes, so that they never fill, until their other ends are closed.
fn collect(pipes: [OwnedFd; 2], output: &Arc<Output>) {
    let watched = pipes.each_ref().map(|pipe| pipe.try_clone().unwrap());
    output.said.lock().unwrap().ends.extend(pipes.map(End::new));
    let output = Arc::clone(output);
    std::thread::spawn(move || {
        loop {
            let is_open: Vec<_> = output
                .said
                .lock()
                .unwrap()
                .ends
                .iter()
                .map(|end| end.is_open)
                .collect();
            let open = watched
                .iter()
                .zip(&is_open)
                .filter(|(_, is_open)| **is_open)
                .map(|(pipe, _)| pipe);
            let mut open: Vec<_> = open.map(|pipe| PollFd::new(pipe, PollFlags::IN)).collect();
            if open.is_empty() {
                break;
            }
            // Woken by a signal, it looks in vain.
            let _ = poll(&mut open, None);
            drop(output.so_far());
        }
    });
}

/// Tries `done` until it gives something, at most for `within`.
pub fn until<T>(what: &str, within: Duration, mut done: impl FnMut() -> Option<T>) -> T {
    let end = Instant::now() + within;
    loop {
        if let Some(it) = done() {
            return it;
        }
        assert!(Instant::now() < end, "not within {within:?}: {what}");
        std::thread::sleep(Duration::from_millis(10));
    }
}
