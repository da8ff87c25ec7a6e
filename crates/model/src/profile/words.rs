//! The words of a model file for enumerations: one table each, for reading and printing.

use super::model::{
    BitMeaning, Confidence, DocumentKind, ExceptionKind, FactPart, IndicatedState, NeededFor,
    PollClass, ReadBoundary, ReadHoles, RefusedWrite, RegisterAccess, RegisterMemory, RegisterRole,
    WordOrder, ZeroWord,
};
use crate::domain::address::DataTable;

/// Declares tables of words: for each its name, its enumeration, and the values with their words. A value without a word here
/// has one of its own. The comment of a word is its meaning in `docs/model-reference.md`; the words of a table without comments
/// explain themselves.
macro_rules! declare_words {
    ($(
        $(#[doc = $about:literal])+
        $vis:vis $table:ident: $kind:ident {
            $($(#[doc = $meaning:literal])* $value:ident $($word:literal)?;)+
        }
    )+) => {
        $(
            $(#[doc = $about])+
            $vis const $table: [(&str, $kind); [$(stringify!($value)),+].len()] =
                [$(($crate::profile::words::word_of!($kind $value $($word)?), $kind::$value)),+];
        )+

        /// The words of each table with their meanings.
        #[cfg(test)]
        pub fn meanings() -> Vec<Vec<(&'static str, String)>> {
            vec![$(vec![$({
                let meaning: &[&str] = &[$($meaning),*];
                let meaning: Vec<_> = meaning.iter().map(|line| line.trim()).collect();
                ($crate::profile::words::word_of!($kind $value $($word)?), meaning.join(" "))
            }),+]),+]
        }
    };
}
pub(super) use declare_words;

macro_rules! word_of {
    ($kind:ident $value:ident) => {
        $kind::$value.keyword()
    };
    ($kind:ident $value:ident $word:literal) => {
        $word
    };
}
pub(super) use word_of;

declare_words! {
    /// Access to a register.
    pub ACCESSES: RegisterAccess {
        Read "read";
        Write "write";
        ReadWrite "read-write";
    }

    /// The tables of the Modbus data model.
    pub TABLES: DataTable {
        /// Holding registers: read by 03, written by 06 or 10 hex.
        Holding;
        /// Input registers: read by 04, never written.
        Input;
        /// Coils: bits, read by 01, written by 05 or 0F hex.
        Coil;
        /// Discrete inputs: bits, read by 02, never written.
        Discrete;
    }

    /// How often a register is polled.
    pub POLL_CLASSES: PollClass {
        /// At the poll period of the drive: status, output frequency, trips.
        Fast "fast";
        /// Once a second, or at the poll period if that is longer.
        Second "second";
        /// At four times the poll period.
        Slow "slow";
        /// Once a minute: settings that are changed at the panel.
        Minutely "minutely";
        /// Once an hour: what does not change while the drive is on.
        Hourly "hourly";
    }

    /// The kind of memory behind a register.
    pub MEMORIES: RegisterMemory {
        /// Volatile: it may be written any number of times.
        Ram;
        /// Kept without power: it wears out, so that it is written only if the configuration lists it.
        Stored;
    }

    /// Properties of a register that its source may leave unstated.
    pub(super) PARTS: FactPart {
        /// That it can be read.
        Reading;
        /// That it can be written.
        Writing;
        /// Its scale.
        Scale;
        /// How negative numbers are encoded.
        Sign;
        /// Whether it is stored.
        Memory;
        /// What its words mean.
        Meaning;
    }

    /// States that a status register can indicate.
    pub FLAGS: IndicatedState {
        /// The output is active or ordered to be.
        Running "running";
        /// The direction is reverse.
        Reverse "reverse";
        /// The motor is ramped down to standstill.
        Stopping "stopping";
        /// A trip is active.
        Tripped "tripped";
        /// An alarm is active; the drive keeps running.
        Alarm "alarm";
        /// The drive would obey a run order.
        Ready "ready";
        /// Run commands are taken from the bus.
        BusRun "bus-run";
        /// The frequency is taken from the bus.
        BusFrequency "bus-frequency";
    }

    /// Meanings of bits in a run command.
    pub BIT_MEANINGS: BitMeaning {
        /// Run; without it the motor is ramped down, unless another bit means `stop`: then a run order stays until that.
        Run "run";
        /// The direction is reverse; without it forward, unless another bit means `forward`.
        Reverse "reverse";
        /// The direction is forward; without it reverse, unless another bit means `reverse`.
        Forward "forward";
        /// Run forward.
        RunForward "run-forward";
        /// Run in reverse.
        RunReverse "run-reverse";
        /// Ramp down and stop.
        Stop "stop";
        /// Stop by the fast ramp.
        QuickStop "quick-stop";
        /// Stop by direct current.
        DcBrake "dc-brake";
        /// Keep the output frequency as it is.
        Freeze "freeze";
        /// Change the direction. In no command.
        Toggle "toggle";
        /// The drive does not take the word. In no command.
        Ignored "ignored";
        /// Reset a trip.
        Reset "reset";
        /// Cut the output off.
        Coast "coast";
        /// The drive trips. In no command.
        Trip "trip";
        /// Jog. In no command.
        Jog "jog";
        /// Run commands are taken from the bus whatever the settings say.
        BusRun "bus-run";
        /// The frequency is taken from the bus whatever the settings say.
        BusFrequency "bus-frequency";
        /// Something that the gateway never orders.
        Other "other";
    }

    /// What a run command of all zeros does.
    pub ZERO_WORDS: ZeroWord {
        /// The motor ramps down.
        Stop "stop";
        /// The motor coasts.
        Coast "coast";
        /// The drive takes the word and goes on as it was ordered before.
        Nothing "nothing";
        /// The drive does not take the word.
        Ignored "ignored";
        /// Panel and terminals take over.
        Release "release";
    }

    /// What a drive means by an exception.
    pub(super) EXCEPTION_KINDS: ExceptionKind {
        /// Not now: a read is tried again after 0.2 s, a write never, a stop until it is taken.
        Busy;
        /// It is locked against this. Results name it.
        Locked;
        /// It does not do this while a trip holds. Results name it.
        InTrip;
        /// The request reached it damaged: as a damaged reply, after which none comes late.
        DamagedFrame;
    }

    /// What a drive does about a read of an address without a register.
    pub(super) HOLES: ReadHoles {
        /// An exception.
        Refused "refused";
        /// 0. An answer proves no register, so that `scan` calls such a drive possible only.
        Zero "zero";
        /// Something. An answer proves no register either.
        Read "read";
    }

    /// Boundaries that no read may cross.
    pub(super) BOUNDARIES: ReadBoundary {
        HighByte "high-byte";
    }

    /// Appearances of a refused write.
    pub(super) REFUSED_WRITES: RefusedWrite {
        /// An exception.
        Exception "exception";
        /// A normal reply with the value that the drive kept. Not with `functions` that lack `0x06`.
        KeepsOldValue "keeps-old-value";
        /// An exception. The value in a normal reply may be the old one although the new one was taken; only reading back
        /// proves it.
        EchoMayBeOld "echo-may-be-old";
    }

    /// The orders that a setting is needed for.
    pub(super) NEEDED_FOR: NeededFor {
        /// RUN in either direction.
        Run "run";
        /// RUN in reverse.
        Reverse "reverse";
        /// A setpoint.
        Setpoint "setpoint";
    }

    /// Orders of the words of a 32-bit value.
    pub(super) WORD_ORDERS: WordOrder {
        /// The word at the lower address is the high one.
        HighFirst;
        /// The word at the lower address is the low one.
        LowFirst;
    }

    /// Kinds of documents.
    pub(super) DOCUMENT_KINDS: DocumentKind {
        /// The maker's manual; at best `manual`.
        Manual;
        /// The maker's addition to a manual; at best `manual`.
        Addendum;
        /// The manual of a firm that sells the drive under another name; at best `second-source`.
        DistributorManual;
        /// A program that talks to the drive; at best `third-party`.
        Program;
        /// A list of registers made by others; at best `third-party`.
        RegisterMap;
        /// Notes from one site; at best `third-party`.
        SiteNote;
        /// The settings of drives at one site; at best `third-party`.
        CommissioningSheet;
        /// A public discussion; at best `third-party`.
        Forum;
    }

    /// Degrees of confidence.
    pub CONFIDENCES: Confidence {
        /// Stated in a manual of this very model. Proven.
        Manual;
        /// Stated in a second manual of this model, or in that of a firm which sells it under its own name. Proven.
        SecondSource;
        /// Stated for this model by others: a program, a map, a note from a site.
        ThirdParty;
        /// Stated for another model of the family only.
        Sibling;
        /// Follows from other facts; it was not observed.
        Inferred;
        /// No source, a cautious choice. Under `[timing]` only.
        Default;
        /// Reserved for registers that a configuration adds; a file cannot use it.
        Configured;
    }

    /// Uses of a register by the gateway.
    pub ROLES: RegisterRole {
        /// Takes the words of `[run]`. Writable and not stored.
        RunCommand "run-command";
        /// Takes an order of `[run]` that names it, or the direction. Writable and not stored.
        Order "order";
        /// Takes the setpoint. Writable, not stored, and in Hz if the drive is to take orders.
        FrequencyCommand "frequency-command";
        /// The setpoint as the drive holds it, if that is another register than the one that takes it.
        FrequencySetting "frequency-setting";
        /// The output frequency. A drive that takes orders has one that is polled: it shows that a stop takes effect.
        OutputFrequency "output-frequency";
        /// The time of the ramp up.
        AccelerationTime "acceleration-time";
        /// The time of the ramp down.
        DecelerationTime "deceleration-time";
        /// Where the drive takes its setpoint from. Never written natively.
        FrequencySource "frequency-source";
        /// Where the drive takes its run commands from. Never written natively.
        RunSource "run-source";
        /// The number of the trip that is active now, 0 for none.
        TripCode "trip-code";
        /// The trips that are active now, one bit each. May have two words.
        TripBits "trip-bits";
        /// How many trips there were. One more is a new trip.
        TripCount "trip-count";
        /// The number of the newest trip, also when it is over. It counts only while the flag `tripped` holds or the count
        /// rises.
        TripCause "trip-cause";
        /// The output frequency at the newest trip.
        TripFrequency "trip-frequency";
        /// The output current at the newest trip.
        TripCurrent "trip-current";
        /// The DC link voltage at the newest trip.
        TripDcLinkVoltage "trip-dc-link-voltage";
        /// The output current.
        OutputCurrent "output-current";
        /// The output voltage.
        OutputVoltage "output-voltage";
        /// The DC link voltage.
        DcLinkVoltage "dc-link-voltage";
        /// The output power.
        OutputPower "output-power";
        /// The torque.
        Torque "torque";
        /// The temperature of the drive.
        Temperature "temperature";
        /// The hours that the motor has run.
        RunHours "run-hours";
        /// The energy that the drive has counted, in kWh or MWh and polled. It is shown as what the drive has used; without
        /// such a register that is summed up from the output power.
        Energy "energy";
        /// The number of an older trip. Several registers may have it; the newest trip is at the lowest address.
        TripHistory "trip-history";
        /// The number of the warning that is active now, 0 for none.
        WarningCode "warning-code";
        /// The warnings that are active now, one bit each. May have two words.
        WarningBits "warning-bits";
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::profile::model::RegisterRole;
    use crate::toml_file::words::word_for;

    #[test]
    fn every_value_has_its_word() {
        assert_eq!(word_for(&ROLES, &RegisterRole::TripCause), "trip-cause");
        assert_eq!(word_for(&POLL_CLASSES[..1], &PollClass::Slow), "?");
    }
}
