//! Rigs of any built-in drive, and native requests with their answers.

use super::{MQTT, ORIGIN, Rig, RigOptions, STOP, catalog, control, model};
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::{Arc, LazyLock};
use std::time::Duration;
use vfd_gateway::domain::command::{GoOrder, Order, Origin, Outcome, Owner, Reason, RegisterWrite};
use vfd_gateway::domain::control::{ControlAction, ControlSettings};
use vfd_gateway::domain::frequency::Hertz;
use vfd_gateway::domain::link::Framing;
use vfd_gateway::domain::native::{NativeAsk, NativeOutcome, NativeRefusal};
use vfd_gateway::profile::model::{Model, RegisterRole};
use vfd_gateway::sim::BusOptions;
use vfd_gateway::vendors;

/// A tool at the gateway's own socket.
pub const LOCAL: Origin = Origin {
    owner: Owner::Local,
    ..super::MQTT
};

/// The drives with which one promise is played in depth: those that are [reviewed](vendors::reviewed), and those in
/// `VFD_MODEL_DIR`. [`walked`] has every model.
pub fn models() -> Vec<Arc<Model>> {
    let built_in = vendors::catalog();
    let is_played = |model: &&Arc<Model>| {
        vendors::reviewed().contains(&model.id.as_str()) || built_in.find(&model.id).is_none()
    };
    catalog().models().filter(is_played).cloned().collect()
}

/// The test models that have the constructs which no drive of the time has.
const CONSTRUCTED: [(&str, &str); 7] = [
    ("orders.toml", include_str!("../golden/models/orders.toml")),
    ("signed.toml", include_str!("../golden/models/signed.toml")),
    ("start.toml", include_str!("../golden/models/start.toml")),
    ("values.toml", include_str!("../golden/models/values.toml")),
    (
        "zero-coast.toml",
        include_str!("../golden/models/zero-coast.toml"),
    ),
    (
        "zero-ignored.toml",
        include_str!("../golden/models/zero-ignored.toml"),
    ),
    (
        "zero-nothing.toml",
        include_str!("../golden/models/zero-nothing.toml"),
    ),
];

/// Full scale of the drives whose configuration must state one.
const FULL_SCALE: Hertz = Hertz::from_centihertz(6000);

/// [Every model](catalog) and the constructed ones, as a configuration makes them.
pub fn walked() -> &'static [Arc<Model>] {
    static WALKED: LazyLock<Vec<Arc<Model>>> = LazyLock::new(|| {
        let catalog = catalog()
            .with_texts(CONSTRUCTED)
            .expect("all of them are sound");
        let scaled = |model: &Arc<Model>| match model.needs_full_scale() {
            true => Arc::new(model.with_full_scale(FULL_SCALE)),
            false => Arc::clone(model),
        };
        catalog.models().map(scaled).collect()
    });
    &WALKED
}

/// Plays `walk` with each of [these models](walked), and then fails with all that did not get through.
pub fn each(walk: impl Fn(&Arc<Model>)) {
    let failed: Vec<_> = walked()
        .iter()
        .filter_map(|model| Some((model, failure(|| walk(model))?)))
        .collect();
    let told: Vec<_> = failed
        .iter()
        .map(|(model, why)| format!("{}: {why}", model.id))
        .collect();
    assert!(
        told.is_empty(),
        "{} of {} models:\n{}",
        told.len(),
        walked().len(),
        told.join("\n")
    );
}

/// Why `walk` panicked; `None` if it did not.
pub fn failure(walk: impl FnOnce()) -> Option<String> {
    let why = catch_unwind(AssertUnwindSafe(walk)).err()?;
    let text = why.downcast_ref::<String>().cloned();
    Some(
        text.or_else(|| why.downcast_ref::<&str>().map(|it| (*it).to_owned()))
            .unwrap_or_default(),
    )
}

/// A rig whose drive, with every order accepted, was stopped and has shown everything.
pub fn ready(model: &Arc<Model>) -> Rig {
    let mut rig = rig_of(model, accepting());
    assert_eq!(
        rig.commanded(MQTT, STOP),
        (Outcome::Confirmed, Reason::None)
    );
    rig.live(Duration::from_secs(3));
    rig.sent.clear();
    rig
}

/// The model called `id` with a change.
pub fn model_with(id: &str, change: impl FnOnce(&mut Model)) -> Arc<Model> {
    let mut model = Model::clone(&model(id));
    change(&mut model);
    Arc::new(model)
}

/// Everything that a model has, proven or not; no native register.
pub fn accepting() -> ControlSettings {
    let accept_unverified = ControlAction::ALL.to_vec();
    ControlSettings {
        accept_unverified,
        allow_release: true,
        native_write: Vec::new(),
        ..control()
    }
}

/// The same with these registers open for native writes.
pub fn listing(native_write: Vec<u16>) -> ControlSettings {
    ControlSettings {
        native_write,
        ..accepting()
    }
}

/// One drive of `model` with factory settings of its line, polled every 500 ms.
pub fn options_of(model: &Arc<Model>, control: ControlSettings) -> RigOptions {
    let is_ascii = !model.link.framings.value.contains(&Framing::Rtu);
    let framing = if is_ascii {
        Framing::Ascii
    } else {
        Framing::Rtu
    };
    RigOptions {
        model: Arc::clone(model),
        link: model.link.played(),
        bus: BusOptions {
            framing,
            ..BusOptions::default()
        },
        control: Some(control),
        poll: Duration::from_millis(500),
        proof_words: None,
        ..RigOptions::default()
    }
}

/// The rig of such a drive.
pub fn rig_of(model: &Arc<Model>, control: ControlSettings) -> Rig {
    Rig::new(&options_of(model, control))
}

/// A rig of the model called `id` without polls: everything on the line was requested.
pub fn quiet(id: &str, control: ControlSettings) -> Rig {
    let poll = RigOptions::default().poll;
    Rig::new(&RigOptions {
        poll,
        ..options_of(&model(id), control)
    })
}

/// A rig of the model called `id` that the client of native requests has stopped, so that it may start it.
pub fn stopped(id: &str, control: ControlSettings) -> Rig {
    let mut rig = rig_of(&model(id), control);
    assert_eq!(
        rig.commanded(ORIGIN, STOP),
        (Outcome::Confirmed, Reason::None),
        "{id}"
    );
    // Until a RUN over MQTT may follow the stop.
    rig.pass(ControlSettings::RESTART_DELAY);
    rig.sent.clear();
    rig
}

/// The address of the register with `role`.
pub fn address_of(model: &Model, role: RegisterRole) -> u16 {
    model
        .register_for(role)
        .expect("the model has it")
        .address
        .number()
}

/// An order that sets one register.
pub fn register(address: u16, value: u16) -> Order {
    Order::Go(
        GoOrder::new(vec![RegisterWrite::new(address, value)], None, None).expect("not empty"),
    )
}

/// Writes registers as a client of native units does, and waits for the answer.
pub fn write(rig: &mut Rig, address: u16, values: &[u16]) -> NativeOutcome {
    let ticket = rig.ask(
        1,
        0,
        NativeAsk::Write {
            address: address.into(),
            values: values.to_vec(),
        },
    );
    rig.answer_to(ticket)
}

/// A refusal by the guard.
pub fn refused(reason: Reason) -> NativeOutcome {
    NativeOutcome::Refused(NativeRefusal::Guard(reason))
}

/// The PDU of function 06.
pub fn single(address: u16, value: u16) -> Vec<u8> {
    let words = [address, value].map(u16::to_be_bytes);
    [vec![6], words.concat()].concat()
}
