//! What goes over the wire with each built-in model, from its first status to the reset of a trip, as a drive engineer
//! reads it. `UPDATE_GOLDEN=1` rewrites the texts. Orders are accepted whatever their proof.

use crate::conversation::{GOLDEN, compare};
use crate::support::families::{accepting, each, options_of};
use crate::support::{MQTT, Rig, RigOptions, STOP, run, setpoint};
use std::collections::HashMap;
use std::fmt::Write;
use std::sync::Arc;
use std::time::Duration;
use vfd_gateway::domain::address::Address;
use vfd_gateway::domain::command::{Direction, Order, Outcome, Reason};
use vfd_gateway::domain::ids::Station;
use vfd_gateway::domain::traffic::{FramePurpose, TrafficKind, TrafficRecord};
use vfd_gateway::profile::model::{Model, OrderKind, Register, RegisterRole};
use vfd_gateway::profile::words::FLAGS;
use vfd_gateway::vendors;
use vfd_gateway::wire::pdu::{Reply, Request};

const SECOND: Duration = Duration::from_secs(1);
/// Most lines of a conversation: more is read by nobody.
const LINES_MAX: usize = 80;
/// The roles whose registers are shown wherever they are polled.
const SHOWN: [RegisterRole; 9] = [
    RegisterRole::RunCommand,
    RegisterRole::Order,
    RegisterRole::FrequencyCommand,
    RegisterRole::FrequencySetting,
    RegisterRole::OutputFrequency,
    RegisterRole::TripCode,
    RegisterRole::TripBits,
    RegisterRole::TripCause,
    RegisterRole::TripCount,
];
/// Files in the same place that are about no model.
const OTHERS: [&str; 4] = ["barrier", "dead_drive", "late_reply", "sharing"];

#[test]
fn each_model_has_its_conversation() {
    each(|model| {
        if vendors::catalog().find(&model.id).is_some() {
            let text = conversation(model);
            assert!(
                text.lines().count() <= LINES_MAX,
                "{} lines:\n{text}",
                text.lines().count()
            );
            compare(&model.id, &text);
        }
    });
}

#[test]
fn each_conversation_is_that_of_a_model() {
    let catalog = vendors::catalog();
    for entry in std::fs::read_dir(GOLDEN).expect("the golden texts") {
        let path = entry.expect("an entry").path();
        let name = path
            .file_stem()
            .and_then(|it| it.to_str())
            .expect("a name")
            .to_owned();
        assert!(
            catalog.find(&name).is_some() || OTHERS.contains(&name.as_str()),
            "{name} is of no model"
        );
    }
}

fn conversation(model: &Arc<Model>) -> String {
    let options = RigOptions {
        tells_traffic: true,
        ..options_of(model, accepting())
    };
    let mut told = Told {
        rig: Rig::new(&options),
        model: Arc::clone(model),
        last: HashMap::new(),
        text: String::new(),
    };
    let framing = if model.link.asks().is_some() {
        ", a usual setting"
    } else {
        ""
    };
    let _ = writeln!(
        told.text,
        "{} {}: {}{framing}, station 1, a simulated drive.\n\
         Polls are shown where their answer is new, and only of registers that tell the state.",
        model.vendor, model.title, options.link
    );
    told.passes("at rest", SECOND * 2);
    let has = |kind| model.order(kind).is_some();
    if has(OrderKind::Forward) {
        told.orders("setpoint 30 Hz", setpoint(3000));
        told.orders("run forward", run(Direction::Forward, None));
        told.passes("it runs", SECOND * 8);
        told.orders("stop", STOP);
        told.passes("it has stopped", SECOND * 12);
    }
    if model.trip_register().is_some() {
        let cause = model
            .trip_codes
            .iter()
            .map(|it| it.code)
            .find(|code| *code > 0)
            .unwrap_or(2);
        let now = told.rig.now;
        told.rig
            .bus
            .drive_mut(Station(1))
            .expect("it is there")
            .trip(now, cause);
        told.passes("it trips", SECOND * 4);
        if has(OrderKind::Reset) {
            told.orders("reset", Order::Reset);
            told.passes("it is reset", SECOND * 4);
        }
    }
    told.text
}

/// A rig whose conversation is told.
struct Told {
    rig: Rig,
    model: Arc<Model>,
    /// The words that were told last.
    last: HashMap<Address, u16>,
    text: String,
}

impl Told {
    /// Gives an order, and tells everything that was sent for it.
    fn orders(&mut self, name: &str, order: Order) {
        self.rig.traffic.clear();
        let outcome = self.rig.commanded(MQTT, order);
        assert!(
            matches!(outcome.0, Outcome::Confirmed | Outcome::Acknowledged),
            "{name}: {outcome:?}"
        );
        let _ = writeln!(self.text, "\n{name}");
        let mut exchanges = self.exchanges();
        exchanges.retain(|(request, _)| {
            matches!(
                request.why,
                Some(FramePurpose::Command | FramePurpose::Stop)
            )
        });
        for (at, (request, reply)) in exchanges.iter().enumerate() {
            // A read that is repeated until its answer is right is shown once.
            let is_repeated = exchanges
                .get(at + 1)
                .is_some_and(|(next, _)| next.bytes == request.bytes);
            let is_read = matches!(
                Request::decode(pdu(&request.bytes)),
                Some(Request::Read { .. })
            );
            if !(is_read && is_repeated) && self.is_new(request, reply) {
                self.tell(request, reply);
            }
        }
        let reason = if outcome.1 == Reason::None {
            String::new()
        } else {
            format!(", {}", outcome.1.keyword())
        };
        let _ = writeln!(self.text, "   the order is {}{reason}", outcome.0.keyword());
    }

