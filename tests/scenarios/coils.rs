//! Drives that are commanded by coils, as their model files say: run, direction of either polarity, reset, coast, flags in
//! coils and discrete inputs, monitors in input registers, and a device without function 03.

use crate::support::families::{accepting, options_of, refused, rig_of};
use crate::support::{MQTT, Rig, STOP, run, setpoint};
use std::sync::Arc;
use std::time::Duration;
use vfd_gateway::domain::address::{Address, DataTable};
use vfd_gateway::domain::command::{Direction, Order, Outcome, Reason};
use vfd_gateway::domain::control::ControlSettings;
use vfd_gateway::domain::ids::Station;
use vfd_gateway::domain::native::{NativeAsk, NativeOutcome};
use vfd_gateway::drive::view::RunState;
use vfd_gateway::profile::check;
use vfd_gateway::profile::model::Model;
use vfd_gateway::wire::pdu::{Reply, Request};

const SECOND: Duration = Duration::from_secs(1);
const COILS: &str = include_str!("../golden/models/coils.toml");
const RUN: u16 = 0;
const DIRECTION: u16 = 1;
const RESET: u16 = 3;
const CUT_OFF: u16 = 4;
const BUS_ENABLE: u16 = 0x20;

fn coil(number: u16) -> Address {
    Address::new(DataTable::Coil, number)
}

/// The model of the file with these replacements.
fn with(changes: &[(&str, &str)]) -> Arc<Model> {
    let text = changes.iter().fold(COILS.to_owned(), |text, (from, to)| {
        assert!(text.contains(from), "{from}");
        text.replacen(from, to, 1)
    });
    Arc::new(check::model(&text).unwrap_or_else(|problems| panic!("{problems:?}")))
}

fn coils() -> Arc<Model> {
    with(&[])
}

/// The direction coil the other way round, as another family has it.
fn inverted() -> Arc<Model> {
    with(&[("forward = 0, reverse = 1", "forward = 1, reverse = 0")])
}

/// A device that knows neither 03 nor 05: its setpoint is written only, and shown in an input register.
fn without_03() -> Arc<Model> {
    let setting = "[[register]]\nname = \"setting\"\ntitle = \"Set frequency\"\ntable = \"input\"\naddress = 0x1003\n\
                   scale = 100\nunit = \"Hz\"\naccess = \"read\"\nrole = \"frequency-setting\"\npoll = \"second\"\n\
                   confidence = \"manual\"\nsource = \"IM 5\"\n\n[[register]]\nname = \"series\"";
    with(&[
        ("0x03, 0x04, 0x05, 0x06", "0x04, 0x06"),
        (
            "scale = 100\nunit = \"Hz\"\naccess = \"read-write\"",
            "scale = 100\nunit = \"Hz\"\naccess = \"write\"",
        ),
        ("[[register]]\nname = \"series\"", setting),
    ])
}

/// A coil for each order, each of which is a pulse, as a spindle has them.
fn pulses() -> Arc<Model> {
    let source = "confidence = \"manual\", source = \"IM 5\"";
    let own = |name: &str, address: u16| {
        format!(
            "[[register]]\nname = \"{name}\"\ntitle = \"{name}\"\ntable = \"coil\"\naddress = {address}\nunit = \"-\"\n\
             access = \"write\"\nmemory = \"ram\"\nconfidence = \"manual\"\nsource = \"IM 5\"\n\n"
        )
    };
    let registers = format!(
        "{}{}[[register]]\nname = \"series\"",
        own("halt", 6),
        own("backwards", 7)
    );
    let direction = COILS
        .lines()
        .find(|line| line.starts_with("direction = "))
        .unwrap();
    with(&[
        (
            "stop = { value = 0,",
            "stop = { register = \"halt\", value = 1,",
        ),
        (
            direction,
            &format!("reverse = {{ register = \"backwards\", value = 1, {source} }}"),
        ),
        ("[[register]]\nname = \"series\"", &registers),
    ])
}

