//! Registers on which the values of others depend.

use crate::domain::units::UnitOfMeasure;
use crate::profile::model::{FractionWhole, FullScale, Model, Register};
use crate::sim::options::DriveOptions;

/// The word with which a register begins on which others depend; `None` for any other.
pub(super) fn first_basis(
    model: &Model,
    register: &Register,
    options: &DriveOptions,
) -> Option<u16> {
    let by = model
        .registers
        .iter()
        .filter_map(|it| it.form.scale_by.as_ref());
    let mut by = by.filter(|by| by.address == register.address && by.mask == register.form.mask);
    if let Some((word, _)) = by.next().and_then(|by| by.steps.last()) {
        return Some(*word);
    }
    let is_whole = |scale: &FullScale| matches!(scale.of, FractionWhole::Register(basis) if basis.address == register.address);
    model
        .registers
        .iter()
        .filter_map(|it| it.form.full_scale.as_ref())
        .find(|scale| is_whole(scale))?;
    let whole = match register.unit {
        UnitOfMeasure::Hertz => u32::from(options.max_frequency_hz),
        UnitOfMeasure::Ampere => u32::from(options.rated_current_x10) / 10,
        UnitOfMeasure::Volt => u32::from(options.rated_voltage_v),
        _ => 100,
    };
    u16::try_from(whole * register.scale / register.form.per).ok()
}
