//! Whether the program's own commands reach the gateway.

use arc_swap::ArcSwapOption;
use std::sync::Arc;

/// Why the program's own commands do not reach the gateway, if they do not.
#[derive(Debug, Default)]
pub struct CommandReachability(ArcSwapOption<String>);

impl CommandReachability {
    /// Why they do not; `None` if they do.
    #[must_use]
    pub fn refusal(&self) -> Option<String> {
        self.0.load().as_ref().map(|refusal| refusal.to_string())
    }

    /// Sets why they do not; `None` if they do.
    pub(super) fn set(&self, refusal: Option<String>) {
        self.0.store(refusal.map(Arc::new));
    }
}
