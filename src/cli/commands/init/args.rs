//! The flags of `init`: one for each question, so that it can be scripted.

use crate::cli::tools::link_args::LinkArgs;
use crate::config::{self, PortAddress};
use std::path::PathBuf;

/// Arguments of `init`. What is not given is asked.
#[derive(Clone, Debug, clap::Args)]
pub struct Args {
    /// The file to write; never overwritten
    #[arg(short, long, value_name = "FILE", default_value = "vfd-gateway.toml")]
    pub out: PathBuf,
    /// Line: a serial port, or tcp://HOST:PORT of a serial device server
    #[arg(long, value_name = "PORT", value_parser = config::serial_port_address)]
    pub port: Option<PortAddress>,
    /// Stations to look for
    #[arg(long, value_name = "NUMBERS", default_value = "1-32")]
    pub stations: String,
    /// Search at this speed only, in bit/s
    #[arg(long)]
    pub baud: Option<u32>,
    #[command(flatten)]
    pub link: LinkArgs,
    /// A drive to use instead of a search; repeatable. The line is then at --baud, --parity and --stop-bits, or at the
    /// factory setting of the first
    #[arg(long, value_name = "NAME=MODEL@STATION")]
    pub drive: Vec<String>,
    /// Names of the drives that are found, in the order of their stations
    #[arg(long, value_name = "NAME,...", value_delimiter = ',')]
    pub names: Option<Vec<String>>,
    /// Model of the drives that fit several, repeatable: the first that fits is taken
    #[arg(long, value_name = "MODEL")]
    pub model: Vec<String>,
    /// The frequency that stands for 100 % at drives that need it stated
    #[arg(long, value_name = "HZ")]
    pub full_scale_hz: Option<String>,
    /// Interfaces to the drives: page, modbus-tcp, mqtt, home-assistant, sparkplug
    #[arg(long, value_name = "WAY,...")]
    pub ways: Option<String>,
    /// Address of the page
    #[arg(long, value_name = "ADDRESS")]
    pub page_listen: Option<String>,
    /// Networks that may see the page
    #[arg(long, value_name = "NETWORK,...")]
    pub page_allow: Option<String>,
    /// Who may sign in to the page. The password is the next line of stdin
    #[arg(long, value_name = "NAME")]
    pub page_user: Option<String>,
    /// Address of Modbus TCP
    #[arg(long, value_name = "ADDRESS")]
    pub modbus_listen: Option<String>,
    /// Networks that may read over Modbus TCP
    #[arg(long, value_name = "NETWORK,...")]
    pub modbus_allow: Option<String>,
    /// Networks that may command over Modbus TCP
    #[arg(long, value_name = "NETWORK,...")]
    pub modbus_write: Option<String>,
    /// URL of the broker
    #[arg(long, value_name = "URL")]
    pub broker: Option<String>,
    /// User at the broker; "" for none. The password is the next line of stdin
    #[arg(long, value_name = "NAME")]
    pub broker_user: Option<String>,
    /// Group of the Sparkplug edge node
    #[arg(long, value_name = "GROUP")]
    pub sparkplug_group: Option<String>,
    /// Who may command: page, modbus-tcp, mqtt, sparkplug; "" for none
    #[arg(long, value_name = "WAY,...")]
    pub command_from: Option<String>,
    /// Accept commands for models whose stop no manual proves: yes or no
    #[arg(long, value_name = "yes|no")]
    pub accept_unverified: Option<String>,
    /// Lowest and highest frequency in Hz
    #[arg(long, value_name = "MIN-MAX")]
    pub limits: Option<String>,
    /// Directions in which the motors may run: forward, or both
    #[arg(long, value_name = "forward|both")]
    pub directions: Option<String>,
    /// What to do when the client is lost: stop, coast or hold
    #[arg(long, value_name = "ACTION")]
    pub on_commander_lost: Option<String>,
    /// How long the client may be silent, such as 10s
    #[arg(long, value_name = "TIME")]
    pub lost_after: Option<String>,
    /// What to do when the gateway is shut down: stop, coast or hold
    #[arg(long, value_name = "ACTION")]
    pub on_shutdown: Option<String>,
    /// Directory for the journal and the tools
    #[arg(long, value_name = "DIR")]
    pub data_dir: Option<PathBuf>,
    /// Install the gateway as a service of systemd, or install and start it. Needs root, and --out
    /// /etc/vfd-gateway/vfd-gateway.toml
    #[arg(long, value_name = "none|install|start")]
    pub service: Option<String>,
    /// Run the gateway afterwards: yes or no
    #[arg(long, value_name = "yes|no")]
    pub start: Option<String>,
}