/// A rig whose drive is of the right series, was stopped and has shown everything.
fn ready(model: &Arc<Model>, control: ControlSettings) -> Rig {
    let mut rig = rig_of(model, control);
    set(&mut rig, Address::new(DataTable::Input, 0x2000), 200);
    assert_eq!(
        rig.commanded(MQTT, STOP),
        (Outcome::Confirmed, Reason::None),
        "{}",
        model.id
    );
    rig.live(SECOND * 3);
    rig.sent.clear();
    rig
}

fn set(rig: &mut Rig, address: Address, word: u16) {
    let now = rig.now;
    rig.bus
        .drive_mut(Station(1))
        .unwrap()
        .set_locally(now, address, word);
}

/// The coils written so far, whatever the function.
fn orders(rig: &Rig) -> Vec<(u16, u16)> {
    let requests = rig
        .sent
        .iter()
        .filter_map(|sent| Request::decode(&sent.pdu));
    let of_coils = requests.flat_map(|request| match request {
        Request::WriteSingle { address, value } => vec![(address, value)],
        Request::WriteMultiple { address, values } => address.onwards().zip(values).collect(),
        _ => Vec::new(),
    });
    of_coils
        .filter(|(it, _)| it.table() == DataTable::Coil)
        .map(|(it, value)| (it.number(), value))
        .collect()
}

fn confirmed(rig: &mut Rig, order: Order) {
    assert_eq!(
        rig.commanded(MQTT, order.clone()),
        (Outcome::Confirmed, Reason::None),
        "{order:?}"
    );
}

#[test]
fn a_file_says_how_coils_run_reverse_and_stop_the_motor() {
    for (model, forward, reverse) in [(coils(), 0, 1), (inverted(), 1, 0), (without_03(), 0, 1)] {
        let mut rig = ready(&model, accepting());
        confirmed(&mut rig, setpoint(3000));
        rig.sent.clear();
        confirmed(&mut rig, run(Direction::Reverse, None));
        assert_eq!(orders(&rig), [(DIRECTION, reverse), (RUN, 1)]);
        rig.live(SECOND * 5);
        assert!(rig.output(1) < 0, "{}", rig.output(1));
        assert_eq!(rig.view(0).run_state, RunState::Reverse);
        rig.sent.clear();
        confirmed(&mut rig, STOP);
        assert_eq!(orders(&rig), [(RUN, 0)], "one frame");
        rig.live(SECOND * 15);
        rig.sent.clear();
        confirmed(&mut rig, run(Direction::Forward, None));
        assert_eq!(orders(&rig), [(DIRECTION, forward), (RUN, 1)]);
        rig.live(SECOND * 5);
        assert!(rig.output(1) > 0, "{}", rig.output(1));
        rig.sent.clear();
        confirmed(&mut rig, Order::Coast);
        assert_eq!(orders(&rig), [(CUT_OFF, 1)]);
    }
}

#[test]
fn only_functions_that_the_device_serves_are_sent() {
    let mut rig = ready(&without_03(), accepting());
    confirmed(&mut rig, run(Direction::Reverse, Some(3000)));
    rig.live(SECOND * 10);
    confirmed(&mut rig, STOP);
    let functions: std::collections::BTreeSet<u8> =
        rig.sent.iter().map(|sent| sent.pdu[0]).collect();
    assert_eq!(
        functions.into_iter().collect::<Vec<_>>(),
        [0x01, 0x02, 0x04, 0x06, 0x0F]
    );
    let bits = rig.sent.iter().find(|sent| sent.pdu[0] == 0x0F).unwrap();
    assert_eq!(
        bits.pdu,
        [0x0F, 0, 1, 0, 1, 1, 1],
        "the direction, in a frame of one coil"
    );
}

