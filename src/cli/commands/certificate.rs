//! `certificate`: a local authority, and the certificate that it issues for the page.

use crate::cli::tools::page_certificate::{CERTIFICATE_DAYS_MAX, PAGE, last, own_names, renewed};
use crate::cli::tools::{CommandFailure, print};
use crate::daemon::host::clock;
use crate::domain::calendar;
use std::path::PathBuf;

/// Arguments of `certificate`.
#[derive(Debug, clap::Args)]
pub struct Args {
    /// Directory for the authority and the certificate, such as /etc/vfd-gateway/tls. Made if its parent exists
    #[arg(long, value_name = "DIR")]
    dir: PathBuf,
    /// Host name or address by which browsers reach the gateway, repeatable; default: those of the last certificate, or
    /// this host's own
    #[arg(long = "name", value_name = "NAME")]
    names: Vec<String>,
    /// Days for which the certificate is valid
    #[arg(long, value_name = "N", default_value_t = CERTIFICATE_DAYS_MAX,
        value_parser = clap::value_parser!(i64).range(1..=CERTIFICATE_DAYS_MAX))]
    days: i64,
    /// Only renew a certificate that ends within so many days; for a timer
    #[arg(long, value_name = "DAYS", value_parser = clap::value_parser!(i64).range(1..=CERTIFICATE_DAYS_MAX))]
    renew_within: Option<i64>,
    /// Port of the page, for the address that is shown
    #[arg(long, value_name = "PORT", default_value_t = 8443)]
    port: u16,
}

/// Makes or renews the certificate in `args.dir`, with an authority if there is none yet.
pub fn certificate(args: &Args) -> Result<(), CommandFailure> {
    let now = clock::wall();
    let last = last(&args.dir.join(PAGE))?;
    if let (Some(within), Some(last)) = (args.renew_within, &last) {
        let ends_within =
            last.until.unix_ms.saturating_sub(now.unix_ms) < within * calendar::DAY_MS;
        if !ends_within {
            return print(&format!(
                "valid until {}: not renewed\n",
                calendar::day(last.until)
            ));
        }
    }
    let names = match (&args.names, last) {
        (given, _) if !given.is_empty() => {
            given.iter().map(|name| name.to_ascii_lowercase()).collect()
        }
        (_, Some(last)) => last.names,
        _ => own_names(),
    };
    print(&renewed(&args.dir, &names, now, args.days, args.port)?)
}
