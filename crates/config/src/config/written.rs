//! Parts of a configuration file as text, with comments, as the program writes them for people.

use super::PortAddress;
use crate::domain::link::LinkSettings;
use crate::profile::model::Model;
use crate::toml_file::words::{PARITIES, word_for};
use serde_json::json;
use std::fmt::Write;
use std::sync::Arc;

/// A line with its drives: a `[[line]]`.
#[derive(Clone, Debug)]
pub struct NewLine {
    /// Its name.
    pub name: String,
    /// Where it is.
    pub port: PortAddress,
    /// Speed and character format.
    pub link: LinkSettings,
    /// Frames of text.
    pub is_ascii: bool,
    /// The adapter sends back what is sent.
    pub echoes: bool,
    /// Its drives.
    pub drives: Vec<NewDrive>,
    /// What was found besides, for comments.
    pub notes: Vec<String>,
}

/// One drive: a `[[line.drive]]`.
#[derive(Clone, Debug)]
pub struct NewDrive {
    /// Its name.
    pub name: String,
    /// Its model.
    pub model: Arc<Model>,
    /// Its station.
    pub station: u8,
    /// The unit of its own registers on Modbus TCP; `None`: the default.
    pub unit: Option<u8>,
    /// The frequency that stands for 100 %, for models that need it.
    pub full_scale_hz: Option<f64>,
    /// Why this model, for a comment.
    pub why: String,
    /// Who may command it; `None`: no client.
    pub control: Option<NewControl>,
}

/// The rules of control of a drive: a `[line.drive.control]`.
#[derive(Clone, Debug)]
pub struct NewControl {
    /// Who may command, as words of the configuration.
    pub from: Vec<String>,
    /// Lowest and highest frequency in Hz.
    pub limits_hz: (f64, f64),
    /// May run in reverse.
    pub has_reverse: bool,
    /// When the commander is lost, as a word of the configuration.
    pub on_commander_lost: String,
    /// How long it may be silent, such as `10s`.
    pub lost_after: String,
    /// When the gateway is shut down, as a word of the configuration.
    pub on_shutdown: String,
    /// Orders are taken although no manual proves the model's stop.
    pub accepts_unproven: bool,
}

impl NewLine {
    /// The text, which begins with an empty line.
    #[must_use]
    pub fn text(&self) -> String {
        let Self {
            name,
            port,
            link,
            is_ascii,
            echoes,
            drives,
            notes,
        } = self;
        let LinkSettings {
            baud,
            data_bits,
            parity,
            stop_bits,
        } = link;
        let parity = word_for(&PARITIES, parity);
        let (name, port) = (json!(name), json!(port.to_string()));
        let mut text = format!(
            "\n[[line]]\nname = {name}\nport = {port}\n# Every drive of the line is set to this.\n\
             baud = {baud}\nparity = \"{parity}\"\nstop_bits = {stop_bits}\n"
        );
        // Writing to a String cannot fail.
        if *is_ascii {
            let _ = writeln!(text, "framing = \"ascii\"\ndata_bits = {data_bits}");
        }
        if *echoes {
            text.push_str(
                "# The adapter echoes what is sent. If you can, switch that off at the adapter.\n\
                 echo = \"strip\"\n",
            );
        }
        for drive in drives {
            drive.write(&mut text);
        }
        for note in notes {
            let _ = writeln!(text, "\n# {note}");
        }
        text
    }
}

impl NewDrive {
    fn write(&self, text: &mut String) {
        let Self {
            name,
            model,
            station,
            unit,
            full_scale_hz,
            why,
            control,
        } = self;
        let name = json!(name);
        let id = &model.id;
        let _ = write!(
            text,
            "\n  [[line.drive]]\n  name = {name}\n  model = \"{id}\" # {why}\n  station = {station}\n"
        );
        if let Some(unit) = unit {
            let _ = writeln!(text, "  unit = {unit}");
        }
        if let Some(hz) = full_scale_hz {
            let _ = writeln!(
                text,
                "  # The frequency that stands for 100 % at the drive.\n  full_scale_hz = {hz:?}"
            );
        }
        if let Some(control) = control {
            text.push_str(&control.text());
        }
    }
}

impl NewControl {
    /// The text, which begins with an empty line.
    #[must_use]
    pub fn text(&self) -> String {
        let (least, most) = self.limits_hz;
        let directions = if self.has_reverse {
            "[\"forward\", \"reverse\"]"
        } else {
            "[\"forward\"]"
        };
        let mut text = format!(
            "\n    # Who may command it, and what happens when that client is lost.\n    [line.drive.control]\n    from = {}\n    \
             frequency_hz = {{ min = {least:?}, max = {most:?} }}\n    directions = {directions}\n    \
             on_commander_lost = {}\n    lost_after = {}\n    on_shutdown = {}\n",
            json!(self.from),
            json!(self.on_commander_lost),
            json!(self.lost_after),
            json!(self.on_shutdown),
        );
        if self.accepts_unproven {
            text.push_str(
                "    # No manual of this model proves its stop: see it work before you rely on it.\n    accept_unverified = [\"basic\"]\n",
            );
        }
        text
    }
}
