//! Conclusions from what was observed on a line: a table of signs, each with its text for people, which says what to
//! do.

use super::{DriveObserved, LineObserved};
use crate::domain::ids::Name;
use crate::north::finding::{Finding, FindingSign, Severity, ranked};
use crate::north::texts::Sentence;

/// How many of one kind are needed before it is believed: a single one is chance.
pub(super) const SIGNS: u64 = 3;
/// Exchanges before anything is said about shares of them.
pub(super) const ENOUGH: u64 = 20;
/// From this many in a thousand exchanges on, something is a problem.
const PROBLEM_PER_MILLE: u64 = 10;

/// What one rule says, if it applies.
pub(super) type FindingText = Option<(Severity, Sentence)>;

/// One row of the table.
pub struct FindingRule {
    /// What it finds.
    pub sign: FindingSign,
    of: RuleScope,
}

enum RuleScope {
    Line(fn(&LineObserved) -> FindingText),
    Drive(fn(&LineObserved, &DriveObserved) -> FindingText),
}

const fn line(sign: FindingSign, of: fn(&LineObserved) -> FindingText) -> FindingRule {
    FindingRule {
        sign,
        of: RuleScope::Line(of),
    }
}

const fn drive(
    sign: FindingSign,
    of: fn(&LineObserved, &DriveObserved) -> FindingText,
) -> FindingRule {
    FindingRule {
        sign,
        of: RuleScope::Drive(of),
    }
}

/// The table. Rows further up are more likely causes than those below.
pub const RULES: &[FindingRule] = &[
    line(FindingSign::Suspicion, super::line_rules::suspicion),
    line(FindingSign::LineDown, super::line_rules::down),
    line(FindingSign::PortLost, super::line_rules::port_lost),
    line(FindingSign::Suspended, super::line_rules::suspended),
    line(FindingSign::OtherMaster, super::line_rules::other_master),
    line(FindingSign::Stranger, super::line_rules::stranger),
    line(FindingSign::Floating, super::line_rules::floating),
    line(FindingSign::OverFull, super::line_rules::over_full),
    line(FindingSign::EchoStripped, super::line_rules::echo_stripped),
    line(FindingSign::FewExchanges, super::line_rules::few_exchanges),
    drive(FindingSign::Offline, super::drive_rules::offline),
    drive(
        FindingSign::DuplicateStation,
        super::drive_rules::duplicate_station,
    ),
    drive(
        FindingSign::LateBeyondLimit,
        super::drive_rules::late_beyond_limit,
    ),
    drive(
        FindingSign::FirstCharacters,
        super::drive_rules::first_characters,
    ),
    drive(FindingSign::Cut, super::drive_rules::cut),
    drive(FindingSign::LongFrames, super::drive_rules::long_frames),
    drive(FindingSign::OneStation, super::drive_rules::one_station),
    drive(FindingSign::Damaged, super::drive_rules::damaged),
    drive(FindingSign::Late, super::drive_rules::late),
    drive(FindingSign::Silent, super::drive_rules::silent),
    drive(FindingSign::TimeoutShort, super::drive_rules::timeout_short),
    drive(FindingSign::Exceptions, super::drive_rules::exceptions),
    drive(FindingSign::Warns, super::drive_rules::warns),
];

/// All findings on the line called `name`, the worst first; that all is well if there is none.
#[must_use]
pub fn verdict(name: &Name, observed: &LineObserved) -> Vec<Finding> {
    let mut found: Vec<_> = RULES
        .iter()
        .flat_map(|rule| rule.findings(name, observed))
        .collect();
    if found
        .iter()
        .all(|finding| finding.severity == Severity::Good)
    {
        let text = Sentence::new("finding.fine").with("exchanges", observed.exchanges());
        let text = text.with("seconds", observed.time.as_secs());
        let line = Some(name.clone());
        found.insert(
            0,
            Finding {
                severity: Severity::Good,
                sign: FindingSign::Fine,
                line,
                drive: None,
                text,
            },
        );
    }
    ranked(found)
}

impl FindingRule {
    fn findings(&self, name: &Name, observed: &LineObserved) -> Vec<Finding> {
        let finding = |drive: Option<&DriveObserved>, (severity, text)| {
            let drive = drive.map(|drive| drive.now.name.clone());
            let text = match &drive {
                Some(name) => Sentence::new("finding.of_drive")
                    .with("drive", name.as_str())
                    .with("finding", text),
                None => text,
            };
            Finding {
                severity,
                sign: self.sign,
                line: Some(name.clone()),
                drive,
                text,
            }
        };
        match self.of {
            RuleScope::Line(of) => of(observed)
                .map(|said| finding(None, said))
                .into_iter()
                .collect(),
            RuleScope::Drive(of) => {
                let each = observed
                    .drives
                    .iter()
                    .filter_map(|drive| Some(finding(Some(drive), of(observed, drive)?)));
                each.collect()
            }
        }
    }
}

/// How bad `count` of `all` is; `None` if that is chance, or less than one in a thousand.
pub(super) fn graded(count: u64, all: u64) -> Option<Severity> {
    if count < SIGNS || count * 1000 < all {
        return None;
    }
    Some(if count * 1000 >= all * PROBLEM_PER_MILLE {
        Severity::Problem
    } else {
        Severity::Hint
    })
}

#[cfg(test)]
mod tests {
    use super::super::testing::{cases, good, idle, line_name};
    use super::*;

    #[test]
    fn a_good_line_is_said_to_be_good() {
        let found = verdict(&line_name(), &good());
        assert_eq!(found.len(), 1, "{found:?}");
        assert_eq!(
            (found[0].severity, found[0].sign),
            (Severity::Good, FindingSign::Fine)
        );
        assert_eq!(
            found[0].text.to_string(),
            "no problems found: 2000 exchanges in 30 s"
        );
    }

    #[test]
    fn each_sign_is_found_in_its_case_and_nothing_worse() {
        for (sign, severity, part, observed) in cases() {
            let found = verdict(&line_name(), &observed);
            let finding = found.iter().find(|finding| finding.sign == sign);
            let finding = finding.unwrap_or_else(|| panic!("no {sign:?} among {found:?}"));
            assert_eq!(
                (finding.severity, found[0].severity),
                (severity, severity),
                "{found:?}"
            );
            assert!(
                finding.text.to_string().contains(part),
                "no {part} in {}",
                finding.text
            );
            let others = found
                .iter()
                .filter(|it| it.severity > Severity::Good && it.sign != sign)
                .count();
            assert_eq!(others, 0, "{sign:?}: {found:?}");
        }
    }

    #[test]
    fn each_rule_has_its_case() {
        for rule in RULES {
            assert!(
                cases().iter().any(|(sign, ..)| *sign == rule.sign),
                "{:?}",
                rule.sign
            );
        }
    }

    #[test]
    fn a_line_without_exchanges_is_not_good() {
        assert_ne!(verdict(&line_name(), &idle())[0].severity, Severity::Good);
    }

    #[test]
    fn a_few_are_chance() {
        for (count, all, severity) in [
            (2, 2, None),
            (3, 3000, Some(Severity::Hint)),
            (3, 3001, None),
            (10, 1000, Some(Severity::Problem)),
            (9, 1000, Some(Severity::Hint)),
        ] {
            assert_eq!(graded(count, all), severity, "{count} of {all}");
        }
    }
}
