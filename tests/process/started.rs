//! A program that a test has started: its output line by line, and its end.

use std::io::{BufRead, BufReader, Read, Write};
use std::process::{Child, ChildStdin, Command, ExitStatus, Stdio};
use std::sync::{Arc, Condvar, Mutex};
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

/// The lines of stdout and stderr so far, in order of arrival.
#[derive(Default)]
struct Output {
    lines: Mutex<Vec<String>>,
    more: Condvar,
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

    fn with_input(mut command: Command, input: Stdio) -> Self {
        let name = command.get_program().to_string_lossy().into_owned();
        command.stdin(input).stdout(Stdio::piped()).stderr(Stdio::piped());
        let mut child = command.spawn().unwrap_or_else(|error| panic!("cannot start {name}: {error}; run tests/run"));
        let output = Arc::new(Output::default());
        collect(child.stdout.take().unwrap(), Arc::clone(&output));
        collect(child.stderr.take().unwrap(), Arc::clone(&output));
        let input = child.stdin.take();
        Self { name, child, input, output }
    }

    /// Starts `command` before a reader that takes one line of its output and leaves, as `head` does.
    pub fn before_a_reader_that_leaves(mut command: Command) -> (Self, String) {
        let name = command.get_program().to_string_lossy().into_owned();
        command.stdin(Stdio::null()).stdout(Stdio::piped()).stderr(Stdio::piped());
        let mut child = command.spawn().unwrap_or_else(|error| panic!("cannot start {name}: {error}"));
        let mut line = String::new();
        BufReader::new(child.stdout.take().unwrap()).read_line(&mut line).unwrap();
        drop(child.stderr.take());
        (Self { name, child, input: None, output: Arc::default() }, line)
    }

    /// Waits for a line of which `found` makes something, and returns that.
    pub fn wait_for<T>(&self, what: &str, mut found: impl FnMut(&str) -> Option<T>) -> T {
        let until = Instant::now() + PATIENCE;
        let mut lines = self.output.lines.lock().unwrap();
        let mut seen = 0;
        loop {
            if let Some(it) = lines[seen..].iter().find_map(|line| found(line)) {
                return it;
            }
            seen = lines.len();
            let left = until.saturating_duration_since(Instant::now());
            assert!(!left.is_zero(), "{} never said {what}; it said:\n{}", self.name, lines.join("\n"));
            lines = self.output.more.wait_timeout(lines, left).unwrap().0;
        }
    }

    /// What `found` makes of the lines so far.
    pub fn find_all<T>(&self, found: impl FnMut(&String) -> Option<T>) -> Vec<T> {
        self.output.lines.lock().unwrap().iter().filter_map(found).collect()
    }

    /// Presses the keys of `text` and Enter.
    pub fn type_line(&mut self, text: &str) {
        let input = self.input.as_mut().expect("it was started at a keyboard");
        writeln!(input, "{text}").unwrap();
    }

    /// The number of the process.
    pub fn id(&self) -> u32 {
        self.child.id()
    }

    /// Everything that was printed so far.
    pub fn text(&self) -> String {
        self.output.lines.lock().unwrap().join("\n")
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
        assert!(Command::new("sh").args(["-c", &kill]).status().unwrap().success(), "{kill}");
    }

    /// Waits for the end of the program.
    pub fn end_within(&mut self, within: Duration) -> ExitStatus {
        let until = Instant::now() + within;
        loop {
            if let Some(status) = self.child.try_wait().unwrap() {
                return status;
            }
            assert!(Instant::now() < until, "{} still runs after {within:?}; it said:\n{}", self.name, self.text());
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

fn collect(from: impl Read + Send + 'static, output: Arc<Output>) {
    std::thread::spawn(move || {
        for line in BufReader::new(from).lines().map_while(Result::ok) {
            output.lines.lock().unwrap().push(line);
            output.more.notify_all();
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
