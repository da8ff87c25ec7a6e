//! The words that files use for enumerations: one table each, for reading and for showing.

use super::model::{
    Access, BitMeaning, Boundary, Confidence, DocumentKind, Flag, Memory, Part, PollClass, RefusedWrite, Role,
};
use crate::domain::link::{EchoPolicy, Framing, Interface, Parity};
use crate::domain::units::UnitOfMeasure;

/// The table of an enumeration that knows its own words.
macro_rules! own_words {
    ($kind:ident: $($value:ident),+) => { [$(($kind::$value.word(), $kind::$value)),+] };
}

/// Parities.
pub const PARITIES: [(&str, Parity); 3] = [("none", Parity::None), ("even", Parity::Even), ("odd", Parity::Odd)];

/// Framings.
pub const FRAMINGS: [(&str, Framing); 2] = [("rtu", Framing::Rtu), ("ascii", Framing::Ascii)];

/// What to do about an echo.
pub const ECHO_POLICIES: [(&str, EchoPolicy); 2] = [("refuse", EchoPolicy::Refuse), ("strip", EchoPolicy::Strip)];

/// Interfaces.
pub const INTERFACES: [(&str, Interface); 2] = [("rs485", Interface::Rs485), ("rs232", Interface::Rs232)];

/// Units of measure.
pub const UNITS: [(&str, UnitOfMeasure); 10] = [
    (UnitOfMeasure::Hertz.symbol(), UnitOfMeasure::Hertz),
    (UnitOfMeasure::Ampere.symbol(), UnitOfMeasure::Ampere),
    (UnitOfMeasure::Volt.symbol(), UnitOfMeasure::Volt),
    (UnitOfMeasure::Kilowatt.symbol(), UnitOfMeasure::Kilowatt),
    (UnitOfMeasure::Percent.symbol(), UnitOfMeasure::Percent),
    (UnitOfMeasure::Celsius.symbol(), UnitOfMeasure::Celsius),
    (UnitOfMeasure::Second.symbol(), UnitOfMeasure::Second),
    (UnitOfMeasure::Hour.symbol(), UnitOfMeasure::Hour),
    (UnitOfMeasure::Rpm.symbol(), UnitOfMeasure::Rpm),
    (UnitOfMeasure::None.symbol(), UnitOfMeasure::None),
];

/// Who may do what with a register.
pub const ACCESSES: [(&str, Access); 3] =
    [("read", Access::Read), ("write", Access::Write), ("read-write", Access::ReadWrite)];

/// How often a register is polled.
pub const POLL_CLASSES: [(&str, PollClass); 5] = [
    ("fast", PollClass::Fast),
    ("second", PollClass::Second),
    ("slow", PollClass::Slow),
    ("minutely", PollClass::Minutely),
    ("hourly", PollClass::Hourly),
];

/// Where a register keeps what is written to it.
pub const MEMORIES: [(&str, Memory); 2] = own_words!(Memory: Ram, Stored);

/// What of a register its source may not state.
pub(super) const PARTS: [(&str, Part); 6] = own_words!(Part: Reading, Writing, Scale, Sign, Memory, Meaning);

/// What a status register can tell.
pub const FLAGS: [(&str, Flag); 8] = [
    ("running", Flag::Running),
    ("reverse", Flag::Reverse),
    ("stopping", Flag::Stopping),
    ("tripped", Flag::Tripped),
    ("alarm", Flag::Alarm),
    ("ready", Flag::Ready),
    ("bus-run", Flag::BusRun),
    ("bus-frequency", Flag::BusFrequency),
];

/// What a bit of a run command means.
pub const BIT_MEANINGS: [(&str, BitMeaning); 11] = [
    ("run", BitMeaning::Run),
    ("reverse", BitMeaning::Reverse),
    ("run-forward", BitMeaning::RunForward),
    ("run-reverse", BitMeaning::RunReverse),
    ("reset", BitMeaning::Reset),
    ("coast", BitMeaning::Coast),
    ("trip", BitMeaning::Trip),
    ("jog", BitMeaning::Jog),
    ("bus-run", BitMeaning::BusRun),
    ("bus-frequency", BitMeaning::BusFrequency),
    ("other", BitMeaning::Other),
];

/// What a read must not cross.
pub(super) const BOUNDARIES: [(&str, Boundary); 1] = [("high-byte", Boundary::HighByte)];

/// What a refused write looks like.
pub(super) const REFUSED_WRITES: [(&str, RefusedWrite); 2] =
    [("exception", RefusedWrite::Exception), ("keeps-old-value", RefusedWrite::KeepsOldValue)];

/// What a document is.
pub(super) const DOCUMENT_KINDS: [(&str, DocumentKind); 8] = own_words!(
    DocumentKind: Manual, Addendum, DistributorManual, Program, RegisterMap, SiteNote, CommissioningSheet, Forum
);

/// How sure a fact is.
pub(super) const CONFIDENCES: [(&str, Confidence); 7] =
    own_words!(Confidence: Manual, SecondSource, ThirdParty, Sibling, Inferred, Default, Configured);

/// What the gateway uses a register for.
pub const ROLES: [(&str, Role); 22] = [
    ("run-command", Role::RunCommand),
    ("frequency-command", Role::FrequencyCommand),
    ("frequency-setting", Role::FrequencySetting),
    ("output-frequency", Role::OutputFrequency),
    ("acceleration-time", Role::AccelerationTime),
    ("deceleration-time", Role::DecelerationTime),
    ("frequency-source", Role::FrequencySource),
    ("run-source", Role::RunSource),
    ("trip-code", Role::TripCode),
    ("trip-count", Role::TripCount),
    ("trip-cause", Role::TripCause),
    ("trip-frequency", Role::TripFrequency),
    ("trip-current", Role::TripCurrent),
    ("trip-dc-link-voltage", Role::TripDcLinkVoltage),
    ("output-current", Role::OutputCurrent),
    ("output-voltage", Role::OutputVoltage),
    ("dc-link-voltage", Role::DcLinkVoltage),
    ("output-power", Role::OutputPower),
    ("torque", Role::Torque),
    ("temperature", Role::Temperature),
    ("run-hours", Role::RunHours),
    ("trip-history", Role::TripHistory),
];

/// The word for `value` in `words`; `?` where it has none.
#[must_use]
pub fn word_for<T: PartialEq>(words: &[(&'static str, T)], value: &T) -> &'static str {
    words.iter().find(|(_, it)| it == value).map_or("?", |(word, _)| word)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_value_has_its_word() {
        assert_eq!(word_for(&PARITIES, &Parity::Odd), "odd");
        assert_eq!(word_for(&ROLES, &Role::TripCause), "trip-cause");
        assert_eq!(word_for(&UNITS, &UnitOfMeasure::None), "-");
        assert_eq!(word_for(&POLL_CLASSES[..1], &PollClass::Slow), "?");
    }
}
