//! What is wrong or could be better at this moment: what, where, and what would be right. It is derived from what is
//! already known.

mod of_drive;
mod of_gateway;
mod of_line;

use crate::domain::ids::Name;
use crate::north::finding::{Finding, FindingSign, Severity};
use crate::north::texts::Sentence;

/// Advice on one subject.
#[derive(Debug, Default)]
struct SubjectAdvice {
    line: Option<Name>,
    drive: Option<Name>,
    all: Vec<Finding>,
}

impl SubjectAdvice {
    fn say(&mut self, sign: FindingSign, text: Sentence) {
        self.say_graded(sign.severity(), sign, text);
    }

    fn say_graded(&mut self, severity: Severity, sign: FindingSign, text: Sentence) {
        let line = self.line.clone();
        let drive = self.drive.clone();
        self.all.push(Finding {
            severity,
            sign,
            line,
            drive,
            text,
        });
    }
}
