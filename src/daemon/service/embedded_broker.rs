//! The embedded broker, which the gateway starts itself.

use crate::config::{Config, MqttSettings};
use crate::daemon::mqtt::broker_child::BrokerChild;
use crate::daemon::service::start_error::StartError;
use std::net::{Ipv4Addr, SocketAddr};

/// The embedded broker, if `config` requests it.
///
/// # Errors
/// It does not start.
pub(super) fn embedded_broker(config: &Config) -> Result<Option<BrokerChild>, StartError> {
    if !config.mqtt.as_ref().is_some_and(MqttSettings::is_embedded) {
        return Ok(None);
    }
    let any = |port| SocketAddr::from((Ipv4Addr::LOCALHOST, port));
    // The default port if it is free, so that tools find it; otherwise any.
    let broker = BrokerChild::start(any(1883)).or_else(|_| BrokerChild::start(any(0)));
    broker.map(Some).map_err(StartError::Broker)
}
