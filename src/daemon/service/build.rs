//! Builds from the configuration what the journal and the conversations with the broker need.

use crate::config::{BrokerSettings, Config, MqttSettings, PasswordSource};
use crate::daemon::host::secret_files;
use crate::daemon::journal;
use crate::daemon::mqtt::{BrokerKeeps, ConnectionSettings, HiddenText, check_tls};
use crate::daemon::service::conversations::{BrokerSide, MqttConversation, SparkplugConversation};
use crate::domain::ids::Name;
use crate::domain::standby::StandbyPair;
use crate::north::mqtt::GatewayIdentity;
use std::net::SocketAddr;
use std::path::Path;

/// The settings of the journal of a gateway with a data directory.
#[must_use]
pub fn journal(config: &Config) -> Option<journal::Settings> {
    let directory = config.gateway.data_dir.clone()?;
    Some(journal::Settings {
        directory,
        max_bytes: config.journal.max_bytes,
        configuration: format!("{:016x}", config.digest),
    })
}

/// The connection and session settings of the gateway called `name` for the broker of `mqtt`, with its data in
/// `data_dir`. `standby`: which of several gateways of the name it is. `embedded` is the address of the embedded broker,
/// if that is used.
///
/// # Errors
/// The password cannot be read, or the TLS files cannot be used.
pub fn broker(
    mqtt: &MqttSettings,
    (name, standby): (&Name, Option<&StandbyPair>),
    data_dir: Option<&Path>,
    embedded: Option<SocketAddr>,
) -> Result<BrokerSide, String> {
    let (host, port, also_at, tls) = match (&mqtt.broker, embedded) {
        (
            BrokerSettings::Tcp {
                host,
                port,
                also_at,
                tls,
            },
            _,
        ) => (host.clone(), *port, also_at.clone(), tls.clone()),
        (BrokerSettings::Embedded, Some(address)) => {
            (address.ip().to_string(), address.port(), Vec::new(), None)
        }
        (BrokerSettings::Embedded, None) => {
            return Err("the embedded broker does not listen".to_owned());
        }
    };
    if let Some(tls) = &tls {
        check_tls(tls).map_err(|error| error.to_string())?;
    }
    let password = mqtt
        .credentials
        .as_ref()
        .and_then(|credentials| credentials.password.as_ref());
    let connection = ConnectionSettings {
        host,
        port,
        also_at,
        tls,
        client_id: mqtt.client_id(name, standby),
        user: mqtt
            .credentials
            .as_ref()
            .map(|credentials| credentials.user.clone()),
        password: password.map(read_password).transpose()?,
        keep_alive: mqtt.keep_alive,
        version: mqtt.session.version,
        keeps: BrokerKeeps::Nothing,
    };
    let sparkplug = mqtt
        .sparkplug_session(name.clone(), standby.is_some())
        .zip(data_dir)
        .map(|(settings, data_dir)| SparkplugConversation {
            connection: ConnectionSettings {
                client_id: mqtt.sparkplug_client_id(name),
                ..connection.clone()
            },
            settings,
            data_dir: data_dir.to_owned(),
        });
    let gateway = GatewayIdentity {
        name: name.clone(),
        standby: standby.cloned(),
    };
    let mqtt = MqttConversation {
        connection,
        gateway,
        settings: mqtt.session.clone(),
    };
    Ok(BrokerSide { mqtt, sparkplug })
}

/// A file's text without the line break that editors put at its end.
fn read_password(source: &PasswordSource) -> Result<HiddenText, String> {
    match source {
        PasswordSource::File(path) => secret_files::read(path)
            .map(|text| HiddenText::new(text.trim_end_matches(['\n', '\r']).to_owned()))
            .map_err(|error| format!("password_file {}: {error}", path.display())),
        PasswordSource::Env(name) => std::env::var(name)
            .map(HiddenText::new)
            .map_err(|error| format!("password_env {name}: {error}")),
    }
}
