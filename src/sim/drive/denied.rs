//! Why a drive does not do what it is asked, and the exception code by which a model says so.

use crate::profile::model::Model;
use crate::wire::exception::{ILLEGAL_DATA_ADDRESS, ILLEGAL_DATA_VALUE, ILLEGAL_FUNCTION, SERVER_DEVICE_FAILURE};

/// Why a request was not done.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Denied {
    /// The drive cannot serve such a request. Some stay silent.
    Request(Objection),
    /// The drive could, but did not take the value.
    Refused(Objection),
}

/// What a drive objects to.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Objection {
    /// The function.
    Function,
    /// The register: it does not exist, or not for this function.
    Address,
    /// The number of words.
    Quantity,
    /// The value.
    Value,
    /// The moment: tripped, running, or under somebody else's control.
    NotNow,
}

/// The codes of vendors who number the five objections on their own, from here on in the order of [`Objection`].
const OWN_FIRST: u8 = 0x51;

impl Objection {
    /// The exception code that a drive of `model` answers: the standard's, unless the model is surer of other ones.
    ///
    /// Two habits differ from the standard: five codes of the vendor's own in a row, and a code 04 that stands for
    /// too many registers instead of a failure.
    pub(super) fn code(self, model: &Model) -> u8 {
        let sureness = |code| model.exception_text(code).map(|it| it.confidence);
        let has_own = (OWN_FIRST..OWN_FIRST + 5).all(|code| sureness(code).is_some());
        // The surest confidence is the smallest; none at all must not win.
        if has_own && sureness(ILLEGAL_FUNCTION).is_none_or(|standard| sureness(OWN_FIRST) < Some(standard)) {
            return OWN_FIRST + self as u8;
        }
        let counts_registers =
            model.exception_text(SERVER_DEVICE_FAILURE).is_some_and(|it| it.text.to_lowercase().contains("registers"));
        match (self, counts_registers) {
            (Self::Function, _) => ILLEGAL_FUNCTION,
            (Self::Address, _) => ILLEGAL_DATA_ADDRESS,
            (Self::Quantity, true) | (Self::NotNow, false) => SERVER_DEVICE_FAILURE,
            (Self::Quantity, false) | (Self::NotNow, true) | (Self::Value, _) => ILLEGAL_DATA_VALUE,
        }
    }
}
