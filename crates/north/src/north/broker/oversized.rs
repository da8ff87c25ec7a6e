//! What is not published because it is larger than the broker takes.

/// A publication that is larger than the broker takes.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct OversizedPublication {
    /// Its topic.
    pub topic: String,
    /// Bytes of its packet, at most.
    pub bytes: usize,
    /// Bytes of the largest packet that the broker takes.
    pub limit: usize,
}

/// Most topics that are named.
const TOPICS_MAX: usize = 64;

/// The topics that are not published at present, each once.
#[derive(Debug, Default)]
pub(in crate::north) struct OversizedTopics {
    all: Vec<OversizedPublication>,
    /// Topics that were taken by [`next_unreported`](Self::next_unreported) on this connection: a document whose size swings
    /// around the limit is reported once.
    reported: Vec<String>,
}

impl OversizedTopics {
    /// Whether a publication on `topic` whose packet has up to `bytes` bytes may be sent. If not, it is added here.
    pub(in crate::north) fn admits(
        &mut self,
        topic: &str,
        bytes: usize,
        limit: Option<usize>,
    ) -> bool {
        if let Some(limit) = limit
            && bytes > limit
        {
            self.add(OversizedPublication {
                topic: topic.to_owned(),
                bytes,
                limit,
            });
            return false;
        }
        self.published(topic);
        true
    }

    /// Adds a publication, in place of an earlier one on its topic.
    fn add(&mut self, it: OversizedPublication) {
        let has_room = self.all.len() < TOPICS_MAX;
        match self.all.iter_mut().find(|known| known.topic == it.topic) {
            Some(known) => *known = it,
            None if has_room => self.all.push(it),
            None => {}
        }
    }

    /// Something is published on `topic`.
    fn published(&mut self, topic: &str) {
        if !self.all.is_empty() {
            self.all.retain(|it| it.topic != topic);
        }
    }

    /// A new connection: what is too large for it shows itself.
    pub(in crate::north) fn forget(&mut self) {
        self.all.clear();
        self.reported.clear();
    }

    /// All of them.
    pub(in crate::north) fn all(&self) -> &[OversizedPublication] {
        &self.all
    }

    /// A topic that was not returned yet. However often a topic is left out, it is returned once on each connection.
    pub(in crate::north) fn next_unreported(&mut self) -> Option<OversizedPublication> {
        let new = self
            .all
            .iter()
            .find(|it| !self.reported.contains(&it.topic))?
            .clone();
        if self.reported.len() >= TOPICS_MAX {
            self.reported.clear();
        }
        self.reported.push(new.topic.clone());
        Some(new)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn oversized(topic: &str, bytes: usize) -> OversizedPublication {
        OversizedPublication {
            topic: topic.to_owned(),
            bytes,
            limit: 2_000,
        }
    }

    #[test]
    fn each_topic_is_named_once_on_each_connection() {
        let mut list = OversizedTopics::default();
        for bytes in [2_500, 2_600] {
            list.add(oversized("state", bytes));
        }
        list.add(oversized("info", 3_000));
        assert_eq!(
            list.all(),
            [oversized("state", 2_600), oversized("info", 3_000)]
        );
        let mut reported = || {
            std::iter::from_fn(|| list.next_unreported())
                .map(|it| it.topic)
                .collect::<Vec<_>>()
        };
        assert_eq!(
            (reported(), reported()),
            (vec!["state".to_owned(), "info".to_owned()], vec![])
        );
        list.published("state");
        assert_eq!(list.all(), [oversized("info", 3_000)]);
        list.add(oversized("state", 2_700));
        assert_eq!(
            (list.all().len(), list.next_unreported()),
            (2, None),
            "its size swings around the limit"
        );
        list.forget();
        list.add(oversized("state", 2_800));
        assert_eq!(
            (list.all().len(), list.next_unreported()),
            (1, Some(oversized("state", 2_800))),
            "the next connection"
        );
    }

    #[test]
    fn it_is_bounded() {
        let mut list = OversizedTopics::default();
        for number in 0..1_000 {
            list.add(oversized(&number.to_string(), 3_000));
        }
        assert_eq!(
            (
                list.all().len(),
                std::iter::from_fn(|| list.next_unreported()).count()
            ),
            (TOPICS_MAX, TOPICS_MAX)
        );
    }
}
