//! The unanswered commands of one connection.

use super::refusal;
use crate::domain::command::{CommandAnswer, Outcome};
use crate::domain::ids::Ticket;
use crate::domain::time::MonoTime;

/// What a call reads after its command is answered (17 hex).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ReadBehind {
    /// The unit.
    pub unit: u8,
    /// First register.
    pub address: u16,
    /// How many.
    pub count: u16,
}

/// A call whose commands are all answered.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct EndedCall {
    /// The call.
    pub call: Ticket,
    /// The worst outcome of its commands; `None`: all succeeded.
    pub exception: Option<u8>,
    /// What is to be read now, if all succeeded.
    pub read: Option<ReadBehind>,
}

/// Which commands belong to which call. Bounded by the number of calls in flight.
#[derive(Debug, Default)]
pub struct CallCommands {
    calls: Vec<WaitingCall>,
}

#[derive(Debug)]
struct WaitingCall {
    call: Ticket,
    deadline: MonoTime,
    /// Unanswered commands.
    out: Vec<Ticket>,
    worst: Option<u8>,
    read: Option<ReadBehind>,
}

impl CallCommands {
    /// Expects an answer to each of `out` for `call`, which expires at `deadline`. `worst` is its worst outcome so far:
    /// a command that could not be handed on. No answer is expected if `out` is empty.
    pub fn expect(
        &mut self,
        now: MonoTime,
        call: Ticket,
        deadline: MonoTime,
        out: Vec<Ticket>,
        worst: Option<u8>,
        read: Option<ReadBehind>,
    ) {
        self.calls.retain(|waiting| now < waiting.deadline);
        if !out.is_empty() {
            self.calls.push(WaitingCall {
                call,
                deadline,
                out,
                worst,
                read,
            });
        }
    }

    /// Takes an answer to a command. Returns the call that this answers, once the drive has answered each of its
    /// commands for the first time; what follows an acknowledgement is shown in the view.
    pub fn take(&mut self, answer: &CommandAnswer) -> Option<EndedCall> {
        if !answer.is_final && answer.report.outcome != Outcome::Acknowledged {
            return None;
        }
        let place = self
            .calls
            .iter()
            .position(|waiting| waiting.out.contains(&answer.ticket))?;
        let waiting = self.calls.get_mut(place)?;
        waiting.out.retain(|ticket| *ticket != answer.ticket);
        waiting.worst = refusal::worst(waiting.worst, refusal::exception_for(&answer.report));
        if !waiting.out.is_empty() {
            return None;
        }
        let WaitingCall {
            call, worst, read, ..
        } = self.calls.swap_remove(place);
        Some(EndedCall {
            call,
            exception: worst,
            read: if worst.is_none() { read } else { None },
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::domain::command::{Reason, Report};
    use crate::domain::ids::{AskerId, DriveIndex};

    const T0: MonoTime = MonoTime::ZERO;
    const LATE: MonoTime = MonoTime::from_millis(5_000);

    fn answer(ticket: u64, report: Report, is_final: bool) -> CommandAnswer {
        CommandAnswer {
            asker: AskerId(1),
            ticket: Ticket(ticket),
            drive: DriveIndex(0),
            report,
            is_final,
        }
    }

    fn done(ticket: u64) -> CommandAnswer {
        answer(ticket, Report::new(Outcome::Confirmed, Reason::None), true)
    }

    #[test]
    fn the_first_answer_ends_the_call_and_later_ones_are_nobodys() {
        let mut commands = CallCommands::default();
        let read = Some(ReadBehind {
            unit: 101,
            address: 0,
            count: 2,
        });
        commands.expect(T0, Ticket(7), LATE, vec![Ticket(7)], None, read);
        let unknown = answer(7, Report::new(Outcome::Unknown, Reason::NoReply), false);
        assert_eq!(commands.take(&unknown), None, "it is being found out");
        let acknowledged = answer(7, Report::new(Outcome::Acknowledged, Reason::None), false);
        assert_eq!(
            commands.take(&acknowledged),
            Some(EndedCall {
                call: Ticket(7),
                exception: None,
                read
            })
        );
        assert_eq!(commands.take(&done(7)), None);
    }

    #[test]
    fn what_became_of_a_command_is_the_exception_of_its_call() {
        for (report, code) in [
            (Report::refused(Reason::StartInhibited), 6),
            (Report::refused(Reason::OutsideLimits), 3),
            (Report::new(Outcome::Failed, Reason::KeptOldValue), 4),
            (Report::new(Outcome::Unknown, Reason::NoReply), 0x0B),
            (Report::new(Outcome::Expired, Reason::TooLate), 0x0B),
            (Report::new(Outcome::Superseded, Reason::Newer), 6),
        ] {
            let mut commands = CallCommands::default();
            let read = Some(ReadBehind {
                unit: 101,
                address: 0,
                count: 2,
            });
            commands.expect(T0, Ticket(7), LATE, vec![Ticket(7)], None, read);
            let ended = commands.take(&answer(7, report, true));
            assert_eq!(
                ended,
                Some(EndedCall {
                    call: Ticket(7),
                    exception: Some(code),
                    read: None
                }),
                "{report:?}"
            );
        }
    }

    #[test]
    fn a_call_of_several_commands_ends_with_the_last_and_tells_the_worst() {
        let mut commands = CallCommands::default();
        commands.expect(
            T0,
            Ticket(7),
            LATE,
            vec![Ticket(8), Ticket(9)],
            Some(6),
            None,
        );
        commands.expect(T0, Ticket(10), LATE, vec![Ticket(10)], None, None);
        assert_eq!(
            commands.take(&answer(
                9,
                Report::new(Outcome::Failed, Reason::DriveException),
                true
            )),
            None
        );
        assert_eq!(commands.take(&done(9)), None, "once for each");
        assert_eq!(
            commands.take(&done(10)).map(|ended| ended.call),
            Some(Ticket(10))
        );
        assert_eq!(
            commands.take(&done(8)),
            Some(EndedCall {
                call: Ticket(7),
                exception: Some(4),
                read: None
            })
        );
    }

    #[test]
    fn what_is_never_answered_is_forgotten_with_its_call() {
        let mut commands = CallCommands::default();
        commands.expect(T0, Ticket(1), LATE, vec![Ticket(1)], None, None);
        commands.expect(
            LATE,
            Ticket(2),
            MonoTime::from_millis(9_000),
            vec![Ticket(2)],
            None,
            None,
        );
        assert_eq!(commands.calls.len(), 1);
        assert_eq!(commands.take(&done(1)), None);
        commands.expect(LATE, Ticket(3), MonoTime::NEVER, Vec::new(), None, None);
        assert_eq!(commands.calls.len(), 1);
    }
}
