//! The full scale that the configuration states for a model whose frequencies are fractions of one that no register holds.

use super::{FractionWhole, Model};
use crate::domain::frequency::Hertz;

impl Model {
    /// The model of a drive whose configuration states `full_scale`, for registers that are fractions of it.
    #[must_use]
    pub fn with_full_scale(&self, full_scale: Hertz) -> Self {
        let mut model = self.clone();
        for scale in model
            .registers
            .iter_mut()
            .filter_map(|register| register.form.full_scale.as_mut())
        {
            if scale.of == FractionWhole::Configured {
                scale.of = FractionWhole::Fixed(full_scale);
            }
        }
        model
    }

    /// Whether a register is a fraction of a full scale that the configuration of the drive must state.
    #[must_use]
    pub fn needs_full_scale(&self) -> bool {
        let scales = self
            .registers
            .iter()
            .filter_map(|register| register.form.full_scale.as_ref());
        scales.into_iter().any(|scale| {
            matches!(
                scale.of,
                FractionWhole::Configured | FractionWhole::Fixed(_)
            )
        })
    }
}
