//! Hides what must not be shown of a configuration: its text is printed with its problems, and goes into diagnostics.

use std::ops::Range;
use toml::de::{DeTable, DeValue};

/// What begins the hash of a password.
const HASH: &str = "$argon2";
/// Parts of the names of keys whose values are secret. Names of files are not.
const SECRET_KEYS: [&str; 4] = ["password", "passphrase", "secret", "token"];

/// `text` with stars, byte for byte, in place of passwords that were put there by mistake, as a value or before the
/// host of a URL, and of the hashes of passwords. What is shown may end up in a log.
///
/// What a value is, the parser says: TOML has many ways to write one, some of them over several lines. Only comments, and
/// a text that is no TOML, are looked at line by line.
#[must_use]
pub fn without_secrets(text: &str) -> String {
    let (root, errors) = DeTable::parse_recoverable(text);
    let mut secrets = Secrets { text, spans: Vec::new() };
    secrets.look_at_table(root.get_ref(), false);
    let mut shown = text.to_owned();
    for span in secrets.spans {
        shown = starred(&shown, span);
    }
    by_line(&shown, !errors.is_empty())
}

/// The places of secrets in a parsed text.
struct Secrets<'a> {
    text: &'a str,
    spans: Vec<Range<usize>>,
}

impl Secrets<'_> {
    fn look_at_table(&mut self, table: &DeTable<'_>, is_secret: bool) {
        for (key, value) in table {
            if key.get_ref().contains(HASH) {
                self.spans.push(key.span());
            }
            self.look_at(value, is_secret || is_secret_key(key.get_ref()));
        }
    }

    fn look_at(&mut self, value: &toml::Spanned<DeValue<'_>>, is_secret: bool) {
        match value.get_ref() {
            DeValue::Table(table) => self.look_at_table(table, is_secret),
            DeValue::Array(values) => values.iter().for_each(|value| self.look_at(value, is_secret)),
            DeValue::Boolean(_) => {}
            DeValue::String(text) if !is_secret && !text.contains(HASH) => self.look_at_url(value.span(), text),
            _ if is_secret => self.spans.push(value.span()),
            DeValue::String(_) => self.spans.push(value.span()),
            _ => {}
        }
    }

    /// User and password of a URL, or all of it where they are not written as they are meant.
    fn look_at_url(&mut self, span: Range<usize>, value: &str) {
        let Some(user) = user_in(value).and_then(|user| value.get(user)) else { return };
        let written = self.text.get(span.clone()).and_then(|written| written.find(user));
        let place = written.map(|at| span.start + at..span.start + at + user.len());
        self.spans.push(place.unwrap_or(span));
    }
}

fn is_secret_key(key: &str) -> bool {
    let key = key.to_ascii_lowercase();
    SECRET_KEYS.iter().any(|word| key.contains(word)) && !key.ends_with("_file")
}

/// `text` with stars in place of `span`, line ends aside, so that all lines stay where they are.
fn starred(text: &str, span: Range<usize>) -> String {
    let (before, rest) = text.split_at_checked(span.start).unwrap_or((text, ""));
    let (secret, after) = rest.split_at_checked(span.len()).unwrap_or((rest, ""));
    let star = |c: char| if matches!(c, '\n' | '\r') { c.to_string() } else { "*".repeat(c.len_utf8()) };
    [before, &secret.chars().map(star).collect::<String>(), after].concat()
}

/// `text` without what looks like a secret in its comments, and if it `is_broken` elsewhere too.
fn by_line(text: &str, is_broken: bool) -> String {
    let mut goes_on = false;
    let lines = text.split_inclusive('\n').map(|line| {
        let is_comment = line.trim_start().starts_with('#');
        // The rest of a value that began in a line before.
        goes_on &= (is_broken || is_comment) && !begins_anew(line);
        if goes_on {
            return starred(line, 0..line.len());
        }
        let Some(span) = secret_in(line) else { return line.to_owned() };
        goes_on = true;
        starred(line, span)
    });
    lines.collect()
}