    /// Lets time pass, and tells what the drive shows at its end that it has not shown before.
    fn passes(&mut self, name: &str, time: Duration) {
        self.rig.traffic.clear();
        self.rig.live(time);
        let _ = writeln!(self.text, "\n{name}");
        let exchanges = self.exchanges();
        let before = self.text.len();
        for (at, (request, reply)) in exchanges.iter().enumerate() {
            let is_last = exchanges[at + 1..]
                .iter()
                .all(|(later, _)| later.bytes != request.bytes);
            let tells =
                Request::decode(pdu(&request.bytes)).is_some_and(|it| self.tells_state(&it));
            if is_last && tells && self.is_new(request, reply) {
                self.tell(request, reply);
            }
        }
        if self.text.len() == before {
            self.text.push_str("   nothing that is not shown above\n");
        }
    }

    /// Requests with their replies.
    fn exchanges(&self) -> Vec<(TrafficRecord, TrafficRecord)> {
        let records = &self.rig.traffic;
        let pairs = records.iter().zip(records.iter().skip(1));
        let is_pair = |(request, reply): &(&TrafficRecord, &TrafficRecord)| {
            matches!(
                (request.kind, reply.kind),
                (TrafficKind::Request, TrafficKind::Reply)
            )
        };
        pairs
            .filter(is_pair)
            .map(|(request, reply)| (request.clone(), reply.clone()))
            .collect()
    }

    /// Whether it is a write, or a read that shows a word that was not told before.
    fn is_new(&mut self, request: &TrafficRecord, reply: &TrafficRecord) -> bool {
        let asked = Request::decode(pdu(&request.bytes)).expect("a request");
        let (Request::Read { address, .. }, Some(Reply::Words(words))) =
            (&asked, asked.reply_in(pdu(&reply.bytes)))
        else {
            return true;
        };
        let told = self
            .told_of(*address, &words)
            .into_iter()
            .map(|register| register.address);
        let held: Vec<_> = told
            .filter_map(|at| Some((at, at.word_in(*address, &words)?)))
            .collect();
        held.into_iter().fold(false, |is_new, (at, word)| {
            self.last.insert(at, word) != Some(word) || is_new
        })
    }

    /// The registers in `words`, read from `address` on, that show the state of the drive; all of them where none does.
    fn told_of(&self, address: Address, words: &[u16]) -> Vec<&Register> {
        let count = u16::try_from(words.len()).expect("few");
        let here = || {
            self.model
                .registers
                .iter()
                .filter(|it| it.access.can_read() && is_within(it.address, address, count))
        };
        let tell_state: Vec<_> = here().filter(|register| self.is_shown(register)).collect();
        if tell_state.is_empty() {
            here().collect()
        } else {
            tell_state
        }
    }

    /// Whether a read has a register that shows the state of the drive.
    fn tells_state(&self, request: &Request) -> bool {
        let Request::Read { address, count } = request else {
            return false;
        };
        self.model
            .registers
            .iter()
            .any(|it| is_within(it.address, *address, *count) && self.is_shown(it))
    }

    fn is_shown(&self, register: &Register) -> bool {
        let has_flag = self
            .model
            .status
            .iter()
            .any(|flag| flag.address == register.address);
        let can_read = register.access.can_read();
        can_read && (has_flag || register.role.is_some_and(|role| SHOWN.contains(&role)))
    }

    fn tell(&mut self, request: &TrafficRecord, reply: &TrafficRecord) {
        let asked = Request::decode(pdu(&request.bytes)).expect("a request");
        let answered = asked.reply_in(pdu(&reply.bytes)).expect("a reply");
        let hex = |bytes: &[u8]| {
            bytes
                .iter()
                .map(|byte| format!("{byte:02X}"))
                .collect::<Vec<_>>()
                .join(" ")
        };
        let (asks, answers) = (self.asked(&asked), self.answered(&asked, &answered));
        let _ = writeln!(
            self.text,
            "-> {:<24} {asks}\n<- {:<24} {answers}",
            hex(&request.bytes),
            hex(&reply.bytes)
        );
    }

