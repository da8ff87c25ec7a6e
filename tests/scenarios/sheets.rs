//! The models against what the documents say of their drives, typed a second time in `tests/sheets/`: where things are,
//! which frames an order sends, what the simulated drive does with a word, what status words, trips and readings mean, and
//! the frames that are printed or were captured.

use crate::support::families::{accepting, failure, rig_of, walked};
use crate::support::sheet::{Row, bytes, open_rows, place, sheets};
use crate::support::{MQTT, STOP, catalog, run, setpoint};
use std::collections::BTreeSet;
use std::sync::Arc;
use std::time::Duration;
use vfd_gateway::domain::address::Address;
use vfd_gateway::domain::command::{Direction, Order};
use vfd_gateway::domain::ids::Station;
use vfd_gateway::domain::time::MonoTime;
use vfd_gateway::drive::status::StatusWatch;
use vfd_gateway::profile::model::{
    Confidence, IndicatedState, Model, OrderKind, Register, RegisterRole,
};
use vfd_gateway::profile::words::{CONFIDENCES, FLAGS, ROLES};
use vfd_gateway::sim::{DriveOptions, SimDrive};
use vfd_gateway::vendors;
use vfd_gateway::wire::crc;
use vfd_gateway::wire::pdu::Request;

const SECOND: Duration = Duration::from_secs(1);

/// The rows in which model and sheet differ although neither is wrong, each with its reason.
const OPEN: &str = include_str!("../sheets/open.txt");
/// The roles that an order, a stop or a trip rests on. A model may leave out the others, such as that of a torque.
const NEEDED: [RegisterRole; 8] = [
    RegisterRole::RunCommand,
    RegisterRole::Order,
    RegisterRole::FrequencyCommand,
    RegisterRole::FrequencySetting,
    RegisterRole::OutputFrequency,
    RegisterRole::TripCode,
    RegisterRole::TripBits,
    RegisterRole::TripCause,
];

