//! Rigs of any built-in drive, and native requests with their answers.

use super::{ORIGIN, Rig, RigOptions, STOP, catalog, control, model};
use std::sync::Arc;
use std::time::Duration;
use vfd_gateway::domain::command::{Go, Order, Origin, Outcome, Owner, Reason, RegisterWrite};
use vfd_gateway::domain::control::{ControlAction, ControlSettings};
use vfd_gateway::domain::native::{NativeAsk, NativeOutcome, Refusal};
use vfd_gateway::profile::model::{Model, Role};

/// A tool at the gateway's own socket.
pub const LOCAL: Origin = Origin { owner: Owner::Local, ..super::MQTT };

/// All built-in models, in the order of their names.
pub fn models() -> Vec<Arc<Model>> {
    let catalog = catalog();
    catalog.ids().map(|id| Arc::clone(catalog.find(id).expect("it is listed"))).collect()
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
    ControlSettings { accept_unverified, allow_release: true, native_write: Vec::new(), ..control() }
}

/// The same with these registers open for native writes.
pub fn listing(native_write: Vec<u16>) -> ControlSettings {
    ControlSettings { native_write, ..accepting() }
}

/// One drive of `model` with factory settings of its line, polled every 500 ms.
pub fn options_of(model: &Arc<Model>, control: ControlSettings) -> RigOptions {
    RigOptions {
        model: Arc::clone(model),
        link: model.link.default.value,
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
    Rig::new(&RigOptions { poll, ..options_of(&model(id), control) })
}

/// A rig of the model called `id` that the client of native requests has stopped, so that it may start it.
pub fn stopped(id: &str, control: ControlSettings) -> Rig {
    let mut rig = rig_of(&model(id), control);
    assert_eq!(rig.commanded(ORIGIN, STOP), (Outcome::Confirmed, Reason::None), "{id}");
    // Until a RUN over MQTT may follow the stop.
    rig.pass(ControlSettings::RESTART_DELAY);
    rig.sent.clear();
    rig
}

/// The address of the register with `role`.
pub fn address_of(model: &Model, role: Role) -> u16 {
    model.register_for(role).expect("the model has it").address.number()
}

/// An order that sets one register.
pub fn register(address: u16, value: u16) -> Order {
    Order::Go(Go::new(vec![RegisterWrite { address: address.into(), value }], None, None).expect("not empty"))
}

/// Writes registers as a client of native units does, and waits for the answer.
pub fn write(rig: &mut Rig, address: u16, values: &[u16]) -> NativeOutcome {
    let ticket = rig.ask(1, 0, NativeAsk::Write { address: address.into(), values: values.to_vec() });
    rig.answer_to(ticket)
}

/// A refusal by the guard.
pub fn refused(reason: Reason) -> NativeOutcome {
    NativeOutcome::Refused(Refusal::Guard(reason))
}

/// The PDU of function 06.
pub fn single(address: u16, value: u16) -> Vec<u8> {
    let words = [address, value].map(u16::to_be_bytes);
    [vec![6], words.concat()].concat()
}
