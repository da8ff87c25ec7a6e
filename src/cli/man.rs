//! `man`: the manual pages of this program, made from what `--help` is made from.

use super::{Failure, help, print};
use std::path::PathBuf;

/// Arguments of `man`.
#[derive(Debug, clap::Args)]
pub struct Args {
    /// Write a page for the program and one for each command into this directory, which must exist
    #[arg(long, value_name = "DIR")]
    dir: Option<PathBuf>,
}

/// Prints the program's page, or writes all of them.
pub fn man(args: &Args) -> Result<(), Failure> {
    let command = help::command();
    if let Some(dir) = &args.dir {
        return clap_mangen::generate_to(command, dir)
            .map_err(|error| Failure::failed(format!("{}: {error}", dir.display())));
    }
    let mut page = Vec::new();
    clap_mangen::Man::new(command).render(&mut page).map_err(Failure::failed)?;
    print(&String::from_utf8(page).map_err(Failure::failed)?)
}
