//! Directories that the gateway makes for itself.

use rustix::process::geteuid;
use std::fs::{self, DirBuilder};
use std::io;
use std::os::unix::fs::{DirBuilderExt, MetadataExt};
use std::path::{Path, PathBuf};

/// Only its owner and group may look into it.
const MODE: u32 = 0o750;

/// Why a directory that is missing was not made.
#[derive(Debug, thiserror::Error)]
pub enum NotMade {
    /// The directory above it is missing too, or belongs to another user.
    #[error("it does not exist; create it: install -d -o {uid} -m 750 {}", path.display())]
    NotOurs {
        /// The directory.
        path: PathBuf,
        /// The user of this process.
        uid: u32,
    },
    /// The system's.
    #[error(transparent)]
    System(#[from] io::Error),
}

/// Makes `path` if there is nothing, and returns whether it did. Only in a directory of this user: what an administrator
/// has to make, as below `/var/lib`, may be a mistyped path.
///
/// # Errors
/// [`NotMade`]
pub fn make(path: &Path) -> Result<bool, NotMade> {
    if path.try_exists()? {
        return Ok(false);
    }
    let uid = geteuid().as_raw();
    let above = path.parent().map(fs::metadata);
    if !above.is_some_and(|above| above.is_ok_and(|it| it.is_dir() && it.uid() == uid)) {
        return Err(NotMade::NotOurs {
            path: path.to_path_buf(),
            uid,
        });
    }
    match DirBuilder::new().mode(MODE).create(path) {
        // Another process has just made it.
        Err(error) if error.kind() == io::ErrorKind::AlreadyExists => Ok(false),
        made => Ok(made.map(|()| true)?),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::daemon::testing::Dir;
    use std::os::unix::fs::PermissionsExt;

    #[test]
    fn a_directory_is_made_in_one_of_ours_alone() {
        let dir = Dir::new();
        let data = dir.join("data");
        assert!(make(&data).unwrap());
        assert_eq!(
            fs::metadata(&data).unwrap().permissions().mode() & 0o777,
            MODE & !umask()
        );
        assert!(!make(&data).unwrap(), "it is there");
        let deeper = dir.join("missing/data");
        let refused = make(&deeper).unwrap_err().to_string();
        assert!(
            refused.contains("install -d -o ") && refused.ends_with("missing/data"),
            "{refused}"
        );
        assert!(!deeper.exists());
    }

    /// The mask of this process, from what it makes.
    fn umask() -> u32 {
        let dir = Dir::new();
        let probe = dir.join("probe");
        DirBuilder::new().mode(0o777).create(&probe).unwrap();
        !fs::metadata(&probe).unwrap().permissions().mode() & 0o777
    }
}
