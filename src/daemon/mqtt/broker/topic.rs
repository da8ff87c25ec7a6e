//! Topic names and filters.

/// Most levels of a filter: subscriptions are a tree of this depth.
const LEVELS_MAX: usize = 128;

/// Whether `topic` is a valid topic name.
pub fn is_name(topic: &str) -> bool {
    !topic.is_empty() && !topic.contains(['+', '#', '\0'])
}

/// A valid filter, possibly of a group that shares its messages.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct TopicFilter<'a> {
    pub group: Option<&'a str>,
    pub levels: &'a str,
}

impl<'a> TopicFilter<'a> {
    /// `None` if `text` is not a valid filter.
    pub fn new(text: &'a str) -> Option<Self> {
        let (group, levels) = match text.strip_prefix("$share/") {
            Some(rest) => {
                let (group, levels) = rest.split_once('/')?;
                (Some(group), levels)
            }
            None if text == "$share" => return None,
            None => (None, text),
        };
        let is_group = group.is_none_or(|name| !name.is_empty() && !name.contains(['+', '#']));
        (is_group && is_filter(levels)).then_some(Self { group, levels })
    }
}

fn is_filter(text: &str) -> bool {
    let mut levels = text.split('/').rev();
    let last = levels.next().unwrap_or_default();
    let is_level = |level: &str| level == "+" || !level.contains(['+', '#']);
    !text.is_empty()
        && text.split('/').count() <= LEVELS_MAX
        && (last == "#" || is_level(last))
        && levels.all(is_level)
}

/// Whether `topic` matches `filter`. Wildcards at the beginning do not match topics that begin with `$`.
pub fn matches(filter: &str, topic: &str) -> bool {
    if topic.starts_with('$') && filter.starts_with(['+', '#']) {
        return false;
    }
    let mut levels = topic.split('/');
    for wanted in filter.split('/') {
        if wanted == "#" {
            return true;
        }
        match levels.next() {
            Some(level) if wanted == "+" || wanted == level => {}
            _ => return false,
        }
    }
    levels.next().is_none()
}

/// The common prefix of all topics that match `filter`.
pub fn literal(filter: &str) -> &str {
    let literal = filter.find(['+', '#']).map_or(filter, |at| &filter[..at]);
    // `a/#` also matches `a`.
    if filter.ends_with('#') {
        literal.strip_suffix('/').unwrap_or(literal)
    } else {
        literal
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Filter, topic, whether they match: the examples of the specification, and others.
    pub const MATCHES: &[(&str, &str, bool)] = &[
        ("sport/tennis/player1/#", "sport/tennis/player1", true),
        (
            "sport/tennis/player1/#",
            "sport/tennis/player1/ranking",
            true,
        ),
        (
            "sport/tennis/player1/#",
            "sport/tennis/player1/score/wimbledon",
            true,
        ),
        ("sport/#", "sport", true),
        ("sport/#", "sports", false),
        ("#", "a/b", true),
        ("#", "/", true),
        ("sport/tennis/+", "sport/tennis/player1", true),
        ("sport/tennis/+", "sport/tennis/player1/ranking", false),
        ("sport/+", "sport", false),
        ("sport/+", "sport/", true),
        ("+/+", "/finance", true),
        ("/+", "/finance", true),
        ("+", "/finance", false),
        ("#", "$SYS/x", false),
        ("+/monitor/Clients", "$SYS/monitor/Clients", false),
        ("$SYS/#", "$SYS/x", true),
        ("$SYS/#", "$SYS", true),
        ("$SYS/monitor/+", "$SYS/monitor/Clients", true),
        ("a/+/c", "a/b/c", true),
        ("a/+/c", "a/b/d", false),
        ("a//c", "a//c", true),
        ("a/+/#", "a/b", true),
        ("a/b", "a/b/c", false),
        ("ä/+", "ä/ö", true),
    ];

    #[test]
    fn filters_match_as_the_specification_says() {
        for (filter, topic, expected) in MATCHES {
            assert_eq!(matches(filter, topic), *expected, "{filter} {topic}");
            assert!(
                !expected || topic.starts_with(literal(filter)),
                "{filter} {topic}"
            );
        }
    }

    #[test]
    fn wrong_filters_and_names_are_refused() {
        for wrong in [
            "",
            "a#",
            "a/#/b",
            "a+",
            "a/+b/c",
            "##",
            "$share",
            "$share/g",
            "$share//a",
            "$share/g+/a",
        ] {
            assert_eq!(TopicFilter::new(wrong), None, "{wrong}");
        }
        assert_eq!(TopicFilter::new("$share/g/"), None);
        assert_eq!(
            TopicFilter::new("$share/g/a/#"),
            Some(TopicFilter {
                group: Some("g"),
                levels: "a/#"
            })
        );
        for right in ["/", "+", "#", "a/+/+/#", "$SYS/#", "a b", "//"] {
            assert_eq!(
                TopicFilter::new(right),
                Some(TopicFilter {
                    group: None,
                    levels: right
                }),
                "{right}"
            );
        }
        assert!(TopicFilter::new(&"/".repeat(LEVELS_MAX - 1)).is_some());
        assert_eq!(TopicFilter::new(&"/".repeat(LEVELS_MAX)), None);
        assert!(is_name("a/b") && is_name("/") && !is_name("") && !is_name("a/+") && !is_name("#"));
    }
}
