//! The real program, started as an operator starts it, against programs that nobody here wrote.
//!
//! | file | what is promised there |
//! | --- | --- |
//! | `reading` | ordinary clients read a drive through the gateway, and ordinary drives are read |
//! | `refusing` | what may not be done is refused by the right exception and never reaches the line |
//! | `crashing` | the gateway is killed at any moment, and what must hold over that |
//! | `crowding` | more clients than there is room for: who gives way, and that priority finds a place |
//! | `failing_disk` | the disk refuses writes, syncs and room: control goes on, it is seen, nothing is lost or doubled |
//! | `beginning` | a start beside a large journal |
//! | `burdening` | clients without rights cost little memory, and a drive that runs stays commanded |
//! | `flooding` | a line whose peer never stops sending takes no time from another |
//! | `coming_and_going` | unplugged adapters, signals, taken ports |
//! | `unplugging` | an adapter that comes and goes leaks nothing and is back within a second; a device has one holder |
//! | `network` | lines behind ser2net and other serial device servers |
//! | `modbus_tcp_drives` | drives behind Modbus TCP servers of others, with a way between that cuts, delays, doubles and swaps |
//! | `live` | the page hears of values, trips, lost lines and reloads, and no listener costs the others anything |
//! | `asking` | `health`, `read`, `write` and `watch` ask a running gateway |
//! | `scanning` | `scan` finds drives on a line that nobody uses, with model and setting, by reads alone |
//! | `on_port` | `read`, `write` and `watch` without a gateway, behind the same guard |
//! | `parameters` | `params`: what a drive holds goes to a file, is compared, and comes back at standstill |
//! | `enabling` | `verify` and `enable` look at a drive and set what it needs before it obeys |
//! | `qualifying` | `qualify` leads a person through what a model leaves unproven, and no motor runs on behind it |
//! | `capturing` | what goes over a line is seen by whoever watches, and tshark decodes what is captured |
//! | `checking` | what `check` and the other commands say, and their exit codes |
//! | `adding` | the drive that the tutorial adds is checked, played and run as it says |
//! | `documents` | the reference lists every command, option and key, and the links of all documents lead somewhere |
//! | `guides` | the guides under `docs/` and the README, followed literally from their beginning to a live value |
//! | `initialising` | `init`: from a line of unknown drives to a gateway that serves them |
//! | `asked` | `init` at a terminal: how much a person is asked, and that Home Assistant sees what was found |
//! | `new_models` | `models new`: from answers, with a drive that is read meanwhile, from a device template |
//! | `manual` | completions, manual pages and `map` |
//! | `containers` | what the Dockerfile and its guide say of the program is true |
//! | `topics` | the topic tree for subscribers, and trips |
//! | `commanding` | commands over MQTT are answered and move the motor, and what is no command moves nothing |
//! | `replays` | what a broker has kept moves nothing |
//! | `restarting` | the broker restarts with a run command kept on every topic |
//! | `half_open` | a way to the broker that swallows one direction is down |
//! | `rivals` | another client with the gateway's identifier is named, and not fought with |
//! | `encrypted` | TLS to the broker with certificates, user and password; what is said when it is refused |
//! | `brokers` | brokers other than mosquitto; strict and retained commands of other clients |
//! | `liars` | a broker that answers a subscription wrongly or not at all, or loses the probe, is given up and asked again |
//! | `owning` | commanders with names of their own on MQTT, and what the broker grants to each |
//! | `reloading` | the configuration changes while the gateway runs, and the service manager is told |
//! | `certificates` | the certificate of the page: made, trusted by OpenSSL, renewed, and its authority served |
//! | `serial_master` | a serial master reads and commands drives; noise, foreign units and late answers do not reach it; its port comes and goes, and so does it over reloads |
//! | `secured` | Modbus Security: certificates on both sides, and what each role may |
//! | `page_control` | control from the page: sign-in, what is refused, and what happens when the page is gone |
//! | `standby` | two gateways on one bus: one is killed, hangs, is unplugged, and the other stops what ran; never two masters; what subscribers, a Sparkplug host and the page see of that |
//! | `stopping` | STOP by every way, and nobody goes on behind it |
//! | `taking` | control passes from one commander to another, each by the way it came |
//! | `hanging` | a line whose thread hangs is noticed |
//! | `home_assistant` | Home Assistant finds the drives, commands them, and stops them by dying |
//! | `kept_trends` | trends survive a kill, and the page draws them |
//! | `many_drives` | the page with many drives: no stop moves, problems come first, drives are found, no barrier |
//! | `languages` | the page in another language: all of it, numbers as they were typed, and no stop moves |
//! | `unseen` | the page in a real browser: a motor that may still run where it is not seen, and names that are long |
//! | `looking` | the page in a real browser: what it shows, signing in, start, stop, trip, a gateway that is lost |
//! | `losing` | the commander, the broker or the gateway is gone, and the motor does not run on |
//! | `uniform` | the uniform unit and the exceptions as Modbus clients see them |
//! | `clients` | Modbus clients that nobody here wrote: all their functions, limits, many requests at once |
//! | `overseeing` | metrics, alive, ready, the health check |
//! | `scraping` | Prometheus as it stands reads the metrics, and the delivered alerts fire |
//! | `mistakes` | forty usual mistakes, each with the first line that it makes people see |
//! | `doctoring` | `doctor` names what is wrong with a line |
//! | `addon` | the add-on for Home Assistant writes a configuration that works |
//! | `diagnosing` | `diagnose` packs what helps into one archive that other programs read, without secrets |
//! | `vendors` | drives of other vendors, in ASCII too, played by a program that nobody here wrote, obey and are understood |
//! | `services` | the service unit, the udev rule and the starting configuration of the package, as systemd and udev read them |
//! | `composing` | the compose file, and its broker with its own passwords and access rules |
//! | `clusters` | the Kubernetes files, held against its schemas and against each other; the probes are answered |
//! | `controller` | the function block of `deploy/plc`, run beside a Modbus client, starts and stops a drive |
//! | `sparkplug` | a Sparkplug host finds the gateway and its drives, commands them, and loses them |
//! | `node_red` | the flow of `deploy/node-red`, in Node-RED as it stands, shows a drive and moves it |
//! | `fleet` | many gateways on one broker, a user each: what it acknowledges arrives, over bridges and lost nodes too |
//! | `fleet_commands` | the gateway of the fleet's guide is commanded over a bridge and at a cluster, and never late |
//! | `embedded` | the embedded broker serves mosquitto's tools and paho-mqtt |
//! | `trying` | the demo does what it prints |
//! | `pictures` | the pictures of the page for the documents, on demand |
//!
//! The other files are helpers. These tests are few and slow; what needs no process is tested elsewhere.

