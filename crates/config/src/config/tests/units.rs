//! Units: each listener reaches one drive, native or uniform, at each of them.

use super::*;

/// Native and uniform units of all drives.
fn units(text: &str) -> Vec<(u8, u8)> {
    let drives = good(text).lines.into_iter().flat_map(|line| line.drives);
    drives
        .map(|drive| (drive.unit.get(), drive.uniform_unit.get()))
        .collect()
}

#[test]
fn a_uniform_unit_lies_100_above_unless_it_is_given() {
    assert_eq!(units(TWO_LINES), [(1, 101), (2, 102)]);
    assert_eq!(
        units(&with(
            TWO_LINES,
            "unit = 1\n",
            "unit = 1\nuniform_unit = 7\n"
        )),
        [(1, 7), (2, 102)]
    );
    assert_eq!(
        units(&with(TWO_LINES, "unit = 1\n", "unit = 147\n")),
        [(147, 247), (2, 102)]
    );
}

#[test]
fn a_default_beyond_the_last_unit_is_reported() {
    let beyond = |unit| {
        format!(
            "line[0].drive[0].uniform_unit: `uniform_unit` is left out, and its default of {unit} + 100 is beyond 247; \
             uniform_unit = 1, which is free"
        )
    };
    only(&with(TWO_LINES, "unit = 1\n", "unit = 148\n"), &beyond(148));
    only(&with(TWO_LINES, "unit = 1\n", "unit = 247\n"), &beyond(247));
    assert_eq!(
        units(&with(
            TWO_LINES,
            "unit = 1\n",
            "unit = 148\nuniform_unit = 1\n"
        )),
        [(148, 1), (2, 102)]
    );
}

#[test]
fn a_uniform_unit_belongs_to_one_drive_too() {
    only(
        &with(TWO_LINES, "unit = 2\n", "unit = 101\nuniform_unit = 2\n"),
        "line[1].drive[0].unit: drive `pump-1` (uniform) and drive `pump-2` would both answer at unit 101; \
         unit = 3, which is free",
    );
    only(
        &with(TWO_LINES, "unit = 2\n", "unit = 2\nuniform_unit = 1\n"),
        "line[1].drive[0].uniform_unit: drive `pump-1` and drive `pump-2` (uniform) would both answer at unit 1; \
         uniform_unit = 3, which is free",
    );
    only(
        &with(TWO_LINES, "unit = 2\n", "unit = 2\nuniform_unit = 101\n"),
        "line[1].drive[0].uniform_unit: drive `pump-1` (uniform) and drive `pump-2` (uniform) would both answer at \
         unit 101; uniform_unit = 3, which is free",
    );
    only(
        &with(TWO_LINES, "unit = 2\n", "unit = 2\nuniform_unit = 2\n"),
        "line[1].drive[0].uniform_unit: drive `pump-2` would answer at unit 2 both as its vendor describes it and \
         uniformly; uniform_unit = 3, which is free",
    );
}

#[test]
fn a_free_unit_has_room_for_its_uniform_one() {
    // 2 is free, and the uniform unit that would follow it, 102, is not.
    let text = with(TWO_LINES, "unit = 1\n", "unit = 1\nuniform_unit = 102\n");
    only(
        &with(&text, "unit = 2\n", "unit = 1\n"),
        "line[1].drive[0].unit: drive `pump-1` and drive `pump-2` would both answer at unit 1; unit = 3, which is free",
    );
}

#[test]
fn drives_of_different_listeners_may_share_a_uniform_unit() {
    let text = with(TWO_LINES, "unit = 2\n", "unit = 2\nuniform_unit = 101\n")
        + "lines = ['hall-1']\n[[modbus_tcp]]\nlisten = '127.0.0.1:1503'\nlines = ['hall-2']";
    assert_eq!(units(&text), [(1, 101), (2, 101)]);
}

#[test]
fn taking_every_advice_makes_units_right() {
    let mut text = TWO_LINES
        .replace("unit = 1\n", "")
        .replace("unit = 2\n", "");
    for (number, unit) in [(3, 101), (4, 148), (5, 101)] {
        let drive = format!(
            "[[line.drive]]\nname = 'd{number}'\nmodel = 'hyundai-n700'\nstation = {number}\n"
        );
        text = with(
            &text,
            "[[line]]\nname = \"hall-2\"",
            &format!("{drive}unit = {unit}\n[[line]]\nname = \"hall-2\""),
        );
    }
    let wrong = load(&text, &catalog()).unwrap_err();
    assert_eq!(wrong.len(), 4, "{}", shown(&text, &wrong));
    // From the end, so that places before it stay as they are.
    for problem in wrong.iter().rev() {
        let right = problem.right.as_deref().unwrap();
        let advice = right.strip_suffix(", which is free").unwrap();
        if problem.what.contains("left out") {
            let end = text[problem.span.start..].find('\n').unwrap() + problem.span.start;
            text.insert_str(end, &format!("\n{advice}"));
        } else {
            text.replace_range(problem.span.clone(), advice.split(' ').next_back().unwrap());
        }
    }
    good(&text);
}
