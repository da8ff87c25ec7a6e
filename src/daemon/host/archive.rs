//! One compressed file with several files in it.

use super::clock;
use flate2::Compression;
use flate2::write::GzEncoder;
use std::io;
use tar::{Builder, Header};

/// A file for an archive.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ArchivedFile {
    /// Its path in the archive.
    pub path: String,
    /// Its content.
    pub content: Vec<u8>,
}

impl ArchivedFile {
    /// A file.
    pub fn new(path: impl Into<String>, content: impl Into<Vec<u8>>) -> Self {
        Self {
            path: path.into(),
            content: content.into(),
        }
    }
}

/// A `tar.gz` of `files` in the directory `root`, all of this moment.
///
/// # Errors
/// A path that the format cannot hold.
pub fn archive(root: &str, files: &[ArchivedFile]) -> io::Result<Vec<u8>> {
    let unix_s = u64::try_from(clock::wall().unix_ms / 1000).unwrap_or(0);
    let mut archive = Builder::new(GzEncoder::new(Vec::new(), Compression::default()));
    for file in files {
        let mut header = Header::new_gnu();
        header.set_size(file.content.len() as u64);
        header.set_mode(0o644);
        header.set_mtime(unix_s);
        archive.append_data(
            &mut header,
            format!("{root}/{}", file.path),
            file.content.as_slice(),
        )?;
    }
    archive.into_inner()?.finish()
}
