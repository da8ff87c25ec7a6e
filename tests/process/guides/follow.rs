//! Whoever follows a guide: reads it from its beginning to its end in a fresh directory, writes each configuration into
//! the file that is named, and types each line in the state that the lines before have left.

use super::super::rig::{Place, terminal};
use super::super::started::{PATIENCE, Started, until};
use super::lines::{Kind, frequency, is_done, kind, live_value, online};
use super::text::{Block, blocks, comment, document, named_file, statements};
use rustix::io::write;
use std::path::Path;
use std::process::Command;
use std::sync::MutexGuard;
use std::time::{Duration, Instant};
use vfd_gateway::daemon::host::pty::Pty;

/// How soon a line is typed again that was refused for now.
const AGAIN_AFTER: Duration = Duration::from_millis(200);
/// The longest that a line may take that ends by itself: `doctor` watches for 30 s.
const LONGEST: Duration = Duration::from_secs(90);
/// What is run; everything else stands in the list of what is not.
const PROGRAMS: [&str; 4] = ["vfd-gateway", "mosquitto_sub", "mosquitto_pub", "mbpoll"];

/// Words that tell where the next line is typed, when a line has kept its terminal.
const FREE: [&str; 3] = ["terminal", "another one", "until Ctrl-C"];

/// Lines or blocks that cannot be run here, by their beginning, and why.
pub type NotRun = (&'static str, &'static str);
/// What stands in a guide, and what is meant on this machine: ports, the adapter, directories, hosts. Nothing else
/// differs.
pub type Table = Vec<(&'static str, String)>;

/// A line that was typed, and what it has printed.
pub struct Typed {
    pub line: String,
    /// As it was meant here.
    here: String,
    pub said: String,
}

/// A guide, and how far it was followed.
pub struct Guide {
    name: &'static str,
    table: Table,
    not_run: &'static [NotRun],
    used: Vec<bool>,
    /// The gateway, or the demo.
    gateway: Option<Started>,
    /// A line that keeps a motor running, and the line that reads it.
    forward: Option<(Started, String)>,
    watchers: Vec<(String, Started)>,
    /// Said since the gateway was started, and since a line was typed that keeps its terminal.
    since_start: String,
    since_taken: Option<String>,
    /// Said before the block that is read.
    before: String,
    file: String,
    /// Values of drives that were seen.
    live: Vec<String>,
    /// Held while a demo runs.
    pub alone: Option<MutexGuard<'static, ()>>,
    /// It is gone when nobody has it open any more.
    pub place: Place,
}

impl Guide {
    /// The guide at `name` of this repository. Each row of `table` stands in it.
    pub fn new(name: &'static str, place: Place, table: Table, not_run: &'static [NotRun]) -> Self {
        let text = document(name);
        for (there, _) in &table {
            assert!(text.contains(there), "{name}: nothing there says {there}");
        }
        Self {
            place,
            name,
            table,
            not_run,
            used: vec![false; not_run.len()],
            gateway: None,
            forward: None,
            watchers: Vec::new(),
            since_start: String::new(),
            since_taken: None,
            before: String::new(),
            file: String::new(),
            live: Vec::new(),
            alone: None,
        }
    }

    /// Reads it to its end. `after` is told of each line that was typed.
    pub fn follow(mut self, mut after: impl FnMut(&mut Self, &Typed)) {
        for block in blocks(&document(self.name)) {
            self.read_on(&block);
            match block.language.as_str() {
                "toml" if !self.is_listed(&block.text) => self.write_file(&block),
                "sh" | "console" => {
                    for line in statements(&block.text) {
                        if self.is_listed(&line) {
                            continue;
                        }
                        let typed = self.type_line(&line);
                        self.live.extend(live_value(&typed.here, &typed.said));
                        after(&mut self, &typed);
                    }
                }
                "toml" | "end" => {}
                _ => assert!(
                    self.is_listed(&block.text),
                    "{}: nobody runs\n{}",
                    self.name,
                    block.text
                ),
            }
        }
        self.end();
    }

    /// Nothing of the lists is there in vain, a value was seen, and everything ends in good order.
    fn end(mut self) {
        for ((begins, _), used) in self.not_run.iter().zip(&self.used) {
            assert!(
                used,
                "{}: listed as not run, and not there: {begins}",
                self.name
            );
        }
        assert!(
            !self.live.is_empty(),
            "{}: nothing that it says to type has shown a live value",
            self.name
        );
        self.watchers.clear();
        self.end_gateway();
    }

    fn is_listed(&mut self, text: &str) -> bool {
        let found = self
            .not_run
            .iter()
            .position(|(begins, _)| text.starts_with(begins));
        found.inspect(|index| self.used[*index] = true).is_some()
    }

    /// What stands in the guide, as it is meant here.
    fn here(&self, text: &str) -> String {
        self.table
            .iter()
            .fold(text.to_owned(), |text, (there, here)| {
                text.replace(there, here)
            })
    }

    /// More rows, whose right side is known only now.
    pub fn add_to_table(&mut self, rows: Table) {
        self.table.extend(rows);
    }

    /// Takes in what is said before a block, and ends what it says to end.
    fn read_on(&mut self, block: &Block) {
        self.before.clone_from(&block.before);
        self.since_start.push_str(&block.before);
        if let Some(since) = self.since_taken.as_mut() {
            since.push_str(&block.before);
        }
        // What is to be looked at "while it runs" stands in the next block.
        if self.forward.is_some() && !block.before.contains("While it runs") {
            self.stop_motor();
        }
        let starts = block.language == "sh"
            && statements(&block.text)
                .iter()
                .any(|it| kind(it) == Kind::Gateway);
        if starts && self.gateway.is_some() {
            assert!(
                self.since_start.contains("Ctrl-C"),
                "{}: nobody says how the first one ends",
                self.name
            );
            self.end_gateway();
            self.since_taken = None;
        }
    }

    fn end_gateway(&mut self) {
        if let Some(mut gateway) = self.gateway.take() {
            gateway.interrupt();
            assert!(
                gateway.end_within(PATIENCE).success(),
                "{}: {}",
                self.name,
                gateway.text()
            );
        }
    }

    fn write_file(&mut self, block: &Block) {
        if let Some(name) = named_file(&block.before) {
            name.clone_into(&mut self.file);
        }
        let is_told = named_file(&block.before).is_some()
            || block
                .before
                .split_whitespace()
                .collect::<Vec<_>>()
                .join(" ")
                .contains("whole file");
        assert!(
            is_told && !self.file.is_empty(),
            "{}: nobody says into which file this goes\n{}",
            self.name,
            block.text
        );
        let text = self.here(&block.text);
        self.place.write(&self.file, &text);
    }

    /// Changes the file as the guide says in words: `said` stands there.
    pub fn edit(&self, said: &str, change: impl FnOnce(&str) -> String) {
        assert!(
            document(self.name).contains(said),
            "{}: nobody says: {said}",
            self.name
        );
        let text = std::fs::read_to_string(self.place.file(&self.file)).unwrap();
        self.place.write(&self.file, &change(&text));
    }

    fn type_line(&mut self, line: &str) -> Typed {
        let program = line.split_whitespace().next().unwrap();
        let here = self.here(line);
        let runs = here.split_whitespace().next().unwrap();
        assert!(
            PROGRAMS.contains(&runs),
            "{}: {program} is not run, and not listed: {line}",
            self.name
        );
        if let Some(since) = self.since_taken.take() {
            if since.contains("until Ctrl-C") {
                self.end_watcher();
            }
            let is_told = [&since, comment(line)]
                .iter()
                .any(|it| FREE.iter().any(|word| it.contains(word)));
            assert!(
                is_told,
                "{}: nobody says that another terminal is needed for: {line}",
                self.name
            );
        }
        let said = match kind(&here) {
            Kind::Ends => self.until_done(&here),
            Kind::Asks => self.answered(&here),
            Kind::Demo => self.start(&here, |it, _| it.contains("Ctrl-C")),
            Kind::Gateway => {
                let drives = self.drives_of(&here);
                self.start(&here, move |_, all| online(all) >= drives)
            }
            Kind::Forward => self.run_forward(&here),
            Kind::Watcher => self.watch(line, &here),
        };
        if ![Kind::Ends, Kind::Asks].contains(&kind(&here)) {
            self.since_taken = Some(format!("{}{}", self.before, comment(line)));
        }
        Typed {
            line: line.to_owned(),
            here,
            said,
        }
    }

    /// How many drives the file has that `line` names.
    fn drives_of(&self, line: &str) -> usize {
        let (_, file) = line.split_once(" -c ").expect("it names its file");
        let file = self.place.file(file.split_whitespace().next().unwrap());
        std::fs::read_to_string(file)
            .unwrap()
            .matches("[[line.drive]]")
            .count()
    }

    /// Starts the gateway as a service does: no terminal is taken.
    pub fn start_service(&mut self, line: &str) {
        let here = self.here(line);
        let drives = self.drives_of(&here);
        self.start(&here, |_, all| online(all) >= drives);
    }

    /// Starts what stays, until it has said that it is there.
    fn start(&mut self, line: &str, is_there: impl Fn(&str, &str) -> bool) -> String {
        assert!(
            self.gateway.is_none(),
            "{}: it runs already: {line}",
            self.name
        );
        let started = Started::at_a_keyboard(self.shell(line));
        let mut all = String::new();
        started.wait_for(&format!("that {line} works"), |said| {
            all.extend([said, "\n"]);
            is_there(said, &all).then_some(())
        });
        self.since_start.clear();
        let said = started.text();
        self.gateway = Some(started);
        said
    }

    /// What was ordered just before may still be under way: a person is slower.
    fn until_done(&self, line: &str) -> String {
        let begun = Instant::now();
        loop {
            let mut started = Started::new(self.shell(line));
            let is_good = started.end_within(LONGEST).success();
            let said = started.text();
            if is_good && is_done(line, &said) {
                return said;
            }
            let why = self.gateway.as_ref().map(Started::text).unwrap_or_default();
            assert!(
                begun.elapsed() < PATIENCE,
                "{}: {line}\n{said}\nthe gateway:\n{why}",
                self.name
            );
            std::thread::sleep(AGAIN_AFTER);
        }
    }

    /// Says yes at a terminal to what is asked.
    fn answered(&self, line: &str) -> String {
        let begun = Instant::now();
        loop {
            let keyboard = Pty::new().unwrap();
            let mut started = Started::at_a_terminal(self.shell(line), terminal(keyboard.path()));
            write(keyboard.master(), b"y\n").unwrap();
            let is_good = started.end_within(PATIENCE).success();
            if is_good {
                return started.text();
            }
            assert!(
                begun.elapsed() < PATIENCE,
                "{}: {line}\n{}",
                self.name,
                started.text()
            );
            std::thread::sleep(AGAIN_AFTER);
        }
    }

    fn watch(&mut self, line: &str, here: &str) -> String {
        let mut command = Command::new("stdbuf");
        command.args(["-oL", "sh", "-c", &format!("exec {here}")]);
        let watcher = Started::new(self.prepared(command));
        if line.contains(" --out ") {
            let (_, out) = here.split_once(" --out ").unwrap();
            let out = self.place.file(out.split_whitespace().next().unwrap());
            until("something is captured", PATIENCE, || {
                out.metadata().ok().filter(|it| it.len() > 200)
            });
        } else {
            watcher.wait_for("something", |said| (!said.is_empty()).then_some(()));
        }
        let said = watcher.text();
        self.watchers.push((line.to_owned(), watcher));
        said
    }

    /// What was typed last ends as the guide says.
    fn end_watcher(&mut self) {
        let (line, mut watcher) = self.watchers.pop().unwrap();
        watcher.interrupt();
        watcher.end_within(PATIENCE);
        assert!(watcher.is_silent(), "{}: {line} goes on", self.name);
    }

    /// The line that watches and begins with `begins`.
    pub fn watcher(&self, begins: &str) -> &Started {
        let found = self
            .watchers
            .iter()
            .find(|(line, _)| line.starts_with(begins));
        &found
            .unwrap_or_else(|| panic!("{}: nobody has typed {begins}", self.name))
            .1
    }

    /// It stays until Ctrl-C. While it runs, the guide's own way to read shows that the motor turns.
    fn run_forward(&mut self, line: &str) -> String {
        let writer = until("the start is taken", PATIENCE, || {
            let mut writer = Started::new(self.shell(line));
            until("it runs or is refused", PATIENCE, || {
                (writer.has_ended() || writer.text().contains("the lease is renewed")).then_some(())
            });
            (!writer.has_ended()).then_some(writer)
        });
        let (target, _) = line.split_once(" run forward").unwrap();
        let read = format!("{} --uniform", target.replace(" write ", " read "));
        until("the motor turns", PATIENCE, || {
            self.frequency(&read).filter(|it| *it > 1.0)
        });
        let said = writer.text();
        self.live.push(self.until_done(&read));
        self.forward = Some((writer, read));
        said
    }

    /// The output frequency that a line shows which reads all of a drive.
    pub fn frequency(&self, line: &str) -> Option<f64> {
        frequency(&self.until_done(line))
    }

    fn stop_motor(&mut self) {
        let (mut writer, read) = self.forward.take().unwrap();
        assert!(
            document(self.name).contains("Ctrl-C"),
            "{}: nobody says how it is stopped",
            self.name
        );
        writer.interrupt();
        assert!(
            writer.end_within(PATIENCE).success(),
            "{}: {}",
            self.name,
            writer.text()
        );
        until("the motor stands", PATIENCE, || {
            self.frequency(&read).filter(|it| *it == 0.0)
        });
        self.since_taken = None;
    }

    fn shell(&self, line: &str) -> Command {
        let mut shell = Command::new("sh");
        // Signals are for the program itself, where it is one.
        let typed = line.split(" # ").next().unwrap();
        let exec = if typed.contains(['|', ';']) {
            ""
        } else {
            "exec "
        };
        shell.args(["-c", &format!("{exec}{line}")]);
        self.prepared(shell)
    }

    fn prepared(&self, mut command: Command) -> Command {
        let program = Path::new(env!("CARGO_BIN_EXE_vfd-gateway"))
            .parent()
            .unwrap()
            .to_str()
            .unwrap();
        command.env(
            "PATH",
            format!("{program}:{}", std::env::var("PATH").unwrap()),
        );
        command.current_dir(self.place.file(""));
        command
    }
}
