//! The words of a model file for enumerations: one table each, for reading and printing.

use super::model::{
    Access, BitMeaning, Boundary, Confidence, DocumentKind, ExceptionKind, FactPart, Flag, Holes,
    Memory, NeededFor, PollClass, RefusedWrite, Role, WordOrder, ZeroWord,
};
use crate::domain::address::Table;

/// The table of an enumeration that defines its own words.
macro_rules! own_words {
    ($kind:ident: $($value:ident),+) => { [$(($kind::$value.word(), $kind::$value)),+] };
}

/// Access to a register.
pub const ACCESSES: [(&str, Access); 3] = [
    ("read", Access::Read),
    ("write", Access::Write),
    ("read-write", Access::ReadWrite),
];

/// The tables of the Modbus data model.
pub const TABLES: [(&str, Table); 4] = own_words!(Table: Holding, Input, Coil, Discrete);

/// How often a register is polled.
pub const POLL_CLASSES: [(&str, PollClass); 5] = [
    ("fast", PollClass::Fast),
    ("second", PollClass::Second),
    ("slow", PollClass::Slow),
    ("minutely", PollClass::Minutely),
    ("hourly", PollClass::Hourly),
];

/// The kind of memory behind a register.
pub const MEMORIES: [(&str, Memory); 2] = own_words!(Memory: Ram, Stored);

/// Properties of a register that its source may leave unstated.
pub(super) const PARTS: [(&str, FactPart); 6] =
    own_words!(FactPart: Reading, Writing, Scale, Sign, Memory, Meaning);

/// States that a status register can indicate.
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

/// Meanings of bits in a run command.
pub const BIT_MEANINGS: [(&str, BitMeaning); 18] = [
    ("run", BitMeaning::Run),
    ("reverse", BitMeaning::Reverse),
    ("forward", BitMeaning::Forward),
    ("run-forward", BitMeaning::RunForward),
    ("run-reverse", BitMeaning::RunReverse),
    ("stop", BitMeaning::Stop),
    ("quick-stop", BitMeaning::QuickStop),
    ("dc-brake", BitMeaning::DcBrake),
    ("freeze", BitMeaning::Freeze),
    ("toggle", BitMeaning::Toggle),
    ("ignored", BitMeaning::Ignored),
    ("reset", BitMeaning::Reset),
    ("coast", BitMeaning::Coast),
    ("trip", BitMeaning::Trip),
    ("jog", BitMeaning::Jog),
    ("bus-run", BitMeaning::BusRun),
    ("bus-frequency", BitMeaning::BusFrequency),
    ("other", BitMeaning::Other),
];

/// What a run command of all zeros does.
pub const ZERO_WORDS: [(&str, ZeroWord); 5] = [
    ("stop", ZeroWord::Stop),
    ("coast", ZeroWord::Coast),
    ("nothing", ZeroWord::Nothing),
    ("ignored", ZeroWord::Ignored),
    ("release", ZeroWord::Release),
];

/// What a drive means by an exception.
pub(super) const EXCEPTION_KINDS: [(&str, ExceptionKind); 4] =
    own_words!(ExceptionKind: Busy, Locked, InTrip, DamagedFrame);

/// What a drive does about a read of an address without a register.
pub(super) const HOLES: [(&str, Holes); 3] = [
    ("refused", Holes::Refused),
    ("zero", Holes::Zero),
    ("read", Holes::Read),
];

/// Boundaries that no read may cross.
pub(super) const BOUNDARIES: [(&str, Boundary); 1] = [("high-byte", Boundary::HighByte)];

/// Appearances of a refused write.
pub(super) const REFUSED_WRITES: [(&str, RefusedWrite); 3] = [
    ("exception", RefusedWrite::Exception),
    ("keeps-old-value", RefusedWrite::KeepsOldValue),
    ("echo-may-be-old", RefusedWrite::EchoMayBeOld),
];

/// The orders that a setting is needed for.
pub(super) const NEEDED_FOR: [(&str, NeededFor); 3] = [
    ("run", NeededFor::Run),
    ("reverse", NeededFor::Reverse),
    ("setpoint", NeededFor::Setpoint),
];

/// Orders of the words of a 32-bit value.
pub(super) const WORD_ORDERS: [(&str, WordOrder); 2] = own_words!(WordOrder: HighFirst, LowFirst);

/// Kinds of documents.
pub(super) const DOCUMENT_KINDS: [(&str, DocumentKind); 8] = own_words!(
    DocumentKind: Manual, Addendum, DistributorManual, Program, RegisterMap, SiteNote, CommissioningSheet, Forum
);

/// Degrees of confidence.
pub const CONFIDENCES: [(&str, Confidence); 7] = own_words!(Confidence: Manual, SecondSource, ThirdParty, Sibling, Inferred, Default, Configured);

/// Uses of a register by the gateway.
pub const ROLES: [(&str, Role); 27] = [
    ("run-command", Role::RunCommand),
    ("order", Role::Order),
    ("frequency-command", Role::FrequencyCommand),
    ("frequency-setting", Role::FrequencySetting),
    ("output-frequency", Role::OutputFrequency),
    ("acceleration-time", Role::AccelerationTime),
    ("deceleration-time", Role::DecelerationTime),
    ("frequency-source", Role::FrequencySource),
    ("run-source", Role::RunSource),
    ("trip-code", Role::TripCode),
    ("trip-bits", Role::TripBits),
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
    ("energy", Role::Energy),
    ("trip-history", Role::TripHistory),
    ("warning-code", Role::WarningCode),
    ("warning-bits", Role::WarningBits),
];

#[cfg(test)]
mod tests {
    use super::*;
    use crate::toml_file::words::word_for;

    #[test]
    fn every_value_has_its_word() {
        assert_eq!(word_for(&ROLES, &Role::TripCause), "trip-cause");
        assert_eq!(word_for(&POLL_CLASSES[..1], &PollClass::Slow), "?");
    }
}
