//! Server-sent events, parsed from the bytes of an answer (HTML standard, 9.2.6, as far as the gateway uses it).

/// Longest accepted event, in bytes. A frame at its largest takes a twentieth of it.
const EVENT_BYTES_MAX: usize = 512 * 1024;

/// One event.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct SseEvent {
    /// Its name.
    pub name: String,
    /// Its id, if any.
    pub id: Option<String>,
    /// Its data.
    pub data: String,
}

/// Bytes that do not form a whole event yet.
#[derive(Debug, Default)]
pub struct EventCutter {
    bytes: Vec<u8>,
    at: usize,
}

impl EventCutter {
    /// More bytes have arrived.
    ///
    /// # Errors
    /// An event that does not end.
    pub fn push(&mut self, bytes: &[u8]) -> Result<(), String> {
        self.bytes.drain(..std::mem::take(&mut self.at));
        self.bytes.extend_from_slice(bytes);
        let is_too_long = self.bytes.len() > EVENT_BYTES_MAX
            && !self.bytes.windows(2).any(|pair| pair == b"\n\n");
        if is_too_long {
            Err("the gateway sent an event that is too long".to_owned())
        } else {
            Ok(())
        }
    }

    /// The next whole event.
    pub fn next(&mut self) -> Option<SseEvent> {
        loop {
            let rest = self.bytes.get(self.at..)?;
            let length = rest.windows(2).position(|pair| pair == b"\n\n")?;
            let text = String::from_utf8_lossy(rest.get(..length)?);
            let event = event(&text);
            self.at += length + 2;
            // A block without a name only concerns the stream itself.
            if !event.name.is_empty() {
                return Some(event);
            }
        }
    }
}

fn event(text: &str) -> SseEvent {
    let mut event = SseEvent::default();
    for line in text.lines() {
        let (key, value) = line.split_once(':').unwrap_or((line, ""));
        let value = value.strip_prefix(' ').unwrap_or(value);
        match key {
            "event" => value.clone_into(&mut event.name),
            "id" => event.id = Some(value.to_owned()),
            "data" => event.data.push_str(value),
            _ => {}
        }
    }
    event
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn events_are_found_however_the_bytes_are_cut() {
        let text = "retry: 500\nevent: begin\ndata: {\"line\":\"a\"}\n\n: a remark\n\nid: 0.7\nevent: frame\ndata: {}\n\n";
        for size in 1..text.len() {
            let mut cutter = EventCutter::default();
            let mut events = Vec::new();
            for bytes in text.as_bytes().chunks(size) {
                cutter.push(bytes).unwrap();
                events.extend(std::iter::from_fn(|| cutter.next()));
            }
            let event = |name: &str, id: Option<&str>, data: &str| SseEvent {
                name: name.to_owned(),
                id: id.map(str::to_owned),
                data: data.to_owned(),
            };
            assert_eq!(
                events,
                [
                    event("begin", None, "{\"line\":\"a\"}"),
                    event("frame", Some("0.7"), "{}")
                ],
                "{size}"
            );
        }
    }

    #[test]
    fn what_does_not_end_is_not_kept_for_ever() {
        let mut cutter = EventCutter::default();
        let half = vec![b'a'; EVENT_BYTES_MAX / 2];
        assert!(cutter.push(&half).is_ok() && cutter.push(&half).is_ok());
        assert_eq!(cutter.next(), None);
        assert!(cutter.push(b"a").is_err());
    }
}
