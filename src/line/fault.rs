//! The fault table: what can go wrong in an exchange, and what happens next.

/// What went wrong in an exchange, or instead of one.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Fault {
    /// No sound frame came from the station in time. What came begins like the reply and is as long, and its check is
    /// wrong: the reply, damaged, or noise, an echo that lost a byte, another drive, so that the reply may still come.
    Garbled,
    /// No frame came from the station in time.
    Silent,
    /// No frame came from the station in time, on a request that it need not know.
    Ignored,
    /// No frame came from the station, which is known to be deaf.
    Deaf,
    /// The station answered something else, or too late.
    Stray,
    /// A station that was not asked spoke.
    Foreign,
    /// The drive answered with an exception.
    Refused,
    /// The drive answered a write with the value it kept.
    KeptOldValue,
    /// What we sent came back.
    Echoed,
    /// Somebody else sends requests on the line.
    OtherMaster,
    /// Bytes keep coming, so that no silence is long enough for a frame of ours.
    Jammed,
    /// Requests go out, and nothing has been heard from anybody for long.
    Mute,
    /// The port is gone.
    PortGone,
}

/// What follows from a fault.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Consequence {
    /// The exchange is over; otherwise the wait for its reply goes on.
    pub ends_exchange: bool,
    /// A read is sent once more before it is given up, once no late reply can be taken for its own. A write never is.
    pub repeats_read: bool,
    /// A reply to this exchange may still come, so the station's next answers must not be mistakable.
    pub reply_may_come_late: bool,
    /// The station is asked less and less often.
    pub backs_off: bool,
    /// The drive has shown that it is there.
    pub drive_is_there: bool,
    /// The port is closed and opened again.
    pub reopens_port: bool,
}

/// The table.
#[must_use]
pub const fn consequence(fault: Fault) -> Consequence {
    let none = Consequence {
        ends_exchange: false,
        repeats_read: false,
        reply_may_come_late: false,
        backs_off: false,
        drive_is_there: false,
        reopens_port: false,
    };
    match fault {
        Fault::Garbled => Consequence { ends_exchange: true, repeats_read: true, reply_may_come_late: true, ..none },
        Fault::Silent => Consequence { ends_exchange: true, reply_may_come_late: true, backs_off: true, ..none },
        Fault::Ignored => Consequence { ends_exchange: true, reply_may_come_late: true, ..none },
        Fault::Deaf => Consequence { ends_exchange: true, ..none },
        Fault::Stray => Consequence { drive_is_there: true, ..none },
        // Whose requests they are says nothing about the drives that they name.
        Fault::Foreign | Fault::Echoed | Fault::OtherMaster | Fault::Jammed => none,
        Fault::Mute => Consequence { reopens_port: true, ..none },
        Fault::Refused | Fault::KeptOldValue => Consequence { ends_exchange: true, drive_is_there: true, ..none },
        Fault::PortGone => Consequence { ends_exchange: true, reply_may_come_late: true, reopens_port: true, ..none },
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// ends, repeats a read, late reply possible, backs off, drive is there, reopens
    const TABLE: [(Fault, [bool; 6]); 13] = [
        (Fault::Garbled, [true, true, true, false, false, false]),
        (Fault::Silent, [true, false, true, true, false, false]),
        (Fault::Ignored, [true, false, true, false, false, false]),
        (Fault::Deaf, [true, false, false, false, false, false]),
        (Fault::Stray, [false, false, false, false, true, false]),
        (Fault::Foreign, [false, false, false, false, false, false]),
        (Fault::Refused, [true, false, false, false, true, false]),
        (Fault::KeptOldValue, [true, false, false, false, true, false]),
        (Fault::Echoed, [false, false, false, false, false, false]),
        (Fault::OtherMaster, [false, false, false, false, false, false]),
        (Fault::Jammed, [false, false, false, false, false, false]),
        (Fault::Mute, [false, false, false, false, false, true]),
        (Fault::PortGone, [true, false, true, false, false, true]),
    ];

    #[test]
    fn what_follows_from_each_fault() {
        for (fault, row) in TABLE {
            let c = consequence(fault);
            let got =
                [c.ends_exchange, c.repeats_read, c.reply_may_come_late, c.backs_off, c.drive_is_there, c.reopens_port];
            assert_eq!(got, row, "{fault:?}");
        }
    }
}
