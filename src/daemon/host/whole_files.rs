//! Files that are there as a whole or not at all: written beside their place, synced and renamed.

use rustix::fs::{CWD, RenameFlags, fchown, renameat_with};
use rustix::process::Gid;
use std::ffi::OsString;
use std::fs::{self, File, OpenOptions};
use std::io::{self, Write};
use std::os::unix::fs::{MetadataExt, OpenOptionsExt, PermissionsExt};
use std::path::{Path, PathBuf};

/// Who may read a file, besides its owner.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum FileReaders {
    /// The owner alone: 0600.
    Owner,
    /// The group of its directory: 0640.
    Group,
    /// Everybody: 0644.
    All,
}

impl FileReaders {
    const fn mode(self) -> u32 {
        match self {
            Self::Owner => 0o600,
            Self::Group => 0o640,
            Self::All => 0o644,
        }
    }
}

/// Makes the file at `path`.
///
/// # Errors
/// The system's; `AlreadyExists` if there is anything at `path`, which is then unchanged.
pub fn create(path: &Path, bytes: &[u8], readers: FileReaders) -> io::Result<()> {
    put(path, bytes, readers, RenameFlags::NOREPLACE)
}

/// Makes the file at `path` or replaces it: whatever happens, the old or the new one is there.
///
/// # Errors
/// The system's.
pub fn replace(path: &Path, bytes: &[u8], readers: FileReaders) -> io::Result<()> {
    put(path, bytes, readers, RenameFlags::empty())
}

fn put(path: &Path, bytes: &[u8], readers: FileReaders, how: RenameFlags) -> io::Result<()> {
    let directory = match path.parent() {
        Some(parent) if !parent.as_os_str().is_empty() => parent,
        _ => Path::new("."),
    };
    let new = temporary_path(path);
    // What a process left that was killed while it wrote. Removed, so that the new file has none of its permissions.
    match fs::remove_file(&new) {
        Err(error) if error.kind() != io::ErrorKind::NotFound => return Err(error),
        _ => (),
    }
    let placed = fill(&new, bytes, readers, directory)
        .and_then(|()| renameat_with(CWD, &new, CWD, path, how).map_err(io::Error::from))
        .and_then(|()| File::open(directory)?.sync_all());
    if placed.is_err() {
        // The failure that counts is the first one.
        let _ = fs::remove_file(&new);
    }
    placed
}

fn fill(new: &Path, bytes: &[u8], readers: FileReaders, directory: &Path) -> io::Result<()> {
    // Closed to others until it has its group.
    let mut file = OpenOptions::new()
        .write(true)
        .create_new(true)
        .mode(FileReaders::Owner.mode())
        .open(new)?;
    let group = fs::metadata(directory)?.gid();
    if file.metadata()?.gid() != group {
        // A user outside of that group cannot give a file to it, and reads what the file says as its own group does.
        let _ = fchown(&file, None, Some(Gid::from_raw(group)));
    }
    file.set_permissions(fs::Permissions::from_mode(readers.mode()))?;
    file.write_all(bytes)?;
    file.sync_all()
}

/// The name under which it is written.
fn temporary_path(path: &Path) -> PathBuf {
    let mut name = path.file_name().map_or_else(OsString::new, OsString::from);
    name.push(".new");
    path.with_file_name(name)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::daemon::testing::Dir;

    fn mode(path: &Path) -> u32 {
        fs::metadata(path).unwrap().permissions().mode() & 0o777
    }

    #[test]
    fn a_file_is_created_once_and_replaced_as_a_whole() {
        let dir = Dir::new();
        let file = dir.join("key.pem");
        create(&file, b"first", FileReaders::Owner).unwrap();
        let again = create(&file, b"second", FileReaders::All).unwrap_err();
        assert_eq!(again.kind(), io::ErrorKind::AlreadyExists);
        assert_eq!(
            (fs::read(&file).unwrap(), mode(&file)),
            (b"first".to_vec(), 0o600)
        );
        replace(&file, b"third", FileReaders::Group).unwrap();
        assert_eq!(
            (fs::read(&file).unwrap(), mode(&file)),
            (b"third".to_vec(), 0o640)
        );
        assert_eq!(
            fs::read_dir(&*dir).unwrap().count(),
            1,
            "nothing is left beside it"
        );
    }

    #[test]
    fn what_a_killed_writer_left_gives_no_permissions() {
        let dir = Dir::new();
        let file = dir.join("key.pem");
        fs::write(dir.join("key.pem.new"), "half").unwrap();
        fs::set_permissions(dir.join("key.pem.new"), fs::Permissions::from_mode(0o666)).unwrap();
        create(&file, b"whole", FileReaders::Owner).unwrap();
        assert_eq!(
            (fs::read(&file).unwrap(), mode(&file)),
            (b"whole".to_vec(), 0o600)
        );
    }

    #[test]
    fn a_directory_that_is_missing_is_an_error() {
        let dir = Dir::new();
        assert!(replace(&dir.join("missing/file"), b"", FileReaders::All).is_err());
    }
}
