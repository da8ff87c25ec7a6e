//! The operator's own model files, read from their directories within bounds.

use crate::daemon::host::user_files;
use std::fmt::Display;
use std::fs;
use std::io;
use std::path::{Path, PathBuf};

/// Most files of one catalogue, over all its directories.
const FILES_MAX: usize = 256;
/// Longest file, in bytes. The largest built-in model takes a tenth of it.
const BYTES_MAX: u64 = user_files::BYTES_MAX;

/// Directories of the operator's own models.
#[derive(Clone, Debug, Default, clap::Args)]
pub struct ModelDirs {
    /// A directory with model files of your own (*.toml); repeat it for several
    #[arg(long = "model-dir", value_name = "DIR", global = true)]
    pub dirs: Vec<PathBuf>,
}

/// The texts of model files, each with its path.
#[derive(Debug, Default)]
pub struct OwnModels {
    files: Vec<(PathBuf, String)>,
}

/// Something that cannot be read.
#[derive(Debug)]
pub struct UnreadableModel {
    /// The path and the reason.
    pub what: String,
    /// What would be correct.
    pub right: &'static str,
}

impl UnreadableModel {
    fn new(path: &Path, reason: impl Display, right: &'static str) -> Self {
        Self {
            what: format!("{}: {reason}", path.display()),
            right,
        }
    }
}

impl OwnModels {
    /// Reads each file in `dir` that ends in `.toml`, in the order of their names. Hidden ones are skipped: editors
    /// create such.
    ///
    /// Everything that cannot be read is returned; the rest is loaded.
    pub fn read_dir(&mut self, dir: &Path) -> Vec<UnreadableModel> {
        let paths = match model_files(dir) {
            Ok(paths) => paths,
            Err(error) => {
                return vec![UnreadableModel::new(
                    dir,
                    error,
                    "a directory that can be read",
                )];
            }
        };
        let mut unread = Vec::new();
        for path in paths {
            if self.files.len() >= FILES_MAX {
                let reason = format!("there are more than {FILES_MAX} model files");
                unread.push(UnreadableModel::new(
                    &path,
                    reason,
                    "only the models that are used",
                ));
                break;
            }
            match text_of(&path) {
                Ok(text) => self.files.push((path, text)),
                Err(problem) => unread.push(problem),
            }
        }
        unread
    }

    /// Reads the file at `path`, whatever its name and whether or not its directory was read before.
    ///
    /// # Errors
    /// It cannot be read, or is too long.
    pub fn read_file(&mut self, path: &Path) -> Result<(), UnreadableModel> {
        let text = text_of(path)?;
        let place = fs::canonicalize(path).ok();
        self.files
            .retain(|(other, _)| fs::canonicalize(other).ok() != place);
        self.files.push((path.to_owned(), text));
        Ok(())
    }

    /// Path and text of each file.
    pub fn files(&self) -> impl Iterator<Item = (&Path, &str)> {
        self.files
            .iter()
            .map(|(path, text)| (path.as_path(), text.as_str()))
    }
}

/// The model files in `dir`, by name.
fn model_files(dir: &Path) -> io::Result<Vec<PathBuf>> {
    let mut paths = Vec::new();
    for entry in fs::read_dir(dir)? {
        let path = entry?.path();
        let name = path.file_name().unwrap_or_default().to_string_lossy();
        let is_model = name.ends_with(".toml") && !name.starts_with('.');
        // Anything but a regular file would block, or is not intended.
        if is_model && fs::metadata(&path).map_or(true, |data| data.is_file()) {
            paths.push(path);
        }
    }
    paths.sort();
    Ok(paths)
}

fn text_of(path: &Path) -> Result<String, UnreadableModel> {
    user_files::text(path, BYTES_MAX).map_err(|error| match error.kind() {
        io::ErrorKind::FileTooLarge => {
            UnreadableModel::new(path, error, "a description of one drive model")
        }
        _ => UnreadableModel::new(path, error, "a text file that can be read"),
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::daemon::testing::Dir;

    #[test]
    fn a_model_file_that_is_much_too_long_is_not_read() {
        let dir = Dir::new();
        let long = dir.join("long.toml");
        fs::File::create(&long)
            .unwrap()
            .set_len(BYTES_MAX + 1)
            .unwrap();
        assert!(text_of(&long).is_err());
        fs::write(&long, "id = 1").unwrap();
        assert_eq!(text_of(&long).ok().as_deref(), Some("id = 1"));
    }
}
