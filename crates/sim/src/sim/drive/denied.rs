//! Reasons why a drive refuses a request, and the model's exception codes for them.

use crate::profile::model::Model;
use crate::wire::exception::{
    ILLEGAL_DATA_ADDRESS, ILLEGAL_DATA_VALUE, ILLEGAL_FUNCTION, SERVER_DEVICE_FAILURE,
};

/// Why a request was not executed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum DeniedRequest {
    /// The drive cannot serve such a request. Some stay silent.
    Request(RequestObjection),
    /// The drive can, but refuses the value.
    Refused(RequestObjection),
}

/// The part of a request that a drive objects to.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum RequestObjection {
    /// The function.
    Function,
    /// The register: it does not exist, or not for this function.
    Address,
    /// The number of words.
    Quantity,
    /// The value.
    Value,
    /// The state of the drive: tripped, running, or under other control.
    NotNow,
}

/// First code of vendors with their own five codes, in the order of [`RequestObjection`].
const OWN_FIRST: u8 = 0x51;

impl RequestObjection {
    /// The exception code of a drive of `model`: the standard's, unless the model states others with more confidence.
    ///
    /// There are two deviations from the standard: five consecutive vendor codes, and a code 04 that means too many
    /// registers instead of a failure.
    pub(super) fn code(self, model: &Model) -> u8 {
        let sureness = |code| model.exception_text(code).map(|it| it.confidence);
        let has_own = (OWN_FIRST..OWN_FIRST + 5).all(|code| sureness(code).is_some());
        // The highest confidence is the smallest value; `None` must not win.
        if has_own
            && sureness(ILLEGAL_FUNCTION)
                .is_none_or(|standard| sureness(OWN_FIRST) < Some(standard))
        {
            return OWN_FIRST + self as u8;
        }
        let counts_registers = model
            .exception_text(SERVER_DEVICE_FAILURE)
            .is_some_and(|it| it.text.to_lowercase().contains("registers"));
        match (self, counts_registers) {
            (Self::Function, _) => ILLEGAL_FUNCTION,
            (Self::Address, _) => ILLEGAL_DATA_ADDRESS,
            (Self::Quantity, true) | (Self::NotNow, false) => SERVER_DEVICE_FAILURE,
            (Self::Quantity, false) | (Self::NotNow, true) | (Self::Value, _) => ILLEGAL_DATA_VALUE,
        }
    }
}
