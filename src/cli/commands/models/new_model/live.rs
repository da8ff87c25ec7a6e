//! The drive in front of the person, where there is one: single reads, nothing else.

use crate::cli::tools::CommandFailure;
use crate::cli::tools::link_args::LinkArgs;
use crate::cli::tools::scanning::single::{ReadOutcome, SingleReads};
use crate::config::{self, PortAddress};
use crate::domain::address::Address;
use crate::domain::link::{LinkSettings, Parity};
use tokio::runtime::Runtime;

/// Where the drive is.
#[derive(Clone, Debug, clap::Args)]
pub struct LiveArgs {
    /// Read from the drive at this port while you answer. The line must not be in use
    #[arg(long, value_name = "PORT", value_parser = config::serial_port_address, requires = "station")]
    port: Option<PortAddress>,
    /// Station of the drive on the port
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u8).range(1..=247), requires = "port")]
    station: Option<u8>,
    /// Speed of the line in bit/s
    #[arg(long, default_value_t = 9600, value_parser = clap::value_parser!(u32).range(300..=1_000_000))]
    baud: u32,
    #[command(flatten)]
    link: LinkArgs,
}

/// A drive that is read.
pub struct LiveDrive {
    runtime: Runtime,
    reads: SingleReads,
}

impl LiveDrive {
    /// Opens the port, if one is given. Listens first, and refuses a line with traffic.
    pub fn open(args: &LiveArgs) -> Result<Option<Self>, CommandFailure> {
        let (Some(port), Some(station)) = (&args.port, args.station) else {
            return Ok(None);
        };
        let parity = args.link.parity().unwrap_or(Parity::None);
        let link = LinkSettings {
            baud: args.baud,
            data_bits: 8,
            parity,
            stop_bits: args.link.stop_bits.unwrap_or(1),
        };
        let runtime = tokio::runtime::Builder::new_current_thread()
            .enable_all()
            .build()
            .map_err(CommandFailure::failed)?;
        let reads = runtime.block_on(SingleReads::open(
            port,
            link,
            args.link.direction(),
            station,
        ))?;
        Ok(Some(Self { runtime, reads }))
    }

    /// The word of the holding register at `address`, or why there is none, for people.
    pub fn read(&mut self, address: u16) -> Result<Result<u16, String>, CommandFailure> {
        let heard = self
            .runtime
            .block_on(self.reads.read(Address::holding(address)))?;
        Ok(match heard {
            ReadOutcome::Word(word) => Ok(word),
            ReadOutcome::Exception(code) => Err(format!("the drive answers with exception {code}")),
            ReadOutcome::Damaged => Err("the answer was damaged".to_owned()),
            ReadOutcome::Silent => Err("the drive does not answer".to_owned()),
        })
    }

    /// Releases the port.
    pub fn close(mut self) {
        self.runtime.block_on(self.reads.close());
    }
}
