//! The rules between the keys of `[link]`.

use crate::domain::problem::Problem;
use crate::profile::file::{FactFile, LinkFile, TimingFile};
use crate::toml_file::{LocatedValue, RequiredKey};

pub(super) fn check(link: &LinkFile, problems: &mut Vec<Problem>) {
    defaults_are_allowed(link, problems);
    stations_are_apart(link, problems);
}

/// Each default setting is one of the supported settings.
fn defaults_are_allowed(link: &LinkFile, problems: &mut Vec<Problem>) {
    let Some(LocatedValue { value: default, .. }) = &link.default.value else {
        return;
    };
    one_of(&default.baud, &link.bauds, "bauds", problems);
    one_of(&default.data_bits, &link.data_bits, "data_bits", problems);
    one_of(&default.parity, &link.parities, "parities", problems);
    one_of(&default.stop_bits, &link.stop_bits, "stop_bits", problems);
}

/// The pause after a stored write is the longer one.
pub(super) fn pauses_fit(timing: &TimingFile, problems: &mut Vec<Problem>) {
    let value = |fact: &Option<FactFile<_>>| fact.as_ref().and_then(|fact| fact.value.clone());
    let (Some(pause), Some(stored)) = (
        value(&timing.pause_after_write),
        value(&timing.pause_after_stored_write),
    ) else {
        return;
    };
    if stored.value <= pause.value {
        let what = "is no longer than `pause_after_write`, which applies to every write";
        problems.push(
            stored
                .location
                .problem(what)
                .right("a longer time, or leave it out"),
        );
    }
}

fn one_of<T: PartialEq>(
    value: &RequiredKey<T>,
    allowed: &FactFile<Vec<T>>,
    name: &str,
    problems: &mut Vec<Problem>,
) {
    if let (Some(value), Some(allowed)) = (value, &allowed.value)
        && !allowed.value.contains(&value.value)
    {
        problems.push(
            value
                .location
                .problem("the default is not a supported setting")
                .right(format!(
                    "one of `link.{name}`, or add it there if the manual names it"
                )),
        );
    }
}

/// The range of stations is not empty and does not include the broadcast station.
fn stations_are_apart(link: &LinkFile, problems: &mut Vec<Problem>) {
    let Some(LocatedValue {
        value: stations, ..
    }) = &link.stations.value
    else {
        return;
    };
    let (Some(from), Some(to)) = (&stations.from, &stations.to) else {
        return;
    };
    if from.value > to.value {
        let problem = to.location.problem(format!(
            "the last station is below the first, {}",
            from.value
        ));
        problems.push(problem.right(format!("{} to 247", from.value)));
    }
    let broadcast = link
        .broadcast
        .as_ref()
        .and_then(|broadcast| broadcast.value.as_ref()?.value.station.as_ref());
    if let Some(broadcast) = broadcast.filter(|it| (from.value..=to.value).contains(&it.value)) {
        let problem = broadcast
            .location
            .problem("the broadcast station is also the station of a drive");
        problems.push(problem.right(format!("a number outside {} to {}", from.value, to.value)));
    }
}

#[cfg(test)]
mod tests {
    use crate::domain::link::Framing;
    use crate::profile::check::model;
    use crate::profile::testing::{each_is_told, each_mistake_is_told};

    #[test]
    fn a_stored_write_takes_longer_than_another() {
        each_mistake_is_told(&[
            (
                "pause_after_stored_write = { value = \"200ms\"",
                "pause_after_stored_write = { value = \"50ms\"",
                "timing.pause_after_stored_write.value: is no longer than `pause_after_write`, which applies to every write -> \
                 a longer time, or leave it out",
            ),
            (
                "pause_after_write = { value = \"50ms\"",
                "pause_after_write = { value = \"1500ms\"",
                "timing.pause_after_write.value: 1500ms is out of range -> a time from \"1ms\" to \"1s\"",
            ),
        ]);
    }

    #[test]
    fn stations_and_defaults_are_apart_and_allowed() {
        each_is_told(&[
            (
                "broadcast = { station = 0",
                "broadcast = { station = 9",
                "link.broadcast.station: the broadcast station is also the station of a drive -> a number outside 1 to 127",
            ),
            (
                "from = 1, to = 127",
                "from = 9, to = 8",
                "link.stations.to: the last station is below the first, 9 -> 9 to 247",
            ),
            (
                "default = { baud = 19200",
                "default = { baud = 4800",
                "link.default.baud: the default is not a supported setting -> \
                 one of `link.bauds`, or add it there if the manual names it",
            ),
            (
                "default = { baud = 19200, data_bits = 8, parity = \"even\", stop_bits = 1",
                "default = { ask = \"P12 and P13\", baud = 19200",
                "link.default.baud: `ask` says that the factory setting is unknown, `baud` what it is -> \
                 one of both: leave out `ask`, or the setting",
            ),
            (
                "default = { baud = 19200, data_bits = 8, parity = \"even\", stop_bits = 1",
                "default = { ask = \" \"",
                "link.default.ask: ` ` is not valid -> what to read at the drive's panel, not empty",
            ),
        ]);
    }

    #[test]
    fn seven_data_bits_may_be_the_factory_setting_and_none_may_be_known() {
        let text = include_str!("../../../../../tests/golden/models/everything.toml");
        let known = "baud = 19200, data_bits = 8, parity = \"even\", stop_bits = 1";
        assert!(text.contains(known));
        let of_ascii = model(&text.replace(
            known,
            "baud = 9600, data_bits = 7, parity = \"none\", stop_bits = 2",
        ))
        .unwrap()
        .link;
        let settings = of_ascii
            .factory_with(Framing::Ascii)
            .map(|it| it.to_string());
        assert_eq!(
            (settings.as_deref(), of_ascii.factory_with(Framing::Rtu)),
            (Some("9600 7N2"), None)
        );
        let unknown = model(&text.replace(known, "ask = \"P12 and P13\""))
            .unwrap()
            .link;
        assert_eq!(
            (unknown.factory(), unknown.asks()),
            (None, Some("P12 and P13"))
        );
        assert_eq!(unknown.played().to_string(), "9600 8N1");
        assert_eq!(
            unknown.default.value.to_string(),
            "read at the drive: P12 and P13"
        );
    }
}
