//! Lines of guides: what each does with its terminal, and what can be told from what it prints.

/// What a line does with the terminal in which it is typed.
#[derive(Clone, Copy, PartialEq, Eq)]
pub enum Kind {
    Ends,
    /// It asks before it sets something.
    Asks,
    Demo,
    Gateway,
    /// It stays and keeps a motor running.
    Forward,
    /// It stays and shows something.
    Watcher,
}

/// What `statement` does.
pub fn kind(statement: &str) -> Kind {
    let line = statement.split(" # ").next().unwrap();
    let words: Vec<_> = line.split_whitespace().collect();
    let has = |word: &str| words.contains(&word);
    match (words[0], words.get(1).copied().unwrap_or_default()) {
        ("vfd-gateway", "run") => Kind::Gateway,
        ("vfd-gateway", "demo") => Kind::Demo,
        ("vfd-gateway", "write") if has("run") && has("forward") => Kind::Forward,
        ("vfd-gateway", "enable") => Kind::Asks,
        ("vfd-gateway", "watchdog") if has("--set") => Kind::Asks,
        ("vfd-gateway", "capture" | "simulate" | "watch") => Kind::Watcher,
        ("mosquitto_sub", _) if !has("-C") => Kind::Watcher,
        ("mbpoll", _) if !has("-1") => Kind::Watcher,
        _ => Kind::Ends,
    }
}

/// How many drives a gateway has said to be there, each counted once.
pub fn online(log: &str) -> usize {
    let mut drives: Vec<_> = log
        .lines()
        .filter_map(|it| it.split_once("drive online ").map(|(_, drive)| drive))
        .collect();
    drives.sort_unstable();
    drives.dedup();
    drives.len()
}

/// mbpoll ends well where it has only shown an error.
pub fn is_done(line: &str, said: &str) -> bool {
    let is_poll = line.starts_with("mbpoll");
    !is_poll
        || said.contains("Written 1 references.")
        || said
            .lines()
            .any(|it| it.starts_with('[') && it.contains("]:"))
}

/// The output frequency in what `read --uniform` prints.
pub fn frequency(said: &str) -> Option<f64> {
    let row = said
        .lines()
        .find_map(|line| line.strip_prefix("output_frequency"))?;
    row.trim().strip_suffix(" Hz")?.parse().ok()
}

/// What a line has shown of a drive: a frequency, registers, or what a broker has.
pub fn live_value(line: &str, said: &str) -> Option<String> {
    let words: Vec<_> = line.split_whitespace().take(2).collect();
    match words[..] {
        ["vfd-gateway", "read"] if line.contains("--uniform") => {
            frequency(said).map(|hz| format!("{hz} Hz"))
        }
        ["vfd-gateway", "read"] => {
            let is_value = |line: &&str| line.starts_with("0x") || line.ends_with(" Hz");
            said.lines().find(is_value).map(str::to_owned)
        }
        ["mbpoll", _] => said
            .lines()
            .find(|line| line.starts_with('['))
            .map(str::to_owned),
        ["mosquitto_sub", _] => said.lines().next().map(str::to_owned),
        _ => None,
    }
}
