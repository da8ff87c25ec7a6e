//! Hides what must not be shown of a configuration: its text is printed with its problems, and goes into diagnostics.

use crate::domain::problem::{Problem, nearest};
use std::ops::Range;
use toml::de::{DeTable, DeValue};

/// What begins the hash of a password.
const HASH: &str = "$argon2";
/// What every private key has in its first line.
const PRIVATE_KEY: &str = "PRIVATE KEY-----";
/// Parts of the names of keys whose values are secret. That of `key_file` is one if the key itself was put there.
const SECRET_KEYS: [&str; 5] = ["password", "passphrase", "secret", "token", "key_file"];
/// A shorter secret is hidden in a message only where it stands as a word: it may be a part of any other.
const WORD_LEAST: usize = 4;
/// What stands in a message for a secret.
const HIDDEN: &str = "***";

/// `text` with stars, byte for byte, in place of passwords that were put there by mistake, as a value or before the
/// host of a URL, and of the hashes of passwords. What is shown may end up in a log.
///
/// What a value is, the parser says: TOML has many ways to write one, some of them over several lines. Only comments, and
/// a text that is no TOML, are looked at line by line.
#[must_use]
pub fn without_secrets(text: &str) -> String {
    let (secrets, is_broken) = TextSecrets::of(text);
    let mut shown = text.to_owned();
    for span in secrets.spans {
        shown = starred(&shown, span);
    }
    by_line(&shown, is_broken)
}

/// Hides the secrets of `text` in its `problems`, which may repeat a value.
pub(super) fn hide_in(problems: &mut [Problem], text: &str) {
    let words = TextSecrets::of(text).0.words;
    for problem in problems {
        let Problem {
            key, what, right, ..
        } = problem;
        for said in [what].into_iter().chain(right) {
            *said = words
                .iter()
                .fold(std::mem::take(said), |said, word| without_word(said, word));
        }
        // The names of keys may be words of values. Only a hash is a secret there.
        let hashes = words.iter().filter(|word| word.contains(HASH));
        *key = hashes.fold(std::mem::take(key), |said, word| without_word(said, word));
    }
}

/// `said` without `secret`, in capitals or not.
fn without_word(mut said: String, secret: &str) -> String {
    let lower = secret.to_ascii_lowercase();
    let mut from = 0;
    while let Some(at) = said
        .get(from..)
        .and_then(|rest| rest.to_ascii_lowercase().find(&lower))
    {
        let place = from + at..from + at + lower.len();
        let (before, after) = (
            said[..place.start].chars().next_back(),
            said[place.end..].chars().next(),
        );
        let is_part = [before, after]
            .into_iter()
            .flatten()
            .any(char::is_alphanumeric);
        if is_part && secret.len() < WORD_LEAST {
            from = place.end;
        } else {
            from = place.start + HIDDEN.len();
            said.replace_range(place, HIDDEN);
        }
    }
    said
}

/// The secrets of a parsed text.
struct TextSecrets<'a> {
    text: &'a str,
    /// Places of the secrets in the text.
    spans: Vec<Range<usize>>,
    /// What they are, as it is meant and as it is written in a message; the longest first.
    words: Vec<String>,
}

impl<'a> TextSecrets<'a> {
    /// The secrets of `text`, and whether it is no TOML.
    fn of(text: &'a str) -> (Self, bool) {
        let (root, errors) = DeTable::parse_recoverable(text);
        let mut secrets = Self {
            text,
            spans: Vec::new(),
            words: Vec::new(),
        };
        secrets.look_at_table(root.get_ref(), false);
        secrets.words.retain(|word| !word.is_empty());
        secrets
            .words
            .sort_by_key(|word| std::cmp::Reverse(word.len()));
        (secrets, !errors.is_empty())
    }

    fn look_at_table(&mut self, table: &DeTable<'_>, is_secret: bool) {
        for (key, value) in table {
            if key.get_ref().contains(HASH) {
                self.hide(key.span(), key.get_ref());
            }
            let is_name = value
                .get_ref()
                .as_str()
                .is_some_and(|value| names_a_secret(key.get_ref(), value));
            self.look_at(value, is_secret || is_secret_key(key.get_ref()) && !is_name);
        }
    }

