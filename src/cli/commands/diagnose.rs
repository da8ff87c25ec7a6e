//! `diagnose`: writes one archive with everything that helps others to find out what is wrong.

use crate::cli::tools::socket::{self, SocketRequest, connect, exchange_bytes, within};
use crate::cli::tools::{CommandFailure, input, print};
use crate::config::without_secrets;
use crate::daemon::host::about;
use crate::daemon::host::archive::{ArchivedFile, archive};
use crate::daemon::http::diagnostics::SECONDS;
use crate::daemon::journal::file_in;
use crate::daemon::journal::listing::{columns, in_csv};
use crate::daemon::journal::reader::connect as open_journal;
use crate::daemon::journal::search::MergedRows;
use crate::journal::JournalTable;
use crate::north::titles::PlantTitles;
use axum::body::Bytes;
use std::io::Write;
use std::path::{Path, PathBuf};
use std::time::Duration;

/// Longest wait for the archive beyond the recording.
const PATIENCE: Duration = Duration::from_secs(20);
/// Rows of the journal of a gateway that does not run.
const ROWS_MAX: usize = 5000;

/// Arguments of `diagnose`.
#[derive(Debug, clap::Args)]
pub struct Args {
    #[command(flatten)]
    place: socket::SocketArgs,
    /// How long the traffic of the lines is recorded
    #[arg(long, value_name = "N", default_value_t = 10, value_parser = clap::value_parser!(u64).range(SECONDS))]
    seconds: u64,
    /// The archive to write, which must not exist
    #[arg(
        short,
        long,
        value_name = "FILE",
        default_value = "vfd-gateway-diagnostics.tar.gz"
    )]
    out: PathBuf,
}

/// Writes the archive of the running gateway, or with `--config` what is known of one that does not run.
pub fn diagnose(args: &Args) -> Result<(), CommandFailure> {
    let failed =
        |error: std::io::Error| CommandFailure::failed(format!("{}: {error}", args.out.display()));
    // Created first: no traffic is recorded for an archive that cannot be written.
    let mut file = std::fs::File::create_new(&args.out).map_err(failed)?;
    let made = make_archive(args).inspect_err(|_| drop(std::fs::remove_file(&args.out)))?;
    file.write_all(&made.archive)
        .and_then(|()| file.sync_all())
        .map_err(failed)?;
    print(&format!(
        "{}{}: {} kB, without passwords\n",
        made.remark,
        args.out.display(),
        made.archive.len() / 1000
    ))
}

/// An archive, with what has to be said about it.
struct MadeArchive {
    archive: Vec<u8>,
    remark: String,
}

fn make_archive(args: &Args) -> Result<MadeArchive, CommandFailure> {
    let runtime = tokio::runtime::Builder::new_current_thread()
        .enable_all()
        .build()
        .map_err(CommandFailure::failed)?;
    let (reason, place) = match args.place.path() {
        Ok(socket) => match runtime.block_on(running(&socket, args.seconds)) {
            Ok(archive) => {
                return Ok(MadeArchive {
                    archive: archive.to_vec(),
                    remark: String::new(),
                });
            }
            Err(reason) => (reason, format!("gateway at {}", socket.display())),
        },
        Err(failure) => (failure.to_string(), "configuration".to_owned()),
    };
    let Some(config) = args.place.config() else {
        return Err(CommandFailure::failed(format!(
            "{place}: {reason}; with --config FILE what is known without it is written"
        )));
    };
    let archive = stopped(config, &reason).map_err(CommandFailure::failed)?;
    Ok(MadeArchive {
        archive,
        remark: format!("{place}: {reason}\nonly what is known without it is written\n"),
    })
}

/// The archive of the gateway behind `socket`.
async fn running(socket: &Path, seconds: u64) -> Result<Bytes, String> {
    let path = format!("/api/v1/diagnostics?seconds={seconds}");
    let patience = PATIENCE + Duration::from_secs(seconds);
    let question = SocketRequest::get(&path);
    let asked = async { exchange_bytes(connect(socket).await?, "localhost", question).await };
    let (status, body) = within(patience, asked).await?;
    match status.is_success() {
        true => Ok(body),
        false => Err(format!(
            "{path} answers {status}: {}",
            String::from_utf8_lossy(&body).trim()
        )),
    }
}

/// What is known of a gateway with the configuration at `config` that does not answer for `reason`.
fn stopped(config: &Path, reason: &str) -> std::io::Result<Vec<u8>> {
    let (text, findings) = match input::looked_through(config) {
        Ok((loaded, text)) => (
            text,
            loaded
                .err()
                .map_or_else(|| "no problems\n".to_owned(), |it| input::drawn(&it)),
        ),
        Err(failure) => (String::new(), failure.to_string()),
    };
    let mut files = vec![
        ArchivedFile::new("gateway.txt", format!("{reason}\n")),
        ArchivedFile::new("configuration.toml", without_secrets(&text)),
        ArchivedFile::new("check.txt", findings),
    ];
    files.extend(about::files());
    files.extend(crate::config::data_dir(&text).and_then(|dir| journal(&file_in(&dir))));
    archive("vfd-gateway-stopped", &files)
}

/// The newest rows of the journal; `None` if there is none that can be read.
fn journal(path: &Path) -> Option<ArchivedFile> {
    let connection = path.exists().then(|| open_journal(path).ok())??;
    let titles = PlantTitles::default();
    let rows: Vec<_> = MergedRows::new(&connection, &JournalTable::ALL)
        .filter_map(Result::ok)
        .map(|(table, row)| in_csv(table, &row, &titles))
        .collect();
    let newest = rows.len().saturating_sub(ROWS_MAX);
    Some(ArchivedFile::new(
        "journal.csv",
        columns(&titles) + &rows[newest..].concat(),
    ))
}
