//! Shared helpers for tests of the daemon: a temporary directory, and a line thread that sleeps.

use crate::daemon::exchange::inbox::{LineInbox, LineMessage};
use std::ops::Deref;
use std::path::{Path, PathBuf};
use std::pin::Pin;
use std::sync::atomic::{AtomicU32, Ordering};
use std::sync::{Arc, Mutex};
use std::task::{Context, Wake, Waker};

/// A temporary directory that is removed when this is dropped.
#[derive(Debug)]
pub struct Dir(PathBuf);

impl Dir {
    /// A new, empty directory.
    pub fn new() -> Self {
        static COUNT: AtomicU32 = AtomicU32::new(0);
        let name = format!(
            "vfd-gateway-{}-{}",
            std::process::id(),
            COUNT.fetch_add(1, Ordering::Relaxed)
        );
        let path = std::env::temp_dir().join(name);
        std::fs::create_dir(&path).expect("a temporary directory");
        Self(path)
    }
}

impl Deref for Dir {
    type Target = Path;

    fn deref(&self) -> &Path {
        &self.0
    }
}

impl AsRef<Path> for Dir {
    fn as_ref(&self) -> &Path {
        &self.0
    }
}

impl Drop for Dir {
    fn drop(&mut self) {
        // Leftovers in the temporary directory do no harm.
        let _ = std::fs::remove_dir_all(&self.0);
    }
}

/// A line thread that sleeps until it is woken, and reads its inbox at that moment.
pub struct Sleeper {
    first: Arc<First>,
    called: Pin<Box<dyn Future<Output = ()>>>,
}

/// What it finds first.
struct First {
    inbox: Arc<LineInbox>,
    found: Mutex<Vec<LineMessage>>,
}

impl Sleeper {
    /// The thread of the line with this inbox, which must be empty.
    pub fn new(inbox: &Arc<LineInbox>) -> Self {
        let called = Arc::clone(inbox);
        let mut sleeper = Self {
            first: Arc::new(First {
                inbox: Arc::clone(inbox),
                found: Mutex::default(),
            }),
            called: Box::pin(async move { called.called().await }),
        };
        assert!(inbox.may_sleep(true), "something waits");
        let waker = Waker::from(Arc::clone(&sleeper.first));
        assert!(
            sleeper
                .called
                .as_mut()
                .poll(&mut Context::from_waker(&waker))
                .is_pending()
        );
        sleeper
    }

    /// How many messages it found when it was first woken.
    pub fn found(self) -> usize {
        let found = self.first.found.lock().expect("no thread panics").len();
        drop(self.called);
        found
    }
}

impl Wake for First {
    fn wake(self: Arc<Self>) {
        self.inbox
            .take(&mut self.found.lock().expect("no thread panics"));
    }
}
