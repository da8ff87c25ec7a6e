//! Subscriptions as a tree of levels, so that a message is compared only with those that may match.

use super::packet::SubscriptionOptions;
use super::session::SessionId;
use super::topic::TopicFilter;
use std::collections::{BTreeMap, HashMap};

/// Members of one filter.
pub type Members = BTreeMap<SessionId, SubscriptionOptions>;

/// All subscriptions.
#[derive(Debug, Default)]
pub struct SubscriptionTree {
    root: TopicNode,
}

#[derive(Debug, Default)]
struct TopicNode {
    below: HashMap<Box<str>, Self>,
    members: Members,
    groups: BTreeMap<Box<str>, Members>,
}

/// Receivers of a message: each of these members, or one of a group.
#[derive(Clone, Copy, Debug)]
pub enum MessageTaker<'a> {
    Each(&'a Members),
    OneOf(&'a Members),
}

impl SubscriptionTree {
    /// Subscribes; returns whether it is new.
    pub fn insert(
        &mut self,
        filter: TopicFilter<'_>,
        session: SessionId,
        options: SubscriptionOptions,
    ) -> bool {
        let mut node = &mut self.root;
        for level in filter.levels.split('/') {
            node = node.below.entry(level.into()).or_default();
        }
        let members = match filter.group {
            Some(group) => node.groups.entry(group.into()).or_default(),
            None => &mut node.members,
        };
        members.insert(session, options).is_none()
    }

    /// Ends a subscription; returns whether there was one.
    pub fn remove(&mut self, filter: TopicFilter<'_>, session: SessionId) -> bool {
        remove(
            &mut self.root,
            filter.levels.split('/'),
            filter.group,
            session,
        )
    }

    /// The receivers whose filters match `topic`.
    pub fn takers(&self, topic: &str) -> Vec<MessageTaker<'_>> {
        let levels: Vec<&str> = topic.split('/').collect();
        let mut found = Vec::new();
        let mut open = vec![(&self.root, 0)];
        while let Some((node, depth)) = open.pop() {
            let has_wildcards = depth > 0 || !topic.starts_with('$');
            if has_wildcards && let Some(rest) = node.below.get("#") {
                rest.add_to(&mut found);
            }
            let Some(level) = levels.get(depth) else {
                node.add_to(&mut found);
                continue;
            };
            if has_wildcards && let Some(any) = node.below.get("+") {
                open.push((any, depth + 1));
            }
            if let Some(next) = node.below.get(*level) {
                open.push((next, depth + 1));
            }
        }
        found
    }
}

impl TopicNode {
    fn add_to<'a>(&'a self, found: &mut Vec<MessageTaker<'a>>) {
        if !self.members.is_empty() {
            found.push(MessageTaker::Each(&self.members));
        }
        found.extend(self.groups.values().map(MessageTaker::OneOf));
    }

    fn is_empty(&self) -> bool {
        self.below.is_empty() && self.members.is_empty() && self.groups.is_empty()
    }
}

/// Removes a subscription below `node`, and each level that is no longer needed. The recursion is as deep as filters
/// are long, which is bounded.
fn remove<'a>(
    node: &mut TopicNode,
    mut levels: impl Iterator<Item = &'a str>,
    group: Option<&str>,
    session: SessionId,
) -> bool {
    let Some(level) = levels.next() else {
        return remove_here(node, group, session);
    };
    let Some(next) = node.below.get_mut(level) else {
        return false;
    };
    let is_removed = remove(next, levels, group, session);
    if next.is_empty() {
        node.below.remove(level);
    }
    is_removed
}

fn remove_here(node: &mut TopicNode, group: Option<&str>, session: SessionId) -> bool {
    let Some(group) = group else {
        return node.members.remove(&session).is_some();
    };
    let Some(members) = node.groups.get_mut(group) else {
        return false;
    };
    let is_removed = members.remove(&session).is_some();
    if members.is_empty() {
        node.groups.remove(group);
    }
    is_removed
}

#[cfg(test)]
mod tests {
    use super::super::packet::PacketQos;
    use super::super::topic;
    use super::*;

    const OPTIONS: SubscriptionOptions = SubscriptionOptions {
        qos: PacketQos::AtMostOnce,
        no_local: false,
        as_published: false,
        identifier: None,
    };

    fn filter(text: &str) -> TopicFilter<'_> {
        TopicFilter::new(text).unwrap()
    }

    fn count(tree: &SubscriptionTree, topic: &str) -> usize {
        tree.takers(topic)
            .iter()
            .map(|taker| {
                if let MessageTaker::Each(members) = taker {
                    members.len()
                } else {
                    1
                }
            })
            .sum()
    }

    #[test]
    fn the_tree_finds_what_each_filter_matches() {
        let filters = [
            "a/b", "a/+", "a/#", "#", "+/+", "+", "$SYS/#", "$SYS/+", "/", "/+", "a/+/c", "+/b/#",
        ];
        let topics = [
            "a", "a/b", "a/b/c", "/", "$SYS", "$SYS/x", "$SYS/x/y", "b", "a//c", "/x",
        ];
        let mut tree = SubscriptionTree::default();
        for (number, text) in (0..).zip(filters) {
            assert!(tree.insert(filter(text), SessionId(number), OPTIONS));
            assert!(
                !tree.insert(filter(text), SessionId(number), OPTIONS),
                "known"
            );
        }
        for topic in topics {
            let expected = filters
                .iter()
                .filter(|it| topic::matches(it, topic))
                .count();
            assert_eq!(count(&tree, topic), expected, "{topic}");
        }
        for (number, text) in (0..).zip(filters) {
            assert!(tree.remove(filter(text), SessionId(number)));
            assert!(!tree.remove(filter(text), SessionId(number)));
        }
        assert!(tree.root.is_empty(), "no empty levels stay");
    }

    #[test]
    fn a_group_is_one_taker() {
        let mut tree = SubscriptionTree::default();
        for number in 0..3 {
            tree.insert(filter("$share/g/a/#"), SessionId(number), OPTIONS);
        }
        tree.insert(filter("a/b"), SessionId(0), OPTIONS);
        assert_eq!(count(&tree, "a/b"), 2);
        for number in 0..3 {
            assert!(tree.remove(filter("$share/g/a/#"), SessionId(number)));
        }
        assert!(tree.remove(filter("a/b"), SessionId(0)));
        assert!(tree.root.is_empty());
    }
}
