//! The query of a request, after `?`: known keys, each at most once.

use std::collections::BTreeMap;
use std::ops::RangeInclusive;

/// Longest query in bytes: room for some names and a time.
const BYTES_MAX: usize = 1024;

/// Keys with their values.
#[derive(Debug)]
pub struct QueryKeys(BTreeMap<String, String>);

impl QueryKeys {
    /// Parses `query`, whose keys must be among `known`.
    ///
    /// # Errors
    /// What is wrong with it, for people.
    pub fn read(query: Option<&str>, known: &[&str]) -> Result<Self, String> {
        let query = query.unwrap_or_default();
        if query.len() > BYTES_MAX {
            return Err(format!("the query is longer than {BYTES_MAX} bytes"));
        }
        let mut values = BTreeMap::new();
        for (key, value) in form_urlencoded::parse(query.as_bytes()) {
            if !known.contains(&key.as_ref()) {
                return Err(format!(
                    "unknown key `{key}`; expected {}",
                    known.join(" or ")
                ));
            }
            if values
                .insert(key.clone().into_owned(), value.into_owned())
                .is_some()
            {
                return Err(format!("`{key}` is given twice"));
            }
        }
        Ok(Self(values))
    }

    /// The seconds in `query`, which has no other key; `None` if it names none.
    ///
    /// # Errors
    /// What is wrong with it, for people.
    pub fn seconds(
        query: Option<&str>,
        range: &RangeInclusive<u64>,
    ) -> Result<Option<u64>, String> {
        let (first, last) = (range.start(), range.end());
        let expected = || format!("seconds={first} to seconds={last} is expected");
        let keys = Self::read(query, &["seconds"]).map_err(|_| expected())?;
        let Some(text) = keys.0.get("seconds") else {
            return Ok(None);
        };
        match text.parse() {
            Ok(seconds) if range.contains(&seconds) => Ok(Some(seconds)),
            _ => Err(expected()),
        }
    }

    /// The value of `key`; `None` if it is missing or empty.
    pub fn get(&self, key: &str) -> Option<&str> {
        self.0
            .get(key)
            .map(String::as_str)
            .filter(|value| !value.is_empty())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn known_keys_are_read_and_others_named() {
        let known = ["drive", "since"];
        let query = QueryKeys::read(Some("since=2026-01-31T08%3A00&drive="), &known).unwrap();
        assert_eq!(
            (query.get("since"), query.get("drive")),
            (Some("2026-01-31T08:00"), None)
        );
        assert!(
            QueryKeys::read(None, &known)
                .unwrap()
                .get("drive")
                .is_none()
        );
        let wrong = QueryKeys::read(Some("drives=a"), &known).unwrap_err();
        assert_eq!(wrong, "unknown key `drives`; expected drive or since");
        assert_eq!(
            QueryKeys::read(Some("drive=a&drive=b"), &known).unwrap_err(),
            "`drive` is given twice"
        );
        assert!(
            QueryKeys::read(Some(&"x".repeat(1025)), &known)
                .unwrap_err()
                .contains("longer")
        );
    }
}
