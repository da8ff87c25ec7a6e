//! Hides what must not be shown of a configuration: its text is printed with its problems, and goes into diagnostics.

use std::ops::Range;

/// `text` with stars, byte for byte, in place of passwords that were put there by mistake, as a value or before the
/// host of a URL, and of the hashes of passwords. What is shown may end up in a log.
#[must_use]
pub fn without_secrets(text: &str) -> String {
    let lines = text.split_inclusive('\n').map(|line| match secret_in(line) {
        Some(span) => format!("{}{}{}", &line[..span.start], "*".repeat(span.len()), &line[span.end..]),
        None => line.to_owned(),
    });
    lines.collect()
}

/// What must not be shown of `line`: from a password or a hash to its end, or the user and password of a URL.
fn secret_in(line: &str) -> Option<Range<usize>> {
    if let Some(begin) = [password_in(line), line.find("$argon2")].into_iter().flatten().min() {
        return Some(begin..line.trim_end().len());
    }
    let begin = line.find("://")? + 3;
    let end = line.rfind('@').filter(|end| *end > begin)?;
    Some(begin..end)
}

/// Where the value of the first key `password` or `password_hash` begins, also in an inline table and in quotes.
fn password_in(line: &str) -> Option<usize> {
    line.match_indices("password").find_map(|(at, word)| {
        let is_whole = !line[..at].ends_with(|before: char| before == '_' || before.is_alphanumeric());
        let rest = &line[at + word.len()..];
        let rest = rest.strip_prefix("_hash").unwrap_or(rest);
        let value = rest.trim_start_matches(['"', '\'']).trim_start().strip_prefix('=')?;
        is_whole.then_some(line.len() - value.len())
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn passwords_are_not_shown() {
        let text = "password = \"hunter2\"\nbroker = \"mqtt://user:hünter@host\" # x\npassword_file = \"/run/pw\"\n\
                    password_hash = \"$argon2id$v=19$hunter\"\nlist = [{ name = \"a\", password_hash = \"hunter3\" }]\n\
                    \"password\" = \"hunter4\"\n\"$argon2id$v=19$hunter5\"\nallow_plain_password = true\n";
        let shown = without_secrets(text);
        assert_eq!(shown.len(), text.len());
        assert!(!shown.contains("hunter") && !shown.contains("user") && !shown.contains("ünter"), "{shown}");
        assert!(shown.contains("@host") && shown.contains("/run/pw"));
        assert!(shown.contains("name = \"a\"") && shown.contains("allow_plain_password = true"), "{shown}");
    }
}
