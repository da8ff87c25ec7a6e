//! The differences between two dumps, and what a restore would write, in which order.

use super::file::{Parameter, ParameterDump};
use super::live::ListedParameter;
use serde_json::{Value, json};

/// A parameter that is not the same on both sides.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ParameterDifference {
    /// The parameter on the first side; `None`: it is only on the second.
    pub first: Option<Parameter>,
    /// The parameter on the second side; `None`: it is only on the first.
    pub second: Option<Parameter>,
}

impl ParameterDifference {
    fn any(&self) -> Option<&Parameter> {
        self.first.as_ref().or(self.second.as_ref())
    }

    /// Code, title, and both values, as a row.
    #[must_use]
    pub fn row(&self) -> [String; 4] {
        let any = self.any();
        let label = any.map(|it| it.code.clone()).unwrap_or_default();
        let title = any.map(|it| it.title.clone()).unwrap_or_default();
        let shown = |side: &Option<Parameter>| {
            side.as_ref()
                .map_or_else(|| "-".to_owned(), Parameter::shown)
        };
        [label, title, shown(&self.first), shown(&self.second)]
    }

    /// The difference as JSON, for programs.
    #[must_use]
    pub fn json(&self) -> Value {
        let side = |side: &Option<Parameter>| {
            side.as_ref()
                .map(|it| json!({ "raw": it.raw, "text": it.text }))
        };
        let any = self.any();
        json!({
            "code": any.map(|it| it.code.as_str()),
            "address": any.map(|it| it.address),
            "title": any.map(|it| it.title.as_str()),
            "first": side(&self.first),
            "second": side(&self.second),
        })
    }
}

/// All differences, in order of address.
#[must_use]
pub fn differences(first: &ParameterDump, second: &ParameterDump) -> Vec<ParameterDifference> {
    let mut addresses: Vec<u16> = first
        .parameters
        .iter()
        .chain(&second.parameters)
        .map(|it| it.address)
        .collect();
    addresses.sort_unstable();
    addresses.dedup();
    let pair = |address: u16| ParameterDifference {
        first: first.at(address).cloned(),
        second: second.at(address).cloned(),
    };
    let differs = |it: &ParameterDifference| {
        it.first.as_ref().map(|it| it.raw) != it.second.as_ref().map(|it| it.raw)
    };
    addresses
        .into_iter()
        .map(pair)
        .filter(differs)
        .map(without_old_text)
        .collect()
}

/// A person who edits a file changes its words, and leaves the texts beside them unchanged.
fn without_old_text(mut it: ParameterDifference) -> ParameterDifference {
    if let (Some(first), Some(second)) = (&mut it.first, &mut it.second)
        && first.text == second.text
    {
        first.text = None;
        second.text = None;
    }
    it
}

/// What a restore would do.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct RestorePlan {
    /// What is written, in this order: old, new, and whether it wears a memory.
    pub writes: Vec<ParameterChange>,
    /// Differences that are left unchanged, with the reason.
    pub left: Vec<(Parameter, String)>,
}

/// One parameter that a restore writes.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ParameterChange {
    /// What the drive holds.
    pub old: Parameter,
    /// What it is to hold.
    pub new: Parameter,
    /// Writing it wears a memory.
    pub is_stored: bool,
    /// The gateway's word for its effect.
    pub kind: String,
}

/// Position in the order of a restore: parameters that select the command source follow everything else, and those that
/// determine how the drive is reached are last, because nothing may be reachable after them.
fn order(kind: &str) -> u8 {
    match kind {
        "source" => 1,
        "link" => 2,
        _ => 0,
    }
}