    fn asked(&self, request: &Request) -> String {
        match request {
            Request::Read { address, count } => {
                let here = self
                    .model
                    .registers
                    .iter()
                    .filter(|it| is_within(it.address, *address, *count));
                let named: Vec<_> = here
                    .filter(|it| it.access.can_read())
                    .map(|it| it.name.as_str())
                    .collect();
                match named.as_slice() {
                    [first, .., last] if named.len() > 3 => {
                        format!("reads {} registers, {first} to {last}", named.len())
                    }
                    few => format!("reads {}", few.join(", ")),
                }
            }
            Request::WriteSingle { address, value } => {
                format!("writes {}", self.written(*address, *value))
            }
            Request::WriteMultiple { address, values } => {
                let at = |index: usize| {
                    address
                        .checked_add(u16::try_from(index).expect("few"))
                        .expect("an address")
                };
                let each = values
                    .iter()
                    .enumerate()
                    .map(|(index, value)| self.written(at(index), *value));
                format!("writes {}", each.collect::<Vec<_>>().join(", "))
            }
            other => format!("{other:?}"),
        }
    }

    /// What `word` orders at `address`.
    fn written(&self, address: Address, word: u16) -> String {
        let model = &self.model;
        let Some(register) = model.writable_at(address) else {
            return format!("{address} = {word:04X}");
        };
        let name = &register.name;
        if let Some(words) = model.direction_at(address) {
            return format!(
                "{name} = {}",
                if word == words.forward {
                    "forward"
                } else {
                    "reverse"
                }
            );
        }
        if let Some((kind, _)) = model
            .orders_at(address)
            .find(|(_, fact)| fact.value == word)
        {
            return format!("{name} = {}", kind.keyword());
        }
        if model
            .start_steps()
            .iter()
            .any(|step| step.write.value == word)
            && model.takes_run_commands(address)
        {
            return format!("{name} = {word:04X}, before the run word");
        }
        if model
            .reset_clears()
            .is_some_and(|clears| clears.address == address && clears.value == word)
        {
            return format!("{name} = {word}, clears the reset");
        }
        match self.value(register, |at| (at == address).then_some(word)) {
            Some(value) => format!("{name} = {value}"),
            None => format!("{name} = {word:04X}"),
        }
    }

    fn answered(&self, request: &Request, reply: &Reply) -> String {
        let (Request::Read { address, .. }, Reply::Words(words)) = (request, reply) else {
            let is_refused = matches!((request, reply), (Request::WriteSingle { value, .. }, Reply::Holds { value: held }) if value != held);
            return if is_refused {
                "keeps its old value".to_owned()
            } else {
                "taken".to_owned()
            };
        };
        let word = |at: Address| at.word_in(*address, words);
        let told = self.told_of(*address, words);
        told.into_iter()
            .map(|register| self.shown(register, word))
            .collect::<Vec<_>>()
            .join(", ")
    }

    /// What the word of `register` says.
    fn shown(&self, register: &Register, word: impl Fn(Address) -> Option<u16> + Copy) -> String {
        let held = word(register.address).unwrap_or_default();
        let of_flags = self
            .model
            .status
            .iter()
            .filter(|flag| flag.address == register.address);
        let flags: Vec<_> = of_flags
            .filter(|flag| flag.values.contains(&(held & flag.mask)))
            .filter_map(|flag| {
                FLAGS
                    .iter()
                    .find(|(_, it)| *it == flag.flag)
                    .map(|(name, _)| *name)
            })
            .collect();
        let value = match register.role {
            Some(RegisterRole::RunCommand | RegisterRole::Order) => self
                .written(register.address, held)
                .split(" = ")
                .nth(1)
                .map(str::to_owned),
            Some(RegisterRole::TripCode | RegisterRole::TripCause | RegisterRole::TripBits)
                if held != 0 =>
            {
                let code = self
                    .model
                    .trip_codes
                    .iter()
                    .find(|it| it.code == register.code_in(held));
                code.map(|code| format!("{held:04X} {}", code.text))
            }
            _ if self.is_shown(register) && register.role.is_none() => None,
            _ => self.value(register, word),
        };
        let value = value.unwrap_or_else(|| format!("{held:04X}"));
        if flags.is_empty() {
            format!("{} {value}", register.name)
        } else {
            format!("{} {value}: {}", register.name, flags.join(" "))
        }
    }

    /// The value with its unit; `None` if it depends on what was never read.
    fn value(&self, register: &Register, word: impl Fn(Address) -> Option<u16>) -> Option<String> {
        let snapshot = self.rig.view(0).snapshot;
        let polled = |at: Address| snapshot.reading(at).map(|reading| reading.raw);
        let value = register
            .value(|at| {
                word(at)
                    .or_else(|| polled(at))
                    .or_else(|| self.last.get(&at).copied())
            })?
            .value();
        let unit = register.unit.symbol();
        let digits = usize::from(register.digits());
        Some(if unit == "-" {
            format!("{value:.digits$}")
        } else {
            format!("{value:.digits$} {unit}")
        })
    }
}

fn is_within(address: Address, first: Address, count: u16) -> bool {
    address.table() == first.table()
        && (u32::from(first.number())..u32::from(first.number()) + u32::from(count))
            .contains(&u32::from(address.number()))
}

fn pdu(frame: &[u8]) -> &[u8] {
    &frame[1..frame.len() - 2]
}
