//! The file with the users of a fleet, one `user:password` on each line.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use vfd_gateway::cli::tools::{CommandFailure, input};
use vfd_gateway::daemon::mqtt::HiddenText;

/// Users with their passwords.
#[derive(Debug)]
pub struct Credentials {
    path: PathBuf,
    users: BTreeMap<String, HiddenText>,
}

impl Credentials {
    /// Reads the file. Empty lines and those that begin with `#` are ignored.
    pub fn read(path: &Path) -> Result<Self, CommandFailure> {
        let text = input::read(path)?;
        let users = parse(&text).map_err(|line| {
            // The line is not shown: it may contain a password.
            CommandFailure::wrong(format!(
                "{}:{line}: not of the form `user:password`",
                path.display()
            ))
        })?;
        Ok(Self {
            path: path.to_owned(),
            users,
        })
    }

    /// The password of a user.
    pub fn of(&self, user: &str) -> Result<HiddenText, CommandFailure> {
        let password = self.users.get(user).cloned();
        password.ok_or_else(|| {
            CommandFailure::wrong(format!(
                "{}: no line for the user {user}",
                self.path.display()
            ))
        })
    }
}

/// The users, or the number of the first invalid line.
fn parse(text: &str) -> Result<BTreeMap<String, HiddenText>, usize> {
    let lines = (1_usize..)
        .zip(text.lines())
        .filter(|(_, line)| !line.trim().is_empty() && !line.starts_with('#'));
    lines
        .map(|(number, line)| {
            let (user, password) = line.split_once(':').ok_or(number)?;
            Ok((user.to_owned(), HiddenText::new(password.to_owned())))
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_line_is_a_user_with_a_password_that_may_hold_colons() {
        let users = parse("# fleet\ngw-0001:a:b\n\nhistorian:x\n").unwrap();
        let found: Vec<_> = users
            .iter()
            .map(|(user, password)| (user.as_str(), password.expose()))
            .collect();
        assert_eq!(found, [("gw-0001", "a:b"), ("historian", "x")]);
        assert_eq!(parse("a:b\nsecret\n").unwrap_err(), 2);
    }
}
