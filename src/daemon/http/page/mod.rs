//! The web page: its files, which are part of the program. It uses the same routes as scripts.

#[cfg(test)]
mod tests;

use crate::north::texts::{CATALOGUES, TextChapter};
use axum::Router;
use axum::extract::Path;
use axum::http::{HeaderMap, StatusCode, header};
use axum::response::{IntoResponse, Response};
use axum::routing::get;
use crc::{CRC_64_XZ, Crc};
use std::borrow::Cow;
use std::sync::LazyLock;

/// The file that is the page itself.
const INDEX: &str = "index.html";

/// What a browser keeps to say that the gateway cannot be reached. It is served at the root, because it acts below itself.
const OFFLINE_WORKER: &str = "offline.js";

/// A file of the page.
#[derive(Debug)]
struct PageFile {
    name: &'static str,
    media_type: &'static str,
    bytes: &'static [u8],
}

macro_rules! files {
    ($media_type:literal: $($name:literal),+ $(,)?) => {
        [$(PageFile { name: $name, media_type: $media_type, bytes: include_bytes!(concat!("files/", $name)) }),+]
    };
}

/// All files, by their kind.
const FILES: [&[PageFile]; 6] = [
    &files!("text/html; charset=utf-8": "index.html", "offline.html"),
    &files!("text/css; charset=utf-8": "page.css", "setup.css", "uplot.min.css"),
    &files!("text/javascript; charset=utf-8":
        "app.js", "chart.js", "control.js", "dom.js", "drives.js", "fetched.js", "filter.js", "fit.js", "footer.js",
        "gauge.js", "hold.js",
        "journal.js", "kept.js", "layout.js", "leases.js", "lines.js", "notify.js", "offline.js", "problems.js", "report.js",
        "session.js", "setup.js", "setup_found.js", "setup_parts.js", "setup_rules.js", "setup_verify.js", "signing.js",
        "stream.js", "tabs.js", "texts.js", "ticker.js", "titles.js", "traffic.js", "trend.js", "trip_history.js",
        "uplot.min.js",
    ),
    &files!("image/svg+xml": "icon-problem.svg", "icon.svg"),
    &files!("application/manifest+json": "manifest.webmanifest"),
    &files!("text/plain; charset=utf-8": "uplot.LICENSE.txt"),
];

/// A file as it is served, with the entity tag of its content, by which a browser can tell that it has it already.
struct ServedFile {
    name: Cow<'static, str>,
    media_type: &'static str,
    bytes: Cow<'static, [u8]>,
    tag: String,
}

impl ServedFile {
    fn new(
        name: impl Into<Cow<'static, str>>,
        media_type: &'static str,
        bytes: impl Into<Cow<'static, [u8]>>,
    ) -> Self {
        let bytes = bytes.into();
        let tag = format!("\"{:016x}\"", Crc::<u64>::new(&CRC_64_XZ).checksum(&bytes));
        Self {
            name: name.into(),
            media_type,
            bytes,
            tag,
        }
    }
}

/// The files, and each chapter of each language, such as `setup.de.json`.
static SERVED: LazyLock<Vec<ServedFile>> = LazyLock::new(|| {
    let files = FILES
        .iter()
        .copied()
        .flatten()
        .map(|file| ServedFile::new(file.name, file.media_type, lean(file)));
    let chapters = CATALOGUES.into_iter().flat_map(|catalogue| {
        TextChapter::ALL.map(|chapter| {
            let name = format!("{}.{}.json", chapter.keyword(), catalogue.language);
            ServedFile::new(
                name,
                "application/json",
                catalogue.chapter(chapter).into_bytes(),
            )
        })
    });
    files.chain(chapters).collect()
});

/// The content of a file without what only its authors read: indents and lines that are comments. Third-party files are left
/// as they are.
fn lean(file: &PageFile) -> Cow<'static, [u8]> {
    let has_comments = file.name.ends_with(".js") || file.name.ends_with(".css");
    let text = match std::str::from_utf8(file.bytes) {
        Ok(text) if has_comments && !file.name.starts_with("uplot") => text,
        _ => return file.bytes.into(),
    };
    let mut kept = String::with_capacity(text.len());
    let mut in_comment = false;
    for line in text.lines().map(str::trim) {
        in_comment |= line.starts_with("/*");
        if !in_comment && !line.is_empty() && !line.starts_with("//") {
            kept += line;
            kept.push('\n');
        }
        in_comment &= !line.ends_with("*/");
    }
    kept.into_bytes().into()
}

/// The page at `/`, and what it needs below `/assets/`. `/open/` leads to it: the app that was installed from the page
/// starts there, and only there its worker may answer that the gateway cannot be reached.
pub(super) fn router<S: Clone + Send + Sync + 'static>() -> Router<S> {
    let index = async |headers: HeaderMap| answer(INDEX, &headers);
    let asset = async |Path(name): Path<String>, headers: HeaderMap| answer(&name, &headers);
    let worker = async |headers: HeaderMap| answer(OFFLINE_WORKER, &headers);
    let open = async || {
        (
            StatusCode::SEE_OTHER,
            [
                (header::LOCATION, "../"),
                (header::CACHE_CONTROL, "no-store"),
            ],
        )
    };
    let router = Router::new()
        .route("/", get(index))
        .route("/assets/{name}", get(asset));
    router
        .route("/open/", get(open))
        .route("/offline.js", get(worker))
}

fn answer(name: &str, asked: &HeaderMap) -> Response {
    let Some(ServedFile {
        media_type,
        bytes,
        tag,
        ..
    }) = SERVED.iter().find(|served| served.name == name)
    else {
        return StatusCode::NOT_FOUND.into_response();
    };
    let headers = [
        (header::CONTENT_TYPE, *media_type),
        (header::ETAG, tag.as_str()),
        (header::CACHE_CONTROL, "no-cache"),
    ];
    let known = asked
        .get(header::IF_NONE_MATCH)
        .and_then(|value| value.to_str().ok())
        .unwrap_or_default();
    // A proxy that compresses the file marks the tag as weak.
    if known
        .split(',')
        .any(|one| one.trim().trim_start_matches("W/") == tag)
    {
        return (StatusCode::NOT_MODIFIED, headers).into_response();
    }
    (headers, &**bytes).into_response()
}