/// Whether `line` begins with a header or a key, also behind the mark of a comment.
fn begins_anew(line: &str) -> bool {
    let line = line.trim_start_matches([' ', '\t', '#']);
    let is_of_key = |c: char| c.is_ascii_lowercase() || c.is_ascii_digit() || matches!(c, '_' | '.');
    let key = line.split_once(" = ").map(|(key, _)| key.trim());
    line.starts_with('[') || key.is_some_and(|key| !key.is_empty() && key.chars().all(is_of_key))
}

/// What must not be shown of `line`: from a password or a hash to its end, or the user and password of a URL.
fn secret_in(line: &str) -> Option<Range<usize>> {
    if let Some(begin) = [password_in(line), line.find(HASH)].into_iter().flatten().min() {
        return Some(begin..line.trim_end().len());
    }
    user_in(line)
}

/// Where the user and the password before the host of a URL are.
fn user_in(text: &str) -> Option<Range<usize>> {
    let begin = text.find("://")? + 3;
    let end = text.rfind('@').filter(|end| *end > begin)?;
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

    /// What is shown of `text`, in which every secret has the word `hunter`.
    fn shown(text: &str) -> String {
        let shown = without_secrets(text);
        assert_eq!(shown.len(), text.len());
        assert_eq!(shown.matches('\n').count(), text.matches('\n').count());
        assert!(!shown.contains("hunter") && !shown.contains("ünter"), "{shown}");
        shown
    }

    #[test]
    fn passwords_are_not_shown() {
        let shown = shown(
            "password = \"hunter2\"\nbroker = \"mqtt://user:hünter@host\" # x\npassword_file = \"/run/pw\"\n\
             password_hash = \"$argon2id$v=19$hunter\"\nlist = [{ name = \"a\", password_hash = \"hunter3\" }]\n\
             allow_plain_password = true\n[x]\n\"password\" = \"hunter4\"\n\"$argon2id$v=19$hunter5\" = 1\n",
        );
        assert!(!shown.contains("user") && shown.contains("@host\" # x") && shown.contains("/run/pw"), "{shown}");
        assert!(shown.contains("name = \"a\"") && shown.contains("allow_plain_password = true"), "{shown}");
    }

    #[test]
    fn a_value_is_hidden_in_every_way_to_write_it() {
        for value in [
            "\"\"\"$argon2id$v=19$m=1$\\\n    hunter2\\\n  hunter3\"\"\"",
            "'''\n$argon2id$v=19$\nhunter2 = \"x\"\nkey = hunter3\n'''",
            "\"\\u0024argon2id$v=19$hunter2\"",
            "\"hunter#2\"",
            "[\n  \"hunter2\",\n  \"hunter3\",\n]",
        ] {
            for key in ["password_hash", "\"password\"", "\"pass\\u0077ord\"", "a.password", "api_token"] {
                let shown = shown(&format!("name = \"a\"\n{key} = {value}\nafter = 7\n"));
                assert!(shown.contains("name = \"a\"") && shown.ends_with("\nafter = 7\n"), "{shown}");
            }
            shown(&format!("list = [{{ name = \"a\", password_hash = {value} }},\n {{ name = \"b\" }}]\n"));
        }
        // A hash shows itself under any key, and a URL with an escaped sign in its user.
        shown("note = \"\"\"$argon2id$v=19$\\\n    hunter2\"\"\"\n");
        shown("broker = \"mqtt://us\\u0065r:hunter2@host\"\n");
    }

    #[test]
    fn a_comment_hides_nothing_less() {
        let shown =
            shown("# password_hash = \"\"\"$argon2id$v=19$\\\n#   hunter2\"\"\"\n# baud = 9600\nbaud = 1\n# text\n");
        assert!(shown.ends_with("# baud = 9600\nbaud = 1\n# text\n"), "{shown}");
    }

    #[test]
    fn a_text_that_is_no_toml_hides_the_rest_of_a_value_too() {
        let begun = "name = \"a\"\nx = \npassword_hash = \"\"\"$argon2id$v=19$\\\n  hunter2=\"\"\"\n";
        for end in ["[[line]]\nname = \"b\"\n", "baud = 9600\n"] {
            let shown = shown(&format!("{begun}{end}"));
            assert!(shown.starts_with("name = \"a\"") && shown.ends_with(end), "{shown}");
        }
        shown("password = \"hunter2\n");
        shown("password = hunter2\n");
    }
}
