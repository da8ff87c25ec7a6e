//! The page is complete and small, and contains nothing that its own content security policy forbids.

use super::super::tests::on_a_runtime;
use super::*;
use crate::north::texts::TextCatalogue;
use axum::body::Body;
use axum::http::Request;
use hyper_util::service::TowerToHyperService;
use std::collections::BTreeSet;
use std::path::PathBuf;

/// All that one browser fetches to show the page, uncompressed.
const BYTES_MAX: usize = 220_000;

fn files() -> impl Iterator<Item = &'static PageFile> {
    FILES.into_iter().flatten()
}

/// Third-party files are left as they are.
fn is_vendored(file: &PageFile) -> bool {
    file.name.starts_with("uplot")
}

fn text(file: &PageFile) -> &'static str {
    std::str::from_utf8(file.bytes).unwrap()
}

#[test]
fn every_file_is_served_and_all_are_small() {
    let folder = PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("src/daemon/http/page/files");
    let there = std::fs::read_dir(folder)
        .unwrap()
        .map(|entry| entry.unwrap().file_name().into_string().unwrap());
    let served: BTreeSet<_> = files().map(|file| file.name.to_owned()).collect();
    assert_eq!(there.collect::<BTreeSet<_>>(), served);
    let empty: Vec<_> = files()
        .filter(|file| file.bytes.is_empty())
        .map(|file| file.name)
        .collect();
    assert!(empty.is_empty(), "{empty:?}");
    let lazy = quoted_behind(
        text(files().find(|file| file.name == "app.js").unwrap()),
        "lazy(\"./",
    );
    assert_eq!(lazy, ["trend.js", "traffic.js", "report.js", "setup.js"]);
    for TextCatalogue { language, .. } in CATALOGUES {
        let is_of_language = |name: &str| name.ends_with(&format!(".{language}.json"));
        // Panels that few use are fetched when they are opened; a page in English needs no sentences of the gateway.
        let is_fetched = |name: &str| {
            let is_other =
                name.ends_with(".json") && (!is_of_language(name) || name == "gateway.en.json");
            let is_of_trend = name == "chart.js" || name.starts_with("uplot");
            !name.starts_with("setup")
                && !is_of_trend
                && !lazy.contains(&name)
                && !name.ends_with(".txt")
                && !is_other
        };
        let bytes: usize = SERVED
            .iter()
            .filter(|it| is_fetched(&it.name))
            .map(|it| it.bytes.len())
            .sum();
        assert!(bytes < BYTES_MAX, "{language}: {bytes}");
        println!("the page in {language}: {bytes} bytes");
    }
}

#[test]
fn a_file_is_served_without_indents_and_comments_and_is_the_same_otherwise() {
    let bytes: &[u8] =
        b"// One.\n\n/** Two,\n * and three. */\nconst a = 1; // Four.\n/* Five. */\n  if (a) {\n    b();\n  }\n";
    let file = |name| PageFile {
        name,
        media_type: "",
        bytes,
    };
    assert_eq!(
        &*lean(&file("a.js")),
        b"const a = 1; // Four.\nif (a) {\nb();\n}\n"
    );
    assert_eq!(&*lean(&file("uplot.js")), bytes);
    for file in files().filter(|file| !is_vendored(file) && file.name.ends_with(".js")) {
        let is_text_open = |line: &&str| line.replace("\"`\"", "").matches('`').count() % 2 == 1;
        let is_open =
            |line: &&str| is_text_open(line) || (line.contains("*/") && !line.ends_with("*/"));
        let found: Vec<_> = text(file).lines().filter(is_open).collect();
        assert!(
            found.is_empty(),
            "{}: a text or a comment over several lines: {found:?}",
            file.name
        );
    }
}

/// The quoted texts after `mark`.
fn quoted_behind<'t>(text: &'t str, mark: &str) -> Vec<&'t str> {
    text.split(mark)
        .skip(1)
        .filter_map(|rest| rest.split('"').next())
        .collect()
}

#[test]
fn parts_that_are_not_there_are_left_out_in_one_place() {
    for file in files()
        .filter(|file| !is_vendored(file) && file.name.ends_with(".js") && file.name != "dom.js")
    {
        for way in [
            ".append(",
            ".replaceChildren(",
            ".insertAdjacent",
            "innerHTML",
        ] {
            assert!(
                !text(file).contains(way),
                "{}: {way} shows `null` and `false`; use `add` or `fill`",
                file.name
            );
        }
    }
}

#[test]
fn whatever_a_file_asks_for_is_there() {
    let served: BTreeSet<_> = files().map(|file| file.name).collect();
    let mut asked = 0;
    for file in files().filter(|file| !is_vendored(file)) {
        let by_path = quoted_behind(text(file), "\"assets/");
        let by_import = quoted_behind(text(file), "from \"./");
        asked += by_path.len() + by_import.len();
        for name in by_path.into_iter().chain(by_import) {
            assert!(served.contains(name), "{}: {name}", file.name);
        }
    }
    assert!(
        asked > served.len(),
        "the marks are still the right ones: {asked}"
    );
}

#[test]
fn nothing_is_inline_nothing_comes_from_elsewhere_and_text_is_only_text() {
    for file in files().filter(|file| !is_vendored(file)) {
        let text = text(file);
        let forbidden = [
            "<style",
            "style=",
            " onclick",
            "javascript:",
            "innerHTML",
            "outerHTML",
            "insertAdjacentHTML",
        ];
        for forbidden in forbidden
            .into_iter()
            .chain(["document.write", "eval(", "new Function"])
        {
            assert!(!text.contains(forbidden), "{}: {forbidden}", file.name);
        }
        let elsewhere: Vec<_> = quoted_behind(text, "http")
            .into_iter()
            .filter(|url| url.contains("://"))
            .collect();
        let names = ["://www.w3.org/2000/svg"];
        assert!(
            elsewhere.iter().all(|url| names.contains(url)),
            "{}: {elsewhere:?}",
            file.name
        );
    }
    let index = text(files().find(|file| file.name == INDEX).unwrap());
    let scripts: Vec<_> = index.split("<script").skip(1).collect();
    assert!(
        !scripts.is_empty()
            && scripts
                .iter()
                .all(|script| script.trim_start().starts_with("src=\"assets/"))
    );
}

async fn ask(path: &str, tag: &str) -> Response {
    let request = Request::get(path)
        .header(header::IF_NONE_MATCH, tag)
        .body(Body::empty())
        .unwrap();
    hyper::service::Service::call(&TowerToHyperService::new(router::<()>()), request)
        .await
        .unwrap()
}

#[test]
fn a_browser_that_has_a_file_is_not_sent_it_again() {
    on_a_runtime(async {
        for file in files() {
            let path = format!("/assets/{}", file.name);
            let first = ask(&path, "\"other\"").await;
            assert_eq!(first.status(), 200, "{path}");
            assert_eq!(first.headers()[header::CONTENT_TYPE], file.media_type);
            let tag = first.headers()[header::ETAG].to_str().unwrap().to_owned();
            for known in [tag.clone(), format!("\"other\", W/{tag}")] {
                assert_eq!(ask(&path, &known).await.status(), 304, "{path} {known}");
            }
        }
        let page = ask("/", "").await;
        assert_eq!(
            (page.status(), &page.headers()[header::CACHE_CONTROL]),
            (StatusCode::OK, &"no-cache".parse().unwrap())
        );
        assert_eq!(ask("/assets/nothing.js", "").await.status(), 404);
        assert_eq!(ask("/assets/..%2Fmod.rs", "").await.status(), 404);
    });
}
