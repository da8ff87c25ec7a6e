//! Serial masters: a thread per port carries frames between it and the server of Modbus TCP, whose client the master is
//! from then on. So decoding, rights, leases and counts are the same code.

mod serving;

use crate::config::{PortAddress, SerialMasterSettings};
use crate::daemon::exchange::router::UnitRouter;
use crate::daemon::exchange::totals::SerialTotals;
use crate::daemon::host::timer::TaskTimer;
use crate::daemon::modbus_server::{ModbusListener, ModbusServer, PortMaster};
use crate::daemon::port::{OpenBackoff, PortOpener, PortSettings};
use arc_swap::ArcSwap;
use serving::{ServingEnd, ServingTask};
use std::io;
use std::os::unix::net::UnixStream;
use std::path::PathBuf;
use std::pin::pin;
use std::rc::Rc;
use std::sync::Arc;
use tokio::sync::mpsc;
use tokio::task::AbortHandle;
use tokio::time::sleep;

/// Connections to the server that wait to be served: a port that is opened again brings one.
const CONNECTIONS_MAX: usize = 4;

/// A served port. It is closed when this is dropped.
#[derive(Debug)]
pub struct SerialMaster {
    /// Its settings.
    pub settings: SerialMasterSettings,
    listener: Rc<ModbusListener>,
    /// Where the units lead to that answer at the port.
    router: Arc<ArcSwap<UnitRouter>>,
    /// Shown as long as the port is served, also while it cannot be opened.
    _totals: Arc<SerialTotals>,
    task: AbortHandle,
}

impl Drop for SerialMaster {
    fn drop(&mut self) {
        self.listener.close();
        self.task.abort();
    }
}

impl SerialMaster {
    /// Starts the thread of a port whose master `server` serves as `listener` says. Lock files go to `lock_dirs`.
    ///
    /// # Errors
    /// The system's refusal to start a thread.
    pub fn start(
        settings: SerialMasterSettings,
        listener: Rc<ModbusListener>,
        server: &Rc<ModbusServer>,
        lock_dirs: Vec<PathBuf>,
    ) -> io::Result<Self> {
        let router = Arc::new(ArcSwap::new(listener.router()));
        let totals = Arc::new(SerialTotals::new(settings.name.to_string()));
        server.totals().serial().show(&totals);
        server.totals().reads().show(listener.reads());
        let (connections, mut opened) = mpsc::channel::<UnixStream>(CONNECTIONS_MAX);
        let port = port_settings(&settings, lock_dirs);
        let thread = (settings.clone(), Arc::clone(&router));
        let counts = Arc::clone(&totals);
        std::thread::Builder::new().name(format!("serial {}", settings.name)).spawn(move || {
            let (settings, router) = thread;
            let name = settings.name;
            if let Err(error) = run(settings, &port, router, connections, counts) {
                tracing::error!(master = %name, %error, "cannot start the thread of a serial master");
            }
        })?;
        let server = Rc::clone(server);
        let served = Rc::clone(&listener);
        let (name, answer_within) = (settings.name, settings.answer_within);
        let task = tokio::task::spawn_local(async move {
            while let Some(stream) = opened.recv().await {
                let stream = stream
                    .set_nonblocking(true)
                    .and_then(|()| tokio::net::UnixStream::from_std(stream));
                match stream {
                    Ok(stream) => server.serve_master(
                        stream,
                        PortMaster {
                            name,
                            answer_within,
                        },
                        &served,
                    ),
                    Err(error) => {
                        tracing::error!(master = %name, %error, "cannot serve a serial master")
                    }
                }
            }
        });
        Ok(Self {
            settings,
            listener,
            router,
            _totals: totals,
            task: task.abort_handle(),
        })
    }

    /// Its listener, whose settings may change while the port stays open.
    #[must_use]
    pub const fn listener(&self) -> &Rc<ModbusListener> {
        &self.listener
    }

    /// Notes that the units of its listener have changed.
    pub fn changed(&mut self, settings: SerialMasterSettings) {
        self.settings = settings;
        self.router.store(self.listener.router());
    }
}

fn port_settings(settings: &SerialMasterSettings, lock_dirs: Vec<PathBuf>) -> PortSettings {
    PortSettings {
        line: settings.name.to_string(),
        address: settings.port.clone(),
        link: settings.link,
        direction: settings.direction,
        low_latency: settings.low_latency,
        needs_virtual: false,
        lock_dirs,
    }
}

fn run(
    settings: SerialMasterSettings,
    port: &PortSettings,
    router: Arc<ArcSwap<UnitRouter>>,
    connections: mpsc::Sender<UnixStream>,
    totals: Arc<SerialTotals>,
) -> io::Result<()> {
    let runtime = tokio::runtime::Builder::new_current_thread()
        .enable_all()
        .build()?;
    let ended = runtime.block_on(async {
        let timer = TaskTimer::new()?;
        let mut task = ServingTask {
            settings,
            router,
            connections,
            totals,
            timer,
        };
        open_and_serve(port, &mut task).await;
        Ok(())
    });
    // A name lookup in progress must not delay the exit.
    runtime.shutdown_background();
    ended
}

/// Opens the port and serves it, again and again, until the server stops taking its connections.
async fn open_and_serve(port: &PortSettings, task: &mut ServingTask) {
    let ends = task.connections.clone();
    let mut ended = pin!(ends.closed());
    let mut opener = PortOpener::new(port);
    let mut attempts = OpenBackoff::default();
    let mut logged = String::new();
    let master = task.settings.name;
    loop {
        let opened = tokio::select! {
            () = &mut ended => return,
            opened = opener.open() => opened,
        };
        match opened {
            Ok(mut device) => {
                tracing::info!(%master, port = %port.address, link = %port.link, "serial master served");
                if let Some(remark) = device.remark() {
                    tracing::warn!(%master, port = %port.address, "{remark}");
                }
                let is_serial = matches!(port.address, PortAddress::Device(_));
                let (gone, has_heard) = task.serve(&mut device, is_serial).await;
                match gone {
                    ServingEnd::Ended => return,
                    ServingEnd::Lost(error) => {
                        tracing::warn!(%master, port = %port.address, %error, "serial master lost")
                    }
                }
                if has_heard {
                    attempts = OpenBackoff::default();
                    logged.clear();
                }
            }
            Err(error) => {
                let error = opener.explain(&error);
                if logged == error {
                    tracing::debug!(%master, port = %port.address, error, "cannot open the port; retrying");
                } else {
                    tracing::warn!(%master, port = %port.address, error, "cannot open the port; retrying");
                    logged = error;
                }
            }
        }
        tokio::select! {
            () = &mut ended => return,
            () = sleep(attempts.next_wait()) => {}
        }
    }
}
