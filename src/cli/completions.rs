//! `completions`: what lets a shell finish the words of this program.

use super::{Failure, help, print};

/// Arguments of `completions`.
#[derive(Debug, clap::Args)]
pub struct Args {
    /// The shell
    #[arg(value_enum)]
    shell: clap_complete::Shell,
}

/// Prints the script for the shell.
pub fn completions(args: &Args) -> Result<(), Failure> {
    let mut command = help::command();
    let name = command.get_name().to_owned();
    let mut script = Vec::new();
    clap_complete::generate(args.shell, &mut command, name, &mut script);
    print(&String::from_utf8(script).map_err(Failure::failed)?)
}
