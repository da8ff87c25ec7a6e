//! The catalogue of what can be wrong with a drive, a line or the gateway, used by the page, `doctor` and reports.
//!
//! Each sign is defined in one place: its word for programs, how bad it is, and what it means. The code that detects it
//! is next to its data: `report/` for what happened on a line in a span of time, `page/advice/` for the present state.

use crate::domain::ids::{Name, Station};
use crate::domain::report::{LineReport, LineState};
use crate::domain::suspicion::LineSuspicion;
use crate::north::api::FindingDocument;
use crate::north::texts::Sentence;

/// How bad it is.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum Severity {
    /// Nothing has to be done.
    Good,
    /// The subject works, but is worth a look when there is time.
    Hint,
    /// The subject does not work, causes disturbance, or is about to.
    Problem,
    /// A drive is tripped.
    Trip,
    /// A motor may turn where the gateway does not see it: what a person who looks at the page has to see first.
    Danger,
}

impl Severity {
    /// The word in documents.
    #[must_use]
    pub const fn keyword(self) -> &'static str {
        match self {
            Self::Good => "good",
            Self::Hint => "hint",
            Self::Problem | Self::Trip | Self::Danger => "problem",
        }
    }
}

macro_rules! signs {
    ($($name:ident $word:literal $severity:ident $meaning:literal)*) => {
        /// What can be found.
        #[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
        pub enum FindingSign {
            $(#[doc = $meaning] $name,)*
        }

        impl FindingSign {
            /// All of them.
            pub const ALL: &[Self] = &[$(Self::$name,)*];

            /// The word for programs.
            #[must_use]
            pub const fn keyword(self) -> &'static str {
                match self { $(Self::$name => $word,)* }
            }

            /// How bad it is, unless it is graded by how often it was seen.
            #[must_use]
            pub const fn severity(self) -> Severity {
                match self { $(Self::$name => Severity::$severity,)* }
            }

            /// What it means, for the documentation.
            #[must_use]
            pub const fn meaning(self) -> &'static str {
                match self { $(Self::$name => $meaning,)* }
            }
        }
    };
}