#![allow(
    clippy::unwrap_used,
    clippy::expect_used,
    clippy::panic,
    clippy::too_many_lines,
    clippy::disallowed_methods,
    reason = "a test fails by panicking, its helpers too, and is one story; and time here is the real one"
)]

#[path = "process/adding.rs"]
mod adding;
#[path = "process/addon.rs"]
mod addon;
#[path = "process/asked.rs"]
mod asked;
#[path = "process/asking.rs"]
mod asking;
#[path = "process/beginning.rs"]
mod beginning;
#[path = "process/brokers.rs"]
mod brokers;
#[path = "process/browser.rs"]
mod browser;
#[path = "process/burdening.rs"]
mod burdening;
#[path = "process/capturing.rs"]
mod capturing;
#[path = "process/card.rs"]
mod card;
#[path = "process/certificates.rs"]
mod certificates;
#[path = "process/checking.rs"]
mod checking;
#[path = "process/clients.rs"]
mod clients;
#[path = "process/clusters.rs"]
mod clusters;
#[path = "process/coming_and_going.rs"]
mod coming_and_going;
#[path = "process/commanding.rs"]
mod commanding;
#[path = "process/commissioning.rs"]
mod commissioning;
#[path = "process/composing.rs"]
mod composing;
#[path = "process/containers.rs"]
mod containers;
#[path = "process/controller.rs"]
mod controller;
#[path = "process/crashing.rs"]
mod crashing;
#[path = "process/crowding.rs"]
mod crowding;
#[path = "process/demo.rs"]
mod demo;
#[path = "process/diagnosing.rs"]
mod diagnosing;
#[path = "process/doctoring.rs"]
mod doctoring;
#[path = "process/documents.rs"]
mod documents;
#[path = "process/embedded.rs"]
mod embedded;
#[path = "process/enabling.rs"]
mod enabling;
#[path = "process/encrypted.rs"]
mod encrypted;
#[path = "process/failing_disk.rs"]
mod failing_disk;
#[path = "process/families.rs"]
mod families;
#[path = "process/fleet.rs"]
mod fleet;
#[path = "process/fleet_commands.rs"]
mod fleet_commands;
#[path = "process/flooding.rs"]
mod flooding;
#[path = "process/guides/mod.rs"]
mod guides;
#[path = "process/half_open.rs"]
mod half_open;
#[path = "process/hanging.rs"]
mod hanging;
#[path = "process/home_assistant.rs"]
mod home_assistant;
#[path = "process/initialising.rs"]
mod initialising;
#[path = "process/journal.rs"]
mod journal;
#[path = "process/kept_trends.rs"]
mod kept_trends;
#[path = "process/languages.rs"]
mod languages;
#[path = "process/liars.rs"]
mod liars;
#[path = "process/live.rs"]
mod live;
#[path = "process/looking.rs"]
mod looking;
#[path = "process/losing.rs"]
mod losing;
#[path = "process/manual.rs"]
mod manual;
#[path = "process/many_drives.rs"]
mod many_drives;
#[path = "process/network.rs"]
mod network;
#[path = "process/new_models.rs"]
mod new_models;
#[path = "process/node_red.rs"]
mod node_red;
#[path = "process/overseeing.rs"]
mod overseeing;
#[path = "process/owning.rs"]
mod owning;
#[path = "process/packet_limit.rs"]
mod packet_limit;
#[path = "process/page_control.rs"]
mod page_control;
#[path = "process/pictures.rs"]
mod pictures;
#[path = "process/reading.rs"]
mod reading;
#[path = "process/refusing.rs"]
mod refusing;
#[path = "process/reloading.rs"]
mod reloading;
#[path = "process/replays.rs"]
mod replays;
#[path = "process/restarting.rs"]
mod restarting;
#[path = "process/rivals.rs"]
mod rivals;
#[path = "process/scanning.rs"]
mod scanning;
#[path = "process/scraping.rs"]
mod scraping;
#[path = "process/secured.rs"]
mod secured;
#[path = "process/serial_master.rs"]
mod serial_master;
#[path = "process/services.rs"]
mod services;
#[path = "process/setting_up.rs"]
mod setting_up;
#[path = "process/sparkplug.rs"]
mod sparkplug;
#[path = "process/standby/mod.rs"]
mod standby;
#[path = "process/stopping.rs"]
mod stopping;
#[path = "process/taking.rs"]
mod taking;
#[path = "process/titled.rs"]
mod titled;
#[path = "process/topics.rs"]
mod topics;
#[path = "process/trying.rs"]
mod trying;
#[path = "process/uniform.rs"]
mod uniform;
#[path = "process/unplugging.rs"]
mod unplugging;
#[path = "process/unseen.rs"]
mod unseen;
#[path = "process/usage.rs"]
mod usage;
#[path = "process/vendors.rs"]
mod vendors;
#[path = "process/yard.rs"]
mod yard;

#[path = "process/adapter.rs"]
mod adapter;
#[path = "process/chromium.rs"]
mod chromium;
#[path = "process/hass.rs"]
mod hass;
#[path = "process/hub/mod.rs"]
mod hub;
#[path = "process/meddler.rs"]
mod meddler;
#[path = "process/mistakes.rs"]
mod mistakes;
#[path = "process/modbus_tcp_drives.rs"]
mod modbus_tcp_drives;
#[path = "process/mosquitto.rs"]
mod mosquitto;
#[path = "process/on_port.rs"]
mod on_port;
#[path = "process/outsiders.rs"]
mod outsiders;
#[path = "process/parameters.rs"]
mod parameters;
#[path = "process/plant.rs"]
mod plant;
#[path = "process/qualifying.rs"]
mod qualifying;
#[path = "process/raw.rs"]
mod raw;
#[path = "process/rig.rs"]
mod rig;
#[path = "process/roles.rs"]
mod roles;
#[path = "process/scada.rs"]
mod scada;
#[path = "process/standin.rs"]
mod standin;
#[path = "process/started.rs"]
mod started;
