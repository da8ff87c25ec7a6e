//! The north sides that lines answer to.

use crate::daemon::exchange::answers::AnswerBox;
use crate::daemon::journal::Journal;
use std::sync::Arc;

/// The north sides that lines answer to, and the journal of both.
#[derive(Clone, Debug, Default)]
pub struct NorthSides {
    /// Modbus TCP connections.
    pub modbus: Arc<AnswerBox>,
    /// MQTT; `None` if it is not configured: then no news is kept for it.
    pub mqtt: Option<Arc<AnswerBox>>,
    /// Sparkplug, likewise.
    pub sparkplug: Option<Arc<AnswerBox>>,
    /// The program's own tools, and the page.
    pub local: Arc<AnswerBox>,
    /// The journal; `None` without a data directory.
    pub journal: Option<Arc<Journal>>,
}