/// The writes that make `live` hold the values of `wanted`, on a drive that knows `known`. Link, station and sources
/// are left alone unless `with_link`.
#[must_use]
pub fn plan(
    wanted: &ParameterDump,
    live: &ParameterDump,
    known: &[ListedParameter],
    with_link: bool,
) -> RestorePlan {
    let mut plan = RestorePlan::default();
    for difference in differences(live, wanted) {
        let ParameterDifference {
            first: old,
            second: Some(new),
        } = difference
        else {
            continue;
        };
        let of = known.iter().find(|known| known.address == new.address);
        let left = match (&old, of) {
            (_, None) => {
                Some("the model does not know what it does: set it at the drive itself".to_owned())
            }
            (None, _) => Some("the drive does not show it at present".to_owned()),
            (Some(_), Some(known)) => match known.kind.as_str() {
                "read_only" | "command" => continue,
                "back_door" => Some(format!(
                    "set it at the drive itself: {}",
                    known.reason.as_deref().unwrap_or("?")
                )),
                "source" if !with_link => {
                    Some("it decides what controls the motor; --with-link writes it too".to_owned())
                }
                "link" if !with_link => Some(
                    "it decides how the drive is reached; --with-link writes it too".to_owned(),
                ),
                _ => None,
            },
        };
        match (left, old, of) {
            (None, Some(old), Some(known)) => {
                plan.writes.push(ParameterChange {
                    old,
                    new,
                    is_stored: known.is_stored,
                    kind: known.kind.clone(),
                });
            }
            (reason, ..) => plan.left.push((new, reason.unwrap_or_default())),
        }
    }
    plan.writes
        .sort_by_key(|change| (order(&change.kind), change.new.address));
    plan
}

#[cfg(test)]
mod tests {
    use super::*;

    fn parameter(address: u16, raw: u32) -> Parameter {
        Parameter {
            code: format!("P{address}"),
            address,
            raw,
            text: None,
            title: String::new(),
        }
    }

    fn dump(values: &[(u16, u16)]) -> ParameterDump {
        ParameterDump {
            parameters: values
                .iter()
                .map(|(address, raw)| parameter(*address, (*raw).into()))
                .collect(),
            ..ParameterDump::default()
        }
    }

    fn known(address: u16, kind: &str) -> ListedParameter {
        ListedParameter {
            code: format!("P{address}"),
            title: String::new(),
            address,
            kind: kind.to_owned(),
            reason: (kind == "back_door").then(|| "it widens limits".to_owned()),
            is_stored: true,
        }
    }

    #[test]
    fn only_what_differs_is_reported() {
        let first = dump(&[(1, 10), (2, 20), (3, 30)]);
        let second = dump(&[(1, 10), (2, 21), (4, 40)]);
        let rows: Vec<_> = differences(&first, &second)
            .iter()
            .map(ParameterDifference::row)
            .collect();
        let row = |code: &str, first: &str, second: &str| {
            [
                code.to_owned(),
                String::new(),
                first.to_owned(),
                second.to_owned(),
            ]
        };
        assert_eq!(
            rows,
            [
                row("P2", "20", "21"),
                row("P3", "30", "-"),
                row("P4", "-", "40")
            ]
        );
        assert!(differences(&first, &first).is_empty());
        assert_eq!(differences(&first, &second)[0].json()["second"]["raw"], 21);
    }

    #[test]
    fn the_link_is_written_last_and_only_if_wanted() {
        let all = [
            known(1, "link"),
            known(2, "source"),
            known(3, "plain"),
            known(4, "back_door"),
            known(5, "read_only"),
            known(6, "command"),
            known(7, "plain"),
        ];
        let live = dump(&(1..=7).map(|address| (address, 0)).collect::<Vec<_>>());
        let wanted = dump(
            &(1..=8)
                .map(|address| (address, u16::from(address != 7)))
                .collect::<Vec<_>>(),
        );
        let addresses = |plan: &RestorePlan| {
            plan.writes
                .iter()
                .map(|change| change.new.address)
                .collect::<Vec<_>>()
        };
        let careful = plan(&wanted, &live, &all, false);
        assert_eq!(addresses(&careful), [3]);
        let left: Vec<_> = careful.left.iter().map(|(it, _)| it.address).collect();
        assert_eq!(
            left,
            [1, 2, 4, 8],
            "what the drive does not take is no difference to speak of"
        );
        assert!(careful.left[2].1.contains("it widens limits"));
        assert_eq!(addresses(&plan(&wanted, &live, &all, true)), [3, 2, 1]);
    }
}
