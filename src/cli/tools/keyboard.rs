//! The user of a simulation, who presses Enter.

use std::io::{self, BufRead};
use std::sync::Arc;
use std::sync::atomic::{AtomicU32, Ordering};

/// How often Enter was pressed.
#[derive(Clone, Debug, Default)]
pub struct EnterPresses(Arc<AtomicU32>);

impl EnterPresses {
    /// Listens on stdin from now on. The thread exits with stdin or with the program.
    ///
    /// # Errors
    /// The system cannot start a thread.
    pub fn listen() -> io::Result<Self> {
        let enter = Self::default();
        let pressed = Arc::clone(&enter.0);
        let listen = move || {
            for _ in io::stdin().lock().lines().map_while(Result::ok) {
                pressed.fetch_add(1, Ordering::Relaxed);
            }
        };
        std::thread::Builder::new()
            .name("enter".to_owned())
            .spawn(listen)?;
        Ok(enter)
    }

    /// Whether it was pressed since the last call.
    #[must_use]
    pub fn was_pressed(&self) -> bool {
        self.0.swap(0, Ordering::Relaxed) > 0
    }
}
