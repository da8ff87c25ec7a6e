//! What was answered, and the configuration file that says it.

use crate::config::PortAddress;
use crate::domain::link::LinkSettings;
use crate::profile::model::Model;
use crate::toml_file::words::{PARITIES, word_for};
use ipnet::IpNet;
use serde_json::json;
use std::fmt::Write;
use std::net::SocketAddr;
use std::path::PathBuf;
use std::sync::Arc;

/// The line with its drives.
#[derive(Clone, Debug)]
pub struct LineAnswers {
    /// Where it is.
    pub port: PortAddress,
    /// Speed and character format.
    pub link: LinkSettings,
    /// Frames of text.
    pub is_ascii: bool,
    /// The adapter sends back what is sent.
    pub echoes: bool,
    /// Its drives.
    pub drives: Vec<DriveAnswers>,
    /// What was found besides, for comments.
    pub notes: Vec<String>,
}

/// One drive.
#[derive(Clone, Debug)]
pub struct DriveAnswers {
    /// Its name.
    pub name: String,
    /// Its model.
    pub model: Arc<Model>,
    /// Its station.
    pub station: u8,
    /// The frequency that stands for 100 %, for models that need it.
    pub full_scale_hz: Option<f64>,
    /// Why this model, for a comment.
    pub why: String,
    /// Whether it may be commanded.
    pub is_controlled: bool,
}

/// The page.
#[derive(Clone, Debug)]
pub struct PageAnswers {
    /// Its address.
    pub listen: SocketAddr,
    /// The networks that may see it.
    pub allow: Vec<IpNet>,
    /// Who may sign in, with the file of the hash.
    pub user: Option<(String, PathBuf)>,
    /// The certificate with its key.
    pub certificate: Option<PathBuf>,
}

/// Modbus TCP.
#[derive(Clone, Debug)]
pub struct ModbusAnswers {
    /// Its address.
    pub listen: SocketAddr,
    /// The networks that may read.
    pub allow: Vec<IpNet>,
    /// The networks that may command.
    pub write: Vec<IpNet>,
}

/// The broker.
#[derive(Clone, Debug)]
pub struct BrokerAnswers {
    /// Its URL.
    pub url: String,
    /// The user, with the file of the password.
    pub user: Option<(String, PathBuf)>,
    /// Announce the drives to Home Assistant.
    pub home_assistant: bool,
    /// The Sparkplug group.
    pub sparkplug_group: Option<String>,
}

/// The rules of control, the same for all drives.
#[derive(Clone, Debug)]
pub struct ControlAnswers {
    /// Who may command, as words of the configuration.
    pub from: Vec<String>,
    /// Lowest and highest frequency in Hz.
    pub limits_hz: (f64, f64),
    /// May run in reverse.
    pub has_reverse: bool,
    /// When the client is lost.
    pub on_commander_lost: String,
    /// How long it may be silent.
    pub lost_after: String,
    /// When the gateway is shut down.
    pub on_shutdown: String,
}

/// All of it.
#[derive(Clone, Debug)]
pub struct Answers {
    /// Today.
    pub date: String,
    /// For the journal and the tools.
    pub data_dir: PathBuf,
    /// The line.
    pub line: LineAnswers,
    /// The page, if there is one.
    pub page: Option<PageAnswers>,
    /// Modbus TCP, if it is served.
    pub modbus: Option<ModbusAnswers>,
    /// The broker, if there is one.
    pub broker: Option<BrokerAnswers>,
    /// Rules of control; `None`: no client may command.
    pub control: Option<ControlAnswers>,
}

impl Answers {
    /// The configuration file.
    pub fn text(&self) -> String {
        let mut text = format!(
            "# Made by `vfd-gateway init` on {}. deploy/vfd-gateway.toml has every key, with its meaning.\n\
             # After a change: `vfd-gateway check -c FILE`, then `vfd-gateway reload -c FILE`.\n\n\
             [gateway]\n# For the journal, and for the tools of this host.\ndata_dir = {}\n",
            self.date,
            json!(self.data_dir),
        );
        self.line(&mut text);
        for part in [self.page_text(), self.modbus_text(), self.broker_text()].into_iter().flatten() {
            text.push_str(&part);
        }
        text
    }

