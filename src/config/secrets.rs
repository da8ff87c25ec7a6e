//! Hides what must not be shown of a configuration: its text is printed with its problems, and goes into diagnostics.

/// `text` with stars, byte for byte, in place of passwords that were put there by mistake, as a value or before the
/// host of a URL, and of the hashes of passwords. What is shown may end up in a log.
#[must_use]
pub fn without_secrets(text: &str) -> String {
    let lines = text.split_inclusive('\n').map(|line| {
        let secret = if is_password(line) {
            line.find('=').map(|at| at + 1..line.trim_end().len())
        } else {
            line.find("://").and_then(|at| Some(at + 3..line.rfind('@').filter(|end| *end > at + 3)?))
        };
        secret.map_or_else(
            || line.to_owned(),
            |span| format!("{}{}{}", &line[..span.start], "*".repeat(span.len()), &line[span.end..]),
        )
    });
    lines.collect()
}

/// Whether `line` sets a password or the hash of one.
fn is_password(line: &str) -> bool {
    let Some(rest) = line.trim_start().strip_prefix("password") else { return false };
    rest.strip_prefix("_hash").unwrap_or(rest).trim_start().starts_with('=')
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn passwords_are_not_shown() {
        let text = "password = \"hunter2\"\nbroker = \"mqtt://user:hünter@host\" # x\npassword_file = \"/run/pw\"\n\
                    password_hash = \"$argon2id$v=19$hunter\"\n";
        let shown = without_secrets(text);
        assert_eq!(shown.len(), text.len());
        assert!(!shown.contains("hunter") && !shown.contains("user") && !shown.contains("ünter"), "{shown}");
        assert!(shown.contains("@host") && shown.contains("/run/pw"));
    }
}
