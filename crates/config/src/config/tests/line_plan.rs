//! A plan that does not fit: stretched, or refused with the sum.

use super::{MINIMAL, catalog, with};
use crate::config::{line_plan, load};
use std::fmt::Write;

/// A line of `drives` N700, polled every 500 ms, with `lines` of its own.
fn line_of(drives: u8, lines: &str) -> String {
    let mut text = with(
        MINIMAL,
        "port = \"/dev/ttyUSB0\"\n",
        &format!("port = \"/dev/ttyUSB0\"\n{lines}\n"),
    );
    let mut more = String::new();
    for station in 2..=drives {
        let _ = write!(
            more,
            "[[line.drive]]\nname = \"more-{station}\"\nmodel = \"hyundai-n700\"\nstation = {station}\n"
        );
    }
    let at = text.find("[[modbus_tcp]]").unwrap();
    text.insert_str(at, &more);
    text
}

#[test]
fn an_over_full_plan_is_stretched_as_long_as_the_status_stays_young_enough() {
    let config = load(&line_of(12, ""), &catalog()).unwrap();
    let budget = line_plan::budget(&config.lines[0]);
    assert!(budget.stretch > 1.0, "{}", budget.stretch);
    assert!(budget.fast_age(0).unwrap() <= config.lines[0].max_status_age);
    assert_eq!(config.lines[0].max_status_age.as_secs(), 5);
}

#[test]
fn a_plan_whose_status_would_be_too_old_is_refused_with_the_sum() {
    let text = line_of(12, "max_status_age = \"700ms\"");
    let problems = load(&text, &catalog()).unwrap_err();
    let [problem] = problems.as_slice() else {
        panic!("{problems:?}")
    };
    assert_eq!(problem.key, "line[0].max_status_age");
    for word in [
        "`hall-1`",
        "12 drives with",
        "fast",
        "% of its time",
        "700ms",
        "Stretched",
    ] {
        assert!(problem.what.contains(word), "no {word}: {}", problem.what);
    }
    let right = problem.right.as_deref().unwrap();
    for word in ["38400", "fewer drives", "poll = "] {
        assert!(right.contains(word), "no {word}: {right}");
    }
    // What it says helps.
    let poll = right
        .split("poll = \"")
        .nth(1)
        .unwrap()
        .split('"')
        .next()
        .unwrap();
    let slower = text.replace(
        "model = \"hyundai-n700\"\n",
        &format!("model = \"hyundai-n700\"\npoll = \"{poll}\"\n"),
    );
    assert!(load(&slower, &catalog()).is_ok(), "{slower}");
}

#[test]
fn slow_polls_that_somebody_wants_are_not_refused() {
    let text = line_of(2, "max_status_age = \"1s\"");
    let slow = text.replace(
        "model = \"hyundai-n700\"\n",
        "model = \"hyundai-n700\"\npoll = \"1min\"\n",
    );
    assert!(load(&slow, &catalog()).is_ok());
}
