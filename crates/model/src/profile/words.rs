//! The words of a model file for enumerations: one table each, for reading and printing.

use super::model::{
    BitMeaning, Confidence, DocumentKind, ExceptionKind, FactPart, IndicatedState, NeededFor,
    PollClass, ReadBoundary, ReadHoles, RefusedWrite, RegisterAccess, RegisterMemory, RegisterRole,
    WordOrder, ZeroWord,
};
use crate::domain::address::DataTable;

/// The table of an enumeration that defines its own words.
macro_rules! own_words {
    ($kind:ident: $($value:ident),+) => { [$(($kind::$value.keyword(), $kind::$value)),+] };
}

/// Access to a register.
pub const ACCESSES: [(&str, RegisterAccess); 3] = [
    ("read", RegisterAccess::Read),
    ("write", RegisterAccess::Write),
    ("read-write", RegisterAccess::ReadWrite),
];

/// The tables of the Modbus data model.
pub const TABLES: [(&str, DataTable); 4] = own_words!(DataTable: Holding, Input, Coil, Discrete);

/// How often a register is polled.
pub const POLL_CLASSES: [(&str, PollClass); 5] = [
    ("fast", PollClass::Fast),
    ("second", PollClass::Second),
    ("slow", PollClass::Slow),
    ("minutely", PollClass::Minutely),
    ("hourly", PollClass::Hourly),
];

/// The kind of memory behind a register.
pub const MEMORIES: [(&str, RegisterMemory); 2] = own_words!(RegisterMemory: Ram, Stored);

/// Properties of a register that its source may leave unstated.
pub(super) const PARTS: [(&str, FactPart); 6] =
    own_words!(FactPart: Reading, Writing, Scale, Sign, Memory, Meaning);

/// States that a status register can indicate.
pub const FLAGS: [(&str, IndicatedState); 8] = [
    ("running", IndicatedState::Running),
    ("reverse", IndicatedState::Reverse),
    ("stopping", IndicatedState::Stopping),
    ("tripped", IndicatedState::Tripped),
    ("alarm", IndicatedState::Alarm),
    ("ready", IndicatedState::Ready),
    ("bus-run", IndicatedState::BusRun),
    ("bus-frequency", IndicatedState::BusFrequency),
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
pub(super) const HOLES: [(&str, ReadHoles); 3] = [
    ("refused", ReadHoles::Refused),
    ("zero", ReadHoles::Zero),
    ("read", ReadHoles::Read),
];

/// Boundaries that no read may cross.
pub(super) const BOUNDARIES: [(&str, ReadBoundary); 1] = [("high-byte", ReadBoundary::HighByte)];

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
pub const ROLES: [(&str, RegisterRole); 27] = [
    ("run-command", RegisterRole::RunCommand),
    ("order", RegisterRole::Order),
    ("frequency-command", RegisterRole::FrequencyCommand),
    ("frequency-setting", RegisterRole::FrequencySetting),
    ("output-frequency", RegisterRole::OutputFrequency),
    ("acceleration-time", RegisterRole::AccelerationTime),
    ("deceleration-time", RegisterRole::DecelerationTime),
    ("frequency-source", RegisterRole::FrequencySource),
    ("run-source", RegisterRole::RunSource),
    ("trip-code", RegisterRole::TripCode),
    ("trip-bits", RegisterRole::TripBits),
    ("trip-count", RegisterRole::TripCount),
    ("trip-cause", RegisterRole::TripCause),
    ("trip-frequency", RegisterRole::TripFrequency),
    ("trip-current", RegisterRole::TripCurrent),
    ("trip-dc-link-voltage", RegisterRole::TripDcLinkVoltage),
    ("output-current", RegisterRole::OutputCurrent),
    ("output-voltage", RegisterRole::OutputVoltage),
    ("dc-link-voltage", RegisterRole::DcLinkVoltage),
    ("output-power", RegisterRole::OutputPower),
    ("torque", RegisterRole::Torque),
    ("temperature", RegisterRole::Temperature),
    ("run-hours", RegisterRole::RunHours),
    ("energy", RegisterRole::Energy),
    ("trip-history", RegisterRole::TripHistory),
    ("warning-code", RegisterRole::WarningCode),
    ("warning-bits", RegisterRole::WarningBits),
];

#[cfg(test)]
mod tests {
    use super::*;
    use crate::toml_file::words::word_for;

    #[test]
    fn every_value_has_its_word() {
        assert_eq!(word_for(&ROLES, &RegisterRole::TripCause), "trip-cause");
        assert_eq!(word_for(&POLL_CLASSES[..1], &PollClass::Slow), "?");
    }
}
