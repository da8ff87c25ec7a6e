//! An MQTT command to an idle line, alternating with a message through the same broker and with the same path without
//! the gateway.

use crate::bare_mqtt::Talker;
use crate::brokers::Broker;
use crate::plant::{Gateway, RUN, Setup};
use crate::relay;
use crate::table::{Row, Times};
use crate::tapped::TappedLine;
use std::time::Duration;
use vfd_gateway::daemon::host::clock;
use vfd_gateway::domain::time::MonoTime;
use vfd_gateway::sim::{BusOptions, BusPacing};

const PATIENCE: Duration = Duration::from_secs(2);
const ECHO: &str = "bench/echo";

/// A client of the same library as the gateway's, its connection served by a thread.
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
                client
                    .publish(topic, rumqttc::QoS::AtMostOnce, false, payload)
                    .expect("published");
            }
            Self::V5(client) => {
                let qos = rumqttc::v5::mqttbytes::QoS::AtMostOnce;
                client
                    .publish(topic, qos, false, payload)
                    .expect("published");
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

/// What is measured.
#[derive(Clone, Copy)]
struct Case {
    name: &'static str,
    version: u8,
    /// The line has character times, so that its thread is a real-time one.
    is_paced: bool,
    count: u16,
    /// The line counts as idle when it was silent for this long.
    idle: Duration,
}

const CASES: [Case; 3] = [
    Case {
        name: "MQTT 5",
        version: 5,
        is_paced: false,
        count: 1000,
        idle: Duration::from_millis(3),
    },
    Case {
        name: "MQTT 3.1.1",
        version: 4,
        is_paced: false,
        count: 1000,
        idle: Duration::from_millis(3),
    },
    Case {
        name: "MQTT 5, paced line",
        version: 5,
        is_paced: true,
        count: 400,
        idle: Duration::from_millis(60),
    },
];

/// The parts of one measurement.
struct Scene {
    case: Case,
    line: TappedLine,
    publisher: Publisher,
    echo: Talker,
    relayed: TappedLine,
    random: fastrand::Rng,
    lost: u64,
}

pub fn command() -> Vec<Row> {
    CASES.into_iter().flat_map(measure).collect()
}

fn measure(case: Case) -> Vec<Row> {
    let broker = Broker::start(false);
    let unpaced = BusOptions {
        pacing: BusPacing::None,
        silence: Some(Duration::ZERO),
        ..BusOptions::default()
    };
    let bus = if case.is_paced {
        BusOptions::default()
    } else {
        unpaced
    };
    let line = TappedLine::start(1, bus);
    let mqtt = Some((broker.port, case.version));
    let setup = Setup {
        device: line.path(),
        drives: 1,
        unpaced: !case.is_paced,
        poll: "5s",
        mqtt,
        listen: 0,
    };
    let gateway = Gateway::start(&setup);
    let publisher = Publisher::connect(broker.port, case.version);
    let echo = Talker::connect(broker.port, "bench-echo", &[ECHO]).expect("the broker accepts");
    let relayed = relay::start(broker.port, bus, case.is_paced);
    let random = fastrand::Rng::with_seed(1);
    let mut scene = Scene {
        case,
        line,
        publisher,
        echo,
        relayed,
        random,
        lost: 0,
    };
    scene.begin();
    let count = if crate::is_quick() { 100 } else { case.count };
    let all: Vec<_> = (0..count)
        .map(|n| [scene.command(n), scene.echo(n), scene.relay(n)])
        .collect();
    gateway.stop();
    scene.line.stop();
    scene.relayed.stop();
    let [commands, echoes, relayed] =
        [0, 1, 2].map(|which| Times::new(all.iter().filter_map(|it| it[which])));
    let name = format!("command, {}", case.name);
    vec![
        Row::told(
            format!("{name}, {}: p50 / p99 / max of {count}, ms", broker.name()),
            commands.shown(),
        ),
        Row::told(
            format!("{name}: the broker's own time in the same run, ms"),
            echoes.shown(),
        ),
        Row::told(
            format!("{name}: the same hops with nothing in them, ms"),
            relayed.shown(),
        ),
        Row::told(
            format!("{name}: beyond the broker's, p50: gateway / nothing, ms"),
            format!(
                "{:.3} / {:.3}",
                commands.at(0.5) - echoes.at(0.5),
                relayed.at(0.5) - echoes.at(0.5)
            ),
        ),
        Row::at_most(
            format!("{name}: beyond the broker's, p99, ms"),
            2.0,
            commands.at(0.99) - echoes.at(0.99),
        ),
        Row::told(
            format!("{name}: beyond the broker's, p99 with nothing in the hops, ms"),
            format!("{:.3}", relayed.at(0.99) - echoes.at(0.99)),
        ),
        Row::none(format!("{name}: lost on the way"), scene.lost),
    ]
}

impl Scene {
    /// Sends commands until the first one gets through: the gateway may still be connecting to the broker.
    fn begin(&mut self) {
        for _ in 0..100 {
            self.publisher.publish(
                "vfd/bench/drive/d1/command",
                r#"{"run":"forward","frequency_hz":30}"#.into(),
            );
            if self
                .line
                .wait_for(
                    Duration::from_millis(100),
                    |heard| heard.is_write(RUN, 1),
                    drop,
                )
                .is_some()
            {
                return;
            }
        }
        panic!("no command gets through");
    }

    /// A random moment on an idle line.
    fn moment(&mut self) -> MonoTime {
        self.line.quiet(self.case.idle);
        std::thread::sleep(Duration::from_micros(self.random.u64(1_000..10_000)));
        self.line.forget();
        clock::now()
    }

    /// Setpoint and run in turn. The first frame of a run without a setpoint reads the drive's own one.
    fn command(&mut self, n: u16) -> Option<Duration> {
        let value = 1000 + n % 2000;
        let (topic, payload) = if n.is_multiple_of(2) {
            (
                "vfd/bench/drive/d1/frequency/set",
                format!("{}.{:02}", value / 100, value % 100),
            )
        } else {
            ("vfd/bench/drive/d1/run/set", "forward".to_owned())
        };
        let begun = self.moment();
        self.publisher.publish(topic, payload);
        let heard = self
            .line
            .wait_for(PATIENCE, |heard| heard.at >= begun, drop);
        self.lost += u64::from(heard.is_none());
        heard.map(|heard| heard.at.since(begun))
    }

    /// The broker alone.
    fn echo(&mut self, n: u16) -> Option<Duration> {
        let begun = self.moment();
        self.publisher.publish(ECHO, n.to_string());
        let message = self.echo.next(PATIENCE).expect("the broker is there");
        self.lost += u64::from(message.is_none());
        message.map(|_| clock::now().since(begun))
    }

    /// The same path without the gateway.
    fn relay(&mut self, n: u16) -> Option<Duration> {
        let begun = self.moment();
        self.publisher.publish(relay::TOPIC, n.to_string());
        let heard = self
            .relayed
            .wait_for(PATIENCE, |heard| heard.at >= begun, drop);
        self.lost += u64::from(heard.is_none());
        heard.map(|heard| heard.at.since(begun))
    }
}
