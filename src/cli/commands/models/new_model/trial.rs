//! A new model is tried on a simulated drive: read, and, where it takes orders, run and stopped through the guard.

use crate::cli::tools::CommandFailure;
use crate::cli::tools::client::{GatewayPath, UnitClient};
use crate::cli::tools::own_gateway::{DriveArgs, OwnGateway, ToolAccess, UNIFORM_UNIT, control};
use crate::cli::tools::own_models::ModelDirs;
use crate::cli::tools::stopping::stop;
use crate::cli::tools::straight_write::{StraightOptions, arm_simulated};
use crate::config::PortAddress;
use crate::daemon::host::pty::Pty;
use crate::daemon::lines::simulator;
use crate::domain::control::ControlAction;
use crate::domain::ids::Station;
use crate::north::modbus::address as map;
use crate::profile::model::Model;
use crate::sim::{BusOptions, DriveOptions, SimBus, SimDrive};
use std::path::PathBuf;
use std::sync::Arc;
use std::time::Duration;
use tokio::time::{Instant, sleep};

/// The frequency at which the simulated motor runs, in Hz.
const FREQUENCY_HZ: &str = "10";
/// Limits of the simulated motor's frequency, in Hz.
const LIMITS_HZ: (f64, f64) = (1.0, 50.0);
/// Longest time until it is shown to run.
const RUNS_WITHIN: Duration = Duration::from_secs(20);
/// Time between two looks at whether the motor is shown to run.
const LOOK_EVERY: Duration = Duration::from_millis(100);
/// Uniform word of the run state, and its value for running forward.
const STATE: u16 = 2;
/// See [`STATE`].
const RUNNING_FORWARD: u16 = 2;

/// Plays `model`, whose file is in `models`, and returns what was seen.
pub fn play(model: &Arc<Model>, models: PathBuf) -> Result<String, CommandFailure> {
    let pty = Pty::new().map_err(CommandFailure::failed)?;
    let link = model.link.played();
    let mut bus = SimBus::new(link, BusOptions::default(), 1);
    bus.connect(
        Station(1),
        SimDrive::new(Arc::clone(model), DriveOptions::default()),
    );
    let port = PortAddress::Device(pty.path().to_path_buf());
    let args = DriveArgs::of(&model.id, 1, link, ModelDirs { dirs: vec![models] });
    let runtime = tokio::runtime::Builder::new_current_thread()
        .enable_all()
        .build()
        .map_err(CommandFailure::failed)?;
    simulator::play_beside(
        &pty,
        &mut bus,
        |_, _| (),
        || runtime.block_on(tried(&port, &args, model)),
    )
    .map_err(CommandFailure::failed)?
}

async fn tried(
    port: &PortAddress,
    args: &DriveArgs,
    model: &Model,
) -> Result<String, CommandFailure> {
    let poll = Some(Duration::from_millis(200));
    if model.run.is_none() {
        OwnGateway::start(
            port,
            args,
            &ToolAccess {
                poll,
                ..ToolAccess::default()
            },
        )
        .await?
        .close()
        .await;
        return Ok("it is read; it takes no orders".to_owned());
    }
    let unproven = !model.unproven_basics().is_empty();
    let extra = ToolAccess {
        control: control(LIMITS_HZ, "forward", "stop"),
        moves: true,
        accept_unverified: if unproven {
            vec![ControlAction::Basic.keyword().to_owned()]
        } else {
            Vec::new()
        },
        native_write: Vec::new(),
        poll,
    };
    let own = OwnGateway::start(port, args, &extra).await?;
    let mut client = UnitClient::new(GatewayPath::Own(own.connections()), UNIFORM_UNIT);
    let done = run_and_stop(&mut client).await;
    own.close().await;
    done
}

async fn run_and_stop(client: &mut UnitClient) -> Result<String, CommandFailure> {
    arm_simulated(client, &StraightOptions::with_frequency(FREQUENCY_HZ)).await?;
    client
        .write(map::RUN, 1)
        .await
        .map_err(|error| CommandFailure::failed(format!("run forward: {error}")))?;
    let until = Instant::now() + RUNS_WITHIN;
    let runs = loop {
        let state = client
            .read(STATE, 1)
            .await
            .map_err(CommandFailure::failed)?;
        let runs = state.first() == Some(&RUNNING_FORWARD);
        if runs || Instant::now() >= until {
            break runs;
        }
        sleep(LOOK_EVERY).await;
    };
    let stopped = stop(client).await?;
    if !runs {
        return Err(CommandFailure::failed(
            "after the word for forward the drive does not show that it runs forward",
        ));
    }
    Ok(format!(
        "it is read, run forward at {FREQUENCY_HZ} Hz, and stopped: {stopped}"
    ))
}
