//! The north sides that lines answer to.

use crate::daemon::exchange::answers::AnswerBox;
use std::sync::Arc;

/// The north sides that lines answer to.
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
}
