//! What was answered, and the configuration file that says it.

use crate::config::written::NewLine;
use ipnet::IpNet;
use serde_json::json;
use std::fmt::Write;
use std::net::SocketAddr;
use std::path::PathBuf;

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

/// All of it.
#[derive(Clone, Debug)]
pub struct InitAnswers {
    /// Today.
    pub date: String,
    /// For the journal and the tools.
    pub data_dir: PathBuf,
    /// The line.
    pub line: NewLine,
    /// The page, if there is one.
    pub page: Option<PageAnswers>,
    /// Modbus TCP, if it is served.
    pub modbus: Option<ModbusAnswers>,
    /// The broker, if there is one.
    pub broker: Option<BrokerAnswers>,
}

impl InitAnswers {
    /// The configuration file.
    pub fn text(&self) -> String {
        let mut text = format!(
            "# Made by `vfd-gateway init` on {}. deploy/vfd-gateway.toml has every key, with its meaning.\n\
             # After a change: `vfd-gateway check -c FILE`, then `vfd-gateway reload -c FILE`.\n\n\
             [gateway]\n# For the journal, and for the tools of this host.\ndata_dir = {}\n",
            self.date,
            json!(self.data_dir),
        );
        text.push_str(&self.line.text());
        for part in [self.page_text(), self.modbus_text(), self.broker_text()]
            .into_iter()
            .flatten()
        {
            text.push_str(&part);
        }
        text
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
            let _ = writeln!(
                text,
                "allow = {}",
                json!(page.allow.iter().map(IpNet::to_string).collect::<Vec<_>>())
            );
        }
        if let Some((name, hash)) = &page.user {
            let _ = write!(
                text,
                "\n[[http.users]]\nname = {}\npassword_hash_file = {}\n",
                json!(name),
                json!(hash)
            );
        }
        if let Some(file) = &page.certificate {
            let file = json!(file);
            let _ = write!(
                text,
                "\n[http.tls]\ncert_file = {file}\nkey_file = {file}\n"
            );
        }
        Some(text)
    }

    fn modbus_text(&self) -> Option<String> {
        let modbus = self.modbus.as_ref()?;
        let mut text = format!("\n[[modbus_tcp]]\nlisten = \"{}\"\n", modbus.listen);
        for (key, networks) in [("allow", &modbus.allow), ("write", &modbus.write)] {
            if !networks.is_empty() {
                let _ = writeln!(
                    text,
                    "{key} = {}",
                    json!(networks.iter().map(IpNet::to_string).collect::<Vec<_>>())
                );
            }
        }
        Some(text)
    }

    fn broker_text(&self) -> Option<String> {
        let broker = self.broker.as_ref()?;
        let mut text = format!("\n[mqtt]\nbroker = {}\n", json!(broker.url));
        if let Some((user, file)) = &broker.user {
            let _ = writeln!(
                text,
                "user = {}\npassword_file = {}",
                json!(user),
                json!(file)
            );
            if broker.url.starts_with("mqtt://") {
                text.push_str("# The password crosses the network in plain view; with mqtts:// it does not.\nallow_plain_password = true\n");
            }
        }
        if broker.home_assistant {
            text.push_str("home_assistant = { discovery = true }\n");
        }
        if let Some(group) = &broker.sparkplug_group {
            // Without a primary host only explicit leases tell that a host is gone.
            let _ = write!(
                text,
                "lease = \"explicit\"\n\n[mqtt.sparkplug]\ngroup = {}\n",
                json!(group)
            );
        }
        Some(text)
    }
}
