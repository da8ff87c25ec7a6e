//! How far an output has been from what was ordered.

use crate::domain::frequency::Hertz;
use crate::domain::time::MonoTime;

/// How far the output has been from what was ordered.
#[derive(Debug, Default)]
pub(super) struct Outside {
    /// The setpoint that it is compared with.
    pub(super) ordered: Option<Hertz>,
    /// The shortest distance so far, in thousandths of a hertz, and since when it was not shorter.
    pub(super) nearest: Option<(u32, MonoTime)>,
    /// It has been told, and the output was not seen right since.
    pub(super) is_told: bool,
}
