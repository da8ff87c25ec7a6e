//! The reads that show whether a stop takes effect.

use crate::domain::address::Address;
use crate::profile::model::{IndicatedState, Model, RegisterRole};

/// The output frequency, and the status register where that tells whether the drive is ordered to run: in one read if
/// the model allows it.
pub(super) fn look_addresses(model: &Model) -> Vec<(Address, u16)> {
    let output = model
        .register_for(RegisterRole::OutputFrequency)
        .map(|register| (register.address, register.form.words()));
    let status = model
        .status_flag(IndicatedState::Running)
        .map(|flag| flag.address);
    let (Some((output, words)), Some(status)) = (output, status) else {
        return output
            .or(status.map(|address| (address, 1)))
            .into_iter()
            .collect();
    };
    let first = output.min(status);
    let last = output.saturating_add(words - 1).max(status);
    let count = last
        .offset_from(first)
        .and_then(|offset| offset.checked_add(1))
        .unwrap_or(u16::MAX);
    let is_known = |it| model.readable_at(it).is_some() || model.is_readable_hole(it);
    let all_known = || first.onwards().take(count.into()).all(is_known);
    if count <= model.words_in_one_read(first) && all_known() {
        vec![(first, count)]
    } else {
        vec![(status, 1), (output, words)]
    }
}