signs! {
    // The gateway.
    BrokerContested "broker_contested" Problem "another client uses the gateway's client identifier at the broker"
    BrokerUnreachable "broker_unreachable" Problem "the gateway has no connection to the broker"
    Oversized "oversized" Hint "documents are not published, because they are larger than the \
                                broker accepts"
    ClientsGone "clients_gone" Hint "`alive_topic` says that the clients of the broker are \
                                     offline, so the control that MQTT holds ends"
    PartnerMissing "partner_missing" Problem "the other gateway of `[standby]` is offline, as MQTT \
                                              says"
    JournalBroken "journal_broken" Problem "the journal cannot be written"
    JournalMovedAside "journal_moved_aside" Hint "the journal was damaged; a new one was begun and the old one kept"
    JournalReplaced "journal_replaced" Hint "the journal's file was deleted or replaced while the gateway ran"
    JournalRowsLost "journal_rows_lost" Hint "rows of the journal were lost since the start"
    SocketMissing "socket_missing" Problem "the program's own commands do not reach the gateway"
    // A line.
    LineHangs "line_hangs" Problem "the line's thread does not run, so no stop can be sent on the \
                                    line"
    Suspicion "suspicion" Problem "what is suspected of the line as a whole"
    LineDown "line_down" Problem "the line is down, and why"
    PortLost "port_lost" Problem "the adapter went away and came back"
    Suspended "suspended" Problem "so many exchanges fail that RUN is refused"
    BadExchanges "bad_exchanges" Hint "some of the last exchanges failed"
    OtherMaster "other_master" Problem "requests from another master"
    NoListener "no_listener" Problem "no other gateway answers on the line: if this one fails, \
                                      none takes it over"
    NoGatewayActive "no_gateway_active" Problem "this gateway is on standby for the line, and no \
                                                 active one is heard"
    RivalOnLine "rival_on_line" Problem "another master was heard while this gateway was active on a line with several gateways: while it is heard, nothing is polled and no RUN is accepted"
    LineDeaf "line_deaf" Problem "this gateway receives no valid frame on a line with several \
                                  gateways: check its receiver, the speed and the polarity"
    FilesDiffer "files_differ" Problem "the other gateway of the line has other drives, limits or declared actions there"
    Stranger "stranger" Problem "frames of stations that are not configured"
    Floating "floating" Hint "bytes that belong to no frame, before replies or between exchanges: bias and termination"
    OverFull "over_full" Hint "polls that need more than the line's time"
    EchoStripped "echo_stripped" Good "an echo of the adapter, which is removed as configured"
    FewExchanges "few_exchanges" Hint "too few exchanges to judge"
    Fine "good" Good "no problems were found"
    // A drive.
    MayStillRun "may_still_run" Danger "the drive is out of sight and was not seen at standstill: its motor may still run"
    Tripped "tripped" Trip "the drive is tripped"
    Offline "offline" Problem "the drive does not answer"
    Warns "warns" Hint "the drive shows a warning, and keeps working"
    Implausible "implausible" Problem "the drive does not show what every drive of its model shows: nothing read from it counts"
    UndocumentedState "undocumented_state" Hint "the drive shows a state that no document names: it proves nothing"
    RegisterRefused "register_refused" Hint "the drive refuses to show a register; a problem where run state or trips are read there"
    BusRefused "bus_refused" Problem "a parameter of the drive keeps it from obeying the bus"
    LocalControl "local_control" Problem "the drive obeys its panel or terminals"
    NotEffective "not_effective" Problem "a stop shows no effect"
    OutputOutside "output_outside" Problem "the output is outside the limits, or far from the setpoint"
    StoppedElsewhere "stopped_elsewhere" Problem "the drive no longer follows its order to run: it was stopped elsewhere"
    CommandFailed "command_failed" Problem "the last command was not carried out, for a reason that lies in the drive"
    WatchdogWrong "watchdog_wrong" Hint "the drive's own watchdog is off or set wrong; a problem where it is required"
    SetpointOutside "setpoint_outside" Hint "the drive's setpoint is outside the limits of its control section"
    StoppedAgain "stopped_again" Hint "a controller stops the drive again and again although others start it"
    CommanderLost "commander_lost" Hint "the commander was lost, and how far the declared action has come"
    FailSafe "failsafe" Hint "the drive was out of reach, or another gateway was lost, and how far \
                              the declared action has come"
    DuplicateStation "duplicate_station" Problem "the drive answers more often than it is asked"
    LateBeyondLimit "late_beyond_limit" Problem "replies that came later than `max_lateness` allows"
    FirstCharacters "first_characters" Hint "damaged replies in which only the first characters are wrong"
    Cut "cut" Hint "damaged replies whose end is missing"
    LongFrames "long_frames" Hint "damage above all in long replies"
    OneStation "one_station" Hint "damage at one drive alone"
    Damaged "damaged" Hint "damage anywhere"
    Late "late" Hint "replies after the time-out"
    Silent "silent" Hint "requests that are never answered"
    TimeoutShort "timeout_short" Hint "a `reply_timeout` shorter than what is suggested"
    Exceptions "exceptions" Hint "requests that the drive refuses"
}

/// One thing that was found.
#[derive(Clone, Debug, PartialEq)]
pub struct Finding {
    /// How bad it is.
    pub severity: Severity,
    /// What it is, for programs.
    pub sign: FindingSign,
    /// The line it concerns; `None` for the gateway.
    pub line: Option<Name>,
    /// The drive it concerns, if any.
    pub drive: Option<Name>,
    /// What it is and what to do, for people.
    pub text: Sentence,
}

impl Finding {
    /// The document: `text` is in English, `said` is the same for a client that shows another language.
    #[must_use]
    pub fn document(&self) -> FindingDocument {
        FindingDocument {
            severity: self.severity.keyword().into(),
            sign: self.sign.keyword().into(),
            line: self.line.as_ref().map(Name::to_string),
            drive: self.drive.as_ref().map(Name::to_string),
            title: None,
            text: self.text.to_string().into(),
            said: self.text.document(),
        }
    }
}

