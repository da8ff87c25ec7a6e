//! The demo's data directory, which lasts as long as the demo.

use crate::daemon::host::clock;
use std::fs::{self, DirBuilder};
use std::io;
use std::os::unix::fs::DirBuilderExt;
use std::path::{Path, PathBuf};

/// A directory of its own among the temporary files; removed when dropped.
pub(super) struct DataDir(PathBuf);

impl DataDir {
    /// Creates it. An existing one is never used: somebody else may have made it.
    pub(super) fn make() -> io::Result<Self> {
        let name = format!("vfd-gateway-demo-{}-{:x}", std::process::id(), clock::wall().unix_ms);
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
        // What is left is small, and nobody waits for an answer any more.
        let _ = fs::remove_dir_all(&self.0);
    }
}
