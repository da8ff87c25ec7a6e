//! A model file: any text gives a model that everything here can work with, or problems that can be shown.

use super::{plant, text};
use std::sync::Arc;
use std::time::Duration;
use vfd_drive::drive::plan::{PlaceOnLine, PollPace, PollPlan};
use vfd_line::line::timeouts::ReplyTimeouts;
use vfd_line::line::timing::LineTiming;
use vfd_model::domain::link::{Framing, LinkSettings};
use vfd_model::domain::time::MonoTime;
use vfd_model::profile::check;
use vfd_model::profile::model::Model;
use vfd_model::profile::scale::{ScaledValue, to_raw};
use vfd_model::profile::summary::summary;
use vfd_model::wire::pdu::{MAX_PDU_BYTES, Request};
use vfd_north::north::modbus::UniformUnit;
use vfd_sim::sim::{DriveOptions, SimDrive};

pub fn run(bytes: &[u8]) {
    let Some(text) = text::of(bytes) else { return };
    match check::model(text) {
        Err(problems) => text::check_file(text, &problems),
        Ok(model) => {
            assert!(summary(&model).ends_with('\n'));
            for framing in &model.link.framings.value {
                work_with(&Arc::new(model.on(*framing)), *framing);
            }
        }
    }
}

fn work_with(model: &Arc<Model>, framing: Framing) {
    assert!(
        (1..=125).contains(&model.read.max_words.value),
        "{:?}",
        model.read.max_words
    );
    let _ = UniformUnit::new(&plant::drive(model, 0, "pump", true));
    let _ = PollPlan::new(
        model,
        PollPace::new(Duration::from_secs(1), 1.0),
        MonoTime::ZERO,
        PlaceOnLine::ALONE,
    );
    let timing = LineTiming::for_models(
        framing,
        LinkSettings::DEFAULT,
        [model.as_ref()],
        Duration::ZERO,
    );
    let timeouts = ReplyTimeouts::auto(&model.timing);
    assert!(
        timing.silence < Duration::from_secs(60) && !timeouts.read.is_zero(),
        "{timing:?} {timeouts:?}"
    );
    values_survive(model);
    a_drive_answers(model);
}

/// Each word that a register may hold survives being shown and parsed.
fn values_survive(model: &Model) {
    for register in &model.registers {
        for word in [1, 0x7FFF, 0x8000] {
            let value = ScaledValue::from_word(word, register);
            assert!(!value.to_string().is_empty());
            assert_eq!(
                to_raw(value.value(), register),
                Ok(word),
                "{}",
                register.name
            );
        }
    }
}

/// A simulated drive answers every request to its registers, many of which are alike.
fn a_drive_answers(model: &Arc<Model>) {
    let mut drive = SimDrive::new(Arc::clone(model), DriveOptions::default());
    let mut now = MonoTime::from_millis(100_000);
    let every = 1 + model.registers.len() / 16;
    for address in model
        .registers
        .iter()
        .step_by(every)
        .map(|register| register.address)
    {
        let requests = [
            Request::Read { address, count: 1 },
            Request::WriteSingle { address, value: 1 },
            Request::WriteMultiple {
                address,
                values: vec![1, 0],
            },
        ];
        for request in requests {
            let mut pdu = Vec::new();
            let mut reply = Vec::new();
            request.encode(&mut pdu);
            now = now + Duration::from_millis(100);
            let is_answered = drive.answer(now, &pdu, 1, &mut reply);
            assert!(
                !is_answered || (2..=MAX_PDU_BYTES).contains(&reply.len()),
                "{reply:02X?} to {pdu:02X?}"
            );
        }
    }
}
