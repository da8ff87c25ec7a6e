//! The drive's own watchdog: there is one, it is proven, and its time fits between the frames and the lease.

use super::*;

const AT: &str = "line[0].drive[0].control";

/// The built-in models, but that what programs say of the E510 stands in a manual of it: its watchdog and its stop are
/// proven then.
fn catalog() -> Catalog {
    catalog_with("")
}

/// That catalog, with `lines` at the end of the file of the E510.
pub(super) fn catalog_with(lines: &str) -> Catalog {
    let e510 = include_str!("../../../../model/src/vendors/teco/e510.toml");
    let e510 = e510
        .replace("\"program\"", "\"manual\"")
        .replace("\"commissioning-sheet\"", "\"manual\"");
    let e510 = e510.replace("\"third-party\"", "\"second-source\"") + lines;
    let mut others = crate::vendors::texts().to_vec();
    others.retain(|(name, _)| *name != "teco/e510.toml");
    Catalog::of_sound(&others)
        .with_texts([("teco/e510.toml", e510)])
        .unwrap()
}

/// The problems of a drive of `model` with `lines` in its control section, on [that catalog](catalog).
fn problems_of(model: &str, lines: &str) -> Vec<String> {
    let text = with(CONTROLLED, "[line.drive.native]\nwrite = [\"F007\"]\n", "");
    let text = with(
        &text,
        "[[line.drive]]\nname = \"pump-2\"\nmodel = \"hyundai-n700\"\nstation = 2\n",
        "",
    );
    let text = with(&text, "hyundai-n700", model);
    let text = with(
        &text,
        "on_shutdown = \"hold\"\n",
        &format!("on_shutdown = \"hold\"\n{lines}\n"),
    );
    let catalog = catalog();
    let problems = crate::config::load(&text, &catalog)
        .map_or_else(|problems| problems, |config| config.warnings);
    problems.iter().map(problem_text).collect()
}

#[test]
fn nothing_relies_on_a_watchdog_that_is_not_known() {
    for line in [
        "require_watchdog = true",
        "watchdog = '10s'",
        "failsafe_confirm_timeout = '2s'",
    ] {
        let key = line.split_once(' ').unwrap().0;
        assert_eq!(problems_of("teco-e510", line), [""; 0], "{line}");
        let idle = if key == "failsafe_confirm_timeout" {
            "has no effect: "
        } else {
            ""
        };
        let none = format!(
            "{AT}.{key}: {idle}no watchdog of its own is known for hyundai-n700; leave it out"
        );
        assert_eq!(problems_of("hyundai-n700", line), [none]);
        for unproven in ["frecon-fr500a", "teco-e510s"] {
            let what = format!(
                "{AT}.{key}: {idle}the watchdog of {unproven} is unproven and cannot be relied on; leave it out"
            );
            assert_eq!(problems_of(unproven, line).last(), Some(&what));
        }
    }
    assert_eq!(
        problems_of("hyundai-n700", "require_watchdog = false"),
        [""; 0]
    );
}

#[test]
fn its_time_fits_between_the_frames_and_the_lease() {
    let one = |line: &str, part: &str| {
        let reported = problems_of("teco-e510", line);
        assert!(
            matches!(&reported[..], [one] if one.starts_with(&format!("{AT}.watchdog: ")) && one.contains(part)),
            "{reported:?}"
        );
    };
    one("watchdog = '10050ms'", "cannot be set to 10050ms");
    one("watchdog = '26s'", "cannot be set to 26s");
    one("watchdog = '500ms'", "may stop the motor without cause");
    let longer = problems_of("teco-e510", "watchdog = '20s'\n").len();
    assert_eq!(longer, 0);
    let text = with(CONTROLLED, "lost_after = \"30s\"", "lost_after = '8s'");
    let text = with(&text, "[line.drive.native]\nwrite = [\"F007\"]\n", "");
    let text = with(
        &text,
        "model = \"hyundai-n700\"\nstation = 1",
        "model = 'teco-e510'\nstation = 1",
    );
    let text = with(
        &text,
        "[[line.drive]]\nname = \"pump-2\"\nmodel = \"hyundai-n700\"\nstation = 2\n",
        "",
    );
    let text = with(&text, "on_shutdown", "watchdog = '9s'\non_shutdown");
    let catalog = catalog();
    let reported = crate::config::load(&text, &catalog).unwrap_err();
    assert!(
        reported
            .iter()
            .any(|it| it.what == "a watchdog of 9s takes longer than `lost_after`, 8s"),
        "{reported:?}"
    );
}

#[test]
fn the_registers_of_a_watchdog_are_not_listed_for_clients() {
    for listed in ["09-06", "09-07", "0x0906"] {
        let text = with(CONTROLLED, "[\"F007\"]", &format!("['{listed}']"));
        let text = with(
            &text,
            "[[line.drive]]\nname = \"pump-2\"\nmodel = \"hyundai-n700\"\nstation = 2\n",
            "",
        );
        let text = with(&text, "hyundai-n700", "teco-e510");
        let catalog = catalog();
        let reported = crate::config::load(&text, &catalog).unwrap_err();
        assert!(
            reported
                .iter()
                .any(|it| it.what.ends_with("sets the drive's own watchdog")),
            "{listed}: {reported:?}"
        );
    }
}
