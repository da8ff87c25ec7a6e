//! The fault table: what can go wrong in an exchange, and what happens next.

/// What went wrong in an exchange, or instead of one.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Fault {
    /// No sound frame arrived from the station in time. The data received begins like the reply and has its length, but
    /// its check is wrong: the damaged reply, or noise, a damaged echo, another drive. The reply may still arrive.
    Garbled,
    /// No frame arrived from the station in time.
    Silent,
    /// No frame arrived from the station in time, for a request that it need not support.
    Ignored,
    /// No frame arrived from the station, which is known to be deaf.
    Deaf,
    /// The device before the station answered that the station cannot be reached, or has not answered.
    Unreachable,
    /// The station answered something else, or too late.
    Stray,
    /// A station that was not addressed answered.
    Foreign,
    /// The drive answered with an exception.
    Refused,
    /// The drive answered a write with the value it kept.
    KeptOldValue,
    /// The drive answered that the request had reached it damaged.
    DamagedRequest,
    /// Our frame was echoed.
    Echoed,
    /// Another master sends requests on the line.
    OtherMaster,
    /// Bytes keep arriving, so that no silence is long enough for a frame of ours.
    Jammed,
    /// Requests are sent, but nothing has been received from any drive for long.
    Mute,
    /// What is received is no stream of frames: no later byte can be trusted to begin one.
    OutOfStep,
    /// The port is gone.
    PortGone,
}

/// What follows from a fault.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct FaultConsequence {
    /// The exchange is over; otherwise its reply is still awaited.
    pub ends_exchange: bool,
    /// A read is sent once more, as soon as no late reply can be mistaken for its own. A write never is.
    pub repeats_read: bool,
    /// A reply to this exchange may still arrive, so the next answers of the station must be unmistakable.
    pub reply_may_come_late: bool,
    /// The station is polled less and less often.
    pub backs_off: bool,
    /// The drive is known to be present.
    pub drive_is_there: bool,
    /// The port is closed and opened again.
    pub reopens_port: bool,
}

/// The table.
#[must_use]
pub const fn consequence(fault: Fault) -> FaultConsequence {
    let none = FaultConsequence {
        ends_exchange: false,
        repeats_read: false,
        reply_may_come_late: false,
        backs_off: false,
        drive_is_there: false,
        reopens_port: false,
    };
    match fault {
        Fault::Garbled => FaultConsequence {
            ends_exchange: true,
            repeats_read: true,
            reply_may_come_late: true,
            ..none
        },
        Fault::Silent => FaultConsequence {
            ends_exchange: true,
            reply_may_come_late: true,
            backs_off: true,
            ..none
        },
        Fault::Ignored => FaultConsequence {
            ends_exchange: true,
            reply_may_come_late: true,
            ..none
        },
        Fault::Deaf => FaultConsequence {
            ends_exchange: true,
            ..none
        },
        // The drive is as silent as before; whether it obeyed is not known.
        Fault::Unreachable => FaultConsequence {
            ends_exchange: true,
            backs_off: true,
            ..none
        },
        Fault::Stray => FaultConsequence {
            drive_is_there: true,
            ..none
        },
        // Another master's requests say nothing about the drives that they address.
        Fault::Foreign | Fault::Echoed | Fault::OtherMaster | Fault::Jammed => none,
        Fault::Mute => FaultConsequence {
            reopens_port: true,
            ..none
        },
        Fault::Refused | Fault::KeptOldValue => FaultConsequence {
            ends_exchange: true,
            drive_is_there: true,
            ..none
        },
        Fault::DamagedRequest => FaultConsequence {
            ends_exchange: true,
            repeats_read: true,
            drive_is_there: true,
            ..none
        },
        // No reply follows on a connection that is given up.
        Fault::OutOfStep => FaultConsequence {
            ends_exchange: true,
            reopens_port: true,
            ..none
        },
        Fault::PortGone => FaultConsequence {
            ends_exchange: true,
            reply_may_come_late: true,
            reopens_port: true,
            ..none
        },
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// ends, repeats a read, late reply possible, backs off, drive is there, reopens
    const TABLE: [(Fault, [bool; 6]); 16] = [
        (Fault::Garbled, [true, true, true, false, false, false]),
        (Fault::Silent, [true, false, true, true, false, false]),
        (Fault::Ignored, [true, false, true, false, false, false]),
        (Fault::Deaf, [true, false, false, false, false, false]),
        (Fault::Unreachable, [true, false, false, true, false, false]),
        (Fault::Stray, [false, false, false, false, true, false]),
        (Fault::Foreign, [false, false, false, false, false, false]),
        (Fault::Refused, [true, false, false, false, true, false]),
        (
            Fault::KeptOldValue,
            [true, false, false, false, true, false],
        ),
        (
            Fault::DamagedRequest,
            [true, true, false, false, true, false],
        ),
        (Fault::Echoed, [false, false, false, false, false, false]),
        (
            Fault::OtherMaster,
            [false, false, false, false, false, false],
        ),
        (Fault::Jammed, [false, false, false, false, false, false]),
        (Fault::Mute, [false, false, false, false, false, true]),
        (Fault::OutOfStep, [true, false, false, false, false, true]),
        (Fault::PortGone, [true, false, true, false, false, true]),
    ];

    #[test]
    fn what_follows_from_each_fault() {
        for (fault, row) in TABLE {
            let c = consequence(fault);
            let got = [
                c.ends_exchange,
                c.repeats_read,
                c.reply_may_come_late,
                c.backs_off,
                c.drive_is_there,
                c.reopens_port,
            ];
            assert_eq!(got, row, "{fault:?}");
        }
    }
}
