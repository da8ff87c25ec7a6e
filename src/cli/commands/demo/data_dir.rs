//! The demo's data directory, which lasts as long as the demo.

use crate::daemon::host::clock;
use std::fs::{self, DirBuilder};
use std::io;
use std::os::unix::fs::DirBuilderExt;
use std::path::{Path, PathBuf};

/// A directory of its own among the temporary files; removed when dropped.
pub(super) struct DataDir(PathBuf);

impl DataDir {
    /// Creates it. An existing one is never used: another user may have created it.
    pub(super) fn make() -> io::Result<Self> {
        let name = format!(
            "vfd-gateway-demo-{}-{:x}",
            std::process::id(),
            clock::wall().unix_ms
        );
        let path = std::env::temp_dir().join(name);
        DirBuilder::new().mode(0o700).create(&path)?;
        Ok(Self(path))
    }

    pub(super) fn path(&self) -> &Path {
        &self.0
    }
}

impl Drop for DataDir {
    fn drop(&mut self) {
        // A directory that cannot be removed is small, and the demo has ended.
        let _ = fs::remove_dir_all(&self.0);
    }
}