/// All of `findings`, the worst first; otherwise in order.
#[must_use]
pub fn ranked(findings: impl IntoIterator<Item = Finding>) -> Vec<Finding> {
    let mut all: Vec<_> = findings.into_iter().collect();
    all.sort_by_key(|finding| std::cmp::Reverse(finding.severity));
    all
}

/// The finding that a drive does not answer, and what to check.
pub(super) fn offline(station: Option<Station>) -> Sentence {
    match station {
        Some(station) => Sentence::new("finding.offline_at").with("station", u64::from(station.0)),
        None => Sentence::new("finding.offline"),
    }
}

/// What a drive warns of.
pub(super) fn warns(warning: String) -> Sentence {
    Sentence::new("finding.warns").with("warning", warning)
}

/// The finding that so many exchanges of a line fail that RUN is refused.
pub(super) fn suspended(bad_per_cent: u8) -> Sentence {
    Sentence::new("finding.suspended").with("bad", u64::from(bad_per_cent))
}

/// The finding that polls need more than the line's time.
pub(super) fn over_full(planned_use_per_mille: u32) -> Sentence {
    Sentence::new("finding.over_full").with("use", u64::from(planned_use_per_mille / 10))
}

/// What is suspected of a line.
pub(super) fn suspicion(suspicion: LineSuspicion) -> Sentence {
    let said = Sentence::new(format!("suspicion.{}", suspicion.keyword()));
    let said = match suspicion {
        LineSuspicion::WrongReplies { request, reply, .. } => said
            .with("request", request.to_string())
            .with("reply", reply.to_string()),
        _ => said,
    };
    match suspicion.station() {
        Some(station) => said.with("station", u64::from(station.0)),
        None => said,
    }
}

/// Why a line cannot be used; `None` if it can.
pub(super) fn down_reason(report: &LineReport) -> Option<Sentence> {
    let reason = match (report.state, &report.open_error, report.fault) {
        (LineState::Up, ..) => return None,
        // The text of the operating system.
        (LineState::Down, Some(error), _) => Sentence::new("fault.open").with("error", &**error),
        (LineState::Down, None, Some(fault)) => Sentence::new(format!("fault.{}", fault.keyword())),
        (LineState::Down, None, None) => Sentence::new("fault.not_opened"),
    };
    Some(reason)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_sign_has_a_word_of_its_own() {
        for sign in FindingSign::ALL {
            assert_eq!(
                FindingSign::ALL
                    .iter()
                    .filter(|it| it.keyword() == sign.keyword())
                    .count(),
                1,
                "{sign:?}"
            );
        }
    }

    #[test]
    fn the_documentation_lists_each_sign_with_its_meaning() {
        let page = include_str!("../../../../docs/trouble.md");
        let table: String = FindingSign::ALL
            .iter()
            .map(|it| format!("| `{}` | {} |\n", it.keyword(), it.meaning()))
            .collect();
        assert!(
            page.contains(&table),
            "docs/trouble.md should contain:\n{table}"
        );
    }

    #[test]
    fn a_motor_that_may_run_unseen_is_the_first_of_all_problems_and_a_trip_the_second() {
        let finding = |sign: FindingSign| Finding {
            severity: sign.severity(),
            sign,
            line: None,
            drive: None,
            text: Sentence::new(""),
        };
        let all = ranked(
            [
                FindingSign::OverFull,
                FindingSign::Offline,
                FindingSign::Tripped,
                FindingSign::LineDown,
                FindingSign::MayStillRun,
            ]
            .map(finding),
        );
        let signs: Vec<_> = all.iter().map(|it| it.sign).collect();
        assert_eq!(
            signs,
            [
                FindingSign::MayStillRun,
                FindingSign::Tripped,
                FindingSign::Offline,
                FindingSign::LineDown,
                FindingSign::OverFull
            ]
        );
    }
}