#[test]
fn a_coil_for_each_order_has_no_direction_beside_it() {
    let mut rig = ready(&pulses(), accepting());
    confirmed(&mut rig, setpoint(3000));
    rig.sent.clear();
    confirmed(&mut rig, run(Direction::Reverse, None));
    rig.live(SECOND * 5);
    assert!(rig.output(1) < 0);
    confirmed(&mut rig, STOP);
    rig.live(SECOND * 10);
    confirmed(&mut rig, run(Direction::Forward, None));
    assert_eq!(orders(&rig), [(7, 1), (6, 1), (RUN, 1)]);
}

#[test]
fn a_lost_frame_between_direction_and_run_runs_nothing() {
    let mut rig = ready(&coils(), accepting());
    rig.swallows = Some(vec![5, 0, 1, 0xFF, 0]);
    let order = run(Direction::Reverse, Some(3000));
    assert_eq!(
        rig.commanded(MQTT, order.clone()),
        (Outcome::Failed, Reason::NoReply)
    );
    rig.live(SECOND * 10);
    assert!(!orders(&rig).contains(&(RUN, 1)), "{:?}", orders(&rig));
    assert_eq!(rig.output(1), 0);
    rig.swallows = None;
    confirmed(&mut rig, order);
}

#[test]
fn a_direction_coil_that_falls_back_runs_nothing() {
    let mut rig = ready(&coils(), accepting());
    let ticket = rig.command(MQTT, 0, run(Direction::Reverse, Some(3000)));
    while !orders(&rig).contains(&(DIRECTION, 1)) {
        rig.step(rig.now + SECOND);
    }
    rig.step(rig.now + SECOND);
    set(&mut rig, coil(DIRECTION), 0);
    assert_eq!(
        rig.outcome_of(ticket),
        (Outcome::Failed, Reason::KeptOldValue)
    );
    assert_eq!(
        rig.view(0).control.unwrap().last.unwrap().register,
        Some(coil(DIRECTION))
    );
    assert!(!orders(&rig).contains(&(RUN, 1)), "{:?}", orders(&rig));
}

#[test]
fn a_trip_is_reported_by_its_coil_and_the_reset_coil_is_cleared() {
    let mut rig = ready(&coils(), accepting());
    confirmed(&mut rig, run(Direction::Forward, Some(3000)));
    let now = rig.now;
    rig.bus.drive_mut(Station(1)).unwrap().trip(now, 2);
    rig.live(SECOND * 4);
    let view = rig.view(0);
    assert_eq!(
        (
            view.run_state,
            view.trip.last.as_ref().and_then(|trip| trip.code)
        ),
        (RunState::Tripped, Some(2))
    );
    rig.sent.clear();
    confirmed(&mut rig, Order::Reset);
    assert_eq!(orders(&rig), [(RUN, 0), (RESET, 1), (RESET, 0)]);
    rig.live(SECOND * 3);
    confirmed(&mut rig, run(Direction::Forward, Some(3000)));
}

#[test]
fn a_setting_in_a_coil_and_an_identity_in_an_input_register_hold_back_a_run() {
    let mut rig = ready(&coils(), accepting());
    set(&mut rig, coil(BUS_ENABLE), 0);
    assert_eq!(
        rig.commanded(MQTT, run(Direction::Forward, Some(3000))),
        (Outcome::Refused, Reason::Precondition)
    );
    assert_eq!(
        rig.view(0).control.unwrap().last.unwrap().register,
        Some(coil(BUS_ENABLE))
    );
    confirmed(&mut rig, STOP);
    set(&mut rig, coil(BUS_ENABLE), 1);
    rig.reopen();
    set(&mut rig, Address::new(DataTable::Input, 0x2000), 100);
    rig.live(SECOND * 2);
    assert_eq!(
        rig.commanded(MQTT, setpoint(3000)),
        (Outcome::Refused, Reason::OtherDrive)
    );
    assert!(!orders(&rig).contains(&(RUN, 1)));
}