/// Plays `test` with each row of this `kind` of every sheet, and then fails with all that do not hold.
fn each_row(kind: &str, test: impl Fn(&Arc<Model>, Row<'_>)) {
    let mut told = Vec::new();
    let mut rows = 0;
    let mut open = open_rows(OPEN);
    open.retain(|(row, _)| row.split(": ").nth(1) == Some(kind));
    let mut absent: Vec<_> = open.iter().map(|(row, _)| *row).collect();
    for sheet in sheets() {
        let Some(model) = walked().iter().find(|model| model.id == sheet.id) else {
            continue;
        };
        for row in sheet.rows(kind) {
            rows += 1;
            let name = format!("{}: {kind}: {row}", sheet.id);
            let is_open = open.iter().any(|(row, _)| *row == name);
            absent.retain(|row| *row != name);
            match failure(|| test(model, row)) {
                Some(why) if !is_open => told.push(format!("{name}\n    {why}")),
                None if is_open => told.push(format!(
                    "{name}\n    it holds now: strike it out of open.txt"
                )),
                _ => {}
            }
        }
    }
    told.extend(
        absent
            .into_iter()
            .map(|row| format!("{row}\n    it is no row of a sheet: strike it out of open.txt")),
    );
    assert!(
        told.is_empty(),
        "{} of {rows} rows:\n{}",
        told.len(),
        told.join("\n")
    );
}

#[test]
fn a_row_that_differs_has_a_reason() {
    let rows = open_rows(
        "# Why.\na: order: do = 1\n    the model is more careful\n    than that\n\nb: word: at = 2\n    one two three four\n",
    );
    assert_eq!(rows.len(), 2);
    assert_eq!(
        rows[0],
        (
            "a: order: do = 1",
            "the model is more careful than that".to_owned()
        )
    );
    for wrong in [
        "a: order: x = 1\nb: order: y = 2\n    one two three four",
        "    one two three four",
        "a: b: c\n    because",
    ] {
        assert!(failure(|| drop(open_rows(wrong))).is_some(), "{wrong}");
    }
    let twice = "a: order: x = 1\n    one two three four\n";
    assert!(failure(|| drop(open_rows(&twice.repeat(2)))).is_some());
}

/// The reviewed ones were typed a second time in `crates/model/src/vendors/tests`.
#[test]
fn every_model_has_a_sheet() {
    let sheets: BTreeSet<_> = sheets().into_iter().map(|sheet| sheet.id).collect();
    let catalog = catalog();
    let without = catalog
        .ids()
        .filter(|id| !sheets.contains(*id) && !vendors::reviewed().contains(id));
    let without: Vec<_> = without.collect();
    assert!(without.is_empty(), "tests/sheets lacks {without:?}");
}

#[test]
fn registers_are_where_the_documents_have_them() {
    each_row("register", |model, row| {
        let (address, _) = place(row.text("at"));
        let here = || {
            model
                .registers
                .iter()
                .filter(|register| register.address == address)
        };
        let role = row
            .maybe("role")
            .map(|word| ROLES.iter().find(|(it, _)| *it == word).expect("a role").1);
        let is_needed = role.is_some_and(|role| NEEDED.contains(&role));
        if here().next().is_none() && !is_needed {
            return;
        }
        let is_right = |register: &&Register| {
            let steps = i64::from(register.scale) / i64::from(register.form.per);
            let is_plain = register.form.scale_by.is_none() && register.form.full_scale.is_none();
            (role.is_none() || register.role == role || (register.role.is_none() && !is_needed))
                && row
                    .number("scale")
                    .is_none_or(|scale| scale == steps || !is_plain)
                && row
                    .maybe("unit")
                    .is_none_or(|unit| unit == register.unit.symbol())
                && row
                    .signs()
                    .first()
                    .is_none_or(|signed| *signed == register.signed)
        };
        let told = |it: &Register| {
            (
                it.name.clone(),
                it.role,
                it.scale,
                it.form.per,
                it.unit.symbol(),
                it.signed,
            )
        };
        assert!(
            here().any(|register| is_right(&register)),
            "the model has {:?}",
            here().map(told).collect::<Vec<_>>()
        );
    });
}

#[test]
fn an_order_is_written_as_the_documents_say() {
    each_row("order", |model, row| {
        let (kind, order) = match row.text("do") {
            "forward" => (OrderKind::Forward, run(Direction::Forward, None)),
            "reverse" => (OrderKind::Reverse, run(Direction::Reverse, None)),
            "stop" => (OrderKind::Stop, STOP),
            "coast" => (OrderKind::Coast, Order::Coast),
            "reset" => (OrderKind::Reset, Order::Reset),
            other => panic!("no order `{other}`"),
        };
        let is_basic = matches!(kind, OrderKind::Stop | OrderKind::Forward);
        let Some((_, fact)) = model.order(kind) else {
            assert!(
                !is_basic || model.run.is_none(),
                "the model has no such order"
            );
            return;
        };
        // It may be more careful than the sheet.
        let grade = CONFIDENCES
            .iter()
            .find(|(word, _)| *word == row.text("grade"))
            .expect("a grade")
            .1;
        assert!(
            fact.confidence >= grade,
            "its grade in the model is {}",
            Confidence::keyword(fact.confidence)
        );
        let mut rig = rig_of(model, accepting());
        if kind == OrderKind::Reset {
            let now = rig.now;
            rig.bus
                .drive_mut(Station(1))
                .expect("it is there")
                .trip(now, cause(model));
            rig.live(SECOND * 3);
        } else {
            rig.commanded(MQTT, setpoint(3000));
        }
        rig.sent.clear();
        let told = rig.commanded(MQTT, order);
        let named = row.list("writes");
        let requests = rig
            .sent
            .iter()
            .filter_map(|sent| Request::decode(&sent.pdu));
        let written: Vec<_> = requests.filter_map(|request| shown(&request)).collect();
        // The setpoint goes out once more before a start, and a stop before a reset.
        let setpoint = model
            .register_for(RegisterRole::FrequencyCommand)
            .map(|it| it.address);
        let is_extra = |at: usize, write: &str| {
            let is_setpoint = Some(place(write).0) == setpoint && !named.contains(&write);
            let (stop, word) = model.order(OrderKind::Stop).expect("it stops");
            let is_first_stop =
                kind == OrderKind::Reset && at == 0 && place(write) == (stop, vec![word.value]);
            is_setpoint || (is_first_stop && named.first() != Some(&write))
        };
        let kept = written
            .iter()
            .enumerate()
            .filter(|(at, write)| !is_extra(*at, write));
        // A stop keeps the direction, which is forward where none is known.
        let after_forward = model
            .run
            .as_ref()
            .map(|run| run.stop_word(Some(Direction::Forward)));
        let as_named = |write: &String| {
            let is_it = kind == OrderKind::Stop
                && after_forward.is_some_and(|word| place(write).1 == [word]);
            if is_it {
                named[0].to_owned()
            } else {
                write.clone()
            }
        };
        assert_eq!(
            kept.map(|(_, write)| as_named(write)).collect::<Vec<_>>(),
            named,
            "{written:?}: {told:?}"
        );
    });
}

/// A write as sheets have it.
fn shown(request: &Request) -> Option<String> {
    let (address, values) = match request {
        Request::WriteSingle { address, value } => (address, vec![*value]),
        Request::WriteMultiple { address, values } => (address, values.clone()),
        _ => return None,
    };
    let words: Vec<_> = values.iter().map(|word| format!("{word:04X}")).collect();
    Some(format!(
        "{} {:04X} {}",
        address.table().keyword(),
        address.number(),
        words.join(" ")
    ))
}

/// A trip that the model knows, or any number where it knows none.
fn cause(model: &Model) -> u16 {
    model
        .trip_codes
        .iter()
        .map(|it| it.code)
        .find(|code| *code > 0)
        .unwrap_or(2)
}

/// A simulated drive by itself: no gateway, no line.
struct Alone {
    drive: SimDrive,
    now: MonoTime,
}

impl Alone {
    /// A drive with a setpoint of 30 Hz in one of the states that sheets name.
    fn at(model: &Arc<Model>, state: &str) -> Self {
        let mut alone = Self {
            drive: SimDrive::new(Arc::clone(model), DriveOptions::default()),
            now: MonoTime::ZERO,
        };
        alone.pass(SECOND);
        alone.drive.set_frequency(alone.now, 30);
        match state {
            "standstill" => {}
            "running forward" => alone.start(OrderKind::Forward),
            "running reverse" => alone.start(OrderKind::Reverse),
            "tripped" => alone.drive.trip(alone.now, cause(model)),
            other => panic!("no state `{other}`"),
        }
        alone.pass(SECOND * 10);
        alone
    }

    fn pass(&mut self, time: Duration) {
        self.now = self.now + time;
        // The drive sees the time with whatever happens to it.
        self.drive.operate_panel(self.now, None);
    }

    /// Output frequency in hundredths of a hertz, negative in reverse.
    fn output(&self) -> i64 {
        self.drive.output(self.now) / 10_000
    }

    /// Starts it as its model does.
    fn start(&mut self, kind: OrderKind) {
        let model = Arc::new(self.drive.model().clone());
        let Some((address, fact)) = model.order(kind) else {
            // Somebody else does it.
            let direction = if kind == OrderKind::Reverse {
                Direction::Reverse
            } else {
                Direction::Forward
            };
            return self.drive.operate(self.now, Some(direction));
        };
        for step in model.start_steps() {
            self.write(address, vec![step.write.value]);
            self.pass(step.at_least + SECOND);
        }
        if let Some(direction) = model
            .run
            .as_ref()
            .and_then(|run| run.places.direction.as_ref())
        {
            let words = &direction.value;
            let word = if kind == OrderKind::Reverse {
                words.reverse
            } else {
                Some(words.forward)
            };
            self.write(words.address, vec![word.expect("it reverses")]);
        }
        self.write(address, vec![fact.value]);
        self.pass(SECOND * 10);
        assert!(
            self.output().abs() > 2990,
            "it does not run: {}",
            self.output()
        );
    }

    /// Writes as somebody on the line does; the drive may refuse it.
    fn write(&mut self, address: Address, words: Vec<u16>) {
        let single = Request::write(address, words[0]);
        let is_single = words.len() == 1 && self.drive.model().serves(single.function());
        let request = if is_single {
            single
        } else {
            Request::WriteMultiple {
                address,
                values: words,
            }
        };
        let mut pdu = Vec::new();
        request.encode(&mut pdu);
        self.drive.answer(self.now, &pdu, 0, &mut Vec::new());
    }
}

#[test]
fn the_simulated_drive_does_with_a_word_what_the_documents_say() {
    each_row("word", |model, row| {
        let mut alone = Alone::at(model, row.text("at"));
        for before in row.list("before") {
            let (address, words) = place(before);
            alone.write(address, words);
            alone.pass(SECOND);
        }
        let (address, words) = place(row.text("write"));
        alone.write(address, words);
        alone.pass(Duration::from_millis(20));
        let at_once = alone.output();
        alone.pass(SECOND * 40);
        let (output, is_tripped) = (alone.output(), alone.drive.is_tripped());
        let is_right = match row.text("then") {
            "running forward" => output > 0,
            "running reverse" => output < 0,
            "standstill" => at_once == 0 && output == 0 && !is_tripped,
            "stops" => at_once != 0 && output == 0 && !is_tripped,
            "coasts" => at_once == 0 && output == 0 && !is_tripped,
            "tripped" => is_tripped && output == 0,
            "reset" => !is_tripped && output == 0,
            other => panic!("no outcome `{other}`"),
        };
        assert!(
            is_right,
            "{at_once} at once, then {output}, tripped: {is_tripped}"
        );
    });
}

#[test]
fn a_status_word_shows_the_flags_that_the_documents_name() {
    each_row("status", |model, row| {
        let mut watch = StatusWatch::new(model);
        let mut words = Vec::new();
        for text in row.list("words") {
            let (address, held) = place(text);
            watch.take(address, &held);
            words.push((address, held));
        }
        let named = row.list("flags");
        assert!(
            named
                .iter()
                .all(|name| FLAGS.iter().any(|(word, _)| word == name)),
            "an unknown flag"
        );
        for (name, flag) in FLAGS {
            let shown = watch.get(flag);
            assert!(
                !named.contains(&name) || shown == Some(true),
                "{name} is not shown: {shown:?}"
            );
            // Without another flag the direction is that of a motor that turns.
            let counts = flag != IndicatedState::Reverse || named.contains(&"running");
            assert!(
                !counts || named.contains(&name) || shown != Some(true),
                "{name} is shown"
            );
        }
    });
}

#[test]
fn every_trip_of_the_documents_is_known() {
    each_row("trip", |model, row| {
        let number = row
            .number("code")
            .or_else(|| Some(row.number("bit")? + 1))
            .expect("a code or a bit");
        let code = u16::try_from(number).expect("a word");
        assert!(
            model.trip_text(code).is_some(),
            "the model does not list it"
        );
    });
}

#[test]
fn a_reading_means_what_the_documents_say() {
    each_row("reading", |model, row| {
        let words: Vec<_> = row.list("words").into_iter().map(place).collect();
        let word = |at: Address| {
            words
                .iter()
                .find_map(|(first, words)| at.word_in(*first, words))
        };
        let (at, _) = place(row.text("register_at"));
        let (number, unit) = row
            .text("value")
            .split_once(' ')
            .unwrap_or((row.text("value"), "-"));
        let digits = number.split_once('.').map_or(0, |(_, places)| places.len());
        let right: f64 = number.parse().expect("a number");
        let here = model.registers.iter().filter(|it| it.address == at);
        let shown: Vec<_> = here
            .map(|it| (it.value(word).map(|value| value.value()), it.unit.symbol()))
            .collect();
        let near = |value: f64| {
            (value - right).abs() < 0.51 * 10_f64.powi(-i32::try_from(digits).expect("few"))
        };
        assert!(
            shown
                .iter()
                .any(|(value, of)| value.is_some_and(near) && *of == unit),
            "the model reads {shown:?}"
        );
    });
}

#[test]
fn printed_frames_are_sound_or_named_as_misprints() {
    each_row("frame", |_, row| {
        let request = bytes(row.text("request"));
        let reply = row.maybe("reply").map(bytes);
        let sound =
            crc::is_sound(&request) && reply.as_ref().is_none_or(|reply| crc::is_sound(reply));
        assert_eq!(sound, row.switch("misprint") != Some(true), "its check sum");
        let pdu = |frame: &[u8]| frame[1..frame.len() - 2].to_vec();
        if ![1, 2, 3, 4, 5, 6, 8, 0x0F, 0x10].contains(&request[1]) {
            return;
        }
        let asked = Request::decode(&pdu(&request));
        let asked = asked
            .filter(|it| !matches!(it, Request::Unserved { .. }))
            .expect("a request");
        if let Some(reply) = &reply {
            assert_eq!(reply[0], request[0], "the station");
            let is_refused = reply[1] == request[1] | 0x80;
            assert!(
                is_refused || asked.reply_in(&pdu(reply)).is_some(),
                "the reply is none to this request"
            );
        }
    });
}