    fn look_at(&mut self, value: &toml::Spanned<DeValue<'_>>, is_secret: bool) {
        match value.get_ref() {
            DeValue::Table(table) => self.look_at_table(table, is_secret),
            DeValue::Array(values) => values
                .iter()
                .for_each(|value| self.look_at(value, is_secret)),
            DeValue::Boolean(_) => {}
            DeValue::String(text)
                if is_secret || text.contains(HASH) || text.contains(PRIVATE_KEY) =>
            {
                self.hide(value.span(), text)
            }
            DeValue::String(text) => self.look_at_url(value.span(), text),
            _ if is_secret => {
                let written = self.text.get(value.span()).unwrap_or_default();
                self.hide(value.span(), written);
            }
            _ => {}
        }
    }

    fn hide(&mut self, span: Range<usize>, secret: &str) {
        self.spans.push(span);
        self.words.extend([
            secret.trim().to_owned(),
            secret.trim().escape_debug().to_string(),
        ]);
        // A message has the lines of a value beside each other.
        if secret.trim().contains('\n') {
            let lines = secret.lines().map(|line| line.trim().to_owned());
            self.words.extend(lines);
        }
    }

    /// The user, the password and the query of a URL, or all of it where they are not written as they are meant.
    fn look_at_url(&mut self, span: Range<usize>, value: &str) {
        for secret in [user_in_value(value), query_in(value)]
            .into_iter()
            .flatten()
        {
            let written = self
                .text
                .get(span.clone())
                .and_then(|written| written.find(secret));
            let place = written.map(|at| span.start + at..span.start + at + secret.len());
            self.hide(place.unwrap_or_else(|| span.clone()), secret);
            // A message may name a part.
            self.words.extend(
                secret
                    .split([':', '@', '&', '='])
                    .skip(1)
                    .map(str::to_owned),
            );
        }
    }
}

/// Whether the `value` of `key` may be the name of a file or of a variable, and not what belongs there.
fn names_a_secret(key: &str, value: &str) -> bool {
    let is_of_variable =
        |byte: u8| byte.is_ascii_uppercase() || byte.is_ascii_digit() || byte == b'_';
    (key.ends_with("_file") && value.starts_with('/'))
        || (key.ends_with("_env") && value.bytes().all(is_of_variable))
}

/// Whether `key` is or may be meant as one whose value is secret.
fn is_secret_key(key: &str) -> bool {
    let key = key.to_ascii_lowercase();
    // Short words are near to many.
    let is_misspelt = |part: &str| part.len() > 4 && nearest(part, SECRET_KEYS).is_some();
    let is_near =
        |part: &str| is_misspelt(part) || ["pass", "pw"].iter().any(|it| part.starts_with(it));
    SECRET_KEYS.iter().any(|word| key.contains(word))
        || key.split(['_', '-', '.', ' ']).any(is_near)
}

/// The user and the password before the host, also where the scheme is misspelt.
fn user_in_value(value: &str) -> Option<&str> {
    value.get(user_in(value).unwrap_or(0..value.rfind('@')?))
}

/// The query of a URL.
fn query_in(value: &str) -> Option<&str> {
    value
        .split_once('?')
        .map(|(_, query)| query)
        .filter(|query| !query.is_empty())
}

/// `text` with stars in place of `span`, line ends aside, so that all lines stay where they are.
fn starred(text: &str, span: Range<usize>) -> String {
    let (before, rest) = text.split_at_checked(span.start).unwrap_or((text, ""));
    let (secret, after) = rest.split_at_checked(span.len()).unwrap_or((rest, ""));
    let star = |c: char| {
        if matches!(c, '\n' | '\r') {
            c.to_string()
        } else {
            "*".repeat(c.len_utf8())
        }
    };
    [before, &secret.chars().map(star).collect::<String>(), after].concat()
}

