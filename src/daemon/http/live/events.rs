//! Server-sent events as text (WHATWG HTML, 9.2).

/// After how long a browser reconnects when its connection was closed, in milliseconds.
const RETRY_MS: u32 = 1000;

/// An event; `data` is one line.
pub fn event(name: &str, data: &str) -> String {
    format!("event: {name}\ndata: {data}\n\n")
}

/// The first events of a connection.
pub fn first(state: &str, moment: &str) -> String {
    format!(
        "retry: {RETRY_MS}\n{}{}",
        event("state", state),
        alive(moment)
    )
}

/// A heartbeat with the present moment, which orders may name.
pub fn alive(moment: &str) -> String {
    event("alive", &format!("{{\"moment\":\"{moment}\"}}"))
}
