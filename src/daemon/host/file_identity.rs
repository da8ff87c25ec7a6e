//! Which file a path leads to. A process that has a file open does not notice when it is deleted or replaced.

use std::os::unix::fs::MetadataExt;
use std::path::Path;

/// A file, whatever its name is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct FileIdentity {
    device: u64,
    inode: u64,
}

impl FileIdentity {
    /// The file at `path`; `None` if there is none, or none that can be looked at.
    #[must_use]
    pub fn at(path: &Path) -> Option<Self> {
        let found = std::fs::metadata(path).ok()?;
        Some(Self {
            device: found.dev(),
            inode: found.ino(),
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::daemon::testing::Dir;

    #[test]
    fn a_file_is_itself_until_another_one_has_its_name() {
        let dir = Dir::new();
        let (one, other) = (dir.join("one"), dir.join("other"));
        assert_eq!(FileIdentity::at(&one), None);
        std::fs::write(&one, "a").unwrap();
        std::fs::write(&other, "b").unwrap();
        let before = FileIdentity::at(&one).unwrap();
        std::fs::write(&one, "c").unwrap();
        assert_eq!(FileIdentity::at(&one), Some(before), "written again");
        std::fs::rename(&other, &one).unwrap();
        assert_ne!(FileIdentity::at(&one), Some(before));
    }
}
