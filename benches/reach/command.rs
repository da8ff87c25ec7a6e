//! An MQTT command to an idle line, and the way that a message takes through the same broker, in turn.

use crate::bare_mqtt::Talker;
use crate::brokers::Broker;
use crate::plant::{Gateway, RUN, SETPOINT, Setup};
use crate::table::{Row, Times};
use crate::tapped::{Heard, TappedLine};
use std::time::Duration;
use vfd_gateway::daemon::clock;
use vfd_gateway::domain::time::MonoTime;
use vfd_gateway::sim::{BusOptions, Pacing};

const PATIENCE: Duration = Duration::from_secs(2);
/// The line counts as idle when it was silent for this long.
const IDLE: Duration = Duration::from_millis(3);
const ECHO: &str = "bench/echo";

/// A client of the library that the gateway uses too, its connection served by a thread.
enum Publisher {
    V4(rumqttc::Client),
    V5(rumqttc::v5::Client),
}

impl Publisher {
    fn connect(port: u16, version: u8) -> Self {
        if version == 4 {
            let options = rumqttc::MqttOptions::new("bench-publisher", "127.0.0.1", port);
            let (client, mut connection) = rumqttc::Client::new(options, 64);
            connection.eventloop.network_options.set_tcp_nodelay(true);
            std::thread::spawn(move || connection.iter().take_while(Result::is_ok).for_each(drop));
            return Self::V4(client);
        }
        let mut options = rumqttc::v5::MqttOptions::new("bench-publisher", "127.0.0.1", port);
        let mut network = rumqttc::NetworkOptions::new();
        network.set_tcp_nodelay(true);
        options.set_network_options(network);
        let (client, mut connection) = rumqttc::v5::Client::new(options, 64);
        std::thread::spawn(move || connection.iter().take_while(Result::is_ok).for_each(drop));
        Self::V5(client)
    }

    fn publish(&self, topic: &str, payload: String) {
        match self {
            Self::V4(client) => {
                client.publish(topic, rumqttc::QoS::AtMostOnce, false, payload).expect("published");
            }
            Self::V5(client) => {
                let qos = rumqttc::v5::mqttbytes::QoS::AtMostOnce;
                client.publish(topic, qos, false, payload).expect("published");
            }
        }
    }
}

impl Drop for Publisher {
    fn drop(&mut self) {
        let _ = match self {
            Self::V4(client) => client.disconnect().is_ok(),
            Self::V5(client) => client.disconnect().is_ok(),
        };
    }
}

/// What belongs to one measurement.
struct Scene {
    line: TappedLine,
    publisher: Publisher,
    echo: Talker,
    random: fastrand::Rng,
    lost: u64,
}

pub fn command() -> Vec<Row> {
    [5, 4].into_iter().flat_map(of_version).collect()
}

fn of_version(version: u8) -> Vec<Row> {
    let broker = Broker::start(false);
    let bus = BusOptions { pacing: Pacing::None, silence: Some(Duration::ZERO), ..BusOptions::default() };
    let line = TappedLine::start(1, bus);
    let setup = Setup {
        device: line.path(),
        drives: 1,
        unpaced: true,
        poll: "1h",
        mqtt: Some((broker.port, version)),
        listen: 0,
    };
    let gateway = Gateway::start(&setup);
    let publisher = Publisher::connect(broker.port, version);
    let echo = Talker::connect(broker.port, "bench-echo", &[ECHO]).expect("the broker accepts");
    let mut scene = Scene { line, publisher, echo, random: fastrand::Rng::with_seed(1), lost: 0 };
    scene.begin();
    let count = if crate::is_quick() { 100 } else { 1000 };
    let pairs: Vec<_> = (0..count).map(|n| (scene.command(n), scene.echo(n))).collect();
    gateway.stop();
    scene.line.stop();
    let commands = Times::new(pairs.iter().filter_map(|pair| pair.0));
    let echoes = Times::new(pairs.iter().filter_map(|pair| pair.1));
    let name = if version == 5 { "command, MQTT 5" } else { "command, MQTT 3.1.1" };
    let told = format!("p50 / p99 / max of {}, ms", commands.len());
    vec![
        Row::told(format!("{name}, {}: {told}", broker.name()), commands.shown()),
        Row::told(format!("{name}: the broker's own time in the same run, ms"), echoes.shown()),
        Row::told(format!("{name}: p50 beyond the broker's, ms"), format!("{:.3}", commands.at(0.5) - echoes.at(0.5))),
        Row::at_most(format!("{name}: p99 beyond the broker's, ms"), 2.0, commands.at(0.99) - echoes.at(0.99)),
        Row::none(format!("{name}: lost on the way"), scene.lost),
    ]
}

impl Scene {
    /// Commands until the first one gets through: the gateway may still be on its way to the broker.
    fn begin(&mut self) {
        for _ in 0..100 {
            self.publisher.publish("vfd/bench/drive/d1/command", r#"{"run":"forward","frequency_hz":30}"#.into());
            if self.line.wait_for(Duration::from_millis(100), |heard| heard.is_write(RUN, 1), drop).is_some() {
                return;
            }
        }
        panic!("no command gets through");
    }

    /// A random moment on an idle line.
    fn moment(&mut self) -> MonoTime {
        self.line.quiet(IDLE);
        std::thread::sleep(Duration::from_micros(self.random.u64(1_000..10_000)));
        self.line.forget();
        clock::now()
    }

    /// Setpoint and run in turn.
    fn command(&mut self, n: u16) -> Option<Duration> {
        let value = 1000 + n % 2000;
        let is_it = move |heard: &Heard| {
            if n.is_multiple_of(2) { heard.is_write(SETPOINT, value) } else { heard.is_write(RUN, 1) }
        };
        let (topic, payload) = if n.is_multiple_of(2) {
            ("vfd/bench/drive/d1/frequency/set", format!("{}.{:02}", value / 100, value % 100))
        } else {
            ("vfd/bench/drive/d1/run/set", "forward".to_owned())
        };
        let begun = self.moment();
        self.publisher.publish(topic, payload);
        let heard = self.line.wait_for(PATIENCE, is_it, drop);
        self.lost += u64::from(heard.is_none());
        heard.map(|heard| heard.at.since(begun))
    }

    /// The same way without the gateway.
    fn echo(&mut self, n: u16) -> Option<Duration> {
        let begun = self.moment();
        self.publisher.publish(ECHO, n.to_string());
        let message = self.echo.next(PATIENCE).expect("the broker is there");
        self.lost += u64::from(message.is_none());
        message.map(|_| clock::now().since(begun))
    }
}
