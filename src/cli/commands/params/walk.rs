//! How far a group of parameters is read that the model does not describe: until its end is found, within bounds.

use super::file::{LeftOut, Parameter, ParameterDump};

/// Consecutive refused numbers after which the group is taken to have ended before them: groups have gaps.
const REFUSED_MAX: usize = 16;
/// Consecutive unanswered numbers: each of these occupies the line for a whole time-out.
const SILENT_MAX: usize = 3;

/// The outcome of reading a number.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum WalkOutcome {
    /// The drive has it.
    Shown(Parameter),
    /// The drive answered with an exception.
    Refused(String),
    /// The drive did not answer, or could not be asked, for this reason.
    Silent(String, String),
}

/// One group while it is read.
#[derive(Clone, Debug, Default)]
pub struct GroupWalk {
    /// Codes that the drive refused, since it last showed one.
    refused: Vec<String>,
    /// Codes that it did not answer, since it last answered one, and why.
    silent: Vec<(String, String)>,
    /// The walk ended before the last number of the group.
    is_cut: bool,
}

impl GroupWalk {
    /// Takes the outcome of the next number into `dump`; returns whether the one after it is worth asking for.
    pub fn goes_on_after(&mut self, tried: WalkOutcome, dump: &mut ParameterDump) -> bool {
        match tried {
            WalkOutcome::Shown(parameter) => {
                self.note(dump);
                dump.parameters.push(parameter);
            }
            WalkOutcome::Refused(code) => {
                self.note_silent(dump);
                self.refused.push(code);
            }
            WalkOutcome::Silent(code, reason) => {
                self.note_refused(dump);
                self.silent.push((code, reason));
            }
        }
        self.is_cut = self.refused.len() >= REFUSED_MAX || self.silent.len() >= SILENT_MAX;
        !self.is_cut
    }

    /// Ends the group called `name`.
    pub fn end(mut self, name: &str, dump: &mut ParameterDump) {
        let last = self
            .silent
            .last()
            .map(|(code, _)| code)
            .or(self.refused.last())
            .cloned();
        self.note(dump);
        if self.is_cut
            && let Some(last) = last
        {
            let reason = "not read: the drive showed none of those before them".to_owned();
            dump.left_out.push(LeftOut {
                what: format!("group {name} behind {last}"),
                reason,
            });
        }
    }

    fn note(&mut self, dump: &mut ParameterDump) {
        self.note_refused(dump);
        self.note_silent(dump);
    }

    fn note_refused(&mut self, dump: &mut ParameterDump) {
        let codes = std::mem::take(&mut self.refused);
        dump.left_out.extend(range(&codes).map(|what| LeftOut {
            what,
            reason: "the drive refuses to show it".to_owned(),
        }));
    }

    fn note_silent(&mut self, dump: &mut ParameterDump) {
        let silent = std::mem::take(&mut self.silent);
        let reason = silent
            .last()
            .map(|(_, reason)| reason.clone())
            .unwrap_or_default();
        let codes: Vec<_> = silent.into_iter().map(|(code, _)| code).collect();
        dump.left_out
            .extend(range(&codes).map(|what| LeftOut { what, reason }));
    }
}

/// From the first to the last of `codes`.
fn range(codes: &[String]) -> Option<String> {
    match codes {
        [] => None,
        [one] => Some(one.clone()),
        [first, .., last] => Some(format!("{first} to {last}")),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn code(number: usize) -> String {
        format!("F{number:02}")
    }

    fn shown(number: usize) -> WalkOutcome {
        let address = u16::try_from(number).unwrap();
        WalkOutcome::Shown(Parameter {
            code: code(number),
            address,
            raw: 7,
            text: None,
            title: String::new(),
        })
    }

    /// The numbers that are requested, and the resulting dump.
    fn walked(has: impl Fn(usize) -> WalkOutcome) -> (usize, ParameterDump) {
        let mut walk = GroupWalk::default();
        let mut dump = ParameterDump::default();
        let asked = (0..100)
            .take_while(|number| walk.goes_on_after(has(*number), &mut dump))
            .count();
        walk.end("F", &mut dump);
        (asked, dump)
    }

    fn left_out(dump: &ParameterDump) -> Vec<String> {
        dump.left_out
            .iter()
            .map(|it| format!("{}: {}", it.what, it.reason))
            .collect()
    }

    #[test]
    fn a_group_is_read_to_its_end_and_what_is_not_in_it_is_named() {
        let has = |number| {
            if matches!(number, 0 | 5..=9 | 20..) {
                WalkOutcome::Refused(code(number))
            } else {
                shown(number)
            }
        };
        let (asked, dump) = walked(has);
        assert_eq!((asked, dump.parameters.len()), (20 + REFUSED_MAX - 1, 14));
        let expected = [
            "F00: the drive refuses to show it",
            "F05 to F09: the drive refuses to show it",
            "F20 to F35: the drive refuses to show it",
            "group F behind F35: not read: the drive showed none of those before them",
        ];
        assert_eq!(left_out(&dump), expected);
        let (asked, dump) = walked(shown);
        assert_eq!(
            (asked, dump.parameters.len(), dump.left_out.len()),
            (100, 100, 0)
        );
    }

    #[test]
    fn a_drive_that_does_not_answer_is_not_asked_on_and_on() {
        let silent = |number| WalkOutcome::Silent(code(number), "no answer".to_owned());
        let (asked, dump) = walked(|number| {
            if number == 0 || number > 3 {
                silent(number)
            } else {
                shown(number)
            }
        });
        assert_eq!((asked, dump.parameters.len()), (4 + SILENT_MAX - 1, 3));
        let expected = [
            "F00: no answer",
            "F04 to F06: no answer",
            "group F behind F06: not read: the drive showed none of those before them",
        ];
        assert_eq!(left_out(&dump), expected);
    }
}
