//! `read`: registers or named values of one drive, once, through a running gateway or directly on a port.

use crate::cli::tools::reading::{ReadSelection, ShownValue};
use crate::cli::tools::{CommandFailure, print};
use serde_json::json;
use std::fmt::Write;

/// Arguments of `read`.
#[derive(Debug, clap::Args)]
pub struct Args {
    #[command(flatten)]
    what: ReadSelection,
}

impl Args {
    /// Whether there is no gateway between.
    pub const fn is_straight(&self) -> bool {
        self.what.target.is_straight()
    }
}

/// Reads once and prints the values.
pub fn read(args: &Args) -> Result<(), CommandFailure> {
    let asked = args.what.asked()?;
    let runtime = tokio::runtime::Builder::new_current_thread()
        .enable_all()
        .build()
        .map_err(CommandFailure::failed)?;
    let values = runtime.block_on(async {
        let mut reached = args.what.reach().await?;
        let values = asked.read(&mut reached.client).await;
        reached.close().await;
        values.map_err(CommandFailure::from)
    })?;
    if args.what.json {
        let values: Vec<_> = values.iter().map(ShownValue::json).collect();
        let (place, number) = args.what.target.place();
        return print(&format!(
            "{}\n",
            json!({ (place): number, "values": values })
        ));
    }
    let width = values
        .iter()
        .map(|value| value.label.len())
        .max()
        .unwrap_or(0);
    let mut text = String::new();
    for value in &values {
        let _ = writeln!(text, "{:width$}  {}", value.label, value.text());
    }
    print(&text)
}
