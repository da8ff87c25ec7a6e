//! `init` at a terminal: a person answers its questions about a line of unknown drives, and Home Assistant sees all of
//! them.

use super::initialising::{MODELS, Yard};
use super::mosquitto::{Mosquitto, Subscriber};
use super::rig::{Place, assert_says, program, start, terminal, vfd_gateway};
use super::started::{PATIENCE, Started, until};
use rustix::io::write;
use serde_json::Value;
use std::collections::BTreeSet;
use std::time::{Duration, Instant};
use vfd_gateway::daemon::host::pty::Pty;
use vfd_gateway::sim::BusPacing;

/// What is wanted of it: no more answers than these.
const ANSWERS_MAX: usize = 15;
/// A scan of eight stations at their speed, on a machine that is busy with other tests.
const SCAN_MAX: Duration = Duration::from_secs(300);
const NAMES: [&str; 8] = ["p1", "p2", "p3", "p4", "p5", "p6", "p7", "p8"];

/// What a question contains, and what is answered. The model is asked for by numbers, which are looked up.
const ANSWERS: [(&str, &str); 13] = [
    ("Names of the drives", "p1 p2 p3 p4 p5 p6 p7 p8"),
    ("Interfaces to the drives", "home-assistant"),
    ("Broker: mqtt://HOST", "BROKER"),
    ("User at the broker", ""),
    ("Who may command the drives", "mqtt"),
    ("Lowest and highest frequency", "5-50"),
    ("Directions", ""),
    ("When the client is lost", "stop"),
    ("How long may the client be silent", "30s"),
    ("When the gateway is shut down", "stop"),
    ("No manual proves how these are stopped", "yes"),
    ("Directory for the journal", "DATA"),
    ("Run the gateway now", ""),
];

/// `init` at a terminal.
struct Dialogue {
    command: Started,
    keyboard: Pty,
    /// How much was read before the last answer, and the questions so far.
    seen: usize,
    questions: Vec<String>,
    /// How long the drives were looked for.
    line_time: Duration,
}

impl Dialogue {
    /// The next question with what is said before it; nothing when it has ended.
    fn question(&mut self) -> Option<String> {
        let begun = Instant::now();
        let asked = until("a question", SCAN_MAX, || {
            if self.command.has_ended() {
                return Some(None);
            }
            let said = self.command.text_so_far();
            let is_asked = said.len() > self.seen && said.trim_end_matches(' ').ends_with(':');
            is_asked.then_some(Some(said))
        })?;
        self.line_time = self.line_time.max(begun.elapsed());
        let question = asked[self.seen..].to_owned();
        self.seen = asked.len();
        self.questions
            .push(question.lines().last().unwrap_or_default().to_owned());
        Some(question)
    }

    fn answer(&self, text: &str) {
        write(self.keyboard.master(), format!("{text}\n").as_bytes()).unwrap();
    }
}

/// The number of the model on the nameplate of the first station that a question is about.
fn on_the_nameplate(question: &str) -> String {
    let (_, stations) = question.split_once("Station ").unwrap();
    let station: usize = stations.split([',', ' ']).next().unwrap().parse().unwrap();
    let id = format!("({})", MODELS[(station - 1) / 2]);
    let row = question
        .lines()
        .find(|line| line.ends_with(&id))
        .unwrap_or_else(|| panic!("no {id} in {question}"));
    row.trim().split(')').next().unwrap().to_owned()
}

#[test]
fn a_person_is_asked_little_and_home_assistant_sees_eight_drives() {
    let yard = Yard::new(BusPacing::CharacterTimes);
    let place = Place::new();
    let broker = Mosquitto::start(&place.file(""));
    let here = |name: &str| place.file(name).to_str().unwrap().to_owned();
    let (out, data) = (here("vfd-gateway.toml"), here("data"));
    let keyboard = Pty::new().unwrap();
    let mut command = program();
    command.args(["init", "--stations", "1-8", "--out", &out]);
    let command = Started::at_a_terminal(command, terminal(keyboard.path()));
    let (questions, line_time) = (Vec::new(), Duration::ZERO);
    let mut person = Dialogue {
        command,
        keyboard,
        seen: 0,
        questions,
        line_time,
    };
    while let Some(question) = person.question() {
        let known = ANSWERS
            .iter()
            .find(|(part, _)| question.contains(part))
            .map(|(_, answer)| *answer);
        person.answer(&match known {
            Some("BROKER") => format!("mqtt://{}", broker.address()),
            Some("DATA") => data.clone(),
            Some(answer) => answer.to_owned(),
            None if question.contains("Number of the port") => yard.port.display().to_string(),
            None if question.contains("on the nameplate") => on_the_nameplate(&question),
            None => panic!("no answer is listed for {question}"),
        });
    }
    assert!(
        person.command.end_within(PATIENCE).success(),
        "{}",
        person.command.text()
    );
    let answers = person.questions.len();
    println!(
        "{answers} answers, {:.0} s on the line: {:#?}",
        person.line_time.as_secs_f64(),
        person.questions
    );
    assert!(
        answers <= ANSWERS_MAX,
        "{answers} answers: {:#?}",
        person.questions
    );

    let written = std::fs::read_to_string(&out).unwrap();
    assert!(
        written.contains("baud = 9600\nparity = \"none\"\nstop_bits = 1\n"),
        "{written}"
    );
    assert_says(&vfd_gateway(&["check", "-c", &out]), 0, &["line-1"]);
    let announced = Subscriber::new(&broker, "mqttv5", "homeassistant/#");
    let values = Subscriber::new(&broker, "mqttv5", "vfd/#");
    let _gateway = start(&["run", "-c", &out]);
    for name in NAMES {
        values.wait_for_payload(&format!("/drive/{name}/availability"), "online");
        values.wait_for(&format!("/drive/{name}/frequency/output"), |it| {
            it.payload.parse::<f64>().ok()
        });
    }
    let devices = || {
        let documents = announced.on("/config").into_iter();
        let documents = documents.filter_map(|it| serde_json::from_str::<Value>(&it.payload).ok());
        let names = documents.filter_map(|it| it["device"]["name"].as_str().map(str::to_owned));
        names
            .filter(|name| NAMES.contains(&name.as_str()))
            .collect::<BTreeSet<_>>()
    };
    until("eight devices are announced", PATIENCE, || {
        (devices().len() == NAMES.len()).then_some(())
    });
}
