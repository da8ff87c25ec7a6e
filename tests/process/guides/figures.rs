//! The figures of the documents: each that is named is there, is well-formed, has a title and a description, is small,
//! and needs nothing from elsewhere. None lies there unused.

use super::super::outsiders::python;
use super::super::rig::text_of;
use super::said;
use super::text::documents;
use std::collections::BTreeSet;
use std::path::Path;
use std::process::Command;

/// No figure needs more.
const BYTES_MAX: usize = 12_000;

/// The documents that name figures, each with the name of one.
fn named() -> Vec<(String, String)> {
    let readme = ("README.md".to_owned(), text_of("README.md"));
    let mut found = Vec::new();
    for (name, text) in documents().into_iter().chain([readme]) {
        for link in text
            .split("](")
            .skip(1)
            .filter_map(|rest| rest.split(')').next())
        {
            if let Some((_, figure)) = link.split_once("figures/") {
                found.push((name.clone(), figure.to_owned()));
            }
        }
    }
    found
}

/// Title and description of a figure, as a parser of XML reads them. It refuses what is not well-formed.
fn read(figure: &Path) -> [String; 2] {
    const READ: &str = "import sys, xml.etree.ElementTree as tree; root = tree.parse(sys.argv[1]).getroot(); \
        name = '{http://www.w3.org/2000/svg}'; assert root.tag == name + 'svg', root.tag; \
        print(root.findtext(name + 'title')); print(root.findtext(name + 'desc'))";
    let output = Command::new(python())
        .args(["-c", READ])
        .arg(figure)
        .output()
        .unwrap();
    assert!(
        output.status.success(),
        "{}: {}",
        figure.display(),
        said(&output)
    );
    let said = String::from_utf8(output.stdout).unwrap();
    let (title, description) = said.trim_end().split_once('\n').unwrap();
    [title, description].map(str::to_owned)
}

#[test]
fn every_figure_that_a_document_names_is_there_and_can_be_read() {
    let (named, folder) = (
        named(),
        Path::new(env!("CARGO_MANIFEST_DIR")).join("docs/figures"),
    );
    for (document, figure) in &named {
        assert!(
            folder.join(figure).exists(),
            "{document}: there is no {figure}"
        );
        let text = text_of(&format!("docs/figures/{figure}"));
        assert!(text.len() < BYTES_MAX, "{figure}: {} bytes", text.len());
        for part in read(&folder.join(figure)) {
            assert!(
                part.len() > 10,
                "{figure} has no title or no description: {part}"
            );
        }
        let without_namespace = text.replace("http://www.w3.org/2000/svg", "");
        for word in ["http", "<script", "@import", "url(", "<image"] {
            assert!(
                !without_namespace.contains(word),
                "{figure} needs something from elsewhere: {word}"
            );
        }
        assert!(
            text.contains("prefers-color-scheme: dark"),
            "{figure} is for bright pages only"
        );
    }
    let there = std::fs::read_dir(folder)
        .unwrap()
        .map(|entry| entry.unwrap().file_name().into_string().unwrap());
    let named: BTreeSet<_> = named.into_iter().map(|(_, figure)| figure).collect();
    assert_eq!(there.collect::<BTreeSet<_>>(), named);
}
