//! Properties of every text that people write and of the problems found in it.

use vfd_model::domain::problem::Problem;

/// Longest text that is tried. People write shorter ones, and a longer one would test nothing new.
const TEXT_MAX_BYTES: usize = 64 * 1024;

/// The text in `bytes`; `None` if they are not UTF-8: such files are refused when they are read.
pub fn of(bytes: &[u8]) -> Option<&str> {
    std::str::from_utf8(bytes)
        .ok()
        .filter(|text| text.len() <= TEXT_MAX_BYTES)
}

/// The problems of a whole file are in the order of the text.
pub fn check_file(text: &str, problems: &[Problem]) {
    check_problems(text, problems);
    assert!(
        problems.is_sorted_by_key(|problem| problem.span.start),
        "{problems:?}"
    );
}

/// At least one problem, and each can be shown at its place.
pub fn check_problems(text: &str, problems: &[Problem]) {
    assert!(!problems.is_empty(), "refused for no reason");
    for problem in problems {
        assert!(
            text.get(problem.span.clone()).is_some(),
            "outside the text or within a character: {problem:?}"
        );
        assert!(!problem.what.trim().is_empty(), "says nothing: {problem:?}");
        let (line, column) = problem.place_in(text);
        assert!(
            line >= 1 && column >= 1 && line <= text.matches('\n').count() + 1,
            "{problem:?}"
        );
    }
}
