//! Builds the plan of a simulation from the arguments: who connects where, and as which user.

use super::credentials::Credentials;
use super::specimen::Specimen;
use super::{Args, ReadingArg, UpdateArg};
use crate::books::{Shape, Update};
use crate::play::{Plan, Reading};
use std::time::Duration;
use vfd_gateway::cli::tools::{CommandFailure, input};
use vfd_gateway::config::{self, BrokerSettings};
use vfd_gateway::daemon::mqtt::{BrokerKeeps, ConnectionSettings};
use vfd_gateway::daemon::service::build;
use vfd_gateway::domain::ids::Name;
use vfd_gateway::domain::problem::Problem;
use vfd_gateway::north::broker::Qos;

/// Fewest and most updates of a drive in a second: one an hour, and as many as the clock resolves.
const RATES: std::ops::RangeInclusive<f64> = 1.0 / 3600.0..=1000.0;

/// The plan that `args` describe.
pub fn plan(args: &Args, specimen: &Specimen) -> Result<Plan, CommandFailure> {
    let shape = shape(args)?;
    let credentials = args
        .credentials
        .as_deref()
        .map(Credentials::read)
        .transpose()?;
    let broker = way(args, specimen, &args.brokers)?;
    let elsewhere = if args.consumer_brokers.is_empty() {
        None
    } else {
        Some(way(args, specimen, &args.consumer_brokers)?)
    };
    let consumer_broker = elsewhere.as_ref().unwrap_or(&broker);
    let gateways = (0..shape.gateways).map(|number| {
        let name = Shape::gateway_name(number);
        as_user(
            in_turn(&broker, number),
            format!("vfd-gateway-{name}"),
            &name,
            credentials.as_ref(),
        )
    });
    let keeps = if args.qos == 1 {
        BrokerKeeps::Session
    } else {
        BrokerKeeps::Nothing
    };
    let consumers = (0..args.consumers as usize).map(|number| {
        let settings = ConnectionSettings {
            keeps,
            ..in_turn(consumer_broker, number)
        };
        as_user(
            settings,
            format!("vfd-fleet-consumer-{}", number + 1),
            &args.consumer_user,
            credentials.as_ref(),
        )
    });
    Ok(Plan {
        qos: if args.qos == 1 {
            Qos::AtLeastOnce
        } else {
            Qos::AtMostOnce
        },
        retain: !args.no_retain,
        expiry: specimen.expiry.filter(|_| !args.no_retain),
        state: specimen.state.clone(),
        gateways: gateways.collect::<Result<_, _>>()?,
        consumers: consumers.collect::<Result<_, _>>()?,
        shape,
        reading: match args.reading {
            ReadingArg::All => Reading::All,
            ReadingArg::Shared => Reading::Shared,
            ReadingArg::Split => Reading::Split,
        },
        connects_per_second: args.connects_per_second,
        threads: args.threads.into(),
        drain: Duration::from_secs(args.drain_seconds.into()),
        watched: args.watched.clone(),
    })
}

fn shape(args: &Args) -> Result<Shape, CommandFailure> {
    let rate = args.updates_per_second;
    if !RATES.contains(&rate) {
        return Err(CommandFailure::wrong(format!(
            "--updates-per-second {rate} is not between 1/3600 and 1000"
        )));
    }
    let updates = (f64::from(args.seconds) * rate).floor();
    if updates < 1.0 {
        return Err(CommandFailure::wrong(format!(
            "no drive has an update within {} s at {rate} a second",
            args.seconds
        )));
    }
    Ok(Shape {
        prefix: args.prefix.clone(),
        gateways: args.gateways as usize,
        drives: args.drives as usize,
        update: match args.update {
            UpdateArg::State => Update::State,
            UpdateArg::Frequency => Update::Frequency,
        },
        interval: Duration::from_secs_f64(1.0 / rate),
        updates: updates as u32,
    })
}

/// The connection settings for the nodes of a broker, by the rules of a configuration. Each client begins at one of the
/// nodes.
fn way(
    args: &Args,
    specimen: &Specimen,
    urls: &[String],
) -> Result<ConnectionSettings, CommandFailure> {
    let [url, others @ ..] = urls else {
        return Err(CommandFailure::wrong("no broker is named"));
    };
    let quoted = |text: &str| toml::Value::String(text.to_owned()).to_string();
    let others: Vec<_> = others.iter().map(|url| quoted(url)).collect();
    // Files in a configuration have absolute paths; on the command line they may be relative.
    let ca = match &args.ca {
        Some(ca) if url.starts_with("mqtts:") => std::path::absolute(ca).map(Some),
        _ => Ok(None),
    };
    let ca = ca.map_err(|error| CommandFailure::wrong(format!("--ca: {error}")))?;
    let ca = ca.map(|ca| format!("ca_file = {}\n", quoted(&ca.to_string_lossy())));
    let user = args.credentials.as_ref().map(|_| "user = \"fleet\"\n");
    let plain = args
        .allow_plain_password
        .then_some("allow_plain_password = true\n");
    let text = format!(
        "[mqtt]\nbroker = {}\nalso_at = [{}]\nversion = {}\nprefix = {}\n{}{}{}{}",
        quoted(url),
        others.join(", "),
        args.mqtt_version,
        quoted(&args.prefix),
        ca.unwrap_or_default(),
        user.unwrap_or_default(),
        plain.unwrap_or_default(),
        specimen.lines
    );
    let config = config::load(&text, &input::catalog_with(&args.own)?)
        .map_err(|problems| wrong(&problems))?;
    let mqtt = config
        .mqtt
        .filter(|mqtt| mqtt.broker != BrokerSettings::Embedded);
    let mqtt =
        mqtt.ok_or_else(|| CommandFailure::wrong("--broker: the embedded broker serves no fleet"))?;
    let side = build::broker(&mqtt, (&Name::fallback(), None), None, None)
        .map_err(CommandFailure::wrong)?;
    Ok(side.mqtt.connection)
}

/// The same settings, beginning at the node for client `number`.
fn in_turn(way: &ConnectionSettings, number: usize) -> ConnectionSettings {
    (0..number % (1 + way.also_at.len())).fold(way.clone(), |way, _| way.at_next_place())
}

fn as_user(
    settings: ConnectionSettings,
    client_id: String,
    user: &str,
    credentials: Option<&Credentials>,
) -> Result<ConnectionSettings, CommandFailure> {
    let password = credentials.map(|all| all.of(user)).transpose()?;
    let user = password.as_ref().map(|_| user.to_owned());
    Ok(ConnectionSettings {
        client_id,
        user,
        password,
        ..settings
    })
}

/// The problems of the configuration that follows from the arguments, as a failure.
pub fn wrong(problems: &[Problem]) -> CommandFailure {
    let line = |problem: &Problem| {
        let right = problem
            .right
            .as_ref()
            .map(|right| format!("; help: {right}"))
            .unwrap_or_default();
        format!("{}: {}{right}", problem.key, problem.what)
    };
    CommandFailure::wrong(problems.iter().map(line).collect::<Vec<_>>().join("\n"))
}
