//! `completions`: the script with which a shell completes the words of this program.

use crate::cli::tools::{CommandFailure, print};

/// Arguments of `completions`.
#[derive(Debug, clap::Args)]
pub struct Args {
    /// The shell
    #[arg(value_enum)]
    shell: clap_complete::Shell,
}

/// Prints the script that lets the shell complete `command`.
pub fn completions(args: &Args, mut command: clap::Command) -> Result<(), CommandFailure> {
    let name = command.get_name().to_owned();
    let mut script = Vec::new();
    clap_complete::generate(args.shell, &mut command, name.as_str(), &mut script);
    // For bash, clap_complete writes a name with a hyphen in two ways (clap issue 6421), and finds no option of a
    // command.
    let [wrong, right] = ["__subcmd__", "__"].map(|mark| name.replace('-', mark));
    print(
        &String::from_utf8(script)
            .map_err(CommandFailure::failed)?
            .replace(&wrong, &right),
    )
}