/// `text` without what looks like a secret in its comments, and if it `is_broken` elsewhere too.
fn by_line(text: &str, is_broken: bool) -> String {
    let mut goes_on = false;
    let lines = text.split_inclusive('\n').map(|line| {
        let is_comment = line.trim_start().starts_with('#');
        // The rest of a value that began in a line before.
        goes_on &= (is_broken || is_comment) && !begins_entry(line);
        if goes_on {
            return starred(line, 0..line.len());
        }
        let Some(span) = secret_in(line) else {
            return line.to_owned();
        };
        goes_on = true;
        starred(line, span)
    });
    lines.collect()
}

/// Whether `line` begins with a header or a key, also behind the mark of a comment.
fn begins_entry(line: &str) -> bool {
    let line = line.trim_start_matches([' ', '\t', '#']);
    let is_of_key =
        |c: char| c.is_ascii_lowercase() || c.is_ascii_digit() || matches!(c, '_' | '.');
    let key = line.split_once(" = ").map(|(key, _)| key.trim());
    line.starts_with('[') || key.is_some_and(|key| !key.is_empty() && key.chars().all(is_of_key))
}

/// What must not be shown of `line`: from a password or a hash to its end, or the user and password of a URL.
fn secret_in(line: &str) -> Option<Range<usize>> {
    let begins = [HASH, PRIVATE_KEY].map(|secret| line.find(secret));
    if let Some(begin) = [password_in(line)]
        .into_iter()
        .chain(begins)
        .flatten()
        .min()
    {
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
        let is_whole =
            !line[..at].ends_with(|before: char| before == '_' || before.is_alphanumeric());
        let rest = &line[at + word.len()..];
        let rest = rest.strip_prefix("_hash").unwrap_or(rest);
        let value = rest
            .trim_start_matches(['"', '\''])
            .trim_start()
            .strip_prefix('=')?;
        is_whole.then_some(line.len() - value.len())
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    const PEM: &str =
        "-----BEGIN PRIVATE KEY-----\nhunter2\nhunter3==\n-----END PRIVATE KEY-----\n";

    /// What is shown of `text`, in which every secret has the word `hunter`.
    fn shown(text: &str) -> String {
        let shown = without_secrets(text);
        assert_eq!(shown.len(), text.len());
        assert_eq!(shown.matches('\n').count(), text.matches('\n').count());
        assert!(
            !shown.contains("hunter") && !shown.contains("ünter"),
            "{shown}"
        );
        shown
    }

    #[test]
    fn passwords_are_not_shown() {
        let shown = shown(
            "password = \"hunter2\"\nbroker = \"mqtt://user:hünter@host\" # x\npassword_file = \"/run/pw\"\n\
             password_hash = \"$argon2id$v=19$hunter\"\nlist = [{ name = \"a\", password_hash = \"hunter3\" }]\n\
             allow_plain_password = true\n[x]\n\"password\" = \"hunter4\"\n\"$argon2id$v=19$hunter5\" = 1\n",
        );
        assert!(
            !shown.contains("user") && shown.contains("@host\" # x") && shown.contains("/run/pw"),
            "{shown}"
        );
        assert!(
            shown.contains("name = \"a\"") && shown.contains("allow_plain_password = true"),
            "{shown}"
        );
    }

    #[test]
    fn no_message_repeats_what_is_or_may_be_a_secret() {
        let line = "[[line]]\nname = \"a\"\nport = \"PORT\"\n[[line.drive]]\nname = \"d\"\nmodel = \"hyundai-n700\"\nstation = 1\n";
        let http = "[http]\nlisten = \"127.0.0.1:8080\"\n[[http.users]]\nname = \"anna\"\n";
        let port = |port: &str| line.replace("PORT", port);
        let usual = port("/dev/ttyUSB0");
        for text in [
            port("tcp://u:Hunter2@127.0.0.1:4001"),
            port("tcp://u:Hunter2@127.0.0.1:4001x"),
            port("tcp//u:hunter2@127.0.0.1"),
            format!("{usual}[mqtt]\nbroker = \"mqtt://host:1883?password=hunter2\"\n"),
            format!(
                "{usual}[mqtt]\nbroker = \"mqtt:user:hunter2@broker\"\nalso_at = [\"mqtt://x:hunter3@y:z\"]\n"
            ),
            format!(
                "{usual}[mqtt]\nbroker = \"mqtt://host\"\nuser = \"u\"\npassword_file = \"hunter2\"\n"
            ),
            format!(
                "{usual}[mqtt]\nbroker = \"mqtt://host\"\nuser = \"u\"\npassword_env = \"hunter2 x\"\n"
            ),
            format!(
                "{usual}[mqtt]\nbroker = \"mqtt://host\"\nuser = \"u\"\npasword = \"hunter2\"\n"
            ),
            format!("{usual}{http}pasword_hash = \"hunter2\"\npw = \"hunter3\"\n"),
            format!("{usual}{http}password_hash = \"hunter2\"\n"),
            format!("{usual}{http}password_hash_file = \"hunter2\"\n"),
            format!("{usual}{http}[http.tls]\ncert_file = \"/c\"\nkey_file = \"hunter2\"\n"),
            format!(
                "{usual}{http}[http.tls]\ncert_file = \"/c\"\nkey_file = \"\"\"\n{PEM}\"\"\"\n"
            ),
            format!("{usual}{http}[http.tls]\ncert_file = \"\"\"{PEM}\"\"\"\nkey_file = \"/k\"\n"),
            format!("{usual}{http}# {}", PEM.replace('\n', "\n# ")),
            format!("{usual}{http}[http.tls]\ncert_file = \"\"\"{PEM}"),
        ] {
            shown(&text);
            let problems = crate::config::load(&text, &crate::vendors::catalog()).unwrap_err();
            let said = format!("{problems:?}").to_lowercase();
            assert!(!said.contains("hunter2"), "{text}: {said}");
        }
        let known = crate::config::file::reference::names().into_iter();
        let known = known.filter(|key| is_secret_key(key));
        assert!(
            known
                .clone()
                .all(|key| key.contains("password") || key.ends_with("key_file")),
            "{:?}",
            known.collect::<Vec<_>>()
        );
        let file = "password_file = \"/run/secrets/mqtt\"\n";
        assert_eq!(without_secrets(file), file);
    }

    #[test]
    fn a_short_secret_is_hidden_as_a_word() {
        assert_eq!(
            without_word("`ab` is no table".to_owned(), "ab"),
            "`***` is no table"
        );
        assert_eq!(
            without_word("Hunter2 and hunter2s".to_owned(), "hunter2"),
            "*** and ***s"
        );
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
            for key in [
                "password_hash",
                "\"password\"",
                "\"pass\\u0077ord\"",
                "a.password",
                "api_token",
            ] {
                let shown = shown(&format!("name = \"a\"\n{key} = {value}\nafter = 7\n"));
                assert!(
                    shown.contains("name = \"a\"") && shown.ends_with("\nafter = 7\n"),
                    "{shown}"
                );
            }
            shown(&format!(
                "list = [{{ name = \"a\", password_hash = {value} }},\n {{ name = \"b\" }}]\n"
            ));
        }
        // A hash shows itself under any key, and a URL with an escaped sign in its user.
        shown("note = \"\"\"$argon2id$v=19$\\\n    hunter2\"\"\"\n");
        shown("broker = \"mqtt://us\\u0065r:hunter2@host\"\n");
    }

    #[test]
    fn a_comment_hides_nothing_less() {
        let shown = shown(
            "# password_hash = \"\"\"$argon2id$v=19$\\\n#   hunter2\"\"\"\n# baud = 9600\nbaud = 1\n# text\n",
        );
        assert!(
            shown.ends_with("# baud = 9600\nbaud = 1\n# text\n"),
            "{shown}"
        );
    }

    #[test]
    fn a_text_that_is_no_toml_hides_the_rest_of_a_value_too() {
        let begun =
            "name = \"a\"\nx = \npassword_hash = \"\"\"$argon2id$v=19$\\\n  hunter2=\"\"\"\n";
        for end in ["[[line]]\nname = \"b\"\n", "baud = 9600\n"] {
            let shown = shown(&format!("{begun}{end}"));
            assert!(
                shown.starts_with("name = \"a\"") && shown.ends_with(end),
                "{shown}"
            );
        }
        shown("password = \"hunter2\n");
        shown("password = hunter2\n");
    }
}