    fn line(&self, text: &mut String) {
        let LineAnswers { port, link, is_ascii, echoes, drives, notes } = &self.line;
        let LinkSettings { baud, data_bits, parity, stop_bits } = link;
        let parity = word_for(&PARITIES, parity);
        let port = json!(port.to_string());
        // Writing to a String cannot fail.
        let _ = write!(
            text,
            "\n[[line]]\nname = \"line-1\"\nport = {port}\n# Every drive of the line is set to this.\n\
             baud = {baud}\nparity = \"{parity}\"\nstop_bits = {stop_bits}\n"
        );
        if *is_ascii {
            let _ = writeln!(text, "framing = \"ascii\"\ndata_bits = {data_bits}");
        }
        if *echoes {
            text.push_str("# The adapter sends back what is sent. Better switch that off there.\necho = \"strip\"\n");
        }
        for drive in drives {
            self.drive(drive, text);
        }
        for note in notes {
            let _ = writeln!(text, "\n# {note}");
        }
    }

    fn drive(&self, drive: &DriveAnswers, text: &mut String) {
        let DriveAnswers { name, model, station, full_scale_hz, why, is_controlled } = drive;
        let name = json!(name);
        let id = &model.id;
        let _ =
            write!(text, "\n  [[line.drive]]\n  name = {name}\n  model = \"{id}\" # {why}\n  station = {station}\n");
        if let Some(hz) = full_scale_hz {
            let _ = writeln!(text, "  # The frequency that stands for 100 % at the drive.\n  full_scale_hz = {hz:?}");
        }
        let Some(control) = self.control.as_ref().filter(|_| *is_controlled) else { return };
        let (least, most) = control.limits_hz;
        let directions = if control.has_reverse { "[\"forward\", \"reverse\"]" } else { "[\"forward\"]" };
        let _ = write!(
            text,
            "\n    # Who may command it, and what happens when that client is lost.\n    [line.drive.control]\n    from = {}\n    \
             frequency_hz = {{ min = {least:?}, max = {most:?} }}\n    directions = {directions}\n    \
             on_commander_lost = \"{}\"\n    lost_after = {}\n    on_shutdown = \"{}\"\n",
            json!(control.from),
            control.on_commander_lost,
            json!(control.lost_after),
            control.on_shutdown,
        );
        if !model.unproven_basics().is_empty() {
            text.push_str(
                "    # No manual of this model proves its stop: see it work before you rely on it.\n    accept_unverified = [\"basic\"]\n",
            );
        }
    }

    fn page_text(&self) -> Option<String> {
        let page = self.page.as_ref()?;
        let mut text = format!(
            "\n# The page: http{}://{}/\n[http]\nlisten = \"{}\"\n",
            if page.certificate.is_some() { "s" } else { "" },
            page.listen,
            page.listen
        );
        if !page.allow.is_empty() {
            let _ = writeln!(text, "allow = {}", json!(page.allow.iter().map(IpNet::to_string).collect::<Vec<_>>()));
        }
        if let Some((name, hash)) = &page.user {
            let _ = write!(text, "\n[[http.users]]\nname = {}\npassword_hash_file = {}\n", json!(name), json!(hash));
        }
        if let Some(file) = &page.certificate {
            let file = json!(file);
            let _ = write!(text, "\n[http.tls]\ncert_file = {file}\nkey_file = {file}\n");
        }
        Some(text)
    }

    fn modbus_text(&self) -> Option<String> {
        let modbus = self.modbus.as_ref()?;
        let mut text = format!("\n[[modbus_tcp]]\nlisten = \"{}\"\n", modbus.listen);
        for (key, networks) in [("allow", &modbus.allow), ("write", &modbus.write)] {
            if !networks.is_empty() {
                let _ = writeln!(text, "{key} = {}", json!(networks.iter().map(IpNet::to_string).collect::<Vec<_>>()));
            }
        }
        Some(text)
    }

    fn broker_text(&self) -> Option<String> {
        let broker = self.broker.as_ref()?;
        let mut text = format!("\n[mqtt]\nbroker = {}\n", json!(broker.url));
        if let Some((user, file)) = &broker.user {
            let _ = writeln!(text, "user = {}\npassword_file = {}", json!(user), json!(file));
            if broker.url.starts_with("mqtt://") {
                text.push_str("# The password crosses the network in plain view; with mqtts:// it does not.\nallow_plain_password = true\n");
            }
        }
        if broker.home_assistant {
            text.push_str("home_assistant = { discovery = true }\n");
        }
        if let Some(group) = &broker.sparkplug_group {
            // Without a primary host only explicit leases tell that a host is gone.
            let _ = write!(text, "lease = \"explicit\"\n\n[mqtt.sparkplug]\ngroup = {}\n", json!(group));
        }
        Some(text)
    }
}
