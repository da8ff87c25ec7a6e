//! `man`: the manual pages of this program, generated from the same source as `--help`.

use crate::cli::tools::{CommandFailure, print};
use crate::domain::version::PROGRAM_VERSION;
use clap::Command;
use clap_mangen::Man;
use std::io;
use std::path::{Path, PathBuf};

/// Arguments of `man`.
#[derive(Debug, clap::Args)]
pub struct Args {
    /// Write the pages of the program and of each command to this directory, which is made if its parent exists
    #[arg(long, value_name = "DIR")]
    dir: Option<PathBuf>,
}

/// Prints the page of `command`, or writes those of all its sub-commands.
pub fn man(args: &Args, command: Command) -> Result<(), CommandFailure> {
    // A manual needs no command that prints help; and only a built command knows its full names.
    let mut command = command.disable_help_subcommand(true);
    command.build();
    if let Some(dir) = &args.dir {
        match std::fs::create_dir(dir) {
            Err(error) if error.kind() != io::ErrorKind::AlreadyExists => {
                return Err(CommandFailure::failed(format!(
                    "{}: {error}",
                    dir.display()
                )));
            }
            _ => (),
        }
        return write_all(&command, dir)
            .map_err(|error| CommandFailure::failed(format!("{}: {error}", dir.display())));
    }
    let mut page = Vec::new();
    page_of(&command)
        .render(&mut page)
        .map_err(CommandFailure::failed)?;
    print(&String::from_utf8(page).map_err(CommandFailure::failed)?)
}

/// Writes the page of `command` and of each visible command below it.
fn write_all(command: &Command, dir: &Path) -> io::Result<()> {
    for sub in command.get_subcommands().filter(|sub| !sub.is_hide_set()) {
        write_all(sub, dir)?;
    }
    page_of(command).generate_to(dir).map(|_| ())
}

fn page_of(command: &Command) -> Man {
    Man::new(command.clone()).source(format!("vfd-gateway {PROGRAM_VERSION}"))
}