/// What a client of the native unit writes to coils.
fn write(rig: &mut Rig, number: u16, values: &[u16]) -> NativeOutcome {
    let ticket = rig.ask(
        1,
        0,
        NativeAsk::Write {
            address: coil(number),
            values: values.to_vec(),
        },
    );
    rig.answer_to(ticket)
}

#[test]
fn coils_that_a_client_writes_are_orders_or_refused() {
    let mut rig = ready(&coils(), accepting());
    assert_eq!(
        write(&mut rig, RUN, &[0]),
        NativeOutcome::Written,
        "a stop is a stop"
    );
    rig.pass(SECOND * 3);
    rig.sent.clear();
    for (number, value) in [(RUN, 1), (DIRECTION, 0), (DIRECTION, 1), (CUT_OFF, 0)] {
        assert_eq!(
            write(&mut rig, number, &[value]),
            refused(Reason::NotUnderstood),
            "{number} {value}"
        );
    }
    assert_eq!(
        write(&mut rig, BUS_ENABLE, &[0]),
        refused(Reason::NotListed)
    );
    assert_eq!(
        write(&mut rig, 0x0E, &[1]),
        refused(Reason::NotListed),
        "it is only read"
    );
    assert_eq!(write(&mut rig, 0x1234, &[1]), refused(Reason::NotListed));
    assert_eq!(orders(&rig), [], "none of them reached the wire");
    let ticket = rig.ask(
        1,
        0,
        NativeAsk::Write {
            address: 1_u16.into(),
            values: vec![3000],
        },
    );
    assert_eq!(
        rig.answer_to(ticket),
        NativeOutcome::Written,
        "holding register 1 is not coil 1"
    );
    assert_eq!(
        write(&mut rig, RUN, &[1, 1]),
        NativeOutcome::Written,
        "both halves in one frame"
    );
    assert_eq!(orders(&rig), [(DIRECTION, 1), (RUN, 1)]);
    rig.pass(SECOND * 5);
    assert!(rig.output(1) < 0);
    // Reverse is forbidden by this configuration, and then by a coil as well.
    let forward_only = ControlSettings {
        directions: vec![Direction::Forward],
        ..accepting()
    };
    let mut rig = ready(&coils(), forward_only);
    assert_eq!(write(&mut rig, RUN, &[0]), NativeOutcome::Written);
    rig.pass(SECOND * 3);
    rig.sent.clear();
    assert_eq!(
        write(&mut rig, RUN, &[1, 1]),
        refused(Reason::DirectionNotAllowed)
    );
    assert_eq!(orders(&rig), []);
}

#[test]
fn each_table_is_read_by_its_own_function() {
    let mut rig = ready(&coils(), accepting());
    let mut read = |table, number, count| {
        rig.sent.clear();
        let ticket = rig.ask(
            1,
            0,
            NativeAsk::Read {
                address: Address::new(table, number),
                count,
            },
        );
        let outcome = rig.answer_to(ticket);
        let function = rig
            .sent
            .iter()
            .map(|sent| sent.pdu.clone())
            .find(|pdu| pdu[1..3] == number.to_be_bytes());
        (outcome, function.map(|pdu| pdu[0]))
    };
    let words = |words: &[u16]| NativeOutcome::Words(words.into());
    assert_eq!(read(DataTable::Coil, 0, 2), (words(&[0, 0]), Some(1)));
    assert_eq!(read(DataTable::Discrete, 1, 1), (words(&[1]), Some(2)));
    assert_eq!(read(DataTable::Input, 0x2000, 1), (words(&[200]), Some(4)));
    assert_eq!(read(DataTable::Holding, 1, 1), (words(&[0]), Some(3)));
    let reply = Request::read(coil(0), 2).reply_in(&[1, 1, 0b10]);
    assert_eq!(reply, Some(Reply::Words(vec![0, 1])));
    let options = options_of(&coils(), accepting());
    assert_eq!(options.model.words_in_one_read(coil(0)), 32);
}
