//! A database that cannot be used is moved aside and never overwritten.

use crate::domain::calendar::rfc3339;
use crate::domain::time::WallTime;
use std::io;
use std::path::{Path, PathBuf};

/// Most files that are moved aside: a failing disk must not be filled with damaged files.
const ASIDE_MAX: usize = 8;
/// The files of a database: itself, its log, the log's index.
const PARTS: [&str; 3] = ["", "-wal", "-shm"];

/// Moves the database at `path` and its other files aside. Returns the new path.
///
/// # Errors
/// The system's, or too many files were moved aside already; then it stays.
pub fn move_aside(path: &Path, now: WallTime) -> io::Result<PathBuf> {
    let lying = damaged_beside(path)?;
    if lying >= ASIDE_MAX {
        let what = format!(
            "there are already {lying} damaged journals beside {}; move some of them away",
            path.display()
        );
        return Err(io::Error::other(what));
    }
    let moment: String = rfc3339(now)
        .chars()
        .filter(|c| !matches!(c, '-' | ':' | '.'))
        .collect();
    let target = |count: usize| match count {
        0 => PathBuf::from(format!("{}.damaged-{moment}", path.display())),
        _ => PathBuf::from(format!("{}.damaged-{moment}-{count}", path.display())),
    };
    // We hold the lock of the data directory, so no other process creates one meanwhile.
    let target = (0..=ASIDE_MAX).map(target).find(|target| !target.exists());
    let target = target.ok_or_else(|| io::Error::other("no name is free"))?;
    // The main file may be the missing one.
    for part in PARTS {
        let from = format!("{}{part}", path.display());
        let to = format!("{}{part}", target.display());
        match std::fs::rename(from, to) {
            Err(error) if error.kind() != io::ErrorKind::NotFound => return Err(error),
            _ => {}
        }
    }
    Ok(target)
}

fn damaged_beside(path: &Path) -> io::Result<usize> {
    let (Some(directory), Some(name)) = (path.parent(), path.file_name()) else {
        return Ok(0);
    };
    let beginning = format!("{}.damaged-", name.to_string_lossy());
    let mut count = 0;
    for entry in std::fs::read_dir(directory)? {
        let name = entry?.file_name();
        let name = name.to_string_lossy();
        let is_part = PARTS
            .iter()
            .any(|part| !part.is_empty() && name.ends_with(part));
        count += usize::from(name.starts_with(&beginning) && !is_part);
    }
    Ok(count)
}
